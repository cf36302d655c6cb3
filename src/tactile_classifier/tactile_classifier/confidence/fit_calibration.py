# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of probabilities and of the novelty threshold on held-out trials.

Trials of one session share a mounting, so a session is held out as a whole wherever
the table has two or more of them.
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
from tactile_classifier.confidence.fit_novelty import compute_auroc, fit_measure
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
from tactile_classifier.records import VOTES

MAX_FOLDS = 6
"""The most folds that trials or sessions are divided into, wherever so few will do."""

BOUNDS = ((1e-3, 1e3), (0.0, 50.0))
"""Slope, over the spread of the scores, and offset of a calibration."""

PRECISE = {'ftol': 1e-14, 'gtol': 1e-8}

RANDOM = 'stratified'
"""First word of the name of random folds over single trials."""

BINS = 10
"""Bins of the expected calibration error."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclasses.dataclass(frozen=True, eq=False)
class GroupFolds:
    """Folds of whole groups, such as sessions, of repeats or of single trials; held out in turn.

    ``split`` names them in words. ``fold`` is the fold of each trial, and ``session`` its group,
    shapes (trials,); None when folds are of repeats or of single trials. ``names`` are the names
    of the groups; none without groups.
    """

    split: str
    fold: Indices
    session: Indices | None
    names: tuple[str, ...] = ()

    @property
    def groups(self) -> int:
        """Number of groups; 0 when folds are of repeats or of single trials."""
        return len(self.names)

    def divide(self, novelty: Matrix) -> HeldOutNovelty:
        """Return the novelties of held-out trials, shape (trials,), by session."""
        return HeldOutNovelty.divide(novelty, self.session, self.names)

    def take(self, keep: npt.NDArray[np.bool_]) -> GroupFolds:
        """Return the folds of some of the trials."""
        session = None if self.session is None else self.session[keep]
        return dataclasses.replace(self, fold=self.fold[keep], session=session)


def make_group_folds(table: FeatureTable, columns: Sequence[str] = ('session_id',)) -> GroupFolds:
    """Return folds of whole groups where each label comes in two groups or more, else of trials.

    Trials that agree in all columns are one group; columns that the table lacks do not count; no
    columns: single trials. The groups of each label are spread over the folds, so that a model
    fitted on the other folds knows every label of the one that is held out. Trials without groups
    are near copies where conditions were repeated (`find_cells`): those of a condition stay in one
    fold, and so do copies (`find_copies`). Raises TooFewTrialsError when a label has one trial
    only.
    """
    codes = np.unique(table.labels, return_inverse=True)[1]
    if (folds := _hold_groups_out(table, codes, columns)) is not None:
        return folds
    cells = find_cells(table) if columns else None
    if cells and (folds := _hold_groups_out(table, codes, cells.columns)) is not None:
        return dataclasses.replace(folds, session=None, names=())
    labels, counts = count_different(table.labels, table.copies)
    if counts.min() < 2:
        raise TooFewTrialsError(f'label "{labels[counts.argmin()]}" has one trial only')
    count = min(MAX_FOLDS, int(counts.min()))
    fold = np.zeros(len(table), dtype=np.intp)
    folds_of_trials = divide_stratified(table.labels, table.copies, count, RANDOM_STATE)
    for i, (_, held_out) in enumerate(folds_of_trials):
        fold[held_out] = i
    return GroupFolds(f'{RANDOM} {count}-fold over trials', fold, None)


def _hold_groups_out(
    table: FeatureTable, codes: Indices, columns: Sequence[str]
) -> GroupFolds | None:
    """Return folds of whole groups; None where all trials of a label, by ``codes``, are in one."""
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
    """Return the fold of each group, so that no label has all its groups in one fold.

    Groups are assigned one by one, those with the most labels first, each to the fold with the
    fewest groups of its labels. ``contains``, shape (groups, labels), has each label in two groups
    or more.
    """
    groups, labels = contains.shape
    folds = min(MAX_FOLDS, groups)
    fold = np.zeros(groups, dtype=np.intp)
    size = np.zeros(folds, dtype=np.intp)
    count = np.zeros((folds, labels), dtype=np.intp)
    # Of names, only the order among groups of the same labels matters.
    for i in sorted(range(groups), key=lambda i: (-contains[i].sum(), *~contains[i], i)):
        same = count[:, contains[i]]
        only_here = (same > 0) & (same == same.sum(axis=0))
        fold[i] = np.lexsort((size, same.sum(axis=1), only_here.sum(axis=1)))[0]
        size[fold[i]] += 1
        count[fold[i], contains[i]] += 1
    if ((count > 0).sum(axis=0) > 1).all():
        return fold
    # Labels so interwoven that so few folds do not keep them apart: each group on its own.
    return np.arange(groups)


def score_held_out(
    table: FeatureTable,
    held_out: npt.NDArray[np.bool_],
    classifier: str,
    scaling: str,
    parameters: Mapping[str, Any] | None = None,
) -> tuple[Matrix, Indices]:
    """Return raw scores of some trials by a model of the others, and the true labels' columns.

    ``parameters`` are those of `build_estimator`.
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
    """Return raw scores by models of the other folds, shape (trials, labels), and true columns."""
    classes, true = np.unique(table.labels, return_inverse=True)
    scores = np.zeros((len(table), len(classes)))
    for i in np.unique(fold):
        scores[fold == i], _ = score_held_out(table, fold == i, classifier, scaling, parameters)
    return scores, true


