# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One set of labelled trials as the report needs it: features, and some of the signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.automatic_features import Chosen, SESSIONS
from tactile_analysis.datasets.feature_tables import Key, RecordingFeatures
from tactile_analysis.datasets.reading import select_features
from tactile_classifier.datasets.archive import Skipped
from tactile_classifier.datasets.dataset import FeatureTable, plain_name
from tactile_classifier.datasets.splits import grouped_split, Split
from tactile_classifier.errors import EvaluationError
from tactile_features.types import PROTOCOL_STIFFNESS

MOUNTINGS = ('mounting_id', 'mounting')
"""Names of columns of mountings, in small letters."""

SPECIMENS = ('specimen_id', 'specimen')
"""Names of columns of specimens, in small letters."""


@dataclass(frozen=True)
class Example:
    """The window of one trial: its row in the table of features, and times [s] from its start."""

    row: int
    time_s: NDArray[np.float64]
    signal: NDArray[np.float64]


@dataclass(frozen=True)
class TrialExample:
    """A whole trial with its phases, and the window that its features come from [s]."""

    row: int
    time_s: NDArray[np.float64]
    tension_n: NDArray[np.float64]
    phases: tuple[tuple[str, float, float], ...]
    window_s: tuple[float, float]


@dataclass(frozen=True)
class RecordingSet:
    """Trials of one task and contact.

    Attributes
    ----------
    title : str
        Task, contact or source, and whether it is simulated.
    contact : str
        Empty if there is none, as in an archive.
    hold_out : tuple of tuple of str
        Columns of each grouped split; random folds are evaluated, too.
    unit : str
        Unit of the signal; ``raw`` if it is unknown.
    examples : tuple of Example
        One per label.
    splits : tuple of Split
        Stated trials to train on and to test on.
    skipped, steps
        Unusable trials, and the preparation of the signals in words.
    choice : Chosen or None
        Features and classifier that `tactile train` would choose.
    not_done : tuple of str
        One sentence for each usual split that the trials do not allow.
    refused : int
        Labelled trials without features; they count as wrong in the end-to-end accuracy.
    """

    title: str
    contact: str
    simulated: bool
    table: FeatureTable
    hold_out: tuple[tuple[str, ...], ...]
    unit: str
    examples: tuple[Example, ...] = ()
    trial: TrialExample | None = None
    splits: tuple[Split, ...] = ()
    skipped: tuple[Skipped, ...] = ()
    steps: tuple[str, ...] = ()
    choice: Chosen | None = None
    not_done: tuple[str, ...] = ()
    answers: bool = False
    refused: int = 0

    def format_preparation(self, most: int | None = None) -> list[str]:
        """Return the preparation of the signals and at most ``most`` skipped trials, in words."""
        lines = list(self.steps)
        if self.skipped:
            lines.append(f'skipped {len(self.skipped)} trials; rows count from 0:')
            lines += [f'row {each.row}: {each.reason}' for each in self.skipped[:most]]
        if most is not None and len(self.skipped) > most:
            lines.append(f'and {len(self.skipped) - most} more: see the report, or --json')
        return lines


def make_sets(
    features: RecordingFeatures,
    chosen: Mapping[Key, Chosen],
    hold_out: Sequence[Sequence[str]] = (),
    *,
    of_choice: bool = False,
    report: bool = False,
    answers: bool = False,
) -> list[RecordingSet]:
    """Return the sets of an open recording, one for each task and contact.

    Parameters
    ----------
    chosen : mapping
        The choice for each set.
    hold_out : sequence of sequence of str
        Columns of the grouped splits. Empty: one session is held out where there are several that
        have all labels, one block of trials where not, one mounting, and one specimen.
    of_choice : bool
        Tables have the features of the chosen set instead of the recorded ones.
    report : bool
        Also signals.
    answers : bool
        Unknown objects are evaluated, too.
    """
    reading, recording = features.reading, features.recording
    found_tables = features.tables()
    whole = found_tables.tables
    if of_choice:
        whole = {key: each.table for key, each in chosen.items()}
    tables = {
        key: select_features(reading.keep_stated(table), reading.features)
        for key, table in whole.items()
    }
    sets = []
    for key, table in tables.items():
        simulated = bool(np.any(table.columns.get('simulated', False)))
        columns, not_done = (hold_out, []) if hold_out else usual_splits(table)
        of_auto = f', auto: {table.spec.feature_set}' if of_choice and not recording.is_own else ''
        found = RecordingSet(
            title=features.title(key, table) + of_auto + (', simulated' if simulated else ''),
            contact=key[1],
            simulated=simulated,
            table=table,
            hold_out=tuple(map(tuple, columns)),
            unit=recording.unit or 'raw',
            splits=reading.splits(table),
            skipped=features.skipped,
            steps=features.steps,
            choice=chosen.get(key, chosen.get(key[:2])),
            not_done=tuple(not_done),
            answers=answers,
            refused=found_tables.refused.get(key, 0),
        )
        if report:
            rows = _first_rows(table)
            windows = zip(rows, features.windows(table, rows), strict=True)
            found = replace(
                found,
                examples=tuple(Example(row, *window) for row, window in windows),
                trial=_find_trial(features, table) if key[0] == PROTOCOL_STIFFNESS else None,
            )
        sets.append(found)
    return sets


def usual_splits(table: FeatureTable) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return the columns of each split, and a sentence for each that cannot be done."""
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
    # Where each trial has a mounting of its own, random folds hold mountings out already.
    mountings = [
        column
        for column in named(*MOUNTINGS, *SPECIMENS)
        if 1 < len(np.unique(table.columns[column])) < len(table) and can_hold_out(column)
    ]
    return [(column,) for column in (first, *mountings) if column], not_done


def _first_rows(table: FeatureTable) -> list[int]:
    """Return the row of the first trial of each label."""
    return [int(np.argmax(table.labels == label)) for label in np.unique(table.labels)]


def _find_trial(features: RecordingFeatures, table: FeatureTable) -> TrialExample | None:
    """Return the whole of one stiffness trial: that with the steepest relaxation of its kind.

    None where its phases are not known.
    """
    rows = _first_rows(table)
    row = rows[int(np.argmin(table.values[rows, 0]))]
    trial = features.find_trial(table, row)
    if trial is None or trial.begin_ns is None:
        return None
    signal = trial.signal
    assert signal.time_s is not None
    start_s, end_s = (
        (int(table.column(name)[row]) - trial.begin_ns) * 1e-9
        for name in ('window_start_ns', 'window_end_ns')
    )
    return TrialExample(row, signal.time_s, signal.values[0], trial.phases, (start_s, end_s))
