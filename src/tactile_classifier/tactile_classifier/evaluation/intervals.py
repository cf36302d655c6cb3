# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results of an evaluation, and confidence intervals over trials or groups."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import stdtr, stdtrit

LEVEL = 0.95
"""Nominal coverage of the intervals [1]."""


@dataclasses.dataclass(frozen=True)
class Result:
    """Base class of results in reports and ``--json``."""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as a dictionary for JSON."""
        return {f.name: _to_plain(getattr(self, f.name)) for f in dataclasses.fields(self)}


def _to_plain(value: Any) -> Any:
    if isinstance(value, Result):
        return value.to_dict()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_to_plain(each) for each in value] if isinstance(value, tuple) else value


@dataclasses.dataclass(frozen=True)
class Interval(Result):
    """A 95 % interval, or the reason why there is no interval.

    If ``reason`` is not None, ``low`` and ``high`` are 0. ``method`` names the
    statistical method and what counts as independent, such as trials or groups.
    """

    low: float
    high: float
    method: str
    reason: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the interval as a dictionary for JSON, without numbers if there is a reason."""
        if self.reason is not None:
            return {'reason': self.reason}
        return {'low': self.low, 'high': self.high, 'level': LEVEL, 'method': self.method}


def accuracy_interval(
    parts: npt.ArrayLike, parts_are: str, weights: npt.ArrayLike | None = None
) -> Interval:
    """Compute the interval of a mean accuracy from the accuracies of its parts [1].

    A part is a trial, a cell (the trials of one condition) or a held-out group.

    This is the modified Wilson interval of Dean and Pagano (2015) for clustered samples: the score
    interval of Wilson, with two changes. The number of trials is replaced by the effective number
    of trials, which follows from the spread between the accuracies of the parts. The quantile is
    one of Student's t; if all parts have equal weights, it has one degree of freedom less than
    there are parts. The interval accounts for the choice of the tested parts, but not for the
    variation of the training: see `tactile_classifier.coverage`.

    If all parts are completely correct, or all are completely wrong, the exact binomial interval
    over the parts is used. Each part then counts as one trial, so the interval is valid even if
    all trials of a part always have equal results. If all parts have the same accuracy between 0
    and 1, there is no interval.

    ``parts_are`` is the name of the parts, such as ``trials`` or ``groups``. If the mean is over
    trials, ``weights`` contains the number of trials in each part.
    """
    values, share = _shares(parts, weights)
    count, mean = len(values), float(share @ values)
    if np.ptp(values) == 0.0:
        if values[0] in (0.0, 1.0):
            # All or none correct: exact Clopper-Pearson bound, two-sided. Unequal parts are
            # replaced by their effective number (Kish).
            limit = ((1 - LEVEL) / 2) ** float(share @ share)
            low, high = (limit, 1.0) if values[0] == 1.0 else (0.0, 1.0 - limit)
            return Interval(low, high, f'exact binomial over {count} {parts_are}')
        return Interval(0.0, 0.0, '', f'all {count} {parts_are} have the same accuracy')
    variance, freedom = _spread(values, share)
    return wilson_interval(mean, variance, freedom, f'Wilson with t over {count} {parts_are}')


def wilson_interval(mean: float, variance: float, freedom: float, method: str) -> Interval:
    """Return the score interval of a mean between 0 and 1 whose estimated variance is known.

    ``freedom`` is the number of degrees of freedom of the variance. The variance must be above 0.
    """
    # Number of independent trials that would give this variance of the mean.
    effective = mean * (1.0 - mean) / variance
    ratio = _quantile(freedom) ** 2 / effective
    middle = (mean + 0.5 * ratio) / (1.0 + ratio)
    half = math.sqrt(ratio * mean * (1.0 - mean) + 0.25 * ratio**2) / (1.0 + ratio)
    return Interval(max(0.0, middle - half), min(1.0, middle + half), method)


def difference_interval(
    differences: npt.ArrayLike, parts_are: str, weights: npt.ArrayLike | None = None
) -> Interval:
    """Return Student's t interval of a mean paired difference; see `accuracy_interval`."""
    values, share = _shares(differences, weights)
    if np.ptp(values) == 0.0:
        return Interval(0.0, 0.0, '', f'all {len(values)} {parts_are} have the same difference')
    mean = float(share @ values)
    variance, freedom = _spread(values, share)
    half = _quantile(freedom) * math.sqrt(variance)
    return Interval(mean - half, mean + half, f't over {len(values)} {parts_are}')


def difference_p_value(
    differences: npt.ArrayLike, parts_are: str, weights: npt.ArrayLike | None = None
) -> float:
    """Return the two-sided p-value of the hypothesis that the mean difference is zero.

    It is below 0.05 if and only if `difference_interval` excludes zero. If there is no interval,
    it is 1.
    """
    values, share = _shares(differences, weights)
    if np.ptp(values) == 0.0:
        return 1.0
    variance, freedom = _spread(values, share)
    return float(2.0 * stdtr(freedom, -abs(share @ values) / math.sqrt(variance)))


def _quantile(freedom: float) -> float:
    """Return the quantile of Student's t for the two-sided level."""
    return float(stdtrit(freedom, 0.5 * (1.0 + LEVEL)))


def _shares(
    parts: npt.ArrayLike, weights: npt.ArrayLike | None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the values of the parts and their weights, which add up to 1."""
    values = np.asarray(parts, dtype=np.float64)
    size = np.ones(len(values)) if weights is None else np.asarray(weights, dtype=np.float64)
    return values, size / size.sum()


def _spread(
    values: npt.NDArray[np.float64], share: npt.NDArray[np.float64]
) -> tuple[float, float]:
    """Return the variance of the weighted mean and its degrees of freedom.

    If the parts have equal variances, the estimate has no bias. The degrees of freedom are those
    of Satterthwaite (Bell and McCaffrey 2002); if all weights are equal, they are those of
    Student's t. A part with a large weight pulls the mean towards itself, so its residual is too
    small; this is corrected.
    """
    residuals = values - share @ values
    squares = float(share @ share)
    factor = share**2 / (1.0 - 2.0 * share + squares)
    # The variance is a quadratic form of the values. Its matrix is D - d w' - w d' + sum(d) w w',
    # with d = factor, w = share and D = diag(d). This is the trace of its square.
    total, cross = float(factor.sum()), float(factor @ share)
    trace = (
        float(factor @ factor)
        + 2.0 * float(factor @ (total * share**2 - 2.0 * factor * share))
        + 2.0 * float(factor @ factor) * squares
        + 2.0 * cross**2
        + (total * squares) ** 2
        - 4.0 * total * cross * squares
    )
    freedom = squares**2 / trace
    return float(factor @ residuals**2), freedom
