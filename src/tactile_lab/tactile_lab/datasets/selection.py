# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials chosen by a column: ``COLUMN`` or ``COLUMN=VALUE[,VALUE...]``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.datasets.archive import LabelledTrials
from tactile_classifier.datasets.dataset import FeatureTable, find_column
from tactile_classifier.datasets.splits import Split, stated_split
from tactile_ros.errors import TactileError

Columns = Mapping[str, NDArray[Any]]
Trials = TypeVar('Trials', LabelledTrials, FeatureTable)


def select_trials(columns: Columns, text: str, option: str) -> NDArray[np.bool_]:
    """Return which trials ``COLUMN`` (is true) or ``COLUMN=VALUE[,VALUE...]`` chooses.

    Raises
    ------
    TactileError
        When there is no such column or no such trial, or the text is no value of the column.
    """
    name, equals, values = text.partition('=')
    name = find_column(columns, name)
    if name not in columns:
        raise TactileError(
            f'--{option}: there is no column "{name}"; there are: {", ".join(columns) or "none"}'
        )
    column = np.asarray(columns[name])
    if not equals:
        if column.dtype.kind not in 'biu':
            raise TactileError(
                f'--{option}: column {name} is not true or false; write {name}=VALUE'
            )
        chosen = column.astype(bool)
    else:
        chosen = np.isin(column, [_value(v, column, name, option) for v in values.split(',')])
    if not chosen.any():
        raise TactileError(f'--{option}: no trial has {text if equals else f"{name} = True"}')
    return chosen


def _value(text: str, column: NDArray[Any], name: str, option: str) -> Any:
    """Return ``text`` as a value of the column's type."""
    if column.dtype.kind == 'U':
        return text
    if column.dtype.kind == 'b' and text.lower() in ('true', 'false'):
        return text.lower() == 'true'
    try:
        return column.dtype.type(float(text) if column.dtype.kind == 'b' else text)
    except (ValueError, OverflowError) as error:
        raise TactileError(
            f'--{option}: "{text}" is no value of column {name} ({column.dtype})'
        ) from error


@dataclass(frozen=True)
class TrainTest:
    """Selections of the training and the test trials, as `select_trials` takes them.

    Raises
    ------
    TactileError
        When only one of the two selections is given.
    """

    train_where: str | None = None
    test_where: str | None = None

    def __post_init__(self) -> None:
        if (self.train_where is None) != (self.test_where is None):
            raise TactileError('--train-where and --test-where belong together: give both')

    def select(self, columns: Columns) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
        """Return the trials to train on and those to test on; None where none are stated."""
        if self.train_where is None or self.test_where is None:
            return None
        return (
            select_trials(columns, self.train_where, 'train-where'),
            select_trials(columns, self.test_where, 'test-where'),
        )

    def training(self, table: FeatureTable) -> FeatureTable:
        """Return the trials to train on; all where none are stated."""
        chosen = self.select(table.columns)
        return table if chosen is None else table.take(chosen[0])

    def keep(self, trials: Trials) -> Trials:
        """Return the trials that are in either; all where none are stated."""
        chosen = self.select(trials.columns)
        return trials if chosen is None else trials.take(chosen[0] | chosen[1])

    def splits(self, table: FeatureTable) -> tuple[Split, ...]:
        """Return the split into both; empty where none is stated.

        Raises
        ------
        EvaluationError
            When both share a trial, or a class is known in the tests only.
        """
        chosen = self.select(table.columns)
        if chosen is None:
            return ()
        return (stated_split(table, *chosen, str(self.train_where), str(self.test_where)),)
