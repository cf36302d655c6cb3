# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cross-validated accuracy: repeated stratified folds, or each group held out once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.conditions import (
    Cells,
    cells_of_copies,
    describe_copies,
    find_cells,
    find_tied_labels,
)
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import (
    Fold,
    FOLDS,
    grouped_split,
    REPETITIONS,
    Split,
    stratified_split,
)
from tactile_classifier.estimators.classifiers import build_estimator, RANDOM_STATE
from tactile_classifier.evaluation.intervals import accuracy_interval, Interval, Result
from tactile_classifier.evaluation.plans import run_plans, Task
from tactile_classifier.types import ALL_CLASSIFIERS, CLASSIFIERS, ROCKET, SCALINGS

Answers = list[npt.NDArray[np.str_]]


@dataclasses.dataclass(frozen=True)
class Score(Result):
    """Accuracy of one classifier with one scaling for one split.

    Attributes
    ----------
    split : str
        Description of the split.
    fold_accuracies : ndarray of shape (repetitions, folds)
        Accuracy on the held-out trials of each fold [1].
    mean : float
        Mean of ``fold_accuracies`` [1].
    spread : float
        Standard deviation over the groups or repetitions in ``spread_of`` [1].
    spread_of : str
        ``repetitions``: the spread is over their mean accuracies. ``groups``: the spread is over
        the accuracies of the held-out groups.
    interval : Interval
        Interval of the mean. If groups are held out, it is over groups. Otherwise, it is over
        cells, which are trials under the same repeated condition, or over trials if no condition
        is repeated.
    confusion : ndarray of int, shape (labels, labels)
        Numbers of predictions over all repetitions. Rows are true labels, columns predictions.
    """

    classifier: str
    scaling: str
    split: str
    labels: tuple[str, ...]
    fold_accuracies: npt.NDArray[np.float64]
    mean: float
    spread: float
    spread_of: str
    interval: Interval
    confusion: npt.NDArray[np.int64]

    @property
    def recall(self) -> npt.NDArray[np.float64]:
        """Fraction of correct predictions for each label, shape (labels,) [1].

        NaN for a label that was not tested.
        """
        with np.errstate(invalid='ignore'):
            return np.asarray(np.diag(self.confusion) / self.confusion.sum(axis=1))

    @property
    def balanced_accuracy(self) -> float:
        """Mean recall of the labels that were tested [1]."""
        return float(np.nanmean(self.recall))

    def to_dict(self) -> dict[str, Any]:
        """Return the fields, the recall by label and the balanced accuracy for JSON."""
        recall = zip(self.labels, self.recall.tolist(), strict=True)
        return {
            **super().to_dict(),
            'recall': {label: share for label, share in recall if share == share},
            'balanced_accuracy': self.balanced_accuracy,
        }


@dataclasses.dataclass(frozen=True)
class Evaluation(Result):
    """Scores of several classifiers and scalings under one split.

    Attributes
    ----------
    chance : float
        Accuracy of always predicting the most frequent label [1].
    warnings : tuple of str
        Reasons why these numbers may be misleading, found in the table; one sentence each.
    """

    split: str
    labels: tuple[str, ...]
    trials: int
    feature_set: str
    chance: float
    scores: tuple[Score, ...]
    warnings: tuple[str, ...] = ()

    def score(self, classifier: str, scaling: str) -> Score:
        """Return the score of a classifier with a scaling; raise KeyError if not evaluated."""
        for score in self.scores:
            if (score.classifier, score.scaling) == (classifier, scaling):
                return score
        raise KeyError(f'{classifier} with scaling {scaling} was not evaluated')


