# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every feature is computed again from docs/feature_sets.md, with only NumPy and SciPy.

The computation here uses no function of the package. Its sums have extended precision, so that
they are accurate even if the signal has an offset of 1e9 times its size.
"""

import dataclasses
import functools
import math
import os
from pathlib import Path
import re

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.stats.mstats import mquantiles
from trials import event, extract, hard_windows, make_block

from tactile_features import (
    compute_spectrum,
    FeatureConfig,
    FeatureError,
    features_from_trials,
    spec_for,
    UndefinedFeatureError,
    WindowOutcome,
)
from tactile_features.feature_sets.registry import BUILT_IN
from tactile_features.feature_sets.waveforms import average_parts

REPOSITORY = Path(__file__).resolve().parents[4]
PAGE = REPOSITORY / 'docs' / 'feature_sets.md'
RECORDINGS = Path(os.environ.get('TACTILE_DATA', REPOSITORY.parent / 'shared' / 'data'))
wide = np.longdouble
PI = wide('3.14159265358979323846264338327950288')


def remove(x, what):
    if what == 'none':
        return x
    x = x - x[0]  # no rounding error, for any offset
    x = x - x.mean()
    if what == 'mean':
        return x
    i = np.arange(len(x), dtype=wide) - wide(len(x) - 1) / 2
    return x - i * (i @ x) / (i @ i)


def turn(angle):
    return np.cos(angle) + 1j * np.sin(angle)


@functools.cache
def components_over_time(samples, n):
    """Return the factors of the samples in each component of the spectrum."""
    k = np.arange(n // 2 + 1)
    # The product of the indices is reduced modulo n, because large angles are less accurate.
    return turn(-2 * PI * (np.outer(k, np.arange(samples)) % n).astype(wide) / n)


def texture_spectrum(x, n, detrend='linear', window='none'):
    d = remove(x, detrend)
    w = np.sin(PI * np.arange(len(x), dtype=wide) / len(x)) ** 2
    if window == 'none':
        w = np.ones(len(x))
    amplitude = 2 * np.abs(components_over_time(len(x), n) @ (w * d)) / w.sum()
    amplitude[0] = 0
    if n % 2 == 0:
        amplitude[-1] /= 2
    return amplitude


def place(length_m, finest_m, step_m):
    """Return positions of samples and grid points, and which samples are near each grid point.

    The precision is double, because rounding decides whether a sample at a border is near.
    """
    n = math.ceil(length_m / step_m - 1e-9) + 1
    p = step_m * np.arange(n)
    p -= (p[-1] - length_m) / 2
    g = np.arange(0, length_m * (1 + 1e-9), finest_m / 4)
    reach = min(n, math.ceil(8 * finest_m / step_m) + 1)
    first = np.minimum(np.searchsorted(p, g - 4 * finest_m), n - reach)
    return p, g, reach, first


@functools.cache
def smooth(length_m, finest_m, step_m):
    """Return which samples are near each grid point, and their weights."""
    p, g, reach, first = place(length_m, finest_m, step_m)
    near = first[:, None] + np.arange(reach)
    apart = (p[near].astype(wide) - g[:, None]) / wide(finest_m)
    return near, np.exp(-apart * apart / 2)


@functools.cache
def components_over_distance(length_m, finest_m, step_m):
    """Return the weighted factors of the samples in each component, and the sum of the weights."""
    p = place(length_m, finest_m, step_m)[0].astype(wide)
    k = np.arange(1, math.floor(length_m / (2 * finest_m) + 1e-9) + 1)
    h = np.where((p > 0) & (p < length_m), np.sin(PI * p / length_m) ** 2, 0)
    return turn(2 * PI * np.outer(k, p) / length_m) * h, h.sum()


def spatial_waveform(x, length_m, finest_m, step_m):
    near, kernel = smooth(length_m, finest_m, step_m)
    assert len(x) == len(place(length_m, finest_m, step_m)[0])
    return (kernel * x[near]).sum(axis=1) / kernel.sum(axis=1)


def texture_spatial(x, length_m, finest_m, step_m):
    components, weight = components_over_distance(length_m, finest_m, step_m)
    amplitude = 2 * np.abs(components @ (x - x.mean()))
    y = spatial_waveform(x - x.mean(), length_m, finest_m, step_m)
    octaves = math.floor(math.log2(length_m / (4 * finest_m)) + 1e-9)
    lags = [4 * 2**octave for octave in range(octaves + 1)]
    groups = [y - y.mean()]
    groups += [y[lag:] - y[:-lag] for lag in lags]
    groups += [y[2 * lag :] - 2 * y[lag:-lag] + y[: -2 * lag] for lag in lags]
    # With alphap = betap = 1, quantile 0 is the smallest value, and quantile 1 the largest.
    levels = np.arange(13) / 12
    quantiles = [mquantiles(group.astype(float), levels, 1, 1) for group in groups]
    return np.concatenate([amplitude / weight, *quantiles])


def waveform(x, parts):
    n = len(x)
    if n <= parts:
        return x
    edges = np.arange(parts + 1, dtype=wide) * n / parts
    i = np.arange(n)
    overlap = np.minimum(i + 1, edges[1:, None]) - np.maximum(i, edges[:-1, None])
    return np.maximum(overlap, 0) @ x * parts / n


def stiffness_relaxation(t, x):
    t = t - t[0]
    t_, x_ = t - t.mean(), x - x.mean()
    slope = (t_ @ x_) / (t_ @ t_)
    intercept = x.mean() - slope * t.mean()
    correlation = (t_ @ x_) / np.sqrt((t_ @ t_) * (x_ @ x_))
    return np.array([slope, intercept, correlation, slope / intercept])


def recompute(name, x, rate_hz, config, speed_m_s=0.0):
    """Return the features of a window, computed with the formulas of the page."""
    x = np.asarray(x, dtype=wide)
    t = np.rint(np.arange(len(x)) * (1e9 / rate_hz)).astype(wide) / 1_000_000_000
    over = config.spatial_length_m, config.spatial_finest_m, speed_m_s / rate_hz
    return {
        'texture_spectrum': lambda: texture_spectrum(
            x, len(x), config.spectrum_detrend, config.spectrum_window
        ),
        'texture_spatial': lambda: texture_spatial(x, *over),
        'spatial_waveform': lambda: spatial_waveform(x, *over),
        'glide_waveform': lambda: waveform(x, 600),
        'hold_waveform': lambda: waveform(x, 100),
        'stiffness_regression': lambda: stiffness_relaxation(t, x)[:3],
        'stiffness_relaxation': lambda: stiffness_relaxation(t, x),
    }[name]()


def check(values, expected, scale_n):
    """Compare values. Tolerances are 1e-9 of each value, and of the signal's range ``scale_n``."""
    np.testing.assert_allclose(values, expected.astype(float), rtol=1e-9, atol=1e-9 * scale_n)


