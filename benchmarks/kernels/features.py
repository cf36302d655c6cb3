# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed and error of spectrum and regression."""

from __future__ import annotations

import decimal
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
import scipy.fft
import scipy.signal
import scipy.stats

from benchmarks.measuring import measure_ratio, Report, Row
from tactile_features.feature_sets.stiffness import compute_regression
from tactile_features.feature_sets.texture_spectrum import compute_spectrum

PERIOD_NS = 16_666_667

Array = NDArray[np.float64]


# -- spectrum ---------------------------------------------------------------------------


def run_spectrum(quick: bool) -> Report:
    """Compare `compute_spectrum` with a Fourier transform without further computations."""
    rng = np.random.default_rng(1)
    time_s = np.arange(180) / 60
    waves = 0.05 * np.sin(2 * np.pi * np.outer(rng.uniform(1, 25, 480), time_s))
    trials = 5.0 + waves + rng.normal(0.0, 0.004, (480, 180))
    rows = []
    for case, detrend in (('480 x 180', 'mean'), ('480 x 180, linear', 'linear')):
        ratio = measure_ratio(
            lambda detrend=detrend: compute_spectrum(trials, detrend),
            lambda: np.abs(scipy.fft.rfft(trials)),
            5 if quick else 15,
        )
        rows.append(_spectrum_row(case, trials[::10], ratio, detrend))
    rows.append(_spectrum_row('offset 1e6 N', trials[::10] + 1e6, None, 'mean'))
    return Report(
        'spectrum: compute_spectrum',
        'abs(scipy.fft.rfft(x)), without mean removal, scaling and checks',
        'largest deviation from a discrete Fourier transform in extended precision, '
        'relative to the largest amplitude; without the component at 0 Hz',
        rows,
    )


def _spectrum_row(case: str, tension_n: Array, ratio: Any, detrend: str) -> Row:
    exact = _exact_spectrum(tension_n, detrend)
    peer = scipy.signal.detrend(tension_n) if detrend == 'linear' else tension_n
    bare = np.abs(scipy.fft.rfft(peer)) * (2.0 / tension_n.shape[1])
    bare[:, -1] /= 2.0

    def error(amplitude: Array) -> float:
        deviation = np.abs(amplitude - exact)[:, 1:].max(axis=1)
        return float((deviation / exact[:, 1:].max(axis=1)).max())

    ours = compute_spectrum(tension_n, detrend)
    return Row(case, ratio, error(ours), 2e-15 if detrend == 'mean' else 1e-13, error(bare))


def _exact_spectrum(tension_n: Array, detrend: str) -> NDArray[Any]:
    """Return the spectrum in extended precision, from the definition of the DFT.

    The number of samples must be even.
    """
    n = tension_n.shape[1]
    pi = np.longdouble('3.14159265358979323846264338327950288')
    # The product of the indices is reduced as an integer, so that angles remain small.
    turns = np.outer(np.arange(n), np.arange(n // 2 + 1)) % n
    angle = 2 * pi * turns.astype(np.longdouble) / n
    x = tension_n.astype(np.longdouble)
    x = x - x[:, :1]  # this difference is exact, so the mean is small and has a small error
    x = x - x.mean(axis=1, keepdims=True)
    if detrend == 'linear':
        index = np.arange(n).astype(np.longdouble) - np.longdouble(n - 1) / 2
        x = x - (x @ index)[:, None] / (index @ index) * index
    amplitude = np.hypot(x @ np.cos(angle), x @ np.sin(angle)) * 2 / n
    amplitude[:, -1] /= 2
    return np.asarray(amplitude)


# -- regression -------------------------------------------------------------------------


def run_regression(quick: bool) -> Report:
    """Compare `compute_regression` with `scipy.stats.linregress`."""
    rng = np.random.default_rng(2)
    time_ns = PERIOD_NS * np.arange(204)
    time_s = time_ns / 1e9
    trials = 12.0 - 0.4 * time_s + rng.normal(0.0, 0.004, (480, 204))
    ratio = measure_ratio(
        lambda: compute_regression(time_ns, trials),
        lambda: [scipy.stats.linregress(time_s, row) for row in trials],
        5 if quick else 15,
    )
    rows = [
        _regression_row('480 x 204', time_ns, trials[:20], ratio),
        _regression_row('offset 1e6 N, 1e-6 N/s', time_ns, 1e6 + 1e-6 * time_s, None),
    ]
    return Report(
        'regression: compute_regression',
        'scipy.stats.linregress on seconds, which also computes p-value and standard errors',
        'largest relative deviation of slope, intercept or correlation from exact fractions, '
        'checked for 20 of 480 trials',
        rows,
    )


def _regression_row(case: str, time_ns: NDArray[Any], tension_n: Array, ratio: Any) -> Row:
    errors, peer_errors = [], []
    time_s = time_ns / 1e9
    for row in np.atleast_2d(tension_n):
        exact = _exact_regression(time_ns.tolist(), row.tolist())
        peer = scipy.stats.linregress(time_s, row)
        at_start = peer.intercept + peer.slope * time_s[0]
        errors.append(_relative(compute_regression(time_ns, row).tolist(), exact))
        peer_errors.append(_relative([peer.slope, at_start, peer.rvalue], exact))
    return Row(case, ratio, max(errors), 1e-15, max(peer_errors))


def _exact_regression(time_ns: list[int], tension_n: list[float]) -> list[Fraction]:
    n = len(time_ns)
    t = [Fraction(value - time_ns[0], 10**9) for value in time_ns]
    x = [Fraction(value) for value in tension_n]
    mean_t, mean_x = sum(t) / n, sum(x) / n
    s_tt = sum((a - mean_t) ** 2 for a in t)
    s_xx = sum((b - mean_x) ** 2 for b in x)
    s_tx = sum((a - mean_t) * (b - mean_x) for a, b in zip(t, x, strict=True))
    slope = s_tx / s_tt
    with decimal.localcontext() as context:
        context.prec = 50
        square = s_tx**2 / (s_tt * s_xx)
        root = (decimal.Decimal(square.numerator) / decimal.Decimal(square.denominator)).sqrt()
    correlation = Fraction(root) if s_tx > 0 else -Fraction(root)
    return [slope, mean_x - slope * mean_t, correlation]


def _relative(got: list[float], exact: list[Fraction]) -> float:
    pairs = zip(got, exact, strict=True)
    return max(float(abs((Fraction(value) - true) / true)) for value, true in pairs)