class AccuracyPlan:
    """`Plan` that cross-validates a table with one split; its result is an `Evaluation`."""

    def __init__(
        self,
        table: FeatureTable,
        split: Split,
        classifiers: Sequence[str] | None = None,
        scalings: Sequence[str] = SCALINGS,
    ) -> None:
        self._table = table
        self._split = split
        self._pairs = list_pairs(table, classifiers, scalings)
        for pair in self._pairs:
            build_estimator(*pair)  # if a name is invalid, the error is raised here

    def tasks(self) -> list[Task]:
        """Return one task for each repetition."""
        table = self._table
        return [
            (predict_folds, (self._pairs, table.values, table.labels, folds, table.channels))
            for folds in self._split.repeats
        ]

    def finish(self, answers: Sequence[Sequence[Answers]]) -> Evaluation:
        """Return the scores computed from the predictions."""
        scores = [
            make_score(*pair, self._table, self._split, of_pair)
            for pair, of_pair in zip(self._pairs, zip(*answers, strict=True), strict=True)
        ]
        return make_evaluation(self._table, self._split, scores)


def make_evaluation(table: FeatureTable, split: Split, scores: Sequence[Score]) -> Evaluation:
    """Return the evaluation of several scores for one split, with chance level and warnings."""
    cells = find_tested_cells(table, split)
    is_random = split.groups is None and len(split.tested) == len(table)
    repeats = [cells.warning] if cells is not None and cells.columns and is_random else []
    return Evaluation(
        split.name,
        tuple(str(name) for name in np.unique(table.labels)),
        len(split.tested),
        table.spec.feature_set,
        chance_level(table, split),
        tuple(scores),
        (*describe_copies(table), *repeats, *find_tied_labels(table)),
    )


def make_score(
    classifier: str, scaling: str, table: FeatureTable, split: Split, answers: Sequence[Answers]
) -> Score:
    """Return the score of a classifier from its predictions in each repetition."""
    true = table.labels
    labels = tuple(str(name) for name in np.unique(true))
    accuracies = np.zeros((len(split.repeats), len(split.repeats[0])))
    confusion = np.zeros((len(labels), len(labels)), dtype=np.int64)
    rows = np.searchsorted(labels, true)
    right = np.zeros(len(true), dtype=np.int64)
    for i, (repeat, said) in enumerate(zip(split.repeats, answers, strict=True)):
        for j, ((_, test), answer) in enumerate(zip(repeat, said, strict=True)):
            is_right = answer == true[test]
            accuracies[i, j] = np.mean(is_right)
            right[test] += is_right
            np.add.at(confusion, (rows[test], np.searchsorted(labels, answer)), 1)
    parts = accuracies[0] if split.groups is not None else accuracies.mean(axis=1)
    return Score(
        classifier,
        scaling,
        split.name,
        labels,
        accuracies,
        float(accuracies.mean()),
        float(parts.std(ddof=1)) if len(parts) > 1 else 0.0,
        split.spread_of,
        split_interval(split, find_tested_cells(table, split), right / len(split.repeats)),
        confusion,
    )


def find_tested_cells(table: FeatureTable, split: Split) -> Cells | None:
    """Return groups of tested trials (cells) that repeat the same condition.

    If no condition is repeated, but there are copies, each cell contains a trial and its copies.
    Returns None if the split holds out groups, or if all trials are independent.
    """
    if split.groups is not None:
        return None
    tested = split.tested
    return find_cells(table.take(tested)) or cells_of_copies(table.copies[tested])


def chance_level(table: FeatureTable, split: Split) -> float:
    """Return the accuracy of always predicting the most frequent tested label [1]."""
    counts = np.unique(table.labels[split.tested], return_counts=True)[1]
    return float(counts.max() / counts.sum())


def split_interval(split: Split, cells: Cells | None, right: npt.NDArray[np.float64]) -> Interval:
    """Return the interval of a mean accuracy for a split; see `split_parts`."""
    return accuracy_interval(*split_parts(split, cells, right))


def split_parts(
    split: Split, cells: Cells | None, right: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], str, npt.NDArray[np.intp] | None]:
    """Return the independent parts of a mean accuracy, their name, and their trials.

    The parts are held-out groups, cells of repeats (`find_tested_cells`), or trials. The weights
    are the numbers of trials in the parts, or None for equal weights. ``right``, shape (trials,),
    is the fraction of correct predictions for each trial [1], or the difference of two
    classifiers.
    """
    if split.groups is not None:
        return np.array([right[test].mean() for _, test in split.repeats[0]]), 'groups', None
    if cells is not None:
        share, sizes = cells.average(right[split.tested])
        return share, 'groups of repeats', sizes
    return right[split.tested], 'trials', None


