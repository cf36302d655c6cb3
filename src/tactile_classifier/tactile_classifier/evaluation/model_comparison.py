# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Two models on the same trials: which is better, and is the difference more than chance."""

from __future__ import annotations

from collections import Counter
import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import bisect
from scipy.special import chdtrc, ndtri

from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.intervals import (
    accuracy_interval,
    difference_interval,
    Interval,
    LEVEL,
    Result,
)
from tactile_classifier.records import NO_ANSWER, UNKNOWN

Names = npt.NDArray[np.str_]


@dataclasses.dataclass(frozen=True)
class Answered(Result):
    """One model's answers. With several groups, each share is the mean over the groups [1].

    ``accuracy`` is over all trials: a rejected one is not named correctly. ``answered_accuracy``
    is the share of right ones among the labels that it gives; None: it gives none.
    """

    accuracy: float
    interval: Interval
    unknown_rate: float
    no_answer_rate: float
    answered_accuracy: float | None


@dataclasses.dataclass(frozen=True)
class Confusion(Result):
    """One wrong answer, and how often either model gives it."""

    label: str
    answer: str
    count_a: int
    count_b: int
    trials: int


@dataclasses.dataclass(frozen=True)
class Comparison(Result):
    """Two models, A and B, on the same trials.

    ``difference`` is the accuracy of B less that of A [1]. ``only_a`` and ``only_b`` count the
    trials that only one of the two names correctly; ``p_value`` is McNemar's test on these, as if
    trials were independent [1]. ``agreement`` is the share of trials with the same answer [1],
    with several groups the mean over these; 0 groups: none are told apart. ``confusions`` are the
    wrong answers whose counts differ, the largest difference first.
    """

    trials: int
    groups: int
    parts_are: str
    a: Answered
    b: Answered
    difference: float
    interval: Interval
    only_a: int
    only_b: int
    p_value: float
    agreement: float
    confusions: tuple[Confusion, ...]

    @property
    def better(self) -> str:
        """``A``, ``B``, or empty when the interval holds 0 or there is none."""
        if self.interval.reason or self.interval.low <= 0.0 <= self.interval.high:
            return ''
        return 'B' if self.interval.low > 0.0 else 'A'

    def to_dict(self) -> dict[str, Any]:
        """Return the fields and the better model by name as what JSON can hold."""
        return {**super().to_dict(), 'better': self.better}


def compare_answers(
    labels: npt.ArrayLike,
    answers_a: npt.ArrayLike,
    answers_b: npt.ArrayLike,
    groups: npt.ArrayLike | None = None,
    parts_are: str = 'sessions',
) -> Comparison:
    """Compare the answers of two models on the same trials.

    With two groups or more, such as the session of each trial, each group counts once: shares are
    means over the groups, and the interval is Student's over the groups' differences. Otherwise,
    or where all groups have the same difference, it is that of `paired_interval` over trials.

    Labels, answers and groups have shape (trials,); answers are labels, `UNKNOWN` or `NO_ANSWER`;
    ``parts_are`` names the groups in the plural. Raises EvaluationError when there are no trials,
    or the shapes do not fit.
    """
    true, says_a, says_b = (
        np.asarray(each).astype(str) for each in (labels, answers_a, answers_b)
    )
    group = np.zeros(len(true)) if groups is None else np.asarray(groups)
    if not len(true) or not true.shape == says_a.shape == says_b.shape == group.shape:
        raise EvaluationError(
            'a comparison takes one label, one answer of each model and one group a trial; there '
            f'are {len(true)} labels, {len(says_a)} and {len(says_b)} answers, {len(group)} groups'
        )
    right_a, right_b = says_a == true, says_b == true
    only_a, only_b = int((right_a & ~right_b).sum()), int((right_b & ~right_a).sum())
    owner = np.unique(group, return_inverse=True)[1]
    sizes = np.bincount(owner)
    share = 1.0 / (len(sizes) * sizes[owner])  # of each trial in a mean over the groups
    gain = right_b.astype(np.float64) - right_a
    interval = Interval(0.0, 0.0, '', 'one group')
    if len(sizes) > 1:
        interval = difference_interval(np.bincount(owner, gain) / sizes, parts_are)
    if interval.reason:
        interval = paired_interval(only_a, only_b, len(true))
    sides = [_count_answers(true, says, owner, share, parts_are) for says in (says_a, says_b)]
    return Comparison(
        trials=len(true),
        groups=len(sizes) if len(sizes) > 1 else 0,
        parts_are=parts_are,
        a=sides[0],
        b=sides[1],
        difference=float(np.average(gain, weights=share)),
        interval=interval,
        only_a=only_a,
        only_b=only_b,
        p_value=_test_discordant(only_a, only_b),
        agreement=float(np.average(says_a == says_b, weights=share)),
        confusions=_list_confusions(true, says_a, says_b),
    )


