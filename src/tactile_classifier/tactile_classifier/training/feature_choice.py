# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Choice of the set of features and of the classifier inside the folds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
import dataclasses
import time
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import Fold, Split
from tactile_classifier.errors import ClassifierError, DatasetError, EvaluationError
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    default_scaling,
    RANDOM_STATE,
)
from tactile_classifier.evaluation.cross_validation import (
    chance_level,
    find_tested_cells,
    list_pairs,
    predict_folds,
    split_interval,
)
from tactile_classifier.evaluation.intervals import Interval, Result
from tactile_classifier.evaluation.plans import Task
from tactile_classifier.records import ROCKET

INNER_FOLDS, INNER_REPEATS = 6, 3
"""Folds inside a fold, and how often its training trials are divided anew: with three folds, once,
the choice on 60 trials was 6 points worse than the best set; docs/evaluation.md has the numbers.
"""

FEW_TRIALS = 'svm_linear'
"""The classifier where trials are too few to choose by, with its usual scaling."""

MANY_TRIALS = 300
"""More trials than these are divided once: more repetitions would change little."""


class Candidate(NamedTuple):
    """A set of features, and a classifier with its scaling."""

    feature_set: str
    classifier: str
    scaling: str


@dataclasses.dataclass(frozen=True)
class CandidateScore:
    """Accuracy of a candidate on the folds.

    ``accuracy`` is the mean over the folds [1]; of the best candidate it is too good on average.
    ``fold_s`` is the mean time to train and test a fold, without the features [s].
    """

    candidate: Candidate
    accuracy: float
    fold_s: float


