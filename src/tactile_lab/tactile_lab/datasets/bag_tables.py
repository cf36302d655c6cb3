# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature tables from recordings: what training and evaluation start from."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replaying.replay import replay_phases
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.registry import task_of
from tactile_features.records import (
    FeatureWindow,
    Outcome,
    PHASE_ABORTED,
    PHASE_DONE,
    PROTOCOL_SLIP,
    TrialEvent,
)
from tactile_features.spec import FeatureSpec
from tactile_lab.experiment.folder import find_dropped

BLOCKS = 6
"""Into how many parts the trials of a session are cut in the order of time, as many as folds."""

Key = tuple[str, ...]
"""Task and contact of a table; then, but of the first specification of a task, its digest."""

Row = tuple[FeatureWindow, TrialEvent, str, str]
"""A labelled window, its trial's last event before it, bag and namespace."""


@dataclass(frozen=True)
class BagTables:
    """The feature tables of some bags.

    Attributes
    ----------
    tables : dict of tuple to FeatureTable
        By task and contact. Where a recording has several specifications of a task, each has a
        table; those after the first have the digest in their key, too.
    left_out : tuple of str
        One sentence for each trial that gave no features, or has no label.
    """

    tables: dict[Key, FeatureTable]
    left_out: tuple[str, ...]


def read_tables(
    paths: Sequence[Path], chosen: Mapping[str, Any] = MappingProxyType({})
) -> BagTables:
    """Read the labelled trials of bags, by task and kind of contact.

    Every finger (namespace) of a bag counts. The features come from the same object
    as in the live node.

    Parameters
    ----------
    chosen : mapping
        Fields of `FeatureConfig` that name other features than the recorded ones.

    Raises
    ------
    BagError
        When a bag cannot be read, or was recorded with other feature parameters than
        the first, or no labelled trial is in any of them.
    """
    first: RecordedFeatures | None = None
    found: defaultdict[tuple[str, str, str], list[Row]] = defaultdict(list)
    specs: dict[str, FeatureSpec] = {}
    left_out: list[str] = []
    for path in paths:
        with TactileBag(path) as bag:
            for namespace in bag.namespaces:
                features = _choose(path, recorded_features(bag, namespace), chosen)
                first = first or features
                if _compared(features) != _compared(first):
                    finger = f'{namespace} of ' if namespace else ''
                    raise BagError(
                        f'{finger}{path} was recorded with other feature parameters than '
                        f'{paths[0]}; train on each of them alone, or name the features'
                    )
                specs |= _collect(bag, namespace, features, found, left_out)
    if not found:
        what = ', '.join(map(str, paths)) or 'no bag'
        raise BagError(
            f'no labelled trial with features in {what}'
            + (f'; the first reason: {left_out[0]}' if left_out else '')
        )
    tables: dict[Key, FeatureTable] = {}
    places = {digest: place for place, digest in enumerate(specs)}
    for task, contact, digest in sorted(found, key=lambda key: (*key[:2], places[key[2]])):
        key: Key = (task, contact)
        key = (*key, digest) if key in tables else key
        tables[key] = _table(found[task, contact, digest], specs[digest])
    return BagTables(tables, tuple(dict.fromkeys(left_out)))


def name_table(key: Key, table: FeatureTable) -> str:
    """Return task and contact of a table, and the set of features where they are not enough."""
    more = [table.spec.feature_set] if len(key) > 2 else []
    return ', '.join(filter(None, (*key[:2], *more)))


def _choose(path: Path, recorded: RecordedFeatures, chosen: Mapping[str, Any]) -> RecordedFeatures:
    # A table has features of full windows alone: measures would be made in vain.
    if not chosen:
        return recorded.without_parts()
    try:
        config = replace(recorded.bound(), partial_samples=(), measures=False, **chosen)
    except FeatureError as error:
        raise BagError(f'{path}: {error}') from error
    return RecordedFeatures(config)


def _compared(features: RecordedFeatures) -> tuple[object, ...]:
    """Return what the recordings of a table must share."""
    digests = tuple(sorted(spec.digest for spec in features.specifications))
    return features.bound().without_detection(), digests


