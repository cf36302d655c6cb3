# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature tables of bags with trial events, computed again from the recorded samples."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.feature_options import FeatureOptions
from tactile_analysis.datasets.feature_tables import (
    Fields,
    Key,
    Tables,
)
from tactile_analysis.trial_set import TrialSet
from tactile_bags.errors import BagError
from tactile_bags.experiment_journal import Correction
from tactile_bags.recorded_bag import RecordedBag
from tactile_bags.recorded_setup import computable_features, RecordedFeatures
from tactile_bags.replay import replay_phases
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import DatasetError
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.registry import task_of
from tactile_features.spec import FeatureSpec
from tactile_features.types import (
    FeatureWindow,
    PHASE_ABORTED,
    PHASE_DONE,
    TrialEvent,
    WindowOutcome,
)

BLOCKS = 6
"""Number of blocks into which the trials of a session are divided, in order of time."""

Row = tuple[FeatureWindow, TrialEvent, str, str]
"""A labelled window, the last event of its trial before the window, the path of the bag, and the
namespace."""


def compute_bag_tables(
    trials: TrialSet, options: FeatureOptions, fields: Fields
) -> tuple[Tables, tuple[str, ...]]:
    """Return the feature tables of all fingers (namespaces) of bags; see `compute_tables`."""
    chosen = {**options.choose_fields(), **fields}
    first: RecordedFeatures | None = None
    found: defaultdict[tuple[str, str, str], list[Row]] = defaultdict(list)
    specs: dict[str, FeatureSpec] = {}
    refused: Counter[tuple[str, str, str]] = Counter()
    left_out: list[str] = []
    bags = {str(bag.path): bag for bag in trials.bags}
    paths = list(bags)
    for path, bag in bags.items():
        for namespace in bag.namespaces:
            features = _choose(path, computable_features(bag, namespace), chosen, options)
            first = first or features
            if _compared(features) != _compared(first):
                finger = f'{namespace} of ' if namespace else ''
                raise BagError(
                    f'{finger}{path} was recorded with other feature parameters than '
                    f'{paths[0]}: train on each of them separately, or give --features'
                )
            specs |= _collect(trials, bag, namespace, features, found, refused, left_out)
    if not found:
        raise BagError(
            f'no labelled trial with features in {", ".join(paths) or "no bag"}'
            + (f'; the first reason: {left_out[0]}' if left_out else '')
        )
    if options.window_s is not None:
        full = {key for key in found if not specs[key[2]].is_early}
        for unwanted in full:
            del found[unwanted]
        if not found:
            names = ', '.join(sorted({specs[digest].feature_set for *_, digest in full}))
            raise DatasetError(f'{names}: early windows are not possible')
    tables: Tables = {}
    places = {digest: place for place, digest in enumerate(specs)}
    for task, contact, digest in sorted(found, key=lambda key: (*key[:2], places[key[2]])):
        key: Key = (task, contact)
        key = (*key, digest) if key in tables else key
        table = _add_specimens(_table(found[task, contact, digest], specs[digest]), bags)
        tables[key] = replace(table, refused=refused[task, contact, digest])
    return tables, tuple(dict.fromkeys(left_out))


def _add_specimens(table: FeatureTable, bags: Mapping[str, RecordedBag]) -> FeatureTable:
    """Return the table with a column of specimens, if an experiment's journal names any.

    All trials of a label without a specimen count as one specimen, named like the label.
    """
    names = [
        bags[bag].corrections.get(trial, Correction()).specimen
        for bag, trial in _list_rows(table, 'bag', 'trial_id')
    ]
    if not any(names):
        return table
    specimens = np.where(np.array(names) == '', table.labels, names)
    return replace(table, columns={**table.columns, 'specimen': specimens})


def _list_rows(table: FeatureTable, *names: str) -> list[tuple[Any, ...]]:
    """Return one tuple per trial with its values in the columns ``names``."""
    return list(zip(*(table.column(name).tolist() for name in names), strict=True))


def _choose(
    path: str, recorded: RecordedFeatures, chosen: Fields, options: FeatureOptions
) -> RecordedFeatures:
    """Return the features to compute: for full windows, or for early windows if requested."""
    full = RecordedFeatures(
        replace(recorded.config, early_windows=False),
        tuple(spec for spec in recorded.wanted if not spec.is_early),
    )
    if not chosen and options.window_s is None:
        return full
    try:
        config = replace(full.bound(), **chosen)
        return RecordedFeatures(replace(config, **options.early_fields(config.rate_hz)))
    except FeatureError as error:
        raise BagError(f'{path}: {error}') from error


