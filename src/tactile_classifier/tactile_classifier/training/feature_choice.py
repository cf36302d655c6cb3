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
    Answers,
    Evaluation,
    list_pairs,
    make_evaluation,
    make_score,
    predict_folds,
    Score,
)
from tactile_classifier.evaluation.intervals import Result
from tactile_classifier.evaluation.plans import Task
from tactile_classifier.records import ROCKET
from tactile_features.feature_sets.registry import find_feature_set

INNER_FOLDS, INNER_REPEATS = 6, 3
"""Folds inside a fold, and how often its training trials are divided: with three folds, once,
the choice on 60 trials was 6 points worse than the best set; docs/evaluation.md has the numbers.
"""

FEW_TRIALS = 'svm_linear'
"""The classifier where trials are too few to choose by, with its usual scaling."""

MANY_TRIALS = 300
"""More trials than these are divided once: more repetitions would change little."""

ROUNDING = 1e-9
"""Difference of accuracies that is rounding."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


class Candidate(NamedTuple):
    """A set of features, and a classifier with its scaling."""

    feature_set: str
    classifier: str
    scaling: str


ROBUST = (
    (ROCKET, 'none'),
    ('knn', 'none'),
    ('svm_linear', 'standard'),
    ('svm_rbf', 'standard'),
    ('knn', 'standard'),
    ('tree', 'none'),
    ('svm_linear', 'none'),
    ('svm_rbf', 'none'),
)
"""Classifiers and scalings by robustness in new groups, the most robust one first.

Machines without scaling come last: they depend on the unit of force. With two training groups of
public and generated recordings, random convolutions were 6 points better on average than the
candidate with the best accuracy in these two groups.
"""

FEWEST_GROUPS = 3
"""With fewer held-out groups the most robust candidate is taken, whatever their accuracies."""


@dataclasses.dataclass(frozen=True)
class CandidateScore(Result):
    """Score of a candidate under the split that chose.

    Of the best candidate the score is too good on average. ``fold_s`` is the mean time to train
    and test a fold, without the features [s].
    """

    candidate: Candidate
    score: Score
    fold_s: float

    def to_dict(self) -> dict[str, Any]:
        """Return candidate, accuracy and time as what JSON can hold."""
        return {
            **self.candidate._asdict(),
            'accuracy': self.score.mean,
            'fold_s': self.fold_s,
        }


@dataclasses.dataclass(frozen=True)
class FeatureChoice(Result):
    """The choice, and the candidates that it was made from.

    Attributes
    ----------
    chosen : Candidate
    ranking : tuple of CandidateScore
        All candidates, the most accurate first.
    nested : Score
        Score of such a choice: the training trials of each fold choose for that fold (nested
        cross-validation; Varma and Simon 2006).
    evaluation : Evaluation
        Scores of the classifiers with the chosen set.
    picks : tuple of (Candidate, int)
        Choices inside the folds, and the number of folds of each.
    groups : int
        Held-out groups that chose; 0: random folds.
    left_out : tuple of str
        One sentence for each candidate that could not be fitted.
    """

    chosen: Candidate
    ranking: tuple[CandidateScore, ...]
    nested: Score
    evaluation: Evaluation
    picks: tuple[tuple[Candidate, int], ...]
    groups: int
    left_out: tuple[str, ...] = ()

    @property
    def has_few_groups(self) -> bool:
        """True where there are too few groups for a choice, inside the folds at least."""
        return 0 < self.groups <= FEWEST_GROUPS

    def find_score(self, candidate: Candidate) -> CandidateScore:
        """Return the score of a candidate."""
        return next(each for each in self.ranking if each.candidate == candidate)

    def find_runner_up(self) -> CandidateScore | None:
        """Return the best of another set than the chosen one, else of its other classifiers."""
        others = [each for each in self.ranking if each.candidate != self.chosen]
        elsewhere = [e for e in others if e.candidate.feature_set != self.chosen.feature_set]
        return next(iter(elsewhere or others), None)

    def summarise(self) -> dict[str, Any]:
        """Return what a model file states of the choice."""
        score = self.find_score(self.chosen)
        summary: dict[str, Any] = {
            'candidates': len(self.ranking),
            'groups': self.groups,
            'has_few_groups': self.has_few_groups,
        }
        other = self.find_runner_up()
        if other is not None:
            summary['runner_up'] = {
                **other.candidate._asdict(),
                'difference': other.score.mean - score.score.mean,
                'time_ratio': other.fold_s / score.fold_s,
            }
        return summary

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as what JSON can hold."""
        return {
            'chosen': self.chosen._asdict(),
            'ranking': [each.to_dict() for each in self.ranking],
            'nested': self.nested.to_dict(),
            'chance': self.evaluation.chance,
            'picks': [{**c._asdict(), 'folds': count} for c, count in self.picks],
            'groups': self.groups,
            'has_few_groups': self.has_few_groups,
        }


