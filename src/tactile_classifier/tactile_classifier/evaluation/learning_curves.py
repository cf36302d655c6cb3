# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy against the number of trials that were trained on."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import Fold, Split
from tactile_classifier.estimators.classifiers import CLASSIFIERS, RANDOM_STATE, SCALINGS
from tactile_classifier.evaluation.cross_validation import check_folds, list_pairs
from tactile_classifier.evaluation.plans import Task
from tactile_classifier.evaluation.results import Result

_FEWEST = 2  # of each class: three neighbours need three trials, and there are two classes


@dataclasses.dataclass(frozen=True)
class LearningCurve(Result):
    """Accuracy of one classifier with one scaling with fewer trials to train on.

    Attributes
    ----------
    split : str
        How the trials were divided, in words.
    trials_per_class : tuple of int
        Trials of each class in the training.
    accuracies : ndarray of shape (sizes, folds)
        On the whole of each fold's, or group's, held-out trials [1].
    """

    classifier: str
    scaling: str
    split: str
    trials_per_class: tuple[int, ...]
    accuracies: npt.NDArray[np.float64]

    def to_dict(self) -> dict[str, Any]:
        """Return the fields and the means by name as what JSON can hold."""
        return {**super().to_dict(), 'mean': self.accuracies.mean(axis=1).tolist()}


class LearningPlan:
    """Learning curves of a table under one split; a `Plan` of a tuple of `LearningCurve`.

    Each fold's training trials are thinned out to as many of each class, drawn at random
    and the same for all classifiers; a larger choice holds the smaller ones. The tests stay
    as they are, so held-out groups remain whole.

    Parameters
    ----------
    table : FeatureTable
    split : Split
        Of which the first repetition is used.
    classifiers, scalings : sequence of str
    random_state : int
    """

    def __init__(
        self,
        table: FeatureTable,
        split: Split,
        classifiers: Sequence[str] = CLASSIFIERS,
        scalings: Sequence[str] = SCALINGS,
        random_state: int = RANDOM_STATE,
    ) -> None:
        self._table = table
        self._split = split.once()
        self._pairs = list_pairs(table, classifiers, scalings)
        (self._folds,) = self._split.repeats
        self._drawn = [
            draw_training(table.labels, train, np.random.default_rng([random_state, i]))
            for i, (train, _) in enumerate(self._folds)
        ]
        self.trials_per_class = choose_sizes(min(map(len, self._drawn)))

    def tasks(self) -> list[Task]:
        """Return one task a classifier, scaling and size."""
        table = self._table
        tasks: list[Task] = []
        for pair in self._pairs:
            for size in self.trials_per_class:
                folds: list[Fold] = [
                    (np.sort(drawn[:size].ravel()), test)
                    for drawn, (_, test) in zip(self._drawn, self._folds, strict=True)
                ]
                tasks.append((check_folds, (*pair, table.values, table.labels, folds)))
        return tasks

    def finish(self, answers: Sequence[list[npt.NDArray[np.bool_]]]) -> tuple[LearningCurve, ...]:
        """Return one curve a classifier and scaling."""
        sizes = len(self.trials_per_class)
        means = [[right.mean() for right in folds] for folds in answers]
        return tuple(
            LearningCurve(
                *pair,
                self._split.name,
                self.trials_per_class,
                np.array(means[i * sizes : (i + 1) * sizes]),
            )
            for i, pair in enumerate(self._pairs)
        )


def draw_training(
    labels: npt.NDArray[np.str_], train: npt.NDArray[np.intp], generator: np.random.Generator
) -> npt.NDArray[np.intp]:
    """Return trials of ``train`` in random order, shape (fewest of a class, classes)."""
    mixed = generator.permutation(train)
    of_class = [mixed[labels[mixed] == label] for label in np.unique(labels[train])]
    fewest = min(map(len, of_class))
    return np.stack([trials[:fewest] for trials in of_class], axis=1)


def choose_sizes(most: int) -> tuple[int, ...]:
    """Return the numbers of trials a class: doubling from 2, and ``most`` itself."""
    doubling = (_FEWEST * 2**i for i in range(most.bit_length()))
    # The last step would be a short one where the next doubling lies just below ``most``.
    sizes = [size for size in doubling if size <= most / 1.25]
    return (*sizes, most) if most >= _FEWEST else ()
