# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Spectrum, regression, and the extractor around them."""

from __future__ import annotations

import decimal
from fractions import Fraction
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
import scipy.fft
import scipy.signal
import scipy.stats

from benchmarks.measuring import measure_ratio, Report, Row
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.feature_sets.stiffness import compute_regression
from tactile_features.feature_sets.texture_spectrum import compute_spectrum, WINDOWS
from tactile_features.records import TrialEvent
from tactile_ros.strain import StrainBlock

PERIOD_NS = 16_666_667
EPOCH_NS = 1_760_000_000_123_456_789

Array = NDArray[np.float64]


# -- spectrum ---------------------------------------------------------------------------


def run_spectrum(quick: bool) -> Report:
    """Compute spectra, against the bare transform."""
    many = 2_000 if quick else 100_000
    rng = np.random.default_rng(1)
    time_s = np.arange(180) / 60
    waves = 0.05 * np.sin(2 * np.pi * np.outer(rng.uniform(1, 25, many), time_s))
    trials = 5.0 + waves + rng.normal(0.0, 0.004, (many, 180))
    rows = [
        _time_spectra(trials[:count], 5 if quick or count > 1000 else 15)
        for count in (1, 480, many)
    ]
    rows.append(_spectrum_row('offset 1e6 N', trials[:50] + 1e6, None))
    some = trials[:480]
    for window in WINDOWS:
        ratio = measure_ratio(
            lambda window=window: compute_spectrum(some, 'linear', window),
            lambda: np.abs(scipy.fft.rfft(some)),
            5 if quick else 15,
        )
        name = 'linear' if window == 'none' else f'linear, {window}'
        rows.append(_spectrum_row(f'480 x 180, {name}', trials[:50], ratio, 'linear', window))
    hard = 1e6 + 1e-6 * time_s + waves[:50]
    rows.append(_spectrum_row('offset 1e6 N, 1e-6 N/s, linear', hard, None, 'linear'))
    return Report(
        'spectrum: compute_spectrum',
        'abs(scipy.fft.rfft(x)), which neither removes the mean, nor scales, nor checks',
        'largest deviation from a discrete Fourier transform in extended precision, '
        'over the largest amplitude; without the component at 0 Hz',
        rows,
    )