class ChoicePlan:
    """The choice among tables of the same trials, by feature set; a `Plan`.

    Its result is a tuple with one `FeatureChoice` a part. The choice is made by the folds of all
    repetitions. Folds inside each fold's training trials choose for that fold in the same way,
    which gives the nested score (first repetition). A candidate that is more robust (`ROBUST`) is
    preferred unless another is better by more than the standard error of their difference.
    Where the training trials of a random fold cannot be divided once more, there is no choice: the
    only candidate is `FEW_TRIALS` on the first table, and ``no_choice`` says why.

    Parameters
    ----------
    tables : mapping of str to FeatureTable
        Of tables with equally robust classifiers the first is preferred, so cheap ones come first.
    split : Split
        Of the trials of each table.
    random_state : int
        Seed of the folds inside the folds.
    scaling : str
        The only scaling that is tried; empty: all.
    parts : ndarray of int, shape (trials,), optional
        Trials of different parts, such as flexion and abduction, have models of their own, which
        share a candidate.

    Raises
    ------
    DatasetError
        When the tables are not of the same trials.
    EvaluationError
        When no candidate can be fitted (`finish`).
    """

    def __init__(
        self,
        tables: Mapping[str, FeatureTable],
        split: Split,
        random_state: int = RANDOM_STATE,
        scaling: str = '',
        parts: Indices | None = None,
    ) -> None:
        self._tables, self._split = tables, split
        self._first = next(iter(tables.values()))
        self._parts = np.zeros(len(self._first), dtype=np.intp) if parts is None else parts
        for name, table in tables.items():
            if not np.array_equal(table.labels, self._first.labels):
                raise DatasetError(f'the table of {name} is not of the same trials')
        repeats = INNER_REPEATS if len(self._first) <= MANY_TRIALS else 1
        self._candidates = [
            Candidate(name, *pair)
            for name, table in tables.items()
            for pair in _list_pairs(table, scaling)
        ]
        self._inner: list[list[Fold]] = [[] for _ in split.repeats[0]]
        self.no_choice = ''
        try:
            self._inner = [
                self._divide(train, repeats, random_state) for train, _ in split.repeats[0]
            ]
        except EvaluationError as error:
            usual = scaling or default_scaling(self._first.task, FEW_TRIALS)
            same = [c for c in self._candidates if c[1:] == (FEW_TRIALS, usual)]
            self._candidates = (same or self._candidates)[:1]
            self.no_choice = f'nothing is chosen: {error}'

    def _divide(self, train: Indices, repeats: int, random_state: int) -> list[Fold]:
        """Return the folds inside a fold; none where too few groups are left."""
        # Each part must know its own labels.
        labels = np.char.add(self._parts.astype(str), np.char.add(' ', self._first.labels))
        groups = self._split.groups
        if groups is not None and len(np.unique(groups[train])) <= INNER_FOLDS:
            repeats = 1  # each group is held out once, whatever the seed
        seeds = range(random_state, random_state + repeats)
        try:
            divisions = [
                self._split.divide_again(train, labels, seed, INNER_FOLDS) for seed in seeds
            ]
        except EvaluationError:
            if groups is None:
                raise
            return []
        return [fold for division in divisions for fold in division]

    def tasks(self) -> list[Task]:
        """Return one task a candidate and fold."""
        folds = [fold for repeat in self._split.repeats for fold in repeat]
        inner = [*self._inner, *[[] for _ in folds[len(self._inner) :]]]
        return [
            (
                answer_fold,
                (candidate, self._tables[candidate.feature_set], self._parts, fold, again),
            )
            for candidate in self._candidates
            for fold, again in zip(folds, inner, strict=True)
        ]

    def finish(self, answers: Sequence[FoldAnswers | str]) -> tuple[FeatureChoice, ...]:
        """Return the choice for each part, among the candidates that could be fitted."""
        folds = [fold for repeat in self._split.repeats for fold in repeat]
        candidates, found, left_out = list[Candidate](), list[list[FoldAnswers]](), list[str]()
        for i, candidate in enumerate(self._candidates):
            of_it = answers[i * len(folds) : (i + 1) * len(folds)]
            fitted = [answer for answer in of_it if not isinstance(answer, str)]
            if len(fitted) == len(of_it):
                candidates.append(candidate)
                found.append(fitted)
            else:
                reason = next(answer for answer in of_it if isinstance(answer, str))
                left_out.append(f'{", ".join(candidate)} is left out: {reason}')
        if not candidates:
            raise EvaluationError(f'no classifier can be fitted: {left_out[0]}')
        true = self._first.labels
        right = np.zeros((len(candidates), len(true)))
        for row, each in zip(right, found, strict=True):
            for (_, test), answer in zip(folds, each, strict=True):
                row[test] += answer.said == true[test]
        chosen = self._pick(candidates, right / len(self._split.repeats), self._split.tested)
        picks = [
            self._pick(candidates, np.array([each[i].inner_right for each in found]), train)
            for i, (train, _) in enumerate(self._split.repeats[0])
        ]
        return tuple(
            self._describe(self._parts == part, candidates, chosen, found, picks, left_out)
            for part in np.unique(self._parts)
        )

    def _pick(self, candidates: Sequence[Candidate], right: Matrix, rows: Indices) -> int:
        """Return the number of the candidate that some trials choose.

        It is the most robust one that is not worse than the best by more than the standard error
        of their difference over the held-out groups, or over trials where folds are random (the
        rule of one standard error; Breiman et al. 1984).

        ``right``, shape (candidates, trials), is how often each candidate named a trial correctly
        [1], NaN where it was not tested.
        """
        by_robustness = sorted(range(len(candidates)), key=lambda i: _rank(candidates[i]))
        rows = rows[np.isfinite(right[0, rows])]
        group = rows if self._split.groups is None else self._split.groups[rows]
        groups = np.unique(group)
        if len(groups) < FEWEST_GROUPS:
            return by_robustness[0]
        shares = np.stack([right[:, rows[group == each]].mean(axis=1) for each in groups], axis=1)
        means = shares.mean(axis=1)
        best = max(by_robustness, key=lambda i: means[i])
        leads = shares[best] - shares
        errors = leads.std(axis=1, ddof=1) / np.sqrt(len(groups))
        is_close = leads.mean(axis=1) <= errors + ROUNDING
        return next(i for i in by_robustness if is_close[i])

    def _describe(
        self,
        keep: npt.NDArray[np.bool_],
        candidates: Sequence[Candidate],
        chosen: int,
        found: Sequence[Sequence[FoldAnswers]],
        picks: Sequence[int],
        left_out: Sequence[str],
    ) -> FeatureChoice:
        """Return the choice with the scores of one part."""
        split, first = self._split.take(keep), self._first.take(keep)

        def score(candidate: Candidate, whole: Split, each: Sequence[FoldAnswers]) -> Score:
            folds, answers = iter(each), list[Answers]()
            for repeat in whole.repeats:
                of_repeat = [next(folds).said[keep[test]] for _, test in repeat]
                answers.append([said for said in of_repeat if len(said)])
            return make_score(*candidate[1:], first, whole.take(keep), answers)

        scores = [
            CandidateScore(
                candidate,
                score(candidate, self._split, each),
                float(np.mean([answer.time_s for answer in each])),
            )
            for candidate, each in zip(candidates, found, strict=True)
        ]
        best = candidates[chosen]
        nested = [found[pick][i] for i, pick in enumerate(picks)]
        table = self._tables[best.feature_set].take(keep)
        of_set = [e.score for e in scores if e.candidate.feature_set == best.feature_set]
        return FeatureChoice(
            best,
            tuple(sorted(scores, key=lambda each: -each.score.mean)),
            score(best, self._split.once(), nested),
            make_evaluation(table, split, of_set),
            tuple(Counter(candidates[pick] for pick in picks).most_common()),
            0 if self._split.groups is None else len(self._split.repeats[0]),
            tuple(left_out),
        )


