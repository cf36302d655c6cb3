# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Progress of an experiment: trials done and left, from the entries of its journal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from tactile_lab.experiment.plan import ExperimentError, PlannedTrial

GOOD, OUTLIER, FAILED, ABORTED = 'good', 'outlier', 'failed', 'aborted'
"""Verdicts on a trial: usable; usable but unlike the others; not usable; interrupted."""

BEGAN, ENDED, KEPT, MOUNTED, RUN = 'began', 'ended', 'kept', 'mounted', 'run'
"""Kinds of entries."""


@dataclass
class Attempt:
    """One trial that was begun.

    Its verdict is empty while it is not known, as after a power cut. One attempt is kept for each
    planned trial's key. The check for outliers compares the statistics.
    """

    key: str
    trial_id: str
    mounting_id: str
    verdict: str = ''
    sentence: str = ''
    is_kept: bool = False
    statistics: dict[str, float] = field(default_factory=dict)


class Progress:
    """The state of an experiment.

    Parameters
    ----------
    order : sequence of PlannedTrial
    entries : iterable of dict
        Of the journal.

    Attributes
    ----------
    attempts : dict of str to Attempt
        By trial id, in the order in which they were begun.
    mounting_ids : list of str
        In the order in which objects were put under the finger.
    runs : dict of str to int
        How often the nodes were started, by session.

    Raises
    ------
    ExperimentError
        When an entry is not of the form that it must have.
    """

    def __init__(
        self, order: Sequence[PlannedTrial], entries: Iterable[Mapping[str, Any]]
    ) -> None:
        self.order = list(order)
        self.attempts: dict[str, Attempt] = {}
        self.mounting_ids: list[str] = []
        self.runs: dict[str, int] = {}
        self._kept: dict[str, Attempt] = {}
        self._trial_s: list[float] = []
        self._mounting_s: list[float] = []
        count = 0
        try:
            for entry in entries:
                count += 1
                self.take(entry)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ExperimentError(f'entry {count} of the journal: {error!r}') from error

    def take(self, entry: Mapping[str, Any]) -> None:
        """Take in an entry."""
        kind = entry['kind']
        if kind == RUN:
            session_id = str(entry['session_id'])
            self.runs[session_id] = self.runs.get(session_id, 0) + 1
        elif kind == MOUNTED:
            self.mounting_ids.append(str(entry['mounting_id']))
            self._mounting_s.append(float(entry['seconds']))
        elif kind == BEGAN:
            trial_id = str(entry['trial_id'])
            attempt = Attempt(str(entry['key']), trial_id, str(entry['mounting_id']))
            self.attempts[trial_id] = attempt
        elif kind == ENDED:
            attempt = self.attempts[str(entry['trial_id'])]
            attempt.verdict = str(entry['verdict'])
            attempt.sentence = str(entry['sentence'])
            attempt.statistics = {str(k): float(v) for k, v in entry['statistics'].items()}
            self._trial_s.append(float(entry['seconds']))
            if attempt.verdict == GOOD:
                self._keep(attempt)
        elif kind == KEPT:
            self._keep(self.attempts[str(entry['trial_id'])])

    def _keep(self, attempt: Attempt) -> None:
        if attempt.key in self._kept:
            raise ValueError(f'trial {attempt.key} is kept twice')
        attempt.is_kept = True
        self._kept[attempt.key] = attempt

    @property
    def done_count(self) -> int:
        """Number of planned trials that are done."""
        return sum(trial.key in self._kept for trial in self.order)

    @property
    def outlier_count(self) -> int:
        """Number of trials that are kept although they are unlike the others."""
        return sum(attempt.verdict == OUTLIER for attempt in self._kept.values())

    def kept(self, key: str) -> Attempt | None:
        """Return the attempt that counts for a planned trial, if it is done."""
        return self._kept.get(key)

    def left(self, session_id: str | None = None) -> list[PlannedTrial]:
        """Return the trials that are left, in their order; of one session or of all."""
        return [
            trial
            for trial in self.order
            if trial.key not in self._kept and session_id in (None, trial.session_id)
        ]

    def sessions_left(self) -> list[str]:
        """Return the sessions that have trials left, in their order."""
        return list(dict.fromkeys(trial.session_id for trial in self.left()))

    def next_trial_id(self, key: str) -> str:
        """Return a name for the next attempt at a trial; no other attempt has it."""
        count = sum(attempt.key == key for attempt in self.attempts.values())
        return f'{key}-again{count}' if count else key

    def next_mounting_id(self, trial: PlannedTrial) -> str:
        """Return a name for putting a trial's object under the finger now.

        After an interruption that is done once more, and so has another name.
        """
        name = f'{trial.session_id}-m{trial.mounting:02d}'
        count = sum(each == name or each.startswith(f'{name}-') for each in self.mounting_ids)
        return f'{name}-{count + 1}' if count else name

    def earlier(self, trial: PlannedTrial) -> list[tuple[str, dict[str, float]]]:
        """Return mounting and statistics of the kept trials of the same object and contact."""
        same = {
            each.key
            for each in self.order
            if (each.object_label, each.contact) == (trial.object_label, trial.contact)
        }
        return [
            (attempt.mounting_id, attempt.statistics)
            for attempt in self._kept.values()
            if attempt.key in same and attempt.verdict == GOOD
        ]

    def estimate_left_s(self) -> float:
        """Return how long the trials that are left will take [s], once a trial has been run.

        The sum of the median times of trials and mountings until now.
        """
        left = self.left()
        mountings = {(trial.session_id, trial.mounting) for trial in left}
        return median(self._trial_s) * len(left) + median(self._mounting_s) * len(mountings)

    def to_dict(self) -> dict[str, Any]:
        """Return a summary, as what JSON can hold."""
        verdicts = [attempt.verdict for attempt in self.attempts.values()]
        return {
            'planned': len(self.order),
            'done': self.done_count,
            'outliers_kept': self.outlier_count,
            'attempts': len(verdicts),
            'failed': verdicts.count(FAILED),
            'interrupted': verdicts.count(ABORTED) + verdicts.count(''),
            'mountings': len(self.mounting_ids),
            'sessions_left': self.sessions_left(),
        }