@dataclasses.dataclass(frozen=True)
class FeatureChoice(Result):
    """The choice, and the candidates that it was made from.

    The ``ranking`` has all candidates, the best first; of equals the one that was named first.
    ``nested_accuracy``, with its ``interval``, is that when each fold's training trials choose
    [1]; ``picks`` are what the folds chose, and how many of them. ``chance`` is the accuracy of
    always naming the commonest label [1]. ``left_out`` has a sentence for each candidate that
    cannot be fitted.
    """

    split: str
    ranking: tuple[CandidateScore, ...]
    nested_accuracy: float
    interval: Interval
    chance: float
    picks: tuple[tuple[Candidate, int], ...]
    left_out: tuple[str, ...] = ()

    @property
    def best(self) -> CandidateScore:
        """The chosen candidate."""
        return self.ranking[0]

    def find_best(self, feature_set: str) -> CandidateScore | None:
        """Return the best candidate of a set of features; None where the set was none of them."""
        return next((s for s in self.ranking if s.candidate.feature_set == feature_set), None)

    def find_runner_up(self, chosen: Candidate) -> CandidateScore | None:
        """Return the best of another set than the chosen one, else of its other classifiers."""
        others = [s for s in self.ranking if s.candidate != chosen]
        elsewhere = [s for s in others if s.candidate.feature_set != chosen.feature_set]
        return next(iter(elsewhere or others), None)

    def summarise(self, chosen: Candidate) -> dict[str, Any]:
        """Return what a model file states of the choice."""
        score = next(s for s in self.ranking if s.candidate == chosen)
        summary: dict[str, Any] = {
            'candidates': len(self.ranking),
            'accuracy': self.nested_accuracy,
            'split': self.split,
        }
        other = self.find_runner_up(chosen)
        if other is not None:
            summary['runner_up'] = {
                **other.candidate._asdict(),
                'difference': other.accuracy - score.accuracy,
                'time_ratio': other.fold_s / score.fold_s,
            }
        return summary

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as what JSON can hold."""
        return {
            **super().to_dict(),
            'ranking': [
                {**s.candidate._asdict(), 'accuracy': s.accuracy, 'fold_s': s.fold_s}
                for s in self.ranking
            ],
            'picks': [{**c._asdict(), 'folds': count} for c, count in self.picks],
        }


class ChoicePlan:
    """The choice among tables of the same trials, by feature set; a `Plan` of a `FeatureChoice`.

    The choice is made by the folds of all repetitions. Folds inside each fold's training trials
    choose for that fold (nested cross-validation of the first repetition), which says how good it
    is.

    Of equally good tables the first is chosen, so cheap ones come first. ``random_state`` is that
    of the folds inside the folds; ``scaling`` the only one that is tried; empty: all. Where a
    fold's training trials cannot be divided once more, there is no choice: the only candidate is
    `FEW_TRIALS` on the first table, and ``no_choice`` says why. Raises DatasetError when tables
    are not of the same trials.
    """

    def __init__(
        self,
        tables: Mapping[str, FeatureTable],
        split: Split,
        random_state: int = RANDOM_STATE,
        scaling: str = '',
    ) -> None:
        self._tables, self._split = tables, split
        self._first = next(iter(tables.values()))
        for name, table in tables.items():
            if not np.array_equal(table.labels, self._first.labels):
                raise DatasetError(f'the table of {name} is not of the same trials')
        repeats = INNER_REPEATS if len(self._first) <= MANY_TRIALS else 1
        self._candidates = [
            Candidate(name, *pair)
            for name, table in tables.items()
            for pair in _list_pairs(table, scaling)
        ]
        self._inner: list[list[Fold]] = []
        self.no_choice = ''
        try:
            self._inner = [
                [
                    fold
                    for i in range(repeats)
                    for fold in split.divide_again(
                        train, self._first.labels, random_state + i, INNER_FOLDS
                    )
                ]
                for train, _ in split.repeats[0]
            ]
        except EvaluationError as error:
            usual = scaling or default_scaling(self._first.task, FEW_TRIALS)
            same = [c for c in self._candidates if c[1:] == (FEW_TRIALS, usual)]
            self._candidates = (same or self._candidates)[:1]
            self.no_choice = f'nothing is chosen: {error}'

    def tasks(self) -> list[Task]:
        """Return one task a candidate and fold."""
        folds = [fold for repeat in self._split.repeats for fold in repeat]
        inner = [*self._inner, *[[] for _ in folds[len(self._inner) :]]]
        return [
            (check_candidate, (candidate, self._tables[candidate.feature_set], fold, again))
            for candidate in self._candidates
            for fold, again in zip(folds, inner, strict=True)
        ]

    def finish(self, answers: Sequence[FoldAnswer]) -> FeatureChoice:
        """Return the choice."""
        split, candidates = self._split, self._candidates
        folds = split.repeats[0]
        size = len(answers) // len(candidates)
        of_candidate = [answers[i : i + size] for i in range(0, len(answers), size)]
        faults = [
            next((answer.fault for answer in found if answer.fault), '') for found in of_candidate
        ]
        left_out = tuple(
            f'{", ".join(candidate)} is left out: {fault}'
            for candidate, fault in zip(candidates, faults, strict=True)
            if fault
        )
        candidates = [c for c, fault in zip(candidates, faults, strict=True) if not fault]
        of_candidate = [a for a, fault in zip(of_candidate, faults, strict=True) if not fault]
        if not candidates:
            raise EvaluationError(f'no classifier can be fitted: {left_out[0]}')
        scores = [
            CandidateScore(
                candidate,
                float(np.mean([answer.right.mean() for answer in found])),
                float(np.mean([answer.time_s for answer in found])),
            )
            for candidate, found in zip(candidates, of_candidate, strict=True)
        ]
        picked = [
            int(np.argmax([found[i].inner_right for found in of_candidate]))
            for i in range(len(folds))
        ]
        named = np.zeros(len(self._first))
        for i, (pick, (_, test)) in enumerate(zip(picked, folds, strict=True)):
            named[test] = of_candidate[pick][i].right
        return FeatureChoice(
            split.once().name,
            tuple(sorted(scores, key=lambda score: -score.accuracy)),
            float(np.mean([named[test].mean() for _, test in folds])),
            split_interval(split, find_tested_cells(self._first, split), named),
            chance_level(self._first, split),
            tuple(Counter(candidates[pick] for pick in picked).most_common()),
            left_out,
        )


@dataclasses.dataclass(frozen=True)
class FoldAnswer:
    """One candidate in one fold: right tests, how many inside the training, the time [s].

    ``fault`` is why it cannot be fitted; empty: it can.
    """

    right: npt.NDArray[np.bool_]
    inner_right: int
    time_s: float
    fault: str = ''


def check_candidate(
    candidate: Candidate, table: FeatureTable, fold: Fold, inner: Sequence[Fold]
) -> FoldAnswer:
    """Return the answers of a candidate in one fold and in those inside it.

    Random convolutions are fitted once to the fold's training trials; the folds inside share them.
    A candidate that cannot be fitted has a ``fault``.
    """
    try:
        return _check(candidate, table, fold, inner)
    except (ClassifierError, ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        fault = str(error).partition('\n')[0]
        return FoldAnswer(np.zeros(len(fold[1]), dtype=bool), 0, 0.0, fault)


def _check(
    candidate: Candidate, table: FeatureTable, fold: Fold, inner: Sequence[Fold]
) -> FoldAnswer:
    train, test = fold
    pair = candidate.classifier, candidate.scaling
    start_s = time.perf_counter()
    estimator = build_estimator(*pair, table.channels)
    estimator.fit(table.values[train], table.labels[train])
    right = np.asarray(estimator.predict(table.values[test]) == table.labels[test])
    time_s = time.perf_counter() - start_s
    if candidate.classifier == ROCKET and inner:
        answers = estimator[-1].predict_folds(table.values, table.labels, inner)
    else:
        answers = predict_folds(*pair, table.values, table.labels, inner, table.channels)
    held_out = [table.labels[test] for _, test in inner]
    inner_right = sum(int(np.sum(a == b)) for a, b in zip(answers, held_out, strict=True))
    return FoldAnswer(right, inner_right, time_s)


def _list_pairs(table: FeatureTable, scaling: str) -> list[tuple[str, str]]:
    """Return classifiers and scalings; a tree compares, and so no scaling changes it.

    The four classifiers on a waveform itself take its samples for features of any order.
    """
    pairs = list_pairs(table, [ROCKET] if table.is_waveform else None)
    pairs = [pair for pair in pairs if pair != ('tree', 'standard')]
    return [pair for pair in pairs if scaling in ('', pair[1]) or pair[0] in ('tree', ROCKET)]
