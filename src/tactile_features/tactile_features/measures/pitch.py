# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The period of a ripple in a window of tension, and whether there is one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_features.errors import UndefinedFeatureError
from tactile_features.measures.beta import incomplete_beta
from tactile_features.measures.press import average_samples

FloatArray = NDArray[np.float64]

MIN_PERIODS = 3
"""Fewer periods than this in a window are a trend, not a ripple."""

MAX_HARMONICS = 12

FALSE_ALARM = 1e-3
"""Probability that a window without a period is said to have one."""

_TREND_DEGREE = 3
_TOP_SHARE = 0.9  # of half the sample rate, up to which a harmonic is looked for
_OVERSAMPLING = 16
_CANDIDATES = 6
_ITERATIONS = 8
_CLOSE = 1e-4  # step of the frequency that no longer counts, against 1 / window
_MAIN_SHARE = 0.8  # of the explained squares, which the harmonics of a multiple must keep


class Ripple(NamedTuple):
    """A periodic part of a window.

    Attributes
    ----------
    frequency_hz, standard_uncertainty_hz : float
        Of the fundamental.
    harmonics : int
        How many of them the tension bears out.
    """

    frequency_hz: float
    standard_uncertainty_hz: float
    harmonics: int


class _Fit(NamedTuple):
    frequency_hz: float
    harmonics: int
    squares: float
    residual: FloatArray
    lever: FloatArray


def find_ripple(elapsed_s: FloatArray, tension_n: FloatArray) -> Ripple:
    """Return the fundamental of the periodic part of a window.

    Harmonics of one frequency beside a cubic trend, by non-linear least squares; the number
    of harmonics, and with it the choice between a frequency and its fractions, by
    Schwarz's criterion. The uncertainty is the sandwich estimate of that fit with one
    cluster a period (Liang and Zeger, Biometrika 73, 1986): what the periods do not
    have in common counts, be it noise or not.

    Parameters
    ----------
    elapsed_s, tension_n : ndarray of shape (n,)
        Evenly spaced times [s] and tension [N].

    Raises
    ------
    UndefinedFeatureError
        When no periodic part stands out. It must do so from the tension, whose noise is
        white where the sensor's is, and from its differences, whose noise is white where the
        tension drifts as a random walk does: each by an F test, corrected for the
        number of frequencies that were looked at.
    """
    elapsed_s, tension_n = average_samples(elapsed_s, tension_n)
    elapsed_s = elapsed_s - elapsed_s[0]
    n = len(tension_n)
    if n < 8 * MIN_PERIODS:
        raise UndefinedFeatureError(f'{n} samples are too few to look for periodic grooves')
    span_s = float(elapsed_s[-1])
    trend = _make_columns(elapsed_s, 0.0, 0)
    rest = _remove(trend, tension_n)
    fits = [
        fit
        for frequency_hz, harmonics in _find_candidates(rest, (n - 1) / span_s)
        if (fit := _refine(elapsed_s, rest, frequency_hz, harmonics)) is not None
        and fit.frequency_hz * span_s >= MIN_PERIODS
    ]
    best = min(fits, key=lambda fit: _schwarz(n, fit.squares, fit.harmonics), default=None)
    if best is not None:
        best = _leave_echoes(elapsed_s, rest, best)
    if best is None or not _is_significant(elapsed_s, tension_n, best):
        raise UndefinedFeatureError(
            'no periodic grooves found: no ripple stands out from trend and noise '
            f'(false alarms below {100 * FALSE_ALARM:g} %)'
        )
    return Ripple(best.frequency_hz, _spread_hz(elapsed_s, best), best.harmonics)


def _make_columns(elapsed_s: FloatArray, frequency_hz: float, harmonics: int) -> FloatArray:
    """Cubic trend, cosines and sines of the harmonics, shape (n, 4 + 2 harmonics)."""
    place = 2 * elapsed_s / elapsed_s[-1] - 1
    angle = 2 * np.pi * frequency_hz * elapsed_s[:, np.newaxis] * np.arange(1, harmonics + 1)
    trend = np.vander(place, _TREND_DEGREE + 1)
    return np.hstack([trend, np.cos(angle), np.sin(angle)])


