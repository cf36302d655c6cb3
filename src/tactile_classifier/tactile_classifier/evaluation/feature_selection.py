# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy with only the features of the lowest mean rank-sum p (section IV).

The ranking and the number of features kept are chosen on the training trials of each fold
alone: chosen on all trials, they would have seen those of the test.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.conditions import find_strata
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import Fold, Split
from tactile_classifier.estimators.classifiers import RANDOM_STATE
from tactile_classifier.evaluation.cross_validation import (
    find_tested_cells,
    list_pairs,
    predict_folds,
    split_parts,
)
from tactile_classifier.evaluation.intervals import (
    difference_interval,
    difference_p_value,
    Interval,
    LEVEL,
    Result,
)
from tactile_classifier.evaluation.plans import Task
from tactile_classifier.evaluation.significance import correct_holm, rank_features
from tactile_classifier.records import CLASSIFIERS, SCALINGS

Matrix = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class SelectionResult(Result):
    """One classifier with all features, and with those selected inside each fold.

    ``chosen_counts`` are the features kept in each fold, ``all_mean`` and ``selected_mean`` the
    accuracies [1], ``difference`` the second less the first, paired over trials or held-out
    groups. ``p`` is the p-value of no difference, corrected by Holm for all classifiers and
    scalings of the split.
    """

    classifier: str
    scaling: str
    split: str
    chosen_counts: tuple[int, ...]
    all_mean: float
    selected_mean: float
    difference: Interval
    p: float

    @property
    def verdict(self) -> str:
        """``helps`` or ``hurts`` where ``p`` is at most 5 %; else ``no clear difference``."""
        if self.p > 1.0 - LEVEL:
            return 'no clear difference'
        return 'helps' if self.difference.low + self.difference.high > 0 else 'hurts'

    def to_dict(self) -> dict[str, Any]:
        """Return the fields and the verdict by name as what JSON can hold."""
        return {**super().to_dict(), 'verdict': self.verdict}


class SelectionPlan:
    """The comparison under one split; a `Plan` of a tuple of `SelectionResult`.

    The table has two features or more; of the split the first repetition is used.
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
        self._inner = [
            self._split.divide_again(train, table.labels, random_state) for train, _ in self._folds
        ]
        self.counts = choose_counts(table.values.shape[1])

    def tasks(self) -> list[Task]:
        """Return one task a fold."""
        table, strata = self._table, find_strata(self._table)
        return [
            (
                compare_selection,
                (self._pairs, table.values, table.labels, fold, inner, self.counts, strata),
            )
            for fold, inner in zip(self._folds, self._inner, strict=True)
        ]

    def finish(self, answers: Sequence[list[FoldSelection]]) -> tuple[SelectionResult, ...]:
        """Return one result a classifier and scaling."""
        cells = find_tested_cells(self._table, self._split)
        results, p_values = [], []
        for i, (classifier, scaling) in enumerate(self._pairs):
            folds = [answer[i] for answer in answers]
            gain = np.zeros(len(self._table))
            for (_, test), fold in zip(self._folds, folds, strict=True):
                gain[test] = fold.selected_right - fold.all_right
            parts = split_parts(self._split, cells, gain)
            p_values.append(difference_p_value(*parts))
            results.append(
                SelectionResult(
                    classifier,
                    scaling,
                    self._split.name,
                    tuple(fold.count for fold in folds),
                    float(np.mean([fold.all_right.mean() for fold in folds])),
                    float(np.mean([fold.selected_right.mean() for fold in folds])),
                    difference_interval(*parts),
                    p_values[-1],
                )
            )
        corrected = correct_holm(p_values).tolist()
        return tuple(
            dataclasses.replace(result, p=p) for result, p in zip(results, corrected, strict=True)
        )


@dataclasses.dataclass(frozen=True)
class FoldSelection:
    """One fold of one classifier: the features kept, and which tests were right (1 or 0)."""

    count: int
    all_right: Matrix
    selected_right: Matrix


def choose_counts(features: int) -> tuple[int, ...]:
    """Return the numbers of features to choose from: a twentieth to half, doubling, and all."""
    doubling = (1, 2, 5, 10, 20, 40, 80, 160, 320, 640)
    most = features - 1 if features < 10 else 0.6 * features
    return (*(count for count in doubling if features / 20 <= count <= most), features)


def compare_selection(
    pairs: Sequence[tuple[str, str]],
    values: npt.NDArray[np.float64],
    labels: npt.NDArray[np.str_],
    fold: Fold,
    inner: Sequence[Fold],
    counts: Sequence[int],
    strata: npt.NDArray[np.intp] | None = None,
) -> list[FoldSelection]:
    """Return what selection does in one fold, for each classifier and scaling.

    The count with the best accuracy over the inner folds is kept, the smallest of the best.
    """
    train, _ = fold
    strata = np.zeros(len(labels), dtype=np.intp) if strata is None else strata
    ranked, *inner_ranked = (
        rank_features(values[part], labels[part], strata[part])
        for part in (train, *(some for some, _ in inner))
    )

    def is_right(pair: tuple[str, str], columns: npt.NDArray[np.intp], part: Fold) -> Matrix:
        chosen = np.ascontiguousarray(values[:, columns])
        (said,) = predict_folds(*pair, chosen, labels, [part])
        return np.asarray(said == labels[part[1]], dtype=np.float64)

    results = []
    for pair in pairs:
        right_counts = [
            sum(
                is_right(pair, order[:count], part).sum()
                for order, part in zip(inner_ranked, inner, strict=True)
            )
            for count in counts
        ]
        best = counts[int(np.argmax(right_counts))]
        everything = np.arange(values.shape[1])
        right = (is_right(pair, columns, fold) for columns in (everything, ranked[:best]))
        results.append(FoldSelection(best, *right))
    return results
