# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets of trials for the evaluation, each with its features, splits and example signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tactile_analysis.datasets.automatic_features import Chosen, SESSIONS
from tactile_analysis.datasets.feature_options import FeatureOptions, select_features
from tactile_analysis.datasets.feature_tables import compute_tables, find_window, Key, title
from tactile_analysis.trial_set import TrialSet
from tactile_bags.trial import Signal, Trial
from tactile_classifier.datasets.dataset import FeatureTable, plain_name
from tactile_classifier.datasets.splits import grouped_split, Split
from tactile_classifier.errors import EvaluationError

MOUNTINGS = ('mounting_id', 'mounting')
"""Names of columns that contain mountings, in lower case."""

SPECIMENS = ('specimen_id', 'specimen')
"""Names of columns that contain specimens, in lower case."""


@dataclass(frozen=True)
class Example:
    """A trial in the figures: its row in the table of features, and its window.

    ``trial`` is None if only the window is known.
    """

    row: int
    window: Signal
    trial: Trial | None


@dataclass(frozen=True)
class RecordingSet:
    """Trials of one task and contact.

    Attributes
    ----------
    title : str
        Task, contact or source, and whether the trials are simulated.
    contact : str
        Flexion or abduction; empty if it is unknown, as in an archive.
    hold_out : tuple of tuple of str
        Columns of each grouped split; trials with equal values in these columns are held out
        together. Random folds are evaluated in addition.
    unit : str
        Unit of the signal; ``raw`` if it is unknown.
    examples : tuple of Example
        The first trial of each label.
    splits : tuple of Split
        Training and test trials that the user has selected (``--train-where``).
    skipped, steps : tuple of str
        One sentence for each unusable trial, and sentences about the preparation of the signals.
    choice : Chosen or None
        Features and classifier that `tactile train` would choose.
    not_done : tuple of str
        One sentence for each split of `usual_splits` that the trials do not allow.
    unknown_objects : bool
        True if the rejection of unknown objects is to be evaluated.
    """

    title: str
    contact: str
    simulated: bool
    table: FeatureTable
    hold_out: tuple[tuple[str, ...], ...]
    unit: str
    examples: tuple[Example, ...] = ()
    splits: tuple[Split, ...] = ()
    skipped: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()
    choice: Chosen | None = None
    not_done: tuple[str, ...] = ()
    unknown_objects: bool = False

    def format_preparation(self, most: int | None = None) -> list[str]:
        """Return sentences about the preparation of the signals and the skipped trials.

        At most ``most`` skipped trials are listed; None lists all.
        """
        lines = list(self.steps)
        if self.skipped:
            lines.append(f'skipped trials: {len(self.skipped)}')
            lines += self.skipped[:most]
        if most is not None and len(self.skipped) > most:
            lines.append(f'and {len(self.skipped) - most} more; the report and --json list all')
        return lines


def make_sets(
    trials: TrialSet,
    options: FeatureOptions,
    chosen: Mapping[Key, Chosen],
    hold_out: Sequence[Sequence[str]] = (),
    *,
    of_choice: bool = False,
    report: bool = False,
    unknown_objects: bool = False,
) -> list[RecordingSet]:
    """Return the sets of an open recording, one for each task and contact.

    Parameters
    ----------
    trials : TrialSet
        Trials after `prepare`.
    options : FeatureOptions
        Task, channel and features.
    chosen : mapping
        Automatic choice of features and classifier for each set.
    hold_out : sequence of sequence of str
        Columns of the grouped splits. If it is empty, the splits of `usual_splits` are used.
    of_choice : bool
        If True, evaluate the features of the automatic choice instead of the recorded ones.
    report : bool
        If True, also read the signals of some trials, for the figures of the report.
    unknown_objects : bool
        If True, the rejection of unknown objects is to be evaluated.
    """
    whole = {key: each.table for key, each in chosen.items()}
    if not of_choice:
        whole, _ = compute_tables(trials, options)
    tables = {
        key: select_features(options.keep_stated(table), options.features)
        for key, table in whole.items()
    }
    sets = []
    for key, table in tables.items():
        simulated = bool(np.any(table.columns.get('simulated', False)))
        columns, not_done = (hold_out, []) if hold_out else usual_splits(table)
        of_auto = f', auto: {table.spec.feature_set}' if of_choice and not trials.is_own else ''
        sets.append(
            RecordingSet(
                title=title(trials, options, key, table)
                + of_auto
                + (', simulated' if simulated else ''),
                contact=key[1],
                simulated=simulated,
                table=table,
                hold_out=tuple(map(tuple, columns)),
                unit=trials.unit or 'raw',
                examples=_find_examples(trials, table) if report else (),
                splits=options.splits(table),
                skipped=tuple(trials.skipped),
                steps=() if trials.is_own else tuple(trials.notes),
                choice=chosen.get(key, chosen.get(key[:2])),
                not_done=tuple(not_done),
                unknown_objects=unknown_objects,
            )
        )
    return sets


def usual_splits(table: FeatureTable) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return the columns of each default split, and a sentence for each impossible split.

    The first split holds out one session, if several sessions have all labels; otherwise, it holds
    out one block of trials. Further splits hold out one mounting or one specimen, if these are
    recorded.
    """
    not_done: list[str] = []

    def can_hold_out(column: str) -> bool:
        try:
            grouped_split(table, [column])
        except EvaluationError as error:
            not_done.append(f'one {plain_name(column)} held out: {error}')
            return False
        return True

    def named(*names: str) -> list[str]:
        return [column for column in table.columns if column.lower() in names]

    first = next(filter(can_hold_out, (*named(*SESSIONS), *named('trial_block'))), None)
    # Columns with a different value in each trial are left out, because random folds already hold
    # out whole mountings then.
    mountings = [
        column
        for column in named(*MOUNTINGS, *SPECIMENS)
        if 1 < len(np.unique(table.columns[column])) < len(table) and can_hold_out(column)
    ]
    return [(column,) for column in (first, *mountings) if column], not_done


def _find_examples(trials: TrialSet, table: FeatureTable) -> tuple[Example, ...]:
    """Return the first trial of each label."""
    rows = [int(np.argmax(table.labels == label)) for label in np.unique(table.labels)]
    found = [(row, *find_window(trials, table, row)) for row in rows]
    return tuple(Example(row, window, trial) for row, trial, window in found)
