# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bag of this package in memory, with the corrections in the journal of its experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_bags.bag_reader import BagMessage, TactileBag
from tactile_bags.errors import BagDamageError
from tactile_bags.experiment_journal import Correction, experiment_of, read_corrections
from tactile_bags.message_records import KeptMessage, read_records, RECORDED_TYPES
from tactile_bags.recorded_setup import nominal_rate_hz
from tactile_bags.trial import mean_period_s, NO_LABEL, Signal, Trial
from tactile_features.config import round_rate
from tactile_features.types import PHASE_ABORTED, PHASE_DONE, TrialEvent
from tactile_ros.strain import StrainStatus
from tactile_ros.topics import CLASSIFICATION, EVENT, STRAIN

MAX_KEPT_BYTES = 2**28
"""Largest bag whose messages are kept in memory [byte]; larger bags are read repeatedly."""


class RecordedBag(TactileBag):
    """A bag of this package. It is read once; its messages and their records stay in memory.

    After `correct`, its events have the corrected labels of the journal of the experiment, and
    session names that distinguish experiments. It can be used wherever a `TactileBag` is expected.
    The parameters are the same as in `TactileBag`.
    """

    def __init__(self, path: Path, *, needs_strain: bool = True) -> None:
        super().__init__(path, needs_strain=needs_strain)
        self.corrections: Mapping[str, Correction] = {}
        self._prefix = ''
        self._kept: list[BagMessage] | None = None
        self._damage: BagDamageError | None = None
        self._strain: dict[str, tuple[NDArray[Any], ...]] = {}

    def __enter__(self) -> RecordedBag:
        return self

    def messages(self, *type_names: str, namespace: str | None = None) -> Iterator[BagMessage]:
        """Yield messages as `TactileBag.messages` does, from memory if possible."""
        is_kept = bool(type_names) and set(type_names) <= set(RECORDED_TYPES)
        if not is_kept or not self._keep(type_names):
            yield from super().messages(*type_names, namespace=namespace)
            return
        chosen = self.choose_topics(type_names, namespace)
        yield from (message for message in self._kept or () if message.topic in chosen)
        if self._damage is not None:
            raise self._damage

    def _keep(self, type_names: Sequence[str]) -> bool:
        """Read the messages of all types in `RECORDED_TYPES` into memory, if not done before.

        Return False if a requested type cannot be decoded, or the bag is too large.
        """
        known = [name for name in RECORDED_TYPES if name not in self._foreign]
        size_bytes = sum(file.path.stat().st_size for file in self._files)
        if not set(type_names) <= set(known) or size_bytes > MAX_KEPT_BYTES:
            return False
        if self._kept is None:
            self._kept = []
            try:
                for m in super().messages(*known):
                    self._kept.append(
                        KeptMessage(
                            m.topic,
                            m.type_name,
                            m.received_at_ns,
                            m.data,
                            m.store,
                            self._correct if m.type_name == EVENT and self._is_changed else None,
                        )
                    )
            except BagDamageError as error:
                self._damage = error
        return True

    @property
    def is_own(self) -> bool:
        """True if the bag has strain blocks and trial events of this package."""
        counts = {type_name: count for type_name, count in self.topics.values() if count}
        return STRAIN in counts and EVENT in counts

    def correct(self, corrections: Mapping[str, Correction], prefix: str = '') -> None:
        """Apply corrections to all messages that are read later.

        ``corrections`` maps trial ids to corrections. ``prefix`` is added to the names of sessions
        and mountings, to distinguish experiments.
        """
        self.corrections, self._prefix, self._kept = corrections, prefix, None

    @property
    def _is_changed(self) -> bool:
        return bool(self._prefix) or any(each.label for each in self.corrections.values())

    def _correct(self, event: TrialEvent) -> TrialEvent:
        correction = self.corrections.get(event.trial_id, Correction())
        return replace(
            event,
            object_label=correction.label or event.object_label,
            session_id=self._prefix + event.session_id,
            mounting_id=self._prefix + event.mounting_id if event.mounting_id else '',
        )

    def strain(self, namespace: str = '') -> tuple[NDArray[Any], ...]:
        """Return stamps [ns], tension [N] and status of all samples of a finger."""
        if namespace not in self._strain:
            stamps: list[NDArray[np.int64]] = [np.empty(0, dtype=np.int64)]
            values: list[NDArray[np.float64]] = [np.empty(0)]
            status: list[NDArray[np.intp]] = [np.empty(0, dtype=np.intp)]
            for _, block in read_records(self.messages(STRAIN, namespace=namespace)):
                count = len(block.tension_n)
                stamps.append(block.stamp_ns + np.arange(count) * block.period_ns)
                values.append(np.asarray(block.tension_n, dtype=np.float64))
                status.append(np.full(count, int(block.status), dtype=np.intp))
            self._strain[namespace] = (
                np.concatenate(stamps),
                np.concatenate(values),
                np.concatenate(status),
            )
        return self._strain[namespace]

    def signal_between(self, namespace: str, start_ns: int, end_ns: int) -> Signal:
        """Return the samples from ``start_ns`` to ``end_ns``; times are relative to the start."""
        stamps_ns, tension_n, status = self.strain(namespace)
        inside = (stamps_ns >= start_ns) & (stamps_ns <= end_ns)
        return Signal(
            1e-9 * (stamps_ns[inside] - start_ns),
            tension_n[inside][np.newaxis],
            ('tension_n',),
            'N',
            self.rate_hz(namespace),
            status[inside],
        )

    def rate_hz(self, namespace: str) -> float | None:
        """Return the sample rate [Hz]: the nominal rate, or if unknown, the rate of the stamps."""
        if nominal_hz := nominal_rate_hz(self, namespace):
            return nominal_hz
        stamps_ns = self.strain(namespace)[0]
        period_s = mean_period_s(1e-9 * (stamps_ns - stamps_ns[:1]))
        return None if period_s is None else round_rate(1.0 / period_s)

    def trials(self, namespace: str) -> list[Trial]:
        """Return the trials of a finger in the order of their first events."""
        found: list[list[TrialEvent]] = []
        running: dict[str, list[TrialEvent]] = {}
        for _, event in read_records(self.messages(EVENT, namespace=namespace)):
            if event.trial_id not in running:
                running[event.trial_id] = []
                found.append(running[event.trial_id])
            running[event.trial_id].append(event)
            if event.phase in (PHASE_DONE, PHASE_ABORTED):
                del running[event.trial_id]  # later events belong to another trial with this id
        simulated = self.metadata.get('simulated') is True or self._is_of_simulation(namespace)
        return [self._make_trial(namespace, events, simulated) for events in found]

    def _is_of_simulation(self, namespace: str) -> bool:
        """Return True if the first samples of a finger are from a simulated sensor."""
        first = next(read_records(self.messages(STRAIN, namespace=namespace)), None)
        return first is not None and bool(first[1].status & StrainStatus.SIMULATED)

    def _make_trial(self, namespace: str, events: Sequence[TrialEvent], simulated: bool) -> Trial:
        first, last = events[0], events[-1]
        known = {
            'session_id': first.session_id,
            'mounting_id': first.mounting_id,
            'contact': first.contact,
            'task': first.protocol,
            'glide_speed_m_s': max(event.glide_speed_m_s for event in events),
            'simulated': simulated or any(event.simulated for event in events),
            'bag': self.path.resolve().name,
            'namespace': namespace,
        }
        if specimen := self.corrections.get(first.trial_id, Correction()).specimen:
            known['specimen'] = specimen
        return Trial(
            name=first.trial_id,
            source=str(self.path),
            label=first.object_label,
            session_id=first.session_id,
            mounting_id=first.mounting_id,
            contact=first.contact,
            task=first.protocol,
            namespace=namespace,
            why_not=self._find_why_not(events),
            columns=known,
            events=tuple(events),
            begin_ns=first.stamp_ns,
            load_signal=lambda: self.signal_between(namespace, first.stamp_ns, last.stamp_ns),
            load_answers=lambda: tuple(
                answer
                for _, answer in read_records(self.messages(CLASSIFICATION, namespace=namespace))
                if answer.trial_id == first.trial_id
                and first.stamp_ns <= answer.window_start_ns <= last.stamp_ns
            ),
        )

    def _find_why_not(self, events: Sequence[TrialEvent]) -> str | None:
        first, last = events[0], events[-1]
        if why_not := self.corrections.get(first.trial_id, Correction()).why_not:
            return why_not
        if last.phase == PHASE_ABORTED:
            return f'the trial was aborted: {last.message or "no reason given"}'
        if len(events) < 2:
            return 'the recording ends at its first event'
        return None if first.object_label else NO_LABEL


def correct_bags(bags: Sequence[RecordedBag]) -> None:
    """Apply the corrections in the journals of the experiments that contain the bags.

    If the bags are from several experiments, the names of sessions and mountings get the name of
    the experiment as a prefix.
    """
    folders = [experiment_of(bag.path) for bag in bags]
    experiments = list(dict.fromkeys(folder for folder in folders if folder))
    names = [folder.name for folder in experiments]
    if len(set(names)) < len(names):
        names = [f'{name}#{i + 1}' for i, name in enumerate(names)]
    prefixes = dict(zip(experiments, names, strict=True)) if len(experiments) > 1 else {}
    corrections = {folder: read_corrections(folder) for folder in experiments}
    for bag, folder in zip(bags, folders, strict=True):
        if folder is not None:
            prefix = f'{prefixes[folder]}/' if folder in prefixes else ''
            bag.correct(corrections[folder], prefix)