def _compared(features: RecordedFeatures) -> tuple[object, ...]:
    """Return the parameters of the features that must be equal in all recordings of a table."""
    digests = tuple(sorted(spec.digest for spec in features.specifications))
    return features.bound().without_detection(), digests


def _collect(
    trials: TrialSet,
    bag: RecordedBag,
    namespace: str,
    features: RecordedFeatures,
    found: defaultdict[tuple[str, str, str], list[Row]],
    refused_trials: Counter[tuple[str, str, str]],
    left_out: list[str],
) -> dict[str, FeatureSpec]:
    """Collect the labelled windows of a finger; return their specifications by digest.

    Labelled windows without features are counted in ``refused_trials``.
    """
    replayed = replay_phases(bag, features, namespace, finish=True)
    dropped = {name: each.why_not for name, each in bag.corrections.items() if each.why_not}
    events: defaultdict[str, list[TrialEvent]] = defaultdict(list)
    for event in replayed.events:
        events[event.trial_id].append(event)
    # An early window is first accepted, and refused later if its phase ended within the window.
    refused = {
        _identify(window) for window in replayed.windows if window.outcome != WindowOutcome.OK
    }
    for window in replayed.windows:
        event = event_before(window, events[window.trial_id])
        excluded = None
        if trials.is_changed:
            place = str(bag.path), namespace, window.trial_id
            trial = trials.find_window(*place, window.window_start_ns)
            if trial is None:
                continue
            excluded = trial.why_not if trial.is_excluded else None
            event = replace(event, object_label=trial.label)
        end = _end_after(window, events[window.trial_id])
        # The task is taken from the features and not from the trial, because a trial of one task
        # can contain a window of the other task.
        key = task_of(window.feature_set), event.contact, window.specification_digest
        if window.outcome == WindowOutcome.OK and _identify(window) in refused:
            continue
        if excluded:
            left_out.append(f'{window.trial_id}: {excluded}')
        elif window.trial_id in dropped:
            left_out.append(f'{window.trial_id}: {dropped[window.trial_id]}')
        elif window.outcome != WindowOutcome.OK:
            left_out.append(f'{window.trial_id}: {window.reason}')
            refused_trials[key] += bool(event.object_label)
        elif end is not None and end.phase == PHASE_ABORTED:
            reason = end.message or 'no reason given'
            left_out.append(f'{window.trial_id}: the trial was aborted later: {reason}')
        elif not event.object_label:
            left_out.append(f'{window.trial_id}: the trial has no label')
        else:
            found[key].append((window, event, str(bag.path), namespace))
    return {spec.digest: spec for spec in replayed.specifications}


def _identify(window: FeatureWindow) -> tuple[object, ...]:
    return window.trial_id, window.specification_digest, window.window_start_ns


def event_before(window: FeatureWindow, events: Sequence[TrialEvent]) -> TrialEvent:
    """Return the last event before the window; ``events`` may contain trials with the same id."""
    return max(
        (event for event in events if event.stamp_ns <= window.window_start_ns),
        key=lambda event: event.stamp_ns,
    )


def _end_after(window: FeatureWindow, events: Sequence[TrialEvent]) -> TrialEvent | None:
    """Return the event that ended the trial of the window, or None if it was not recorded."""
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
    """Divide the trials of each session and label into blocks, in order of time.

    Consecutive trials are similar, because wear, temperature and drift are similar. Random folds
    place them in both training and test trials. If whole blocks are held out, they stay together.

    Parameters
    ----------
    starts_ns, session_ids, labels : ndarray of shape (trials,)
        Start [ns], session and label of each trial.

    Returns
    -------
    ndarray of int, shape (trials,)
        Block of each trial, from 0.
    """
    blocks = np.zeros(len(labels), dtype=np.intp)
    for session in np.unique(session_ids):
        for label in np.unique(labels):
            (trials,) = np.nonzero((session_ids == session) & (labels == label))
            in_order = trials[np.argsort(starts_ns[trials], kind='stable')]
            blocks[in_order] = np.arange(len(trials)) * BLOCKS // max(len(trials), 1)
    return blocks