@dataclasses.dataclass(frozen=True)
class FoldAnswers:
    """One candidate in one fold.

    ``said`` are the answers on its tests. ``inner_right``, shape (trials,), is how often the folds
    inside named each training trial correctly [1], NaN where they did not test it. ``time_s`` is
    the time of training and tests [s].
    """

    said: npt.NDArray[np.str_]
    inner_right: Matrix
    time_s: float


def answer_fold(
    candidate: Candidate, table: FeatureTable, parts: Indices, fold: Fold, inner: Sequence[Fold]
) -> FoldAnswers | str:
    """Return the answers of a candidate in one fold and in those inside it; one model a part.

    Random convolutions are fitted once to the fold's training trials; the folds inside share them.
    Returns one sentence if the candidate cannot be fitted to these trials.
    """
    try:
        return _answer_fold(candidate, table, parts, fold, inner)
    except (ClassifierError, ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        return str(error).partition('\n')[0]


def _answer_fold(
    candidate: Candidate, table: FeatureTable, parts: Indices, fold: Fold, inner: Sequence[Fold]
) -> FoldAnswers:
    pair = candidate.classifier, candidate.scaling
    labels = table.labels
    said = np.zeros(len(labels), dtype=labels.dtype)
    right, tested = np.zeros(len(labels)), np.zeros(len(labels))
    time_s = 0.0
    for part in np.unique(parts[fold[0]]):
        train, test = _select(parts == part, fold)
        start_s = time.perf_counter()
        estimator = build_estimator(*pair, table.channels)
        estimator.fit(table.values[train], labels[train])
        if len(test):
            said[test] = estimator.predict(table.values[test])
        time_s += time.perf_counter() - start_s
        inside = [each for each in (_select(parts == part, one) for one in inner) if len(each[1])]
        if candidate.classifier == ROCKET and inner:
            answers = estimator[-1].predict_folds(table.values, labels, inside)
        else:
            answers = predict_folds(*pair, table.values, labels, inside, table.channels)
        for (_, held_out), answer in zip(inside, answers, strict=True):
            right[held_out] += answer == labels[held_out]
            tested[held_out] += 1
    with np.errstate(invalid='ignore'):
        return FoldAnswers(said[fold[1]], right / tested, time_s)


def _rank(candidate: Candidate) -> tuple[int, bool]:
    """Return a number that is lower for a more robust candidate.

    Sets over the surface come first: on public recordings they are better in new conditions.
    """
    found = find_feature_set(candidate.feature_set)
    return ROBUST.index(candidate[1:]), not getattr(found, 'needs_speed', False)


def _select(keep: npt.NDArray[np.bool_], fold: Fold) -> Fold:
    train, test = fold
    return train[keep[train]], test[keep[test]]


def _list_pairs(table: FeatureTable, scaling: str) -> list[tuple[str, str]]:
    """Return classifiers and scalings; a tree compares, and so no scaling changes it.

    The four classifiers on a waveform itself take its samples for features of any order.
    """
    pairs = list_pairs(table, [ROCKET] if table.is_waveform else None)
    pairs = [pair for pair in pairs if pair != ('tree', 'standard')]
    return [pair for pair in pairs if scaling in ('', pair[1]) or pair[0] in ('tree', ROCKET)]
