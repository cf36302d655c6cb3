# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The same trials with the features of each of two models."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.model_file.inference import TactileModel
from tactile_features.feature_sets.registry import find_feature_set
from tactile_lab.datasets.bag_tables import BagTables, Key, read_tables
from tactile_lab.datasets.prepared import prepare_trials
from tactile_lab.datasets.sources.leaves import Leaf
from tactile_lab.datasets.trial_options import TrialOptions

"""Task and contact."""

Reader = Callable[[TactileModel], BagTables]
"""Returns the tables of some recordings, with the features that a model takes."""

SESSION = 'session_id'


@dataclass(frozen=True)
class PairedTrials:
    """Trials that give features for one model at least.

    Attributes
    ----------
    key : (str, str)
        Task and contact.
    labels, trial_ids : ndarray of str, shape (trials,)
    groups : ndarray of str, shape (trials,), or None
    parts_are : str
        What the groups are, in the plural.
    simulated : ndarray of bool, shape (trials,)
    tables : (FeatureTable, FeatureTable)
        Features for A and for B.
    rows : (ndarray, ndarray) of int, shape (trials,)
        Where each trial stands in these tables; -1: it gives this model no features.
    """

    key: Key
    labels: NDArray[np.str_]
    trial_ids: NDArray[np.str_]
    groups: NDArray[np.str_] | None
    parts_are: str
    simulated: NDArray[np.bool_]
    tables: tuple[FeatureTable, FeatureTable]
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, keep: NDArray[np.bool_]) -> PairedTrials:
        """Return some of the trials."""
        return replace(
            self,
            labels=self.labels[keep],
            trial_ids=self.trial_ids[keep],
            groups=None if self.groups is None else self.groups[keep],
            simulated=self.simulated[keep],
            rows=(self.rows[0][keep], self.rows[1][keep]),
        )

    def spread(self, side: int, of_table: NDArray[Any], missing: Any) -> NDArray[Any]:
        """Return what stands for each row of a model's table, for each trial.

        Parameters
        ----------
        side : int
            0: A; 1: B.
        of_table : ndarray of shape (rows of the table,)
        missing : Any
            For trials without features.
        """
        rows = self.rows[side]
        return np.array([missing if row < 0 else of_table[row] for row in rows])


def bag_reader(bags: Sequence[Path]) -> Reader:
    """Return what reads bags with trial events, each set of features once."""
    found: dict[str, BagTables] = {}

    def read(model: TactileModel) -> BagTables:
        values = model.spec.config_values()
        name = json.dumps(values, sort_keys=True)
        if name not in found:
            found[name] = read_tables(bags, values)
        return found[name]

    return read


def trial_reader(leaves: Sequence[Leaf], options: TrialOptions) -> Reader:
    """Return what reads any other recordings, each task once."""
    found: dict[str, Any] = {}

    def read(model: TactileModel) -> BagTables:
        if model.task not in found:
            wanted = replace(options, task=model.task, features=model.spec.feature_set)
            found[model.task] = prepare_trials(leaves, wanted, folds=0)
        prepared = found[model.task]
        values = model.spec.config_values()
        # The recordings state rate and length themselves; the model is compared with these.
        feature_set = find_feature_set(model.spec.feature_set)
        for name in ('rate_hz', feature_set.count_field if feature_set else ''):
            values.pop(name, None)
        skipped = tuple(f'row {each.row}: {each.reason}' for each in prepared.trials.skipped)
        return BagTables({(model.task, ''): prepared.compute_table(values)}, skipped)

    return read


def pair_tables(
    read: Reader, models: tuple[TactileModel, TactileModel], columns: Sequence[str]
) -> list[PairedTrials]:
    """Return the trials that both models are for, by contact; none: there are no such trials.

    Parameters
    ----------
    read : callable
        See `Reader`.
    columns : sequence of str
        Columns that make a group; none: the session, where there is one.

    Raises
    ------
    DatasetError
        When the recordings lack a column.
    ModelFileError
        When the features of the recordings are not those that a model takes.
    """
    found = [_fitting(read(model), models) for model in models]
    paired = []
    for key in found[0]:
        if key not in found[1]:
            continue
        tables = (found[0][key], found[1][key])
        for model, table in zip(models, tables, strict=True):
            model.check_fits(table.spec)
        paired.append(_pair(key, tables, columns))
    return paired


def _fitting(
    read: BagTables, models: tuple[TactileModel, TactileModel]
) -> Mapping[Key, FeatureTable]:
    contacts = {model.contact for model in models}
    return {
        key: table
        for key, table in read.tables.items()
        if key[0] == models[0].task and len((contacts | {key[1]}) - {''}) < 2
    }


def _pair(
    key: Key, tables: tuple[FeatureTable, FeatureTable], columns: Sequence[str]
) -> PairedTrials:
    places = [_places(table) for table in tables]
    trials = [*places[0], *(name for name in places[1] if name not in places[0])]
    rows = tuple(np.array([place.get(name, -1) for name in trials]) for place in places)
    sources = [(0, a) if a >= 0 else (1, b) for a, b in zip(*rows, strict=True)]

    def join(*both: NDArray[Any]) -> NDArray[Any]:
        return np.array([both[side][row] for side, row in sources])

    groups = None
    present = [SESSION] if SESSION in tables[0].columns else []
    for name in columns or present:
        values = join(*(table.column(name).astype(str) for table in tables))
        groups = values if groups is None else np.char.add(np.char.add(groups, '/'), values)
    return PairedTrials(
        key,
        labels=join(*(table.labels for table in tables)),
        trial_ids=join(*(table.column('trial_id').astype(str) for table in tables)),
        groups=groups,
        parts_are=f'groups of {" and ".join(columns)}' if columns else 'sessions',
        simulated=join(*(_optional(table, 'simulated').astype(bool) for table in tables)),
        tables=tables,
        rows=(rows[0], rows[1]),
    )


def _optional(table: FeatureTable, name: str) -> NDArray[Any]:
    """Return a column, zeros where there is none."""
    return np.asarray(table.columns.get(name, np.zeros(len(table))))


def _places(table: FeatureTable) -> dict[tuple[str, ...], int]:
    """Return the row of each trial; a trial's name may come again, so its turn counts too."""
    source = [_optional(table, name).astype(str) for name in ('bag', 'namespace', 'trial_id')]
    turns: defaultdict[tuple[str, ...], int] = defaultdict(int)
    places = {}
    for row, name in enumerate(zip(*source, strict=True)):
        turns[name] += 1
        places[(*name, str(turns[name]))] = row
    return places
