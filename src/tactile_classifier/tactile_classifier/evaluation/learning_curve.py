# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Learning curve: accuracy against the number of training sessions, or other groups."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.dataset import FeatureTable, plain_name
from tactile_classifier.datasets.splits import Fold, grouped_split, LEAST_TO_TRAIN
from tactile_classifier.errors import EvaluationError
from tactile_classifier.estimators.classifiers import RANDOM_STATE
from tactile_classifier.evaluation.cross_validation import predict_permuted
from tactile_classifier.evaluation.intervals import (
    accuracy_interval,
    difference_interval,
    Interval,
    Result,
)

MOST_POINTS = 6
"""Largest number of points of a curve."""

MOST_FITS = 150
"""Largest number of trained models. It may be exceeded, because each test group and point needs at
least one model."""

MOST_DRAWS = 10
"""Largest number of random choices of training groups for each test group and point."""

SMALL_GAIN = 0.02
"""Smallest increase of accuracy that justifies more recordings [1]."""


@dataclasses.dataclass(frozen=True)
class LearningPoint(Result):
    """Accuracy on held-out groups of models that are trained on ``groups`` groups of each label.

    ``trials`` is the mean number of training trials, ``mean`` the mean accuracy over the held-out
    groups [1].
    """

    groups: int
    trials: float
    mean: float
    interval: Interval


@dataclasses.dataclass(frozen=True)
class LearningCurve(Result):
    """Accuracy of one classifier against the number of training groups.

    Attributes
    ----------
    group : str
        Name of the groups, such as ``session``.
    points : tuple of LearningPoint
        Points by increasing number of groups. The last point uses all groups except the tested
        one.
    half : int
        Number of groups of the point with which the last point is compared: at most half of the
        groups of the last point, if there is such a point.
    gain : float
        Accuracy of the last point minus accuracy of the point with ``half`` groups [1].
    gain_interval : Interval
        Paired 95 % interval of the gain over the tested groups.
    """

    classifier: str
    scaling: str
    split: str
    group: str
    points: tuple[LearningPoint, ...]
    half: int
    gain: float
    gain_interval: Interval

    @property
    def needs_more(self) -> bool | None:
        """True if more groups will probably increase the accuracy; None if this is unknown."""
        if self.gain_interval.reason:
            return None if self.gain else False
        if self.gain_interval.low > 0.0:
            return True
        return False if self.gain_interval.high < SMALL_GAIN else None

    def to_dict(self) -> dict[str, Any]:
        """Return the fields and ``needs_more`` as a dictionary for JSON."""
        return {**super().to_dict(), 'needs_more': self.needs_more}


def measure_learning_curve(
    table: FeatureTable,
    columns: Sequence[str],
    classifier: str,
    scaling: str,
    random_state: int = RANDOM_STATE,
) -> LearningCurve:
    """Return the learning curve of one classifier.

    Each group is tested once. The training groups are drawn at random from the other groups. For
    each label, these are the first n groups in a random order that contain the label. If each
    group contains all labels, the same n groups are used for all labels. In contrast, the
    function ``learning_curve`` of scikit-learn draws trials instead of groups.

    Parameters
    ----------
    columns : sequence of str
        Columns that define the groups: trials with equal values in them form a group.

    Raises
    ------
    EvaluationError
        If there are fewer than three groups of some label, or groups cannot be held out.
    """
    group = ' and '.join(map(plain_name, columns))
    split = grouped_split(table, columns)
    assert split.groups is not None
    tests = [test for _, test in split.repeats[0]]
    folds = _draw(table.labels, split.groups, tests, group, random_state)
    labels = table.labels
    drawn = [fold for by_group in folds.values() for draws in by_group for fold in draws]
    (answers,) = predict_permuted(classifier, scaling, table, [labels], drawn)
    right = iter(
        float(np.mean(said == labels[test]))
        for (_, test), said in zip(drawn, answers, strict=True)
    )
    shares = dict[int, npt.NDArray[np.float64]]()
    points = list[LearningPoint]()
    for count, by_group in folds.items():
        share = np.array([np.mean([next(right) for _ in draws]) for draws in by_group])
        trials = np.mean([len(train) for draws in by_group for train, _ in draws])
        interval = accuracy_interval(share, 'groups')
        points.append(LearningPoint(count, float(trials), float(share.mean()), interval))
        shares[count] = share
    counts = list(shares)
    half = max((n for n in counts if 2 * n <= counts[-1]), default=counts[0])
    gains = shares[counts[-1]] - shares[half]
    return LearningCurve(
        classifier,
        scaling,
        split.name,
        group,
        tuple(points),
        half,
        float(gains.mean()),
        difference_interval(gains, 'groups'),
    )


def _draw(
    labels: npt.NDArray[np.str_],
    groups: npt.NDArray[np.intp],
    tests: Sequence[npt.NDArray[np.intp]],
    name: str,
    random_state: int,
) -> dict[int, list[list[Fold]]]:
    """Return a dictionary from the number of training groups to the folds.

    For each tested group, there is a list with the distinct folds of all random draws.
    """
    names, codes = np.unique(labels, return_inverse=True)
    contains = np.zeros((groups.max() + 1, len(names)), dtype=bool)
    contains[groups, codes] = True
    groups_of = contains.sum(axis=0)
    most = int(groups_of.min()) - 1
    if most < 2:
        raise EvaluationError(
            f'label "{names[groups_of.argmin()]}" has trials in {groups_of.min()} groups '
            f'({name}); three are needed, one to test and two to train on'
        )
    counts: Sequence[int] = range(1, most + 1)
    if most > MOST_POINTS:
        counts = sorted({round(n) for n in np.geomspace(1, most, MOST_POINTS)})
    draws = max(1, min(MOST_DRAWS, MOST_FITS // (len(tests) * len(counts))))
    rng = np.random.default_rng(random_state)
    folds: dict[int, list[list[Fold]]] = {count: [] for count in counts}
    for test in tests:
        # All counts use the same order, so that larger choices contain the smaller ones.
        orders = [rng.permutation(len(contains)) for _ in range(draws)]
        for count, by_group in folds.items():
            found = dict[bytes, Fold]()
            for order in orders:
                order = order[order != groups[test[0]]]
                is_chosen = np.zeros_like(contains)
                for code in range(len(names)):
                    is_chosen[order[contains[order, code]][:count], code] = True
                train = np.flatnonzero(is_chosen[groups, codes])
                found[train.tobytes()] = (train, test)
            by_group.append(list(found.values()))
    possible = {
        count: by_group
        for count, by_group in folds.items()
        if min(len(train) for draws in by_group for train, _ in draws) >= LEAST_TO_TRAIN
    }
    if len(possible) < 2:
        raise EvaluationError(
            f'one group ({name}) has fewer than {LEAST_TO_TRAIN} trials to train on'
        )
    return possible
