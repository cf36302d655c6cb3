# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Splits: trials to train on and trials to test on."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

import numpy as np
import numpy.typing as npt
from sklearn.model_selection import KFold, LeaveOneGroupOut, StratifiedKFold

from tactile_classifier.datasets.dataset import divide_groups, FeatureTable, plain_name
from tactile_classifier.errors import EvaluationError

IndexArray = npt.NDArray[np.intp]
Fold = tuple[IndexArray, IndexArray]
"""Trials to train on, trials to test on."""

FOLDS = 6
REPETITIONS = 10
"""Folds and how often the trials are divided anew, as in the paper (section IV)."""

_INNER_FOLDS = 3

LEAST_TO_TRAIN = 3
"""Smallest number of training trials, which three nearest neighbours need."""


@dataclasses.dataclass(frozen=True)
class Split:
    """The trials divided once or several times.

    ``name`` stands beside every result. ``repeats`` are the folds of each repetition, within which
    each trial is tested once. ``groups``, shape (trials,), is the group of each trial where whole
    groups are held out. ``copies``, shape (trials,), is `FeatureTable.copies`: trials with equal
    numbers stay in one fold.
    """

    name: str
    repeats: tuple[tuple[Fold, ...], ...]
    groups: IndexArray | None = None
    copies: IndexArray | None = None

    @property
    def tested(self) -> IndexArray:
        """The trials that each repetition tests, in order."""
        return np.sort(np.concatenate([test for _, test in self.repeats[0]]))

    @property
    def spread_of(self) -> str:
        """``groups``, or ``repetitions``: what a spread of accuracies is over."""
        return 'repetitions' if self.groups is None else 'groups'

    def once(self) -> Split:
        """Return the split with its first repetition alone."""
        name = self.name if self.groups is not None else f'{self.name.split(",")[0]}, once'
        return dataclasses.replace(self, name=name, repeats=self.repeats[:1])

    def take(self, keep: npt.NDArray[np.bool_]) -> Split:
        """Return the split of the trials that a mask selects, without folds that test none."""
        place = np.cumsum(keep) - 1
        repeats = tuple(
            tuple(
                (place[train[keep[train]]], place[test[keep[test]]])
                for train, test in folds
                if keep[test].any()
            )
            for folds in self.repeats
        )
        groups = None if self.groups is None else self.groups[keep]
        copies = None if self.copies is None else self.copies[keep]
        return dataclasses.replace(self, repeats=repeats, groups=groups, copies=copies)

    def divide_again(
        self,
        train: IndexArray,
        labels: npt.NDArray[np.str_],
        random_state: int,
        folds: int = _INNER_FOLDS,
    ) -> list[Fold]:
        """Divide the trials of one fold's training once more, to choose something on them.

        A split that holds groups out is divided by whole groups, otherwise trials are divided at
        random. Indices are into the table. Folds whose training part lacks a class are left out.
        Raises EvaluationError when too few groups, or too few trials of a class, are left.
        """
        if self.groups is None:
            copies = train if self.copies is None else self.copies[train]
            inner = _divide_trials(labels[train], copies, random_state, folds)
        else:
            inner = _divide_groups(train, labels[train], self.groups[train], random_state, folds)
        _check_training_size(inner)
        return [(train[a], train[b]) for a, b in inner]


def _divide_trials(
    labels: npt.NDArray[np.str_], copies: IndexArray, random_state: int, folds: int
) -> list[Fold]:
    names, counts = count_different(labels, copies)
    fewest = int(counts.min())
    if fewest < 2:
        raise EvaluationError(
            f'one trial of class "{names[counts.argmin()]}" is left to train on, so '
            'nothing can be chosen by it: record more of it'
        )
    return divide_stratified(labels, copies, min(folds, fewest), random_state)


def _divide_groups(
    train: IndexArray,
    labels: npt.NDArray[np.str_],
    groups: IndexArray,
    random_state: int,
    folds: int,
) -> list[Fold]:
    names = np.unique(groups)
    inner: list[Fold] = []
    if len(names) > 1:
        # As GroupKFold(shuffle=True), which scikit-learn has from 1.6 on.
        splitter = KFold(min(folds, len(names)), shuffle=True, random_state=random_state)
        held_out = [np.isin(groups, names[test]) for _, test in splitter.split(names)]
        known = len(np.unique(labels))
        inner = [
            (np.flatnonzero(~test), np.flatnonzero(test))
            for test in held_out
            if len(np.unique(labels[~test])) == known
        ]
    if len(inner) < 2:
        raise EvaluationError(
            'too few groups are left to train on to hold out some of them again: record more '
            'groups with all labels'
        )
    return inner


LARGE_TABLE = 2_000_000_000
"""Trials squared times features above which `choose_repetitions` saves time [1]."""


def choose_repetitions(table: FeatureTable, wanted: int | None) -> tuple[int, str]:
    """Return how often the trials are divided anew, and a sentence where that is less than usual.

    The time of a fit grows with trials squared times features, and with many trials a repetition
    changes the mean little. ``wanted`` counts where stated; else `REPETITIONS` do, or 1 for a
    table beyond `LARGE_TABLE`.
    """
    trials, features = table.values.shape
    if wanted is not None or trials**2 * features <= LARGE_TABLE:
        return wanted or REPETITIONS, ''
    return 1, (
        f'large table ({trials} trials x {features} features): cross-validation runs once instead '
        f'of {REPETITIONS} times; --repetitions {REPETITIONS} does all, which takes long'
    )


