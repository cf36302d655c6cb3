# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Cross-validated accuracy: repeated stratified folds, or groups held out in turn."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed
from sklearn.model_selection import LeaveOneGroupOut, StratifiedKFold

from tactile_classifier.dataset import FeatureTable
from tactile_classifier.errors import EvaluationError
from tactile_classifier.estimators import CLASSIFIERS, RANDOM_STATE, SCALINGS, build_estimator

Fold = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]


@dataclasses.dataclass(frozen=True)
class Score:
    """How well one classifier with one scaling did under one split.

    Attributes
    ----------
    split : str
        How the trials were divided, in words.
    fold_accuracies : ndarray of shape (repetitions, folds)
        Share of the held-out trials that were named correctly [1].
    mean : float
        Mean of ``fold_accuracies`` [1].
    spread : float
        Standard deviation of what ``spread_of`` says [1].
    spread_of : str
        ``repetitions`` (of their mean accuracies) or ``groups`` (held out in turn).
    confusion : ndarray of int, shape (labels, labels)
        Counts over all repetitions; row: true label, column: answer.
    """

    classifier: str
    scaling: str
    split: str
    labels: tuple[str, ...]
    fold_accuracies: npt.NDArray[np.float64]
    mean: float
    spread: float
    spread_of: str
    confusion: npt.NDArray[np.int64]

    def to_dict(self) -> dict[str, Any]:
        """Return the score as what JSON can hold."""
        return {
            'classifier': self.classifier,
            'scaling': self.scaling,
            'split': self.split,
            'labels': list(self.labels),
            'fold_accuracies': self.fold_accuracies.tolist(),
            'mean': self.mean,
            'spread': self.spread,
            'spread_of': self.spread_of,
            'confusion': self.confusion.tolist(),
        }


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """The scores of several classifiers and scalings under one split.

    Attributes
    ----------
    chance : float
        Accuracy of always naming the commonest label [1].
    """

    split: str
    labels: tuple[str, ...]
    trials: int
    feature_set: str
    chance: float
    scores: tuple[Score, ...]

    def score(self, classifier: str, scaling: str) -> Score:
        """Return the score of one classifier with one scaling; KeyError when not evaluated."""
        for score in self.scores:
            if (score.classifier, score.scaling) == (classifier, scaling):
                return score
        raise KeyError(f'{classifier} with scaling {scaling} was not evaluated')

    def to_dict(self) -> dict[str, Any]:
        """Return the evaluation as what JSON can hold."""
        return {
            'split': self.split,
            'labels': list(self.labels),
            'trials': self.trials,
            'feature_set': self.feature_set,
            'chance': self.chance,
            'scores': [score.to_dict() for score in self.scores],
        }


