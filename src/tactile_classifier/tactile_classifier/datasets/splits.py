# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Splits into training and test trials."""

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
"""Indices of the training trials and of the test trials."""

FOLDS = 6
REPETITIONS = 10
"""Number of folds and of repetitions of cross-validation, as in the paper (section IV)."""

_INNER_FOLDS = 3

LEAST_TO_TRAIN = 3
"""Smallest number of training trials, because one classifier uses three nearest neighbours."""


@dataclasses.dataclass(frozen=True)
class Split:
    """One or more divisions of the trials into folds.

    ``name`` is shown with every result. ``repeats`` contains the folds of each repetition; within
    a repetition, no trial is tested twice. If whole groups are held out, ``groups``, shape
    (trials,), contains the group of each trial. ``copies``, shape (trials,), is
    `FeatureTable.copies`; trials with equal numbers in it stay in one fold.
    """

    name: str
    repeats: tuple[tuple[Fold, ...], ...]
    groups: IndexArray | None = None
    copies: IndexArray | None = None

    @property
    def tested(self) -> IndexArray:
        """Sorted indices of the trials that each repetition tests."""
        return np.sort(np.concatenate([test for _, test in self.repeats[0]]))

    @property
    def spread_of(self) -> str:
        """``groups`` or ``repetitions``, whose accuracies are used to compute the spread."""
        return 'repetitions' if self.groups is None else 'groups'

    def once(self) -> Split:
        """Return the split with only its first repetition."""
        name = self.name if self.groups is not None else f'{self.name.split(",")[0]}, once'
        return dataclasses.replace(self, name=name, repeats=self.repeats[:1])

    def take(self, keep: npt.NDArray[np.bool_]) -> Split:
        """Return the split for the trials that a mask selects.

        Folds without any of these trials in their test part are left out.

        ``keep`` has shape (trials,).
        """
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
        """Divide the training trials of a fold into inner folds, for nested cross-validation.

        If the split holds out groups, the inner folds also hold out whole groups. In this case,
        inner folds whose training part lacks a class are left out. Otherwise, trials are divided
        at random. Indices refer to the whole table. Raises EvaluationError if too few groups or
        too few trials of a class remain.
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
            f'only one training trial of class "{names[counts.argmin()]}" remains in a fold, too '
            'few for inner folds: record more trials of this class'
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
        # The same as GroupKFold(shuffle=True), which requires scikit-learn 1.6.
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
            'too few training groups remain in a fold for inner folds: record more groups with '
            'all labels'
        )
    return inner


LARGE_TABLE = 2_000_000_000
"""If the number of trials squared times the number of features is larger than this,
`choose_repetitions` chooses one repetition [1]."""


def choose_repetitions(table: FeatureTable, wanted: int | None) -> tuple[int, str]:
    """Choose the number of repetitions; also return a sentence if it is below the default.

    If ``wanted`` is given, it is returned. Otherwise, the number is `REPETITIONS`, or 1 if the
    table is larger than `LARGE_TABLE`. The time of a fit grows with the number of trials squared
    times the number of features, and if there are many trials, repetitions change the mean little.
    """
    trials, features = table.values.shape
    if wanted is not None or trials**2 * features <= LARGE_TABLE:
        return wanted or REPETITIONS, ''
    return 1, (
        f'large table ({trials} trials x {features} features): cross-validation runs once instead '
        f'of {REPETITIONS} times; --repetitions {REPETITIONS} runs all, but takes longer'
    )


def stratified_split(
    table: FeatureTable,
    folds: int = FOLDS,
    repetitions: int = REPETITIONS,
    random_state: int = 0,
) -> Split:
    """Return a stratified k-fold split with several repetitions.

    If a class has fewer trials than ``folds``, the number of folds is reduced to the number of
    trials in this class. If fewer than three training trials would remain, one repetition of
    leave-one-out is used instead. The name of the split states both. Raises EvaluationError if a
    class has only one trial.
    """
    if folds < 2 or repetitions < 1:
        raise EvaluationError('cross-validation needs at least two folds and one repetition')
    _check_classes(table)
    names, counts = count_different(table.labels, table.copies)
    fewest, rarest = int(counts.min()), names[counts.argmin()]
    if fewest < 2:
        raise EvaluationError(
            f'class "{rarest}" has only one trial, so none would be left for training: '
            'record more trials of this class, or leave it out'
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
    """Return the labels and the number of trials of each label; copies are not counted."""
    different = np.unique(copies, return_index=True)[1]
    return np.unique(labels[different], return_counts=True)


def divide_stratified(
    labels: npt.NDArray[np.str_], copies: IndexArray, folds: int, random_state: int
) -> list[Fold]:
    """Return stratified random folds; copies stay in one fold.

    In ``copies``, shape (trials,), trials that are copies of each other have equal numbers. If
    there are no copies, the folds equal those of scikit-learn's `StratifiedKFold`.
    """
    numbers, different = np.unique(copies, return_index=True)
    splitter = StratifiedKFold(folds, shuffle=True, random_state=random_state)
    tests = (test for _, test in splitter.split(different, labels[different]))
    held_out = [np.isin(copies, numbers[test]) for test in tests]
    return [(np.flatnonzero(~test), np.flatnonzero(test)) for test in held_out]


def grouped_split(table: FeatureTable, columns: Sequence[str]) -> Split:
    """Return a leave-one-group-out split.

    A group contains all trials that have equal values in the columns. If a trial is a copy of a
    trial in an earlier group, it is tested with that group.

    Raises EvaluationError when there is only one group, or when a class occurs in only one group.
    Raises DatasetError when there is no such column.
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
            f'all trials have the same {name}{" or are copies" * bool(several)}: no group can be '
            'held out'
        )
    for label in np.unique(table.labels):
        if len(np.unique(groups[table.labels == label])) < 2:
            raise EvaluationError(
                f'all trials of class "{label}" have the same {name}: if it is held out, '
                'no training trial of the class remains'
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
    """Return a split with one fold, from masks of the training and test trials.

    In messages, ``train_is`` and ``test_is`` describe the trials. Raises EvaluationError if a
    trial or a copy of it is in both masks, a class occurs only in ``test``, or ``train`` contains
    only one class.
    """
    both = np.flatnonzero(train & test)
    if len(both):
        raise EvaluationError(
            f'{len(both)} trials are in both the training trials ({train_is}) and the test trials '
            f'({test_is})'
        )
    leaked = train & np.isin(table.copies, table.copies[test])
    if leaked.any():
        raise EvaluationError(
            f'{leaked.sum()} trials with {train_is} are copies of trials with {test_is}, such as '
            f'trial {leaked.argmax()}: exclude one trial of each pair'
        )
    known = np.unique(table.labels[train])
    new = np.setdiff1d(table.labels[test], known)
    if len(new):
        raise EvaluationError(
            f'class "{new[0]}" has trials with {test_is}, but no training trials with {train_is}: '
            'add some, or leave the class out of the test'
        )
    if len(known) < 2:
        raise EvaluationError(
            f'all trials with {train_is} are of one class: choose at least two classes'
        )
    fold = (np.flatnonzero(train), np.flatnonzero(test))
    name = f'trained on {train_is} ({train.sum()} trials), tested on {test_is}'
    return _checked(Split(name, ((fold,),), copies=table.copies))


def _check_classes(table: FeatureTable) -> None:
    classes = np.unique(table.labels)
    if len(classes) < 2:
        raise EvaluationError(f'there is only one class, "{classes[0]}": record at least two')


def _checked(split: Split) -> Split:
    _check_training_size([fold for folds in split.repeats for fold in folds])
    return split


def _check_training_size(folds: Sequence[Fold]) -> None:
    smallest = min(len(train) for train, _ in folds)
    if smallest < LEAST_TO_TRAIN:
        raise EvaluationError(
            f'a fold has only {smallest} training trials; at least three are needed'
        )
