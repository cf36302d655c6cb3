# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Automatic choice of feature set and classifier by nested cross-validation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
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
from tactile_classifier.types import ROCKET
from tactile_features.feature_sets.registry import find_feature_set

INNER_FOLDS, INNER_REPEATS = 6, 3
"""Number of folds and of repetitions of the inner cross-validation. With three folds and one
repetition, the feature set that was chosen on 60 trials was 6 points worse than the best one; see
docs/evaluation.md.
"""

FEW_TRIALS = 'svm_linear'
"""Classifier that is used, with its default scaling, if there are too few trials for a choice."""

MANY_TRIALS = 300
"""If there are more trials than this, one repetition is used; more would change little."""

ROUNDING = 1e-9
"""Smaller differences of accuracies are rounding errors."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


class Candidate(NamedTuple):
    """Combination of feature set, classifier and scaling."""

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
"""Classifiers and scalings, ordered by robustness in new groups, most robust first.

Support vector machines without scaling come last, because they depend on the unit of force. On
public and generated recordings with two training groups, random convolutions were on average 6
points better than the candidate that had the best accuracy in the training groups.
"""

FEWEST_GROUPS = 3
"""If there are fewer held-out groups, the most robust candidate is chosen without comparison."""


@dataclasses.dataclass(frozen=True)
class CandidateScore(Result):
    """Score of a candidate on the split that was used for the choice.

    The score of the best candidate is optimistic on average, because it was selected by this
    score. ``fold_s`` is the mean time to train and test a fold, without the computation of
    features [s].
    """

    candidate: Candidate
    score: Score
    fold_s: float

    def to_dict(self) -> dict[str, Any]:
        """Return candidate, accuracy and time as a dictionary for JSON."""
        return {
            **self.candidate._asdict(),
            'accuracy': self.score.mean,
            'fold_s': self.fold_s,
        }


@dataclasses.dataclass(frozen=True)
class FeatureChoice(Result):
    """Chosen candidate, with the scores of all candidates.

    Attributes
    ----------
    chosen : Candidate
    ranking : tuple of CandidateScore
        All candidates, sorted by accuracy in descending order.
    nested : Score
        Score of the whole procedure, including the choice. In each fold, the choice is repeated on
        the training trials only (nested cross-validation; Varma and Simon 2006).
    evaluation : Evaluation
        Scores of all classifiers with the chosen feature set.
    picks : tuple of (Candidate, int)
        The candidates that were chosen inside the folds, and in how many folds.
    groups : int
        Number of held-out groups that were used for the choice; 0 if the folds are random.
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
        """True if there are too few groups for a choice by accuracy inside the folds."""
        return 0 < self.groups <= FEWEST_GROUPS

    def find_score(self, candidate: Candidate) -> CandidateScore:
        """Return the score of a candidate."""
        return next(each for each in self.ranking if each.candidate == candidate)

    def find_runner_up(self) -> CandidateScore | None:
        """Return the best candidate with another feature set than the chosen one.

        If all candidates have the same feature set, returns the best of the others, or None.
        """
        others = [each for each in self.ranking if each.candidate != self.chosen]
        elsewhere = [e for e in others if e.candidate.feature_set != self.chosen.feature_set]
        return next(iter(elsewhere or others), None)

    def summarise(self) -> dict[str, Any]:
        """Return the description of the choice for the model file."""
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
        """Return the choice as a dictionary for JSON."""
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
    """`Plan` that chooses among tables of the same trials with different feature sets.

    Its result is a tuple with one `FeatureChoice` for each part. The choice uses the folds of all
    repetitions. A more robust candidate (`ROBUST`) is preferred, unless the best candidate is
    better by more than the standard error of their difference. For the nested score, the training
    trials of each fold of the first repetition are divided into inner folds, and the choice is
    repeated on these.

    If the folds are random and the training trials of a fold cannot be divided again, there is no
    choice. The only candidate is then `FEW_TRIALS` on the first table, and ``no_choice`` contains
    the reason.

    Parameters
    ----------
    tables : mapping of str to FeatureTable
        Maps the name of each feature set to its table. If feature sets are equally robust, the
        first is preferred, so feature sets that are cheap to compute should come first.
    split : Split
        Split of the trials of all tables.
    random_state : int
        Seed of the inner folds.
    scaling : str
        The only scaling to try; if empty, all scalings are tried.
    parts : ndarray of int, shape (trials,), optional
        Part of each trial, such as flexion or abduction. One model is trained for each part; all
        use the same candidate.

    Raises
    ------
    DatasetError
        If the tables do not contain the same trials.
    EvaluationError
        If no candidate can be fitted (`finish`).
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
                raise DatasetError(f'the table of {name} contains other trials')
        repeats = INNER_REPEATS if len(self._first) <= MANY_TRIALS else 1
        self._candidates = [
            Candidate(name, *pair)
            for name, table in tables.items()
            for pair in _list_pairs(table, scaling)
        ]
        self._inner: list[list[Fold]] = [[] for _ in split.repeats[0]]
        self.no_choice: str | None = None
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
        """Return the inner folds of a fold; empty if too few groups remain."""
        # The folds are stratified by part and label, so that each part keeps all its labels.
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
        """Return one task for each candidate and fold."""
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
        """Choose among the candidates that could be fitted; return the choice for each part."""
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
                left_out.append(f'{", ".join(candidate)} left out: {reason}')
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
        """Choose a candidate by its accuracy on a subset of the trials; return its index.

        The one-standard-error rule (Breiman et al. 1984) is used. A candidate is close to the best
        if it is not worse by more than the standard error of their difference. The most robust of
        the close candidates is chosen. The standard error is computed over held-out groups, or
        over trials if the folds are random.

        ``right``, shape (candidates, trials), is the fraction of correct predictions of each
        candidate for each trial [1]; NaN if the trial was not tested.
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
        """Return the `FeatureChoice` with the scores of one part."""
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
    """Predictions of a candidate in one fold.

    ``said`` contains the predictions for the test trials. ``inner_right``, shape (trials,), is the
    fraction of correct predictions for each trial in the inner folds [1]; NaN if the trial was not
    tested. ``time_s`` is the time of training and testing [s].
    """

    said: npt.NDArray[np.str_]
    inner_right: Matrix
    time_s: float


