# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of probabilities and of the novelty threshold on held-out trials.

Trials of one session share a mounting, and are therefore similar. If each label occurs in at least
two sessions, whole sessions are held out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from scipy.stats import t as student_t

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.fit_novelty import fit_measure
from tactile_classifier.confidence.held_out_novelty import HeldOutNovelty
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.datasets.conditions import find_cells
from tactile_classifier.datasets.dataset import divide_groups, FeatureTable
from tactile_classifier.datasets.splits import count_different, divide_stratified
from tactile_classifier.errors import TooFewTrialsError
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    compute_raw_scores,
    RANDOM_STATE,
    SCORE_KINDS,
)
from tactile_classifier.types import VOTES

MAX_FOLDS = 6
"""Maximum number of folds, unless the groups of trials cannot be divided into so few folds."""

BOUNDS = ((1e-3, 1e3), (0.0, 50.0))
"""Bounds of the slope and of the offset of a calibration. The slope is for scores that were
divided by their spread."""

PRECISE = {'ftol': 1e-14, 'gtol': 1e-8}

RANDOM = 'stratified'
"""First word of the name of a split with random folds of single trials, not of groups."""

BINS = 10
"""Number of bins of the expected calibration error."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclasses.dataclass(frozen=True, eq=False)
class GroupFolds:
    """Folds that hold out whole groups of trials, such as sessions, or single trials.

    Attributes
    ----------
    split : str
        Description of the split.
    fold : ndarray of int, shape (trials,)
        Fold of each trial.
    session : ndarray of int, shape (trials,), or None
        Group of each trial. None if the folds are random, or if the groups are repeated
        conditions.
    names : tuple of str
        Names of the groups; empty if ``session`` is None.
    """

    split: str
    fold: Indices
    session: Indices | None
    names: tuple[str, ...] = ()

    @property
    def groups(self) -> int:
        """Number of groups; 0 if ``session`` is None."""
        return len(self.names)

    def divide(self, novelty: Matrix) -> HeldOutNovelty:
        """Divide the novelties of held-out trials, shape (trials,), by session."""
        if self.session is None:
            return HeldOutNovelty((novelty,))
        found = np.unique(self.session)
        parts = tuple(novelty[self.session == i] for i in found)
        return HeldOutNovelty(parts, tuple(self.names[i] for i in found))

    def take(self, keep: npt.NDArray[np.bool_]) -> GroupFolds:
        """Return the folds of a subset of the trials."""
        session = None if self.session is None else self.session[keep]
        return dataclasses.replace(self, fold=self.fold[keep], session=session)


def make_group_folds(table: FeatureTable, columns: Sequence[str] = ('session_id',)) -> GroupFolds:
    """Return folds that hold out whole groups of trials, or random folds if that is impossible.

    Trials that have equal values in all ``columns`` form a group; columns that the table does not
    have are ignored. Groups are held out if each label occurs in at least two of them. If not, the
    trials of each repeated condition (`find_cells`) are used as groups, under the same rule. The
    groups of each label are distributed over several folds, so that a model that is fitted to the
    other folds knows every label of the held-out fold.

    If neither is possible, or ``columns`` is empty, the folds are random and stratified by label.
    Copies (`find_copies`) always stay in one fold. Raises TooFewTrialsError if a label has only
    one trial.
    """
    codes = np.unique(table.labels, return_inverse=True)[1]
    if (folds := _hold_groups_out(table, codes, columns)) is not None:
        return folds
    cells = find_cells(table) if columns else None
    if cells and (folds := _hold_groups_out(table, codes, cells.columns)) is not None:
        return dataclasses.replace(folds, session=None, names=())
    labels, counts = count_different(table.labels, table.copies)
    if counts.min() < 2:
        raise TooFewTrialsError(f'label "{labels[counts.argmin()]}" has only one trial')
    count = min(MAX_FOLDS, int(counts.min()))
    fold = np.zeros(len(table), dtype=np.intp)
    folds_of_trials = divide_stratified(table.labels, table.copies, count, RANDOM_STATE)
    for i, (_, held_out) in enumerate(folds_of_trials):
        fold[held_out] = i
    return GroupFolds(f'{RANDOM} {count}-fold over trials', fold, None)


def _hold_groups_out(
    table: FeatureTable, codes: Indices, columns: Sequence[str]
) -> GroupFolds | None:
    """Return folds that hold out whole groups, or None if a label occurs in only one group.

    ``codes`` contains the index of the label of each trial.
    """
    group: Indices = np.zeros(len(table), dtype=np.intp)
    for column in columns:
        if column in table.columns:
            group = divide_groups(group, table.columns[column])
    group = np.unique(group[table.copies], return_inverse=True)[1]
    groups = int(group.max()) + 1
    contains = np.zeros((groups, int(codes.max()) + 1), dtype=bool)
    contains[group, codes] = True
    if not (contains.sum(axis=0) > 1).all():
        return None
    fold_of_group = _spread(contains)
    count = int(fold_of_group.max()) + 1
    name = ' and '.join(column.removesuffix('_id') for column in columns)
    words = f'one {name} held out' if groups == count else f'{name} held out in {count} folds'
    first = np.unique(group, return_index=True)[1]
    parts = [table.columns[column][first] for column in columns if column in table.columns]
    names = tuple(', '.join(map(str, values)) for values in zip(*parts, strict=True))
    return GroupFolds(words, fold_of_group[group], group, names)


def _spread(contains: npt.NDArray[np.bool_]) -> Indices:
    """Assign groups to folds so that no label has all its groups in one fold.

    Groups with the most labels are assigned first. Each group is assigned to the fold that has the
    fewest groups with the same labels. ``contains`` has shape (groups, labels); each label must
    occur in two or more groups.
    """
    groups, labels = contains.shape
    folds = min(MAX_FOLDS, groups)
    fold = np.zeros(groups, dtype=np.intp)
    size = np.zeros(folds, dtype=np.intp)
    count = np.zeros((folds, labels), dtype=np.intp)
    # Groups with the same labels are assigned in the order of their names.
    for i in sorted(range(groups), key=lambda i: (-contains[i].sum(), *~contains[i], i)):
        same = count[:, contains[i]]
        only_here = (same > 0) & (same == same.sum(axis=0))
        fold[i] = np.lexsort((size, same.sum(axis=1), only_here.sum(axis=1)))[0]
        size[fold[i]] += 1
        count[fold[i], contains[i]] += 1
    if ((count > 0).sum(axis=0) > 1).all():
        return fold
    # No assignment to this number of folds was found: use one fold for each group.
    return np.arange(groups)


def score_held_out(
    table: FeatureTable,
    held_out: npt.NDArray[np.bool_],
    classifier: str,
    scaling: str,
    parameters: Mapping[str, Any] | None = None,
) -> tuple[Matrix, Indices]:
    """Fit a model to the trials that are not held out; return raw scores of held-out trials.

    The scores have shape (held-out trials, labels). The second result is the column of each
    trial's true label. ``parameters`` is the argument of `build_estimator`.
    """
    train, test = table.take(~held_out), table.take(held_out)
    estimator = build_estimator(classifier, scaling, table.channels, parameters)
    estimator.fit(train.values, train.labels)
    true = np.searchsorted(estimator.classes_, test.labels)
    return compute_raw_scores(estimator, test.values), true


def hold_out_scores(
    table: FeatureTable,
    classifier: str,
    scaling: str,
    fold: Indices,
    parameters: Mapping[str, Any] | None = None,
) -> tuple[Matrix, Indices]:
    """Score each trial with a model that is fitted to the other folds.

    Returns the raw scores, shape (trials, labels), and the column of each true label.
    """
    classes, true = np.unique(table.labels, return_inverse=True)
    scores = np.zeros((len(table), len(classes)))
    for i in np.unique(fold):
        scores[fold == i], _ = score_held_out(table, fold == i, classifier, scaling, parameters)
    return scores, true


def hold_out_novelty(
    table: FeatureTable, fold: Indices, known: npt.NDArray[np.bool_] | slice = slice(None)
) -> Matrix:
    """Compute the novelty of each trial with a measure that is fitted to the other folds.

    The measures are fitted only to ``known`` trials. The novelties have shape (trials,). If there
    are two folds, each measure is fitted to one fold and has no distances between folds. In this
    case, it uses the scales of a measure that is fitted to all known trials.
    """
    novelty = np.zeros(len(table))
    values, labels, of_known = table.values[known], table.labels[known], fold[known]
    whole = fit_measure(values, labels, of_known) if len(np.unique(fold)) == 2 else None
    for i in np.unique(fold):
        inside = of_known != i
        measure = fit_measure(values[inside], labels[inside], of_known[inside])
        if whole is not None:
            measure = dataclasses.replace(measure, scales=whole.scales[:, inside])
        novelty[fold == i] = measure.compute(table.values[fold == i])
    return novelty


def fit_novelty(table: FeatureTable, folds: GroupFolds) -> tuple[NoveltyMeasure, HeldOutNovelty]:
    """Fit the novelty measure to all trials; compute the novelties of held-out trials.

    The novelties of held-out trials are computed with a separate measure for each fold, so this is
    not split conformal prediction. The measure that is fitted to all trials has more reference
    trials than the separate measures, so new trials tend to have lower novelties.
    """
    novelty = hold_out_novelty(table, folds.fold)
    return fit_measure(table.values, table.labels, folds.fold), folds.divide(novelty)


@dataclasses.dataclass(frozen=True)
class UnlearnedLabels:
    """Results of leaving one label at a time out of the training.

    ``labels`` is the number of labels. ``miss_rate`` and ``strict_miss_rate`` are the fractions of
    the trials of left-out labels that are not rejected by the default and by the strict threshold
    [1].
    """

    labels: int
    miss_rate: float
    strict_miss_rate: float


def leave_labels_out(
    table: FeatureTable, folds: GroupFolds, false_alarm_rate: float
) -> UnlearnedLabels | None:
    """Measure how well the trials of a label are rejected if the label was not in the training.

    Returns None if there are fewer than three labels, or too few trials for a threshold with this
    false alarm rate.
    """
    missed: list[list[float]] = []
    labels = np.unique(table.labels)
    if len(labels) < 3:
        return None
    for label in labels:
        is_new = table.labels == label
        novelty = hold_out_novelty(table, folds.fold, ~is_new)
        known = folds.take(~is_new).divide(novelty[~is_new])
        try:
            thresholds = [
                known.compute_threshold(false_alarm_rate, strict=strict)
                for strict in (False, True)
            ]
        except TooFewTrialsError:
            return None
        missed.append([float(np.mean(novelty[is_new] <= threshold)) for threshold in thresholds])
    return UnlearnedLabels(len(labels), *map(float, np.mean(missed, axis=0)))


def fit_calibration(scores: Matrix, true: Indices) -> Calibration:
    """Fit a calibration to the raw scores of held-out trials by maximum likelihood.

    The scores have shape (trials, labels); ``true`` contains the column of each true label, shape
    (trials,). As in Platt's targets, one fictitious error is added. A classifier without errors
    therefore does not reach probability 1. The scores are first divided by their spread, so that
    the result does not depend on their unit. The negative log-likelihood is convex in slope and
    offset.
    """
    trials, labels = scores.shape
    doubt = 1.0 / (trials + 2.0)
    target = np.full(scores.shape, doubt / (labels - 1))
    rows = np.arange(trials)
    target[rows, true] = 1.0 - doubt
    centred = scores - scores.mean(axis=1, keepdims=True)
    spread = float(np.sqrt((centred**2).mean())) or 1.0
    centred /= spread
    answer = scores.argmax(axis=1)

    def loss(parameters: Matrix) -> tuple[float, Matrix]:
        size = parameters[0] * centred
        size[rows, answer] += parameters[1]
        size -= size.max(axis=1, keepdims=True)
        logarithm = size - np.log(np.exp(size).sum(axis=1, keepdims=True))
        surplus = np.exp(logarithm) - target
        gradient = np.array([(surplus * centred).sum(), surplus[rows, answer].sum()])
        return float(-(target * logarithm).sum()), gradient

    found = minimize(
        loss, [1.0, 0.1], jac=True, method='L-BFGS-B', bounds=BOUNDS, options=PRECISE
    ).x
    return Calibration(float(found[0] / spread), float(found[1]))


def compute_calibration_error(probabilities: Matrix, true: Indices) -> float:
    """Compute the expected calibration error of the predictions [1].

    The trials are divided into ten bins of equal width by the probability of their predicted label
    (Naeini et al. 2015). The result is the mean absolute difference between accuracy and mean
    probability in each bin, weighted by the number of trials. The probabilities have shape
    (trials, labels); ``true`` contains the column of each true label, shape (trials,).
    """
    return binned_error(probabilities.max(axis=1), probabilities.argmax(axis=1) == true)


def binned_error(stated: Matrix, is_right: npt.NDArray[np.bool_]) -> float:
    """Compute the expected calibration error of stated probabilities [1].

    ``stated`` contains the probability of each predicted label, ``is_right`` whether the label is
    correct; both have shape (trials,).
    """
    surplus = np.bincount(find_bins(stated), stated - is_right, BINS)
    return float(np.abs(surplus).sum() / len(stated))


def find_bins(stated: Matrix) -> Indices:
    """Return the bin of each probability, from 0 to `BINS` - 1."""
    return np.asarray(np.minimum((stated * BINS).astype(np.intp), BINS - 1))


def compute_uncalibrated(scores: Matrix, score_kind: str) -> Matrix:
    """Return uncalibrated probabilities: vote fractions as they are, or the softmax of scores."""
    return scores if score_kind == VOTES else Calibration(1.0, 0.0).compute(scores)


def hold_out_probabilities(scores: Matrix, true: Indices, fold: Indices) -> Matrix:
    """Compute the probabilities of each fold with a calibration fitted to the other folds."""
    probabilities = np.zeros(scores.shape)
    for i in np.unique(fold):
        others = fit_calibration(scores[fold != i], true[fold != i])
        probabilities[fold == i] = others.compute(scores[fold == i])
    return probabilities


@dataclasses.dataclass(frozen=True)
class Surplus:
    """Mean probability of the predictions minus their accuracy, over held-out sessions.

    ``mean`` and ``half_width`` are the centre and half of the width of the 95 % interval
    (Student's t over the sessions) [1].
    """

    mean: float
    half_width: float


def measure_surplus(
    probabilities: Matrix, true: Indices, session: Indices | None
) -> Surplus | None:
    """Measure how much the probabilities exceed the accuracy.

    Returns None if there are fewer than two sessions.
    """
    if session is None or session.max() < 1:
        return None
    stated = probabilities.max(axis=1) - (probabilities.argmax(axis=1) == true)
    means = np.bincount(session, stated) / np.bincount(session)
    error = means.std(ddof=1) / np.sqrt(len(means))
    return Surplus(float(means.mean()), float(error * student_t.ppf(0.975, len(means) - 1)))


@dataclasses.dataclass(frozen=True, eq=False)
class HeldOutCalibration:
    """Calibration and novelty measure of a model, with their errors on held-out trials.

    ``calibration`` is fitted to all held-out scores, ``novelty`` to all trials. The threshold is
    computed from ``held_out_novelty``: the novelties of trials whose fold was held out when the
    measure was fitted. ``error_before`` and ``error_after`` are the expected calibration errors
    before and after calibration [1]. ``accuracy`` is the accuracy on held-out trials [1].
    ``surplus`` is the stated probability minus the accuracy, over the sessions; None if there are
    fewer than two sessions.
    """

    calibration: Calibration
    novelty: NoveltyMeasure
    novelty_threshold: float
    held_out_novelty: HeldOutNovelty
    error_before: float
    error_after: float
    accuracy: float
    surplus: Surplus | None


def calibrate_held_out(
    table: FeatureTable,
    classifier: str,
    scaling: str,
    folds: GroupFolds,
    false_alarm_rate: float,
    *,
    strict: bool = False,
    parameters: Mapping[str, Any] | None = None,
) -> HeldOutCalibration:
    """Fit the calibration and the novelty threshold on held-out folds, and measure their errors.

    If ``strict`` is True, the strict threshold of `HeldOutNovelty.compute_threshold` is used.
    ``parameters`` is the argument of `build_estimator`. Raises TooFewTrialsError when there are
    too few trials for the false alarm rate or for the classifier.
    """
    fold = folds.fold
    scores, true = hold_out_scores(table, classifier, scaling, fold, parameters)
    measure, novelty = fit_novelty(table, folds)
    probabilities = hold_out_probabilities(scores, true, fold)
    uncalibrated = compute_uncalibrated(scores, SCORE_KINDS[classifier])
    return HeldOutCalibration(
        calibration=fit_calibration(scores, true),
        novelty=measure,
        novelty_threshold=novelty.compute_threshold(false_alarm_rate, strict=strict),
        held_out_novelty=novelty,
        error_before=compute_calibration_error(uncalibrated, true),
        error_after=compute_calibration_error(probabilities, true),
        accuracy=float(np.mean(scores.argmax(axis=1) == true)),
        surplus=measure_surplus(probabilities, true, folds.session),
    )