def _solve(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Least squares by the normal equations: harmonics and scaled powers are well apart.

    Without BLAS, whose threads cost more than they bring on so little.
    """
    gram = np.einsum('ij,ik->jk', columns, columns)
    return np.asarray(np.linalg.solve(gram, np.einsum('ij,i->j', columns, values)))


def _remove(columns: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(values - np.einsum('ij,j->i', columns, _solve(columns, values)))


def _schwarz(n: int, squares: float, harmonics: int) -> float:
    return n * math.log(max(squares, 1e-300)) + (2 * harmonics + 1) * math.log(n)


def _find_candidates(rest: FloatArray, rate_hz: float) -> list[tuple[float, int]]:
    """Frequency and number of harmonics where the sum of the harmonics' power is best."""
    n = len(rest)
    size = _OVERSAMPLING * n
    power = 2 / n * np.abs(np.fft.rfft(rest, size)) ** 2
    last = int(_TOP_SHARE * size / 2)
    low = math.ceil(MIN_PERIODS * _OVERSAMPLING)
    fundamental = np.arange(low, last + 1)
    total = float(np.sum(rest * rest))
    left = np.full(len(fundamental), total)
    score = np.full(len(fundamental), np.inf)
    harmonics = np.ones(len(fundamental), dtype=np.intp)
    for h in range(1, MAX_HARMONICS + 1):
        there = h * fundamental <= last
        left[there] -= power[h * fundamental[there]]
        # What the neighbouring harmonics share is counted twice: never all of it.
        squares = np.maximum(left, 1e-3 * total)
        now = n * np.log(np.maximum(squares, 1e-300)) + (2 * h + 1) * math.log(n)
        better = there & (now < score)
        score[better], harmonics[better] = now[better], h
    inner = (score[1:-1] <= score[:-2]) & (score[1:-1] <= score[2:])
    peaks = np.flatnonzero(inner) + 1
    chosen = peaks[np.argsort(score[peaks], kind='stable')[:_CANDIDATES]]
    return [(float(fundamental[i] * rate_hz / size), int(harmonics[i])) for i in chosen]


def _refine(
    elapsed_s: FloatArray, rest: FloatArray, frequency_hz: float, harmonics: int
) -> _Fit | None:
    """Gauss-Newton on the frequency, all else solved for; None when it runs away."""
    start_hz, resolution_hz = frequency_hz, 1 / float(elapsed_s[-1])
    turn = 2 * np.pi * elapsed_s[:, np.newaxis] * np.arange(1, harmonics + 1)
    for _ in range(_ITERATIONS):
        columns = _make_columns(elapsed_s, frequency_hz, harmonics)
        solved = _solve(columns, rest)
        residual = rest - np.einsum('ij,j->i', columns, solved)
        waves = columns[:, _TREND_DEGREE + 1 :]
        cosines, sines = waves[:, :harmonics], waves[:, harmonics:]
        cosine_part, sine_part = np.split(solved[_TREND_DEGREE + 1 :], 2)
        slope = np.einsum('ij,j->i', turn * cosines, sine_part)
        slope -= np.einsum('ij,j->i', turn * sines, cosine_part)
        lever = _remove(columns, slope)
        weight = float(np.sum(lever * lever))
        if weight == 0.0:
            return None
        step_hz = float(np.sum(lever * residual)) / weight
        if abs(step_hz) < _CLOSE * resolution_hz:
            return _Fit(frequency_hz, harmonics, float(np.sum(residual**2)), residual, lever)
        frequency_hz += max(-0.2, min(0.2, step_hz / resolution_hz)) * resolution_hz
        if abs(frequency_hz - start_hz) > resolution_hz:
            return None
    return None


def _leave_echoes(elapsed_s: FloatArray, rest: FloatArray, fit: _Fit) -> _Fit:
    """Return the fit of a multiple of the frequency where that explains nearly as much.

    Edges that pass every 7.5 samples come out a little different every other time, so that the
    samples repeat after two periods only.
    """
    total = float(np.sum(rest * rest))
    for multiple in range(fit.harmonics, 1, -1):
        harmonics = fit.harmonics // multiple
        higher = _refine(elapsed_s, rest, multiple * fit.frequency_hz, harmonics)
        if higher and total - higher.squares >= _MAIN_SHARE * (total - fit.squares):
            return higher
    return fit


def _spread_hz(elapsed_s: FloatArray, fit: _Fit) -> float:
    period = np.floor(elapsed_s * fit.frequency_hz).astype(np.intp)
    scores = np.bincount(period, weights=fit.lever * fit.residual)
    count = len(scores)
    variance = float(np.sum(scores * scores)) * count / (count - 1)
    of_periods = math.sqrt(variance) / float(np.sum(fit.lever * fit.lever))
    # When an edge passed is known to one sample; over the window that is a change of pitch.
    of_sampling = fit.frequency_hz / (len(elapsed_s) * math.sqrt(12))
    return math.hypot(of_periods, of_sampling)


def _is_significant(elapsed_s: FloatArray, tension_n: FloatArray, fit: _Fit) -> bool:
    looked_at = len(tension_n) * _TOP_SHARE / 2 * MAX_HARMONICS
    for times, values in ((elapsed_s, tension_n), (elapsed_s[1:], np.diff(tension_n))):
        columns = _make_columns(times, fit.frequency_hz, fit.harmonics)
        total = float(np.sum(_remove(columns[:, : _TREND_DEGREE + 1], values) ** 2))
        left = float(np.sum(_remove(columns, values) ** 2))
        free = len(values) - columns.shape[1] - 1
        if free < 1 or total <= 0.0:
            return False
        # Upper tail of F(2 h + 1, free), as an incomplete beta function of the share left.
        tail = incomplete_beta(free / 2, fit.harmonics + 0.5, min(1.0, left / total))
        if tail * looked_at > FALSE_ALARM:
            return False
    return True