def evaluate(
    table: FeatureTable,
    classifiers: Sequence[str] = CLASSIFIERS,
    scalings: Sequence[str] = SCALINGS,
    *,
    folds: int = 6,
    repetitions: int = 10,
    hold_out: Sequence[str] = (),
    random_state: int = RANDOM_STATE,
    jobs: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Evaluation:
    """Cross-validate classifiers on a table of features.

    The scaling is fitted inside each fold. The same arguments give the same result,
    whatever ``jobs``.

    Parameters
    ----------
    table : FeatureTable
    classifiers, scalings : sequence of str
        All their combinations are evaluated.
    folds, repetitions : int
        Stratified folds, and how often the trials are dealt anew.
    hold_out : sequence of str
        Columns. When given, each group of trials that agree in all of them is held
        out once, and ``folds`` and ``repetitions`` do not apply.
    jobs : int
        Processes to share the work.
    progress : callable
        ``progress(done, total)`` after each part of the work.

    Raises
    ------
    EvaluationError
        When the trials do not allow the split.
    """
    classes, counts = np.unique(table.labels, return_counts=True)
    if len(classes) < 2:
        raise EvaluationError(f'there is one class only, "{classes[0]}": nothing to tell apart')
    if hold_out:
        split, deals = _groups(table, hold_out)
    else:
        split, deals = _deals(table, folds, repetitions, random_state)
    smallest = min(len(train) for deal in deals for train, _ in deal)
    if smallest < 3:
        raise EvaluationError(
            f'{smallest} trials would be left to train on; three neighbours need three'
        )

    pairs = [(classifier, scaling) for classifier in classifiers for scaling in scalings]
    for pair in pairs:
        build_estimator(*pair)  # a wrong name fails here, not in a worker
    tasks = [(pair, deal) for pair in pairs for deal in deals]
    answers = []
    work = (delayed(_predict_deal)(*pair, table, deal) for pair, deal in tasks)
    for answer in Parallel(n_jobs=jobs, return_as='generator')(work):
        answers.append(answer)
        progress(len(answers), len(tasks))

    labels = tuple(str(name) for name in classes)
    scores = []
    for i, (classifier, scaling) in enumerate(pairs):
        predicted = answers[i * len(deals) : (i + 1) * len(deals)]
        accuracies, confusion = _count(table.labels, classes, deals, predicted)
        spread_of = 'groups' if hold_out else 'repetitions'
        parts = accuracies[0] if hold_out else accuracies.mean(axis=1)
        scores.append(
            Score(
                classifier,
                scaling,
                split,
                labels,
                accuracies,
                float(accuracies.mean()),
                float(parts.std(ddof=1)) if len(parts) > 1 else 0.0,
                spread_of,
                confusion,
            )
        )
    return Evaluation(
        split,
        labels,
        len(table),
        table.spec.feature_set,
        float(counts.max() / counts.sum()),
        tuple(scores),
    )


def _deals(
    table: FeatureTable, folds: int, repetitions: int, random_state: int
) -> tuple[str, list[list[Fold]]]:
    """Return the split's name and, for each repetition, its folds."""
    if folds < 2 or repetitions < 1:
        raise EvaluationError('cross-validation takes two folds or more, once or more often')
    for name, count in zip(*np.unique(table.labels, return_counts=True), strict=True):
        if count < folds:
            raise EvaluationError(
                f'class "{name}" has {count} trials, fewer than the {folds} folds: '
                'record more of it, leave it out, or use fewer folds'
            )
    deals = [
        list(
            StratifiedKFold(folds, shuffle=True, random_state=random_state + i).split(
                table.values, table.labels
            )
        )
        for i in range(repetitions)
    ]
    return f'stratified {folds}-fold, {repetitions} times', deals


def _groups(table: FeatureTable, hold_out: Sequence[str]) -> tuple[str, list[list[Fold]]]:
    """Return the split's name and its folds, one for each group held out."""
    name = ' and '.join(hold_out)
    groups = np.zeros(len(table), dtype=np.intp)
    for column in hold_out:
        codes = np.unique(table.column(column), return_inverse=True)[1]
        groups = np.unique(groups * (codes.max() + 1) + codes, return_inverse=True)[1]
    if groups.max() < 1:
        raise EvaluationError(f'all trials have the same {name}: there is nothing to hold out')
    for label in np.unique(table.labels):
        if len(np.unique(groups[table.labels == label])) < 2:
            raise EvaluationError(
                f'all trials of class "{label}" have the same {name}: with that held out, '
                'no model can know the class'
            )
    folds = list(LeaveOneGroupOut().split(table.values, table.labels, groups))
    return f'one {name} held out', [folds]


def _predict_deal(
    classifier: str, scaling: str, table: FeatureTable, deal: list[Fold]
) -> list[npt.NDArray[Any]]:
    answers = []
    for train, test in deal:
        estimator = build_estimator(classifier, scaling)
        estimator.fit(table.values[train], table.labels[train])
        answers.append(estimator.predict(table.values[test]))
    return answers


def _count(
    true: npt.NDArray[Any],
    classes: npt.NDArray[Any],
    deals: list[list[Fold]],
    predicted: list[list[npt.NDArray[Any]]],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    accuracies = np.zeros((len(deals), len(deals[0])))
    confusion = np.zeros((len(classes), len(classes)), dtype=np.int64)
    for i, (deal, answers) in enumerate(zip(deals, predicted, strict=True)):
        for j, ((_, test), answer) in enumerate(zip(deal, answers, strict=True)):
            accuracies[i, j] = np.mean(answer == true[test])
            rows, columns = (np.searchsorted(classes, y) for y in (true[test], answer))
            np.add.at(confusion, (rows, columns), 1)
    return accuracies, confusion