def evaluate(
    table: FeatureTable,
    classifiers: Sequence[str] | None = None,
    scalings: Sequence[str] = SCALINGS,
    *,
    folds: int = FOLDS,
    repetitions: int = REPETITIONS,
    hold_out: Sequence[str] = (),
    random_state: int = RANDOM_STATE,
    jobs: int | None = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Evaluation:
    """Cross-validate classifiers on a table of features.

    The result does not depend on ``jobs``.

    Parameters
    ----------
    table : FeatureTable
    classifiers, scalings : sequence of str
        All combinations are evaluated. Default: the combinations of `list_pairs`.
    folds, repetitions : int
        Number of stratified folds, and number of repetitions with other folds.
    hold_out : sequence of str
        Columns that define groups. If given, each group is held out once, and ``folds`` and
        ``repetitions`` are ignored.
    jobs : int or None
        Number of workers; -1 uses all cores.
    progress : callable
        Called as ``progress(done, total)`` after each part of the work.

    Raises
    ------
    EvaluationError
        If the split is impossible with these trials.
    """
    if hold_out:
        split = grouped_split(table, hold_out)
    else:
        split = stratified_split(table, folds, repetitions, random_state)
    plan = AccuracyPlan(table, split, classifiers, scalings)
    (evaluation,) = run_plans([plan], jobs, progress)
    assert isinstance(evaluation, Evaluation)
    return evaluation


def list_pairs(
    table: FeatureTable,
    classifiers: Sequence[str] | None = None,
    scalings: Sequence[str] = SCALINGS,
) -> list[tuple[str, str]]:
    """Return the pairs of classifier and scaling to evaluate for a table.

    The default is the four classifiers of the paper, and random convolutions for waveforms.
    """
    if classifiers is None:
        classifiers = ALL_CLASSIFIERS if table.is_waveform else CLASSIFIERS
    return [
        (classifier, scaling)
        for classifier in classifiers
        for scaling in (scalings if classifier != ROCKET else ('none',))
    ]


def predict_folds(
    pairs: Sequence[tuple[str, str]],
    values: npt.NDArray[np.float64],
    labels: npt.NDArray[np.str_],
    folds: Sequence[Fold],
    channels: int = 1,
) -> list[Answers]:
    """Fit classifiers to the training trials of each fold, and predict its test trials.

    Returns the predictions for each fold, for each pair of classifier and scaling. The pairs share
    the scaled features. A decision tree does not depend on scaling, so it is fitted once.
    """
    # scikit-learn checks integer labels faster than text.
    names, codes = np.unique(labels, return_inverse=True)
    answers: list[Answers] = [[] for _ in pairs]
    for train, test in folds:
        features = {'none': (values[train], values[test])}
        said = dict[tuple[str, str], npt.NDArray[np.str_]]()
        for (classifier, scaling), of_pair in zip(pairs, answers, strict=True):
            key = classifier, 'none' if classifier == 'tree' else scaling
            if key not in said:
                *scalers, machine = build_estimator(*key, channels)
                for scaler in scalers:
                    if scaling not in features:
                        fitted = scaler.fit(values[train])
                        features[scaling] = tuple(map(fitted.transform, features['none']))
                known, new = features[key[1]]
                said[key] = names[machine.fit(known, codes[train]).predict(new)]
            of_pair.append(said[key])
    return answers


def predict_permuted(
    classifier: str,
    scaling: str,
    table: FeatureTable,
    labelings: Sequence[npt.NDArray[np.str_]],
    folds: Sequence[Fold],
) -> list[Answers]:
    """Like `predict_folds`, with one classifier, for each of several arrays of labels.

    Random convolutions are fitted once to all trials, because they do not depend on the labels.
    """
    if classifier != ROCKET:
        pairs = [(classifier, scaling)]
        return [
            predict_folds(pairs, table.values, labels, folds, table.channels)[0]
            for labels in labelings
        ]
    machine = build_estimator(classifier, scaling, table.channels)[-1]
    by_fold = machine.predict_folds(table.values, labelings, folds)
    return [list(answers) for answers in zip(*by_fold, strict=True)]