def stratified_split(
    table: FeatureTable,
    folds: int = FOLDS,
    repetitions: int = REPETITIONS,
    random_state: int = 0,
) -> Split:
    """Return random folds in which each class has its share, several times.

    With fewer trials of a class than folds there are as many folds as it has trials. Where these
    would leave fewer than three trials to train on, each trial is held out in turn, once. The name
    of the split says so. Raises EvaluationError when a class has one trial only.
    """
    if folds < 2 or repetitions < 1:
        raise EvaluationError('cross-validation takes two folds or more, once or more often')
    _check_classes(table)
    names, counts = count_different(table.labels, table.copies)
    fewest, rarest = int(counts.min()), names[counts.argmin()]
    if fewest < 2:
        raise EvaluationError(
            f'class "{rarest}" has one trial only, which would be tested without one to train on: '
            'record more of it, or leave it out'
        )
    why = f' ("{rarest}" has {fewest} trials)' if fewest < folds else ''
    folds = min(folds, fewest)
    if len(table) - -(-len(table) // folds) < LEAST_TO_TRAIN:
        each = tuple(LeaveOneGroupOut().split(table.values, groups=table.copies))
        return _checked(Split(f'leave-one-out{why}', (each,), copies=table.copies))
    repeats = tuple(
        tuple(divide_stratified(table.labels, table.copies, folds, random_state + i))
        for i in range(repetitions)
    )
    times = 'once' if repetitions == 1 else f'{repetitions} times'
    name = f'stratified {folds}-fold{why}, {times}'
    return _checked(Split(name, repeats, copies=table.copies))


def count_different(
    labels: npt.NDArray[np.str_], copies: IndexArray
) -> tuple[npt.NDArray[np.str_], IndexArray]:
    """Return the labels, and how many trials of each are no copies of another one."""
    different = np.unique(copies, return_index=True)[1]
    return np.unique(labels[different], return_counts=True)


def divide_stratified(
    labels: npt.NDArray[np.str_], copies: IndexArray, folds: int, random_state: int
) -> list[Fold]:
    """Return random folds in which each class has its share; copies are in one fold.

    Without copies they are scikit-learn's `StratifiedKFold`. ``copies``, shape (trials,): equal
    numbers are copies.
    """
    numbers, different = np.unique(copies, return_index=True)
    splitter = StratifiedKFold(folds, shuffle=True, random_state=random_state)
    tests = (test for _, test in splitter.split(different, labels[different]))
    held_out = [np.isin(copies, numbers[test]) for test in tests]
    return [(np.flatnonzero(~test), np.flatnonzero(test)) for test in held_out]


def grouped_split(table: FeatureTable, columns: Sequence[str]) -> Split:
    """Return a split that holds out each group of trials that agree in all columns, in turn.

    A copy of a trial of an earlier group is tested with that group.

    Raises EvaluationError when there is one group only, or a class is in one group only, and
    DatasetError when there is no such column.
    """
    name = ' and '.join(map(plain_name, columns))
    _check_classes(table)
    groups: IndexArray = np.zeros(len(table), dtype=np.intp)
    for column in columns:
        groups = divide_groups(groups, table.column(column))
    several = groups.max() > 0
    groups = np.unique(groups[table.copies], return_inverse=True)[1]
    if groups.max() < 1:
        raise EvaluationError(
            f'all trials have the same {name}{" or are copies" * bool(several)}: there is nothing '
            'to hold out'
        )
    for label in np.unique(table.labels):
        if len(np.unique(groups[table.labels == label])) < 2:
            raise EvaluationError(
                f'all trials of class "{label}" have the same {name}: with that held out, '
                'no model can know the class'
            )
    folds = tuple(LeaveOneGroupOut().split(table.values, table.labels, groups))
    return _checked(Split(f'one {name} held out', (folds,), groups, table.copies))


def stated_split(
    table: FeatureTable,
    train: npt.NDArray[np.bool_],
    test: npt.NDArray[np.bool_],
    train_is: str,
    test_is: str,
) -> Split:
    """Return a split that trains on some trials, by a mask, and tests on others, once.

    ``train_is`` and ``test_is`` name them in words. Raises EvaluationError when a trial is in
    both, a class is in ``test`` only, or there is one class to train on.
    """
    both = np.flatnonzero(train & test)
    if len(both):
        raise EvaluationError(
            f'{len(both)} trials are in both: trained on {train_is}, tested on {test_is}'
        )
    leaked = train & np.isin(table.copies, table.copies[test])
    if leaked.any():
        raise EvaluationError(
            f'{leaked.sum()} trials with {train_is} are copies of trials with {test_is}, such as '
            f'number {leaked.argmax()}: leave them out of one of the two'
        )
    known = np.unique(table.labels[train])
    new = np.setdiff1d(table.labels[test], known)
    if len(new):
        raise EvaluationError(
            f'class "{new[0]}" has trials with {test_is} and none with {train_is}: no model can '
            'know it'
        )
    if len(known) < 2:
        raise EvaluationError(
            f'the trials with {train_is} are all of one class; choose at least two'
        )
    fold = (np.flatnonzero(train), np.flatnonzero(test))
    name = f'trained on {train_is} ({train.sum()} trials), tested on {test_is}'
    return _checked(Split(name, ((fold,),), copies=table.copies))


def _check_classes(table: FeatureTable) -> None:
    classes = np.unique(table.labels)
    if len(classes) < 2:
        raise EvaluationError(f'there is one class only, "{classes[0]}"; record at least two')


def _checked(split: Split) -> Split:
    _check_training_size([fold for folds in split.repeats for fold in folds])
    return split


def _check_training_size(folds: Sequence[Fold]) -> None:
    smallest = min(len(train) for train, _ in folds)
    if smallest < LEAST_TO_TRAIN:
        raise EvaluationError(
            f'{smallest} trials would be left to train on; three neighbours need three'
        )