def answer_fold(
    candidate: Candidate, table: FeatureTable, parts: Indices, fold: Fold, inner: Sequence[Fold]
) -> FoldAnswers | str:
    """Train and test a candidate in one fold and its inner folds, with one model for each part.

    Random convolutions are fitted once, to the training trials of the fold; its inner folds use
    the same convolutions. If the candidate cannot be fitted to these trials, returns the reason.
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
        outer = _select(parts == part, fold)
        folds = [outer, *(_select(parts == part, each) for each in inner)]
        answers = _predict_each(pair, table, [each for each in folds if len(each[1])], outer[0])
        start_s = time.perf_counter()
        if len(outer[1]):
            said[outer[1]] = next(answers)
            time_s += time.perf_counter() - start_s
        inside = [each for each in folds[1:] if len(each[1])]
        for (_, held_out), answer in zip(inside, answers, strict=True):
            right[held_out] += answer == labels[held_out]
            tested[held_out] += 1
    with np.errstate(invalid='ignore'):
        return FoldAnswers(said[fold[1]], right / tested, time_s)


def _predict_each(
    pair: tuple[str, str], table: FeatureTable, folds: Sequence[Fold], known: Indices
) -> Iterator[npt.NDArray[np.str_]]:
    """Yield the predictions of each fold; a fold is computed when it is needed."""
    if pair[0] == ROCKET:
        machine = build_estimator(*pair, table.channels)[-1]
        for (said,) in machine.predict_folds(table.values, [table.labels], folds, known):
            yield said
    else:
        for fold in folds:
            ((said,),) = predict_folds([pair], table.values, table.labels, [fold], table.channels)
            yield said


def _rank(candidate: Candidate) -> tuple[int, bool]:
    """Return a sort key; more robust candidates have a lower key.

    Feature sets that need the speed (over distance) come before others with the same classifier:
    on public recordings, they were better in new conditions.
    """
    found = find_feature_set(candidate.feature_set)
    return ROBUST.index(candidate[1:]), not getattr(found, 'needs_speed', False)


def _select(keep: npt.NDArray[np.bool_], fold: Fold) -> Fold:
    train, test = fold
    return train[keep[train]], test[keep[test]]


def _list_pairs(table: FeatureTable, scaling: str) -> list[tuple[str, str]]:
    """Return the classifiers and scalings to try for a table.

    Decision trees are tried only once, because they do not depend on scaling. For waveforms, only
    random convolutions are tried, because the four classifiers of the paper ignore the order of
    the samples.
    """
    pairs = list_pairs(table, [ROCKET] if table.is_waveform else None)
    pairs = [pair for pair in pairs if pair != ('tree', 'standard')]
    return [pair for pair in pairs if scaling in ('', pair[1]) or pair[0] in ('tree', ROCKET)]
