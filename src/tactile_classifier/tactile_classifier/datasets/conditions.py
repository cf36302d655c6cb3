# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Problems that bias an evaluation: copies, repeated conditions, labels confounded with groups."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.dataset import divide_groups, FeatureTable, plain_name

GROUPS = ('session_id', 'mounting_id', 'specimen', 'bag')
"""Columns that group trials which share a state of the rig, such as a mounting."""

_NUMBERS = ('repetition', 'trial', 'trial_id', 'trial_block', 'window_start_ns', 'window_end_ns')
"""Columns that number the trials. They do not describe conditions."""

MOST_NAMED = 5
"""Largest number of copies that a warning lists."""


@dataclasses.dataclass(frozen=True, eq=False)
class Cells:
    """Groups of trials with the same label that were recorded under the same conditions.

    Such a group is called a cell. ``columns`` are the columns that define the conditions.
    ``cell``, shape (trials,), contains the number of the cell of each trial.
    """

    columns: tuple[str, ...]
    cell: npt.NDArray[np.intp]

    def average(
        self, values: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
        """Return the mean of ``values`` in each cell, and the number of trials in each cell.

        ``values`` has one entry per trial.
        """
        sizes = np.bincount(self.cell)
        return np.bincount(self.cell, values) / sizes, sizes

    @property
    def warning(self) -> str:
        """One sentence about repeats in random folds."""
        same = ' and '.join(map(plain_name, self.columns))
        return (
            f'with random folds, test trials repeat training trials: the {len(self.cell)} trials '
            f'form {self.cell.max() + 1} groups with the same label and {same}. '
            f'Accuracy may be lower for a new {same}. Intervals are computed over these groups'
        )


def find_cells(table: FeatureTable) -> Cells | None:
    """Return the cells of repeated conditions, or None if most cells contain a single trial.

    A column describes a condition if it has several values for one label. Columns in `_NUMBERS`
    and columns with almost as many values as there are trials are not used.
    """
    cell = np.unique(table.labels, return_inverse=True)[1]
    columns: list[str] = []
    for name, column in table.columns.items():
        codes = np.unique(column, return_inverse=True)[1]
        if name in _NUMBERS or codes.max() == 0 or 2 * codes.max() >= len(table):
            continue
        crossed = divide_groups(cell, column)
        if crossed.max() > cell.max():
            cell, columns = crossed, [*columns, name]
    if not columns or np.median(np.bincount(cell)) < 2:
        return None
    return Cells(tuple(columns), cell)


def cells_of_copies(copies: npt.NDArray[np.intp]) -> Cells | None:
    """Return cells that contain a trial and its copies, or None if there are no copies."""
    cell = np.unique(copies, return_inverse=True)[1]
    return Cells((), cell) if cell.max() + 1 < len(cell) else None


def describe_copies(table: FeatureTable) -> list[str]:
    """Return a warning that lists the copies in a table; empty if there are none."""
    (copied,) = np.nonzero(table.copies != np.arange(len(table)))
    if not len(copied):
        return []
    names = table.columns.get('trial_id', np.arange(len(table))).astype(str)
    named = [f'{names[i]} of {names[table.copies[i]]}' for i in copied[:MOST_NAMED]]
    more = f' and {len(copied) - MOST_NAMED} more' * (len(copied) > MOST_NAMED)
    one = len(copied) == 1
    return [
        f'{len(copied)} of {len(table)} trials {"is a copy" if one else "are copies"} of '
        f'{"another trial" if one else "other trials"}: {", ".join(named)}{more}. Copies are kept '
        'in the same fold; exclude them from the recordings'
    ]


def find_strata(table: FeatureTable) -> npt.NDArray[np.intp] | None:
    """Return the number of the session of each trial, for statistical tests within sessions.

    Returns None if there is only one session, or if sessions are unknown.
    """
    if 'session_id' not in table.columns:
        return None
    codes = np.unique(table.columns['session_id'], return_inverse=True)[1]
    return codes if codes.max() > 0 else None


def find_mountings(table: FeatureTable) -> npt.NDArray[np.intp] | None:
    """Return the number of the mounting of each trial, for tests over mountings, or None.

    Trials of one mounting share the position of the plate or object. They are not independent
    samples, so tests compare the means of mountings. A mounting belongs to one label and one
    session. If the mounting of a trial is unknown, one mounting for each label and session is
    assumed. Returns None if neither mountings nor sessions are known.
    """
    columns = [
        table.columns[name] for name in ('session_id', 'mounting_id') if name in table.columns
    ]
    if 'mounting_id' in table.columns and not states_mountings(table):
        columns.pop()
    if not columns:
        return None
    code: npt.NDArray[np.intp] = np.unique(table.labels, return_inverse=True)[1]
    for column in columns:
        code = divide_groups(code, column)
    return code


def states_mountings(table: FeatureTable) -> bool:
    """Return True if the mounting of every trial is known."""
    mountings = table.columns.get('mounting_id')
    return mountings is not None and not (mountings.astype(str) == '').any()


def find_tied_labels(table: FeatureTable) -> list[str]:
    """Return warnings for grouping columns that are confounded with the labels.

    A label is tied if all its trials belong to one group that contains no other label. A model may
    then learn the group instead of the label, and random folds overestimate the accuracy. If the
    group is held out, the model does not know the label. If all trials of a label belong to one
    group that also contains other labels, there is only the last problem, which is also reported.
    """
    labels, label = np.unique(table.labels, return_inverse=True)
    warnings = []
    for name in GROUPS:
        if name not in table.columns:
            continue
        group = np.unique(table.columns[name], return_inverse=True)[1]
        together = np.zeros((len(labels), group.max() + 1), dtype=bool)
        together[label, group] = True
        alone = together[:, together.sum(axis=0) == 1].sum(axis=1)
        once = together.sum(axis=1) == 1
        tied = once & (alone == 1)
        what = plain_name(name)
        if tied.any():
            warnings.append(
                f'{what} and label coincide for {_count(labels, tied)}: a '
                f'model may learn the {what} instead of the label, and random '
                f'folds do not show this; record each label in several'
            )
        shared = once & ~tied
        if shared.any() and together.shape[1] > 1 and name != 'bag':
            warnings.append(
                f'one {what} contains all trials of {_count(labels, shared)}: accuracy in another '
                f'{what} cannot be tested; record each label in several'
            )
    return warnings


def _count(labels: npt.NDArray[np.str_], chosen: npt.NDArray[np.bool_]) -> str:
    """Return a text with the number of chosen labels, and the names of the first six."""
    names = labels[chosen]
    more = ' and more' if len(names) > 6 else ''
    return f'{len(names)} of {len(labels)} labels ({", ".join(map(str, names[:6]))}{more})'
