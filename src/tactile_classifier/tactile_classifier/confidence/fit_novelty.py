# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fitting of the novelty measure to training trials, and choice of its metric."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses

import numpy as np
import numpy.typing as npt
from sklearn.covariance import ledoit_wolf

from tactile_classifier.confidence.novelty import (
    Matrix,
    METRICS,
    NEAREST_TO_ALL,
    NoveltyMeasure,
    RELATIVE,
    WHITENED,
)
from tactile_classifier.datasets.dataset import divide_groups

Indices = npt.NDArray[np.intp]

MOST_FEATURES = 400
"""Most features for which each left-out label has a covariance of its own, and `RELATIVE` is
compared: its time grows with their third power."""


def fit_measure(
    values: Matrix,
    labels: npt.NDArray[np.str_],
    fold: Indices,
    metric: str = METRICS[0],
    spaces: Spaces | None = None,
) -> NoveltyMeasure:
    """Return the measure for training trials of shape (trials, k).

    A feature that never varies within a label does not count. ``fold`` is that of each trial,
    such as its session. ``spaces`` are fitted to the same trials, or to these and more.
    """
    classes, owner = np.unique(labels, return_inverse=True)
    spaces = spaces or Spaces.fit(values, labels, fold)
    rows = values - spaces.centre
    whitened = rows @ spaces.within
    factors = spaces.scaled if metric == 'scaled' else spaces.plain
    references = whitened if metric in (WHITENED, RELATIVE) else rows * factors
    each = [owner == i for i in range(len(classes))]
    scales = [_median_distance(references[one], fold[one]) for one in each]
    means = np.stack([whitened[one].mean(axis=0) for one in each])
    return NoveltyMeasure(
        metric,
        spaces.centre,
        factors,
        references,
        np.array(scales)[owner],
        spaces.within,
        spaces.total,
        means,
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Spaces:
    """Transforms of features, from training trials; see `NoveltyMeasure` and `METRICS`."""

    centre: Matrix
    plain: Matrix
    scaled: Matrix
    within: Matrix
    total: Matrix

    @classmethod
    def fit(cls, values: Matrix, labels: npt.NDArray[np.str_], fold: Indices) -> Spaces:
        """Return the transforms for trials of shape (trials, k).

        With two folds a measure that holds out one of them knows no difference between folds, so
        that of all trials may not know it either: the spread is within a label and a fold.
        """
        owner = np.unique(labels, return_inverse=True)[1]
        if len(np.unique(fold)) == 2:
            crossed = divide_groups(owner, fold)
            owner = crossed if np.bincount(crossed).max() > 1 else owner
        counts = np.bincount(owner)
        means = np.stack([values[owner == i].mean(axis=0) for i in range(len(counts))])
        is_repeated = counts[owner] > 1
        unbiased = np.sqrt(counts / np.maximum(counts - 1, 1))[owner, np.newaxis]
        residuals = ((values - means[owner]) * unbiased)[is_repeated]
        centre = values.mean(axis=0)
        if not len(residuals):  # one trial a label: nothing is known of the spread within it
            residuals = values - centre
        spread = np.sqrt((residuals**2).mean(axis=0))
        # Rounding of the mean is no spread.
        varies = spread > 1e-12 * np.abs(values).max(axis=0)
        scale = np.divide(1.0, spread, out=np.zeros_like(spread), where=varies)
        within = _whiten(residuals, scale)
        total = _whiten(values - centre, scale)
        return cls(centre, varies.astype(np.float64), scale, within, total)


def _multiply(squares: Matrix, scale: Matrix, to_label: Matrix, to_all: Matrix) -> Matrix:
    """Return the novelty of `NoveltyMeasure` from squared distances of many windows."""
    nearest = squares.argmin(axis=1)
    distance = np.sqrt(squares[np.arange(len(squares)), nearest]) / scale[nearest]
    return np.asarray(distance * np.sqrt(to_label / np.maximum(to_all, NEAREST_TO_ALL)))


def _relate(to_label: Matrix, to_all: Matrix, features: int) -> Matrix:
    """Return the novelty of the metric `RELATIVE` from squared distances of many windows."""
    excess = (to_label - to_all) / (2 * features)
    return np.asarray(excess + np.sqrt(1.0 + excess**2))


def _squares(rows: Matrix, references: Matrix) -> Matrix:
    squares = (rows**2).sum(axis=1)[:, np.newaxis] + (references**2).sum(axis=1)
    squares -= 2.0 * rows @ references.T
    return np.asarray(np.maximum(squares, 0.0))


def fit_spaces(
    values: Matrix, labels: npt.NDArray[np.str_], fold: Indices
) -> Mapping[int, Spaces]:
    """Return the spaces of the trials outside of each fold, by fold."""
    return {
        int(i): Spaces.fit(values[fold != i], labels[fold != i], fold[fold != i])
        for i in np.unique(fold)
    }


def choose_metric(
    values: Matrix,
    labels: npt.NDArray[np.str_],
    fold: Indices,
    spaces: Mapping[int, Spaces] | None = None,
) -> str:
    """Return the metric that best tells trials of one label when it is left out.

    Folds of the training are held out in turn, and in each every label once has no training
    trials. The first of `METRICS` is kept unless another has a larger area under the receiver
    operating characteristic, by more than one standard error over the labels. ``spaces`` are
    those of `fit_spaces`, if they are there already.
    """
    classes = np.unique(labels)
    is_small = values.shape[1] <= MOST_FEATURES
    metrics = METRICS if is_small else METRICS[:-1]
    areas: dict[str, list[list[float]]] = {m: [[] for _ in classes] for m in metrics}
    for i in np.unique(fold):
        inside, outside = fold != i, fold == i
        for label, novelty in _leave_labels_out(
            *(values[inside], labels[inside], fold[inside], values[outside], metrics),
            spaces=None if spaces is None else spaces[int(i)],
        ):
            is_new = labels[outside] == label
            if is_new.any() and not is_new.all():
                for metric, found in areas.items():
                    area = compute_auroc(is_new, novelty[metric])
                    found[int(np.searchsorted(classes, label))].append(area)
    means = {m: np.array([np.mean(each) for each in found if each]) for m, found in areas.items()}
    count = len(means[METRICS[0]])
    if count < 2:
        return METRICS[0]
    best = max(metrics, key=lambda metric: means[metric].mean())
    gain = means[best] - means[METRICS[0]]
    return best if gain.mean() > gain.std(ddof=1) / np.sqrt(count) else METRICS[0]


def _leave_labels_out(
    values: Matrix,
    labels: npt.NDArray[np.str_],
    fold: Indices,
    windows: Matrix,
    metrics: Sequence[str],
    spaces: Spaces | None = None,
) -> Iterator[tuple[str, dict[str, Matrix]]]:
    """Yield each label of a training, and the novelties of windows by metric without its trials.

    The covariance within labels keeps them: it is about the same for all.
    """
    classes = np.unique(labels)
    if len(classes) < 2:
        return
    spaces = spaces or Spaces.fit(values, labels, fold)
    measures = {m: fit_measure(values, labels, fold, m, spaces) for m in metrics if m != RELATIVE}
    rows = windows - spaces.centre
    squares = {
        m: _squares(
            rows @ spaces.within if m == WHITENED else rows * measure.factors, measure.references
        )
        for m, measure in measures.items()
    }
    to_labels = _squares(rows @ spaces.within, measures[METRICS[0]].means)
    for label in classes:
        known = labels != label
        to_label = to_labels[:, classes != label].min(axis=1)
        total, centre = spaces.total, spaces.centre
        if RELATIVE in metrics:
            centre = values[known].mean(axis=0)
            total = _whiten(values[known] - centre, spaces.scaled)
        to_all = (((windows - centre) @ total) ** 2).sum(axis=1)
        novelty = {
            m: _multiply(squares[m][:, known], measure.scale[known], to_label, to_all)
            for m, measure in measures.items()
        }
        if RELATIVE in metrics:
            novelty[RELATIVE] = _relate(to_label, to_all, values.shape[1])
        yield str(label), novelty


def compute_auroc(is_new: npt.NDArray[np.bool_], novelty: Matrix) -> float:
    """Return the area under the receiver operating characteristic [1].

    The share of pairs in which the new trial has the higher novelty; an equal pair counts half.
    """
    known, new = np.sort(novelty[~is_new]), novelty[is_new]
    ranks = np.searchsorted(known, new) + np.searchsorted(known, new, side='right')
    return float(ranks.sum() / (2 * len(known) * len(new)))


def _whiten(residuals: Matrix, scale: Matrix) -> Matrix:
    """Return the matrix to the space in which the shrunk covariance of residuals is one."""
    counts = scale > 0.0
    transform = np.zeros((len(scale), len(scale)))
    if counts.any():
        scaled = residuals[:, counts] * scale[counts]
        size, directions = np.linalg.eigh(ledoit_wolf(scaled, assume_centered=True)[0])
        transform[np.ix_(counts, counts)] = scale[counts, np.newaxis] * directions / np.sqrt(size)
    return transform


def _median_distance(references: Matrix, fold: Indices) -> float:
    """Return the median distance to the nearest of another fold, or of all; 1 of equal trials."""
    distance = np.sqrt(_squares(references, references))
    same = fold[:, np.newaxis] == fold
    distance[np.eye(len(fold), dtype=bool) if same.all() else same] = np.inf
    nearest = distance.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    median = float(np.median(nearest)) if len(nearest) else 0.0
    return median if median > 0.0 else 1.0