def task_of(feature_set):
    return {'glide': 'texture', 'hold': 'stiffness'}[feature_set.phase]


def real_windows(task):
    path = RECORDINGS / ('fabric_slide.npz' if task == 'texture' else 'phac_hold.npz')
    if not path.is_file():
        pytest.skip(f'{path.name} is not in the folder TACTILE_DATA; see docs/real_recordings.md')
    with np.load(path) as archive:
        rate_hz = float(archive['rate_hz'])
        if task == 'texture':
            return archive['x'][archive['balanced'].astype(bool)].mean(axis=1)[::9], rate_hz
        return archive['x'][:, 0, 100:500].astype(float), rate_hz


SETS = [pytest.param(each, id=each.name) for each in BUILT_IN]


def compare(feature_set, windows, rate_hz, config, speed_m_s=0.0):
    """Compare the features of a batch of windows with those computed by `recompute`."""
    task = task_of(feature_set)
    fields = {'config': config, 'speeds_m_s': [speed_m_s] * len(windows)}
    values, spec = features_from_trials(task, windows, rate_hz, **fields)
    assert len(spec.names) == values.shape[1]
    for x, row in zip(windows, values, strict=True):
        if feature_set.needs_speed:  # only the middle of the window is used
            length_m, step_m = config.spatial_length_m, speed_m_s / rate_hz
            count = len(place(length_m, config.spatial_finest_m, step_m)[0])
            x = x[(len(x) - count) // 2 :][:count]
        expected = recompute(feature_set.name, x, rate_hz, config, speed_m_s)
        check(row, expected, np.ptp(x))


def configure(feature_set, **options):
    chosen = {'glide': 'texture_features', 'hold': 'stiffness_features'}[feature_set.phase]
    return FeatureConfig(**{chosen: feature_set.name, **options})


@pytest.mark.parametrize('feature_set', SETS)
def test_the_page_has_every_set_with_its_version(feature_set):
    parts = [part for part in PAGE.read_text().split('\n## ')[1:] if feature_set.name in part]
    assert re.search(rf'\bversion {feature_set.version}\b', parts[0])


@pytest.mark.parametrize('feature_set', SETS)
@pytest.mark.parametrize('samples', [30, 100, 180, 251])
def test_hard_windows(feature_set, samples):
    windows = hard_windows(samples)
    if not feature_set.needs_speed:
        compare(feature_set, windows, 60.0, configure(feature_set))
        return
    # The length on the surface is a whole or a fractional number of steps between samples. The
    # finest scale is one step or several steps.
    for finest_m, speed_m_s in ((0.0005, 0.015), (0.0007, 0.0137), (0.00025, 0.015)):
        step_m = speed_m_s / 60.0
        for length_m in (step_m * (samples - 1), step_m * (samples - 1.37)):
            if length_m < 4 * finest_m:
                continue
            config = configure(feature_set, spatial_length_m=length_m, spatial_finest_m=finest_m)
            compare(feature_set, windows, 60.0, config, speed_m_s)


@pytest.mark.parametrize('feature_set', SETS)
def test_real_recordings(feature_set):
    windows, rate_hz = real_windows(task_of(feature_set))
    over = {'spatial_length_m': 0.06, 'spatial_finest_m': 0.003} if feature_set.needs_speed else {}
    compare(feature_set, windows, rate_hz, configure(feature_set, **over), 0.03)


@pytest.mark.parametrize('feature_set', SETS)
@pytest.mark.parametrize('offset_ns', [0, 1, 5_000_000])
def test_windows_begin_where_the_page_says(feature_set, offset_ns):
    """Default parameters. The period is 1/64 s, so that a crop can end exactly on a sample."""
    rate_hz, period_ns, start_ns = 64.0, 15_625_000, 10**18
    config = configure(feature_set, rate_hz=rate_hz)
    tension_n = np.random.default_rng(5).standard_normal(600).cumsum()
    first = 64 * 10**9
    begin_ns, end_ns = start_ns + 64 * period_ns - offset_ns, start_ns + 560 * period_ns
    events = [
        dataclasses.replace(event(0, phase, glide_speed_m_s=0.015), stamp_ns=stamp_ns)
        for stamp_ns, phase in ((begin_ns, feature_set.phase), (end_ns, 'release'))
    ]
    (window,) = extract(config, *events, make_block(tension_n, first, period_ns))
    assert window.outcome == WindowOutcome.OK
    stamps_ns = start_ns + period_ns * np.arange(600)
    crop_s = {'glide': 0.6, 'hold': 0.5}[feature_set.phase]
    count, until_ns = 180, end_ns
    if feature_set.needs_speed:
        crop_s, count = 0.009 / 0.015, len(place(0.045, 0.0005, 0.015 / rate_hz)[0])
    if feature_set.name.startswith('stiffness'):
        count, until_ns = 600, end_ns - 100_000_000
    taken = (stamps_ns >= begin_ns + round(crop_s * 1e9)) & (stamps_ns <= until_ns)
    x = tension_n[taken][:count]
    check(window.values, recompute(feature_set.name, x, rate_hz, config, 0.015), np.ptp(x))
    task = task_of(feature_set)
    values, spec = features_from_trials(task, x[None], rate_hz, config=config, speeds_m_s=[0.015])
    assert values[0].tobytes() == window.values.tobytes()
    assert spec.mismatch(spec_for(task, config)) is None


def test_names_are_those_of_the_page():
    def name(feature_set, samples=180, **options):
        config = configure(feature_set, **options)
        return [each.name for each in feature_set(config).describe(samples, 60.0)]

    sets = {each.name: each for each in BUILT_IN}
    assert name(sets['texture_spectrum']) == [
        f'tension__spectrum__hz_{k / 3:.3f}' for k in range(91)
    ]
    scales = ['0.5', '1', '2', '4', '8']
    groups = ['value', *(f'{what}__mm_{mm}' for what in ('change', 'bend') for mm in scales)]
    assert name(sets['texture_spatial']) == [
        *(f'tension__spatial_spectrum__per_m_{k / 0.045:.3f}' for k in range(1, 46)),
        *(f'tension__spatial_{group}__q_{j / 12:.3f}' for group in groups for j in range(13)),
    ]
    assert name(sets['glide_waveform']) == [
        f'tension__waveform__s_{i / 60:.4f}' for i in range(180)
    ]
    assert name(sets['spatial_waveform']) == [
        f'tension__waveform__mm_{m / 8:.4f}' for m in range(361)
    ]
    assert name(sets['hold_waveform']) == [
        f'tension__waveform__s_{j * 1.8 / 60:.4f}' for j in range(100)
    ]
    line = ['slope', 'intercept', 'correlation', 'relative_slope']
    line = [f'tension__regression__{each}' for each in line]
    assert name(sets['stiffness_regression']) == line[:3]
    assert name(sets['stiffness_relaxation']) == line


# -- the spectrum and the means of parts, to the last digits --------------------------------

WAYS = [(d, w) for d in ('none', 'mean', 'linear') for w in ('none', 'hann')]


@pytest.mark.parametrize(('detrend', 'window'), WAYS)
@pytest.mark.parametrize('n', [2, 3, 30, 77, 78, 180, 181])
def test_spectra_of_windows(detrend, window, n):
    i = np.arange(n)
    noise = 0.01 * np.random.default_rng(n).normal(size=n)
    lines = [noise, 5.0 - 0.73 / 60 * i + noise, 1e6 + 1e-8 * i + noise]
    windows = np.stack([*lines, *hard_windows(n)])
    values = compute_spectrum(windows, detrend, window)
    for x, row in zip(windows.astype(wide), values, strict=True):
        expected = texture_spectrum(x, n, detrend, window)
        # Without detrending, the rounding error is proportional to the level of the signal.
        scale_n = np.abs(x).max() if detrend == 'none' else np.ptp(x)
        assert np.abs(row - expected).max() <= 3e-15 * scale_n
    config = FeatureConfig(spectrum_detrend=detrend, spectrum_window=window)
    batch, _ = features_from_trials('texture', windows, 60.0, config=config)
    assert batch.tobytes() == values.tobytes()


@pytest.mark.parametrize('n', [2, 3, 7, 61, 180, 181, 600])
@pytest.mark.parametrize(('offset', 'amplitude'), [(0.0, 1.0), (1e6, 1.0), (1e6, 1e-9)])
def test_error_is_within_2e_15_of_the_largest_component(n, offset, amplitude):
    x = offset + amplitude * np.random.default_rng(n).normal(size=n)
    far = np.where(np.arange(n) == 0, x + 1e6, x)  # the first sample is far from the others
    for each in [x, far] if n == 180 else [x]:
        expected = texture_spectrum(each.astype(wide), n, 'mean')
        assert np.abs(compute_spectrum(each) - expected).max() <= 2e-15 * expected.max()


@given(st.floats(-1e12, 1e12), st.integers(2, 200))
def test_a_constant_has_no_spectrum(value, n):
    assert np.array_equal(compute_spectrum(np.full(n, value)), np.zeros(n // 2 + 1))


@pytest.mark.parametrize('slope', [1e-9, 1e-6, 1.0])
@pytest.mark.parametrize('offset', [0.0, 1e6, -3e8])
def test_a_line_under_any_offset_has_no_spectrum_once_it_is_taken_off(offset, slope):
    x = offset + slope * np.arange(180)
    rounding = np.spacing(abs(offset) + 180 * slope)
    # Without an offset, the line is exact, and the second pass of detrending leaves less of it.
    assert compute_spectrum(x, 'linear').max() <= (rounding if offset else rounding / 4)
    assert compute_spectrum(x, 'mean').max() >= 20 * slope - rounding


@pytest.mark.parametrize('scale', [1e-300, 1e-160, 1e150, 1e300])
def test_extreme_magnitudes_neither_overflow_nor_vanish(scale):
    x = np.random.default_rng(10).integers(-50, 50, 61).astype(float)
    np.testing.assert_allclose(
        compute_spectrum(x * scale) / scale, compute_spectrum(x), rtol=1e-12
    )


@pytest.mark.parametrize(
    ('n', 'parts'), [(101, 100), (150, 100), (400, 100), (3_000, 600), (601, 600)]
)
@pytest.mark.parametrize(('offset', 'slope'), [(0.0, 1.0), (1e9, 1e-4), (-5.0, 0.0)])
def test_means_of_parts_are_exact(n, parts, offset, slope):
    row = offset + slope * (np.arange(n) / n + 0.1 * np.random.default_rng(n).normal(size=n))
    size = np.ptp(row) + np.finfo(float).eps * abs(offset)
    error = np.abs(average_parts(row, parts) - waveform(row.astype(wide), parts)).max()
    assert error <= 1e-12 * size * n + np.spacing(abs(offset))


# -- what has no features -------------------------------------------------------------------


@pytest.mark.parametrize(
    ('compute', 'message'),
    [
        (lambda: compute_spectrum([1.0, np.nan, 2.0]), 'not finite'),
        (lambda: compute_spectrum(np.where(np.eye(99, 180) > 0, np.inf, 1.0)), 'not finite'),
        (lambda: compute_spectrum([1.0]), '2 samples'),
        (lambda: compute_spectrum(1.0), '2 samples'),
        (lambda: compute_spectrum([1e308, -1e308, 1e308]), 'too large'),
        (lambda: compute_spectrum([1.0, 2.0], 'cubic'), 'none, mean, linear'),
        (lambda: compute_spectrum([1.0, 2.0], 'mean', 'hamming'), 'none, hann'),
    ],
)
def test_a_kernel_refuses_what_has_no_value(compute, message):
    with pytest.raises(FeatureError, match=message):
        compute()


TRIALS = np.random.default_rng(0).normal(size=(5, 100))
BAD = np.where(np.arange(5)[:, None] == 2, np.nan, TRIALS)


@pytest.mark.parametrize(
    ('task', 'x', 'fields', 'message'),
    [
        ('texture', TRIALS[0], {}, 'shape'),
        ('stiffness', TRIALS[:, :1], {}, 'samples >= 2'),
        ('weight', TRIALS, {}, 'weight'),
        ('texture', TRIALS, {'rate_hz': 0.0}, 'rate'),
        ('stiffness', TRIALS, {'rate_hz': np.inf}, 'rate'),
        ('texture', BAD, {}, 'trial 2'),
        ('stiffness', BAD, {}, 'trial 2'),
    ],
)
def test_a_batch_names_what_is_wrong_with_it(task, x, fields, message):
    with pytest.raises(FeatureError, match=message):
        features_from_trials(task, x, **{'rate_hz': 60.0, **fields})


def test_a_trial_without_a_value_is_named():
    config = FeatureConfig(stiffness_features='stiffness_relaxation')
    with pytest.raises(UndefinedFeatureError, match=r'trial 1: .*intercept'):
        features_from_trials('stiffness', [[1.0, 2.0, 3.0], [0.0, 1.0, 2.0]], 50.0, config=config)


@pytest.mark.parametrize('level', [0.0, 2.0, -1e-300, 1e200])
def test_a_trial_without_any_change_has_features(level):
    x = np.where(np.arange(5)[:, None] == 3, level, TRIALS)
    assert not features_from_trials('texture', x, 60.0)[0][3].any()
    assert features_from_trials('stiffness', x, 60.0)[0][3].tolist() == [0.0, level, 0.0]
    for name, expected in (
        ('stiffness_relaxation', [0.0, level, 0.0, 0.0]),
        ('hold_waveform', None),
    ):
        config = FeatureConfig(stiffness_features=name)
        row = features_from_trials('stiffness', x, 60.0, config=config)[0][3]
        assert row.tolist() == (expected or [level] * len(row))


def test_no_trials_give_no_rows():
    values, spec = features_from_trials('texture', np.empty((0, 181)), 60.0)
    assert values.shape == (0, 91) == (0, len(spec.names))
