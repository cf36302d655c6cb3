# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy on permuted labels, with the same folds as the accuracy that is compared with it."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import Split
from tactile_classifier.estimators.classifiers import RANDOM_STATE
from tactile_classifier.evaluation.cross_validation import Answers, predict_permuted
from tactile_classifier.evaluation.intervals import Result

PERMUTATIONS = 20


@dataclasses.dataclass(frozen=True)
class PermutationBaseline(Result):
    """Accuracy of a classifier on permuted labels.

    ``mean`` and ``largest`` are the mean and the largest accuracy over the permutations [1].
    ``p_value`` is the fraction of permutations that reach the accuracy on the true labels [1]. The
    true labels count as one permutation (Phipson and Smyth 2010).
    """

    classifier: str
    scaling: str
    split: str
    permutations: int
    mean: float
    largest: float
    p_value: float


def measure_permutation(
    table: FeatureTable,
    split: Split,
    classifier: str,
    scaling: str,
    random_state: int = RANDOM_STATE,
) -> PermutationBaseline:
    """Return the baseline of one classifier, with the first repetition of a split.

    Labels are permuted within the held-out groups, as in scikit-learn's
    ``permutation_test_score``, so each group keeps its number of trials of each label. If each
    group has only one label, see `permute_labels`.
    """
    split = split.once()
    (folds,) = split.repeats
    groups = np.zeros(len(table), dtype=np.intp) if split.groups is None else split.groups
    rng = np.random.default_rng(random_state)
    permuted_labels = [permute_labels(table.labels, groups, rng) for _ in range(PERMUTATIONS)]
    labelings = [table.labels, *permuted_labels]
    answers = predict_permuted(classifier, scaling, table, labelings, folds)

    def measure(labels: npt.NDArray[np.str_], said: Answers) -> float:
        each = zip(folds, said, strict=True)
        return float(np.mean([np.mean(of_fold == labels[test]) for (_, test), of_fold in each]))

    true, *permuted = map(measure, labelings, answers)
    reached = sum(each >= true - 1e-9 for each in permuted)
    return PermutationBaseline(
        classifier,
        scaling,
        split.name,
        PERMUTATIONS,
        float(np.mean(permuted)),
        max(permuted),
        (1 + reached) / (1 + PERMUTATIONS),
    )


def permute_labels(
    labels: npt.NDArray[np.str_], groups: npt.NDArray[np.intp], rng: np.random.Generator
) -> npt.NDArray[np.str_]:
    """Return the labels, permuted within each group.

    If each group has only one label, as specimens have, there is nothing to permute within groups.
    In this case, the labels of the groups are permuted.
    """
    first = np.unique(groups, return_index=True)[1]
    if len(first) > 1 and (labels[first][groups] == labels).all():
        return np.asarray(rng.permutation(labels[first])[groups])
    permuted = labels.copy()
    for group in range(len(first)):
        rows = np.flatnonzero(groups == group)
        permuted[rows] = labels[rng.permutation(rows)]
    return permuted
