# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy with only the most significant features, by mean rank-sum p (section IV).

In each fold, the ranking and the number of features are chosen on the training trials only, so the
choice does not use test trials.
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
from tactile_classifier.types import CLASSIFIERS, SCALINGS

Matrix = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class SelectionResult(Result):
    """Comparison of a classifier with all features, and with selected features.

    ``chosen_counts`` contains the number of selected features in each fold. ``all_mean`` and
    ``selected_mean`` are the accuracies with all and with selected features [1]. ``difference`` is
    the interval of ``selected_mean`` minus ``all_mean``, paired over trials or held-out groups.
    ``p`` is the p-value of the hypothesis that there is no difference, with Holm's correction for
    all classifiers and scalings of the split.
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
        """``helps`` or ``hurts`` if ``p`` is at most 5 %; otherwise ``no clear difference``."""
        if self.p > 1.0 - LEVEL:
            return 'no clear difference'
        return 'helps' if self.difference.low + self.difference.high > 0 else 'hurts'

    def to_dict(self) -> dict[str, Any]:
        """Return the fields and the verdict as a dictionary for JSON."""
        return {**super().to_dict(), 'verdict': self.verdict}


class SelectionPlan:
    """`Plan` of the comparison for one split; its result is a tuple of `SelectionResult`.

    The table must have at least two features. Only the first repetition of the split is used.
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
        """Return one task per fold."""
        table, strata = self._table, find_strata(self._table)
        return [
            (
                compare_selection,
                (self._pairs, table.values, table.labels, fold, inner, self.counts, strata),
            )
            for fold, inner in zip(self._folds, self._inner, strict=True)
        ]

    def finish(self, answers: Sequence[list[FoldSelection]]) -> tuple[SelectionResult, ...]:
        """Return one result per classifier and scaling."""
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
    """One fold of a classifier: number of selected features, and correct predictions (1 or 0)."""

    count: int
    all_right: Matrix
    selected_right: Matrix


def choose_counts(features: int) -> tuple[int, ...]:
    """Return the candidate numbers of features: from a twentieth to half, doubling, and all."""
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
    """Compare all features with selected features in one fold, for each classifier and scaling.

    The number of features with the best accuracy over the inner folds is used. If several numbers
    have the same accuracy, the smallest is used. A number is no longer tested once it cannot
    become better than a smaller one.
    """
    train, _ = fold
    strata = np.zeros(len(labels), dtype=np.intp) if strata is None else strata
    ranked, *inner_ranked = (
        rank_features(values[part], labels[part], strata[part])
        for part in (train, *(some for some, _ in inner))
    )

    def find_right(
        of_pairs: Sequence[int], columns: npt.NDArray[np.intp], part: Fold
    ) -> list[Matrix]:
        chosen = np.ascontiguousarray(values[:, columns])
        found = predict_folds([pairs[i] for i in of_pairs], chosen, labels, [part])
        return [np.asarray(said == labels[part[1]], dtype=np.float64) for (said,) in found]

    every_pair = range(len(pairs))
    most_right, best = np.full(len(pairs), -1.0), np.zeros(len(pairs), dtype=np.intp)
    for count in counts:
        right, open_pairs = np.zeros(len(pairs)), list(every_pair)
        left = sum(len(held_out) for _, held_out in inner)
        for order, part in zip(inner_ranked, inner, strict=True):
            open_pairs = [i for i in open_pairs if right[i] + left > most_right[i]]
            if open_pairs:
                found = find_right(open_pairs, order[:count], part)
                right[open_pairs] += [each.sum() for each in found]
            left -= len(part[1])
        for i in open_pairs:
            if right[i] > most_right[i]:
                most_right[i], best[i] = right[i], count
    all_right = find_right(every_pair, np.arange(values.shape[1]), fold)
    selected_right = dict[int, Matrix]()
    for count in np.unique(best):
        of_count = np.flatnonzero(best == count).tolist()
        found = find_right(of_count, ranked[:count], fold)
        selected_right.update(zip(of_count, found, strict=True))
    return [FoldSelection(int(best[i]), all_right[i], selected_right[i]) for i in every_pair]