def _collect(
    bag: TactileBag,
    namespace: str,
    features: RecordedFeatures,
    found: defaultdict[tuple[str, str, str], list[Row]],
    left_out: list[str],
) -> dict[str, FeatureSpec]:
    """Collect the labelled windows of a finger; return their specifications by digest."""
    replayed = replay_phases(bag, features, namespace, finish=True)
    dropped = find_dropped(bag.path)
    events: defaultdict[str, list[TrialEvent]] = defaultdict(list)
    for event in replayed.events:
        events[event.trial_id].append(event)
    left_out.extend(
        f'{trial_id}: a slip trial, and there are no slip features yet'
        for trial_id, (event, *_) in events.items()
        if event.protocol == PROTOCOL_SLIP
    )
    for window in replayed.windows:
        event = _event_before(window, events[window.trial_id])
        end = _end_after(window, events[window.trial_id])
        if window.trial_id in dropped:
            left_out.append(f'{window.trial_id}: {dropped[window.trial_id]}')
        elif window.outcome != Outcome.OK:
            left_out.append(f'{window.trial_id}: {window.reason}')
        elif end is not None and end.phase == PHASE_ABORTED:
            reason = end.message or 'no reason given'
            left_out.append(f'{window.trial_id}: the trial was aborted later: {reason}')
        elif not event.object_label:
            left_out.append(f'{window.trial_id}: the trial has no label')
        else:
            # By what the features are: a trial of one protocol may have a window of the other.
            key = task_of(window.feature_set), event.contact, window.specification_digest
            found[key].append((window, event, str(bag.path), namespace))
    return {spec.digest: spec for spec in replayed.specifications}


def _event_before(window: FeatureWindow, events: Sequence[TrialEvent]) -> TrialEvent:
    """Return its trial's last event before the window; a trial's name may come again."""
    return max(
        (event for event in events if event.stamp_ns <= window.window_start_ns),
        key=lambda event: event.stamp_ns,
    )


def _end_after(window: FeatureWindow, events: Sequence[TrialEvent]) -> TrialEvent | None:
    """Return how its trial ended after the window, if that was recorded."""
    ends = (
        event
        for event in events
        if event.stamp_ns >= window.window_end_ns and event.phase in (PHASE_DONE, PHASE_ABORTED)
    )
    return min(ends, key=lambda event: event.stamp_ns, default=None)


def _table(rows: Sequence[Row], spec: FeatureSpec) -> FeatureTable:
    windows, events, bags, namespaces = zip(*rows, strict=True)
    labels = np.array([event.object_label for event in events])
    session_ids = np.array([event.session_id for event in events])
    starts_ns = np.array([window.window_start_ns for window in windows])
    return FeatureTable(
        values=np.array([window.values for window in windows]),
        labels=labels,
        spec=spec,
        columns={
            'trial_id': np.array([event.trial_id for event in events]),
            'session_id': session_ids,
            'mounting_id': np.array([event.mounting_id for event in events]),
            'trial_block': number_blocks(starts_ns, session_ids, labels),
            'contact': np.array([event.contact for event in events]),
            'glide_speed_m_s': np.array([event.glide_speed_m_s for event in events]),
            'simulated': np.array([window.simulated for window in windows]),
            'bag': np.array(bags),
            'namespace': np.array(namespaces),
            'window_start_ns': starts_ns,
            'window_end_ns': np.array([window.window_end_ns for window in windows]),
        },
    )


def number_blocks(
    starts_ns: NDArray[np.int64], session_ids: NDArray[np.str_], labels: NDArray[np.str_]
) -> NDArray[np.intp]:
    """Return which sixth of its label's trials in its session each trial belongs to, from 0.

    Trials that follow each other share wear, warmth and drift; with random folds they stand
    on both sides. Held out in turn, these blocks keep neighbours together.

    Parameters
    ----------
    starts_ns, session_ids, labels : ndarray of shape (trials,)
    """
    blocks = np.zeros(len(labels), dtype=np.intp)
    for session in np.unique(session_ids):
        for label in np.unique(labels):
            (trials,) = np.nonzero((session_ids == session) & (labels == label))
            in_order = trials[np.argsort(starts_ns[trials], kind='stable')]
            blocks[in_order] = np.arange(len(trials)) * BLOCKS // max(len(trials), 1)
    return blocks