def _time_spectra(trials: Array, rounds: int) -> Row:
    some = trials[0] if len(trials) == 1 else trials
    ratio = measure_ratio(
        lambda: compute_spectrum(some), lambda: np.abs(scipy.fft.rfft(some)), rounds
    )
    return _spectrum_row(f'{len(trials)} x 180', trials[:: max(1, len(trials) // 50)], ratio)


def _spectrum_row(
    case: str, tension_n: Array, ratio: Any, detrend: str = 'mean', window: str = 'none'
) -> Row:
    exact = _exact_spectrum(tension_n, detrend, window)
    peer = scipy.signal.detrend(tension_n) if detrend == 'linear' else tension_n
    weight = scipy.signal.get_window(window, tension_n.shape[1]) if window != 'none' else 1.0
    bare = np.abs(scipy.fft.rfft(peer * weight)) * (2.0 / tension_n.shape[1] / np.mean(weight))
    bare[:, -1] /= 2.0

    def error(amplitude: Array) -> float:
        deviation = np.abs(amplitude - exact)[:, 1:].max(axis=1)
        return float((deviation / exact[:, 1:].max(axis=1)).max())

    ours = compute_spectrum(tension_n, detrend, window)
    return Row(case, ratio, error(ours), 2e-15 if detrend == 'mean' else 1e-13, error(bare))


def _exact_spectrum(tension_n: Array, detrend: str, window: str) -> NDArray[Any]:
    """Return the amplitudes of an even number of samples by the sum that defines them."""
    n = tension_n.shape[1]
    pi = np.longdouble('3.14159265358979323846264338327950288')
    # The product of the indices is reduced as an integer, so that no angle is large.
    turns = np.outer(np.arange(n), np.arange(n // 2 + 1)) % n
    angle = 2 * pi * turns.astype(np.longdouble) / n
    x = tension_n.astype(np.longdouble)
    x = x - x[:, :1]  # exact
    x = x - x.mean(axis=1, keepdims=True)
    if detrend == 'linear':
        index = np.arange(n).astype(np.longdouble) - np.longdouble(n - 1) / 2
        x = x - (x @ index)[:, None] / (index @ index) * index
    weight = np.ones(n, np.longdouble)
    if window == 'hann':
        weight = np.sin(pi * np.arange(n).astype(np.longdouble) / n) ** 2
    x = x * weight
    amplitude = np.hypot(x @ np.cos(angle), x @ np.sin(angle)) * 2 / weight.sum()
    amplitude[:, -1] /= 2
    return np.asarray(amplitude)


# -- regression -------------------------------------------------------------------------


def run_regression(quick: bool) -> Report:
    """Fit lines, against scipy.stats.linregress."""
    rng = np.random.default_rng(2)
    n = 204
    time_ns = PERIOD_NS * np.arange(n)
    time_s = time_ns / 1e9
    trials = 12.0 - 0.4 * time_s + rng.normal(0.0, 0.004, (480, n))
    one = trials[0]
    half = np.where(np.arange(n) < n // 2, 5.0, np.nextafter(5.0, 6.0))
    rounds = 5 if quick else 15

    def fit_each() -> None:
        for row in trials:
            scipy.stats.linregress(time_s, row)

    single = measure_ratio(
        lambda: compute_regression(time_ns, one),
        lambda: scipy.stats.linregress(time_s, one),
        rounds,
    )
    batch = measure_ratio(lambda: compute_regression(time_ns, trials), fit_each, rounds)
    epoch_ns = EPOCH_NS + time_ns
    rows = [
        _regression_row('1 x 204', time_ns, one, single),
        _regression_row('480 x 204', time_ns, trials[:20], batch),
        _regression_row('offset 1e6 N, 1e-6 N/s', time_ns, 1e6 + 1e-6 * time_s, None),
        _regression_row('times since 1970', epoch_ns, one, None),
        _regression_row('a step of 1 ulp', time_ns, half, None),
    ]
    return Report(
        'regression: compute_regression',
        'scipy.stats.linregress on seconds, which computes p-value and standard errors too',
        'largest deviation of slope, intercept or correlation from exact fractions, relative to '
        'each; of 480 trials, the worst of 20',
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


# -- extractor --------------------------------------------------------------------------


def run_extractor(quick: bool) -> Report:
    """Feed a stream with trials in it, against a loop that keeps the arrays."""
    duration_s = 18 if quick else 120
    rng = np.random.default_rng(3)
    tension_n = 5.0 + rng.normal(0.0, 0.05, 60 * duration_s)
    events = list(_trial_events(duration_s))
    outputs, rows = [], []
    for size in (1, 12):
        blocks = [
            StrainBlock(EPOCH_NS + i * PERIOD_NS, i, PERIOD_NS, tension_n[i : i + size])
            for i in range(0, len(tension_n), size)
        ]
        stream = sorted([*blocks, *events], key=lambda item: item.stamp_ns)
        outputs.append(_extract(stream))
        ratio = measure_ratio(
            lambda stream=stream: _extract(stream),
            lambda blocks=blocks: _keep(blocks),
            rounds=3 if quick else 5,
            round_s=0.2,
        )
        start_s = time.perf_counter()
        _extract(stream)
        block_s = (time.perf_counter() - start_s) / len(blocks)
        changed = sum(a != b for a, b in zip(outputs[0], outputs[-1], strict=True))
        share = 100 * block_s / (size / 60)
        name = 'single samples' if size == 1 else f'blocks of {size} samples'
        rows.append(
            Row(
                name,
                ratio,
                changed,
                0,
                more={'% of block period': share, 'windows': len(outputs[-1])},
            )
        )
    return Report(
        'extractor: TrialFeatureExtractor at 60 Hz',
        'a loop over the same blocks that appends their arrays to a list',
        'windows that differ in any bit from those of single samples',
        rows,
    )


def _trial_events(duration_s: int) -> Any:
    """Yield a glide and a hold of five seconds each, all the time."""
    for number, begin_s in enumerate(range(1, duration_s - 12, 12)):
        for phase, at_s in (('glide', 0), ('hold', 5), ('done', 10)):
            yield TrialEvent(
                stamp_ns=EPOCH_NS + (begin_s + at_s) * 10**9 + 1,
                trial_id=f'trial-{number}',
                session_id='',
                protocol='texture',
                contact='flexion',
                object_label='',
                phase=phase,
            )


def _extract(stream: list[Any]) -> list[Any]:
    extractor = TrialFeatureExtractor(FeatureConfig())
    windows = []
    for item in stream:
        if isinstance(item, StrainBlock):
            windows += extractor.add_block(item)
        else:
            windows += extractor.add_event(item)
    return windows


def _keep(blocks: list[StrainBlock]) -> list[Array]:
    kept: list[Array] = []
    for block in blocks:
        kept.append(block.tension_n)  # noqa: PERF401 -- one by one, as they would arrive
    return kept