def hold_out_novelty(
    table: FeatureTable, fold: Indices, known: npt.NDArray[np.bool_] | slice = slice(None)
) -> Matrix:
    """Return novelties, shape (trials,), by measures fitted on the known trials of other folds.

    Of two folds a measure of one knows no distances between folds; it takes the scales of the
    measure of all known trials, which are such distances.
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
    """Return the measure fitted to all trials, and the novelties of held-out trials.

    This is not split conformal prediction: each fold has a measure of its own. The measure of all
    has more references, so that novelties of new trials are lower rather than higher.
    """
    novelty = hold_out_novelty(table, folds.fold)
    return fit_measure(table.values, table.labels, folds.fold), folds.divide(novelty)


@dataclasses.dataclass(frozen=True)
class UnlearnedLabels:
    """Rejection of labels that were left out of the training, one after another.

    ``auroc`` is the probability that a trial of such a label is more novel than one of a known
    label. ``miss_rate`` and ``strict_miss_rate`` are the shares of their trials that get a known
    name, by the default and by the strict threshold [1].
    """

    labels: int
    auroc: float
    miss_rate: float
    strict_miss_rate: float


def leave_labels_out(
    table: FeatureTable, folds: GroupFolds, false_alarm_rate: float
) -> UnlearnedLabels | None:
    """Return what a model without one of the labels would make of it, for each label in turn.

    None where fewer than two labels would be left, or too few trials for the rate.
    """
    missed: list[list[float]] = []
    areas = []
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
        areas += [
            compute_auroc(is_new[part], novelty[part])
            for part in (folds.fold == i for i in np.unique(folds.fold))
            if is_new[part].any() and not is_new[part].all()
        ]
    auroc = float(np.mean(areas)) if areas else -1.0
    return UnlearnedLabels(len(labels), auroc, *map(float, np.mean(missed, axis=0)))


def fit_calibration(scores: Matrix, true: Indices) -> Calibration:
    """Return the map under which held-out labels are likeliest.

    Scores have shape (trials, labels); ``true`` are positions, shape (trials,). One imagined
    miss, as in Platt's targets, keeps a classifier that made none from claiming certainty. The
    scores are divided by their spread first, so that their unit does not count. The loss is convex
    in slope and offset.
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
    """Return the expected calibration error of the answers [1].

    The distance between the share of right answers and their mean probability, in ten bins of
    equal width of that probability, as a mean over the trials (Naeini et al. 2015). Probabilities
    have shape (trials, labels); ``true`` are positions, shape (trials,).
    """
    return binned_error(probabilities.max(axis=1), probabilities.argmax(axis=1) == true)


def binned_error(stated: Matrix, is_right: npt.NDArray[np.bool_]) -> float:
    """Return the expected calibration error of stated probabilities, both of shape (trials,)."""
    surplus = np.bincount(find_bins(stated), stated - is_right, BINS)
    return float(np.abs(surplus).sum() / len(stated))


def find_bins(stated: Matrix) -> Indices:
    """Return the bin of each probability, from 0 to `BINS` - 1."""
    return np.asarray(np.minimum((stated * BINS).astype(np.intp), BINS - 1))


def compute_uncalibrated(scores: Matrix, score_kind: str) -> Matrix:
    """Return what raw scores pass for without calibration: votes as they are, or a softmax."""
    return scores if score_kind == VOTES else Calibration(1.0, 0.0).compute(scores)


def hold_out_probabilities(scores: Matrix, true: Indices, fold: Indices) -> Matrix:
    """Return probabilities by maps that were fitted on the held-out scores of the other folds."""
    probabilities = np.zeros(scores.shape)
    for i in np.unique(fold):
        others = fit_calibration(scores[fold != i], true[fold != i])
        probabilities[fold == i] = others.compute(scores[fold == i])
    return probabilities


@dataclasses.dataclass(frozen=True)
class Surplus:
    """Mean probability of the answers minus their accuracy, over sessions that were held out.

    ``mean`` and ``half_width`` of the 95 % interval (Student's t over the sessions) [1].
    """

    mean: float
    half_width: float


def measure_surplus(
    probabilities: Matrix, true: Indices, session: Indices | None
) -> Surplus | None:
    """Return by how much probabilities are too large; None with fewer than two sessions."""
    if session is None or session.max() < 1:
        return None
    stated = probabilities.max(axis=1) - (probabilities.argmax(axis=1) == true)
    means = np.bincount(session, stated) / np.bincount(session)
    error = means.std(ddof=1) / np.sqrt(len(means))
    return Surplus(float(means.mean()), float(error * student_t.ppf(0.975, len(means) - 1)))


@dataclasses.dataclass(frozen=True, eq=False)
class HeldOutCalibration:
    """Probabilities and novelty of a model, from trials that were held out.

    ``calibration`` is fitted to all held-out scores, ``novelty`` to all trials; the threshold
    comes from ``held_out_novelty``, by measures of the other folds. The errors are expected
    calibration errors before and after calibration [1]. ``accuracy`` is the share of held-out
    trials whose answer is their label [1]. ``surplus`` is the stated probability minus the
    accuracy by session.
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
    """Hold out each fold in turn; return the calibration, the threshold and their errors.

    With ``strict`` the threshold is the strict one of `HeldOutNovelty.compute_threshold`;
    ``parameters`` are those of `build_estimator`. Raises
    TooFewTrialsError when there are too few for the rate, or for the classifier.
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