def paired_interval(only_a: int, only_b: int, trials: int) -> Interval:
    """Return the score interval of the difference of two models on independent trials.

    Tango (1998), Statistics in Medicine 17, 891: all differences of accuracy whose score test does
    not reject the counts. It leaves 0 out exactly when McNemar's test has a p-value below 0.05.
    ``docs/evaluation.md`` has its coverage. ``only_a`` and ``only_b`` count the trials that only
    A, or only B, names correctly.
    """
    limit = float(ndtri(0.5 * (1.0 + LEVEL)))
    seen = (only_b - only_a) / trials

    def surplus(difference: float) -> float:
        return abs(_score_of_difference(only_a, only_b, trials, difference)) - limit

    low, high = (
        float(bisect(surplus, end, seen)) if surplus(end) > 0.0 else end for end in (-1.0, 1.0)
    )
    return Interval(low, high, f'Tango score interval over {trials} paired trials')


def _score_of_difference(only_a: int, only_b: int, trials: int, difference: float) -> float:
    """Return how far the counts lie from a difference, in standard deviations under it."""
    distance = only_b - only_a - trials * difference
    if distance == 0.0:
        return 0.0
    # The likeliest share of trials that only A names, given the difference: the larger root.
    a = 2.0 * trials
    b = (2.0 * trials - only_b + only_a) * difference - only_a - only_b
    c = -only_a * difference * (1.0 - difference)
    root = math.sqrt(max(0.0, b * b - 4.0 * a * c))
    # Of the two forms, that which does not subtract nearly equal numbers.
    share = (root - b) / (2.0 * a) if b <= 0.0 else -2.0 * c / (root + b)
    variance = trials * (2.0 * share + difference * (1.0 - difference))
    return distance / math.sqrt(variance) if variance > 0.0 else math.copysign(math.inf, distance)


def _test_discordant(only_a: int, only_b: int) -> float:
    """Return the p-value of McNemar's test without continuity correction."""
    discordant = only_a + only_b
    return float(chdtrc(1, (only_b - only_a) ** 2 / discordant)) if discordant else 1.0


def _count_answers(
    true: Names,
    says: Names,
    owner: npt.NDArray[np.intp],
    share: npt.NDArray[np.float64],
    parts_are: str,
) -> Answered:
    right = (says == true).astype(np.float64)
    unknown, silent, accuracy = (
        float(np.average(each, weights=share))
        for each in (says == UNKNOWN, says == NO_ANSWER, right)
    )
    is_label = ~np.isin(says, (UNKNOWN, NO_ANSWER))
    if owner.any():
        accuracies = np.bincount(owner, right) / np.bincount(owner)
        interval = accuracy_interval(accuracies, parts_are)
    elif len(true) > 1:
        interval = accuracy_interval(right, 'trials')
    else:
        interval = Interval(0.0, 0.0, '', 'one trial')
    return Answered(
        accuracy=accuracy,
        interval=interval,
        unknown_rate=unknown,
        no_answer_rate=silent,
        answered_accuracy=float(np.average(right[is_label], weights=share[is_label]))
        if is_label.any()
        else None,
    )


def _list_confusions(true: Names, says_a: Names, says_b: Names) -> tuple[Confusion, ...]:
    trials = Counter(true.tolist())
    pairs_a, pairs_b = (
        Counter(zip(true.tolist(), says.tolist(), strict=True)) for says in (says_a, says_b)
    )
    found = [
        Confusion(*pair, pairs_a[pair], pairs_b[pair], trials[pair[0]])
        for pair in {**pairs_a, **pairs_b}
        if pair[0] != pair[1] and pairs_a[pair] != pairs_b[pair]
    ]
    return tuple(sorted(found, key=lambda c: (-abs(c.count_b - c.count_a), c.label, c.answer)))
