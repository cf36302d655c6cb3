# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest

from tactile_features import compute_spectrum, FeatureError
from tactile_features.feature_sets.texture_spectrum import compute_partial_spectrum

RNG = np.random.default_rng(0)
PI = np.longdouble('3.14159265358979323846264338327950288')


def reference(x, detrend, window, whole=None):
    """Detrended, weighted and transformed by their definitions, in extended precision."""
    x = np.asarray(x, dtype=np.longdouble)
    n, whole = len(x), whole or len(x)
    i = np.arange(n).astype(np.longdouble)
    if detrend != 'none':
        x = x - x[0]  # exact, or the reference itself would lose digits to the offset
        x = x - x.sum() / n
    if detrend == 'linear':
        about = i - i.sum() / n
        x = x - (x * about).sum() / (about * about).sum() * about
    weight = np.sin(PI * i / n) ** 2 if window == 'hann' else np.ones(n, np.longdouble)
    k = np.arange(whole // 2 + 1)[:, None]
    angle = 2 * PI * ((k * np.arange(n)) % whole).astype(np.longdouble) / whole
    y = x * weight
    amplitude = np.hypot((y * np.cos(angle)).sum(axis=1), (y * np.sin(angle)).sum(axis=1))
    amplitude *= 2 / weight.sum()
    if whole % 2 == 0:
        amplitude[-1] /= 2
    amplitude[0] = 0
    return amplitude


def assert_close_to_reference(x, tolerance):
    expected = reference(x, 'mean', 'none')
    error = np.abs(compute_spectrum(x) - expected).max()
    assert error <= tolerance * expected.max(), (error / expected.max(), len(x))


@given(st.floats(-1e12, 1e12), st.integers(2, 200))
def test_a_constant_has_no_spectrum(value, n):
    assert np.array_equal(compute_spectrum(np.full(n, value)), np.zeros(n // 2 + 1))


def test_leaves_its_input_alone():
    x = np.arange(180.0)
    compute_spectrum(x)
    assert np.array_equal(x, np.arange(180.0))


@pytest.mark.parametrize(
    ('x', 'message'),
    [
        ([1.0, np.nan, 2.0], 'not finite'),
        (np.where(np.eye(100, 180) > 0, np.inf, 1.0), 'not finite'),
        ([1.0], 'at least 2 samples'),
        (1.0, 'at least 2 samples'),
        ([1e308, -1e308, 1e308], 'too large'),
    ],
)
def test_refuses_what_has_no_spectrum(x, message):
    with pytest.raises(FeatureError, match=message):
        compute_spectrum(x)


@pytest.mark.parametrize('n', [2, 3, 7, 8, 61, 180, 181, 960])
@pytest.mark.parametrize(('offset', 'amplitude'), [(0.0, 1.0), (1e6, 1.0), (1e6, 1e-9)])
def test_error_is_within_2e_15_of_the_largest_component(n, offset, amplitude):
    x = offset + amplitude * np.random.default_rng(n).normal(size=n)
    assert_close_to_reference(x, 2e-15)
    if n == 180:  # a first sample far from the others
        assert_close_to_reference(np.where(np.arange(n) == 0, x + 1e6, x), 2e-15)


@pytest.mark.parametrize('rows', [1, 15, 64, 65, 200])
def test_the_place_in_a_large_batch_changes_no_bit(rows):
    x = 5.0 + np.random.default_rng(rows).normal(size=(rows, 180))
    whole = compute_spectrum(x)
    for start, stop in ((0, 1), (rows - 1, rows), (rows // 3, rows)):
        assert compute_spectrum(x[start:stop]).tobytes() == whole[start:stop].tobytes()


@pytest.mark.parametrize('scale', [1e-300, 1e-160, 1e150, 1e300])
@pytest.mark.parametrize('n', [60, 61])
def test_extreme_magnitudes_neither_overflow_nor_vanish(scale, n):
    x = np.random.default_rng(10).integers(-50, 50, n).astype(float)
    expected = compute_spectrum(x)
    np.testing.assert_allclose(compute_spectrum(x * scale) / scale, expected, rtol=1e-12)


WAYS = [(d, w) for d in ('none', 'mean', 'linear') for w in ('none', 'hann')]


@pytest.mark.parametrize(('detrend', 'window'), WAYS)
@pytest.mark.parametrize('n', [2, 3, 180, 181])
@pytest.mark.parametrize(('offset', 'slope'), [(0.0, 0.0), (5.0, -0.73 / 60), (1e6, 1e-8)])
def test_each_way_agrees_with_its_definition(detrend, window, n, offset, slope):
    x = offset + slope * np.arange(n) + 0.01 * np.random.default_rng(n).normal(size=n)
    expected = reference(x, detrend, window)
    error = np.abs(compute_spectrum(x, detrend, window) - expected).max()
    # Where nothing is taken off, the transform has to cancel the offset.
    largest = max(expected.max(), abs(slope) * 1e-3, offset if detrend == 'none' else 0.0)
    assert error <= 1e-13 * largest, error / largest


@pytest.mark.parametrize('slope', [1e-9, 1e-6, 1.0])
@pytest.mark.parametrize('offset', [0.0, 1e6, -3e8])
def test_a_line_under_any_offset_has_no_spectrum_once_it_is_taken_off(offset, slope):
    x = offset + slope * np.arange(180)
    rounding = np.spacing(abs(offset) + 180 * slope)
    assert compute_spectrum(x, 'linear').max() <= rounding
    assert compute_spectrum(x, 'mean').max() >= 20 * slope - rounding


@given(
    arrays(
        np.float64, st.tuples(st.integers(1, 6), st.integers(2, 60)), elements=st.floats(-1e9, 1e9)
    ),
    st.sampled_from(WAYS),
)
def test_each_way_gives_a_row_the_same_bits_alone_and_in_a_batch(x, way):
    batch = compute_spectrum(x, *way)
    for row, expected in zip(x, batch, strict=True):
        assert compute_spectrum(row.copy(), *way).tobytes() == expected.tobytes()
    assert compute_spectrum(x[None], *way).tobytes() == batch.tobytes()
    assert compute_spectrum(np.asfortranarray(x), *way).tobytes() == batch.tobytes()
    parts = compute_partial_spectrum(x, 60, *way)
    for row, expected in zip(x, parts, strict=True):
        assert compute_partial_spectrum(row.copy(), 60, *way).tobytes() == expected.tobytes()


def test_a_part_has_two_samples_at_least_and_the_whole_at_most():
    for n in (2, 180):
        assert compute_partial_spectrum(np.arange(n), 180).shape == (91,)
    for n in (0, 1, 181):
        with pytest.raises(FeatureError, match='must have 2 to 180 samples'):
            compute_partial_spectrum(np.arange(n), 180)


@pytest.mark.parametrize(('detrend', 'window'), [('cubic', 'none'), ('linear', 'hamming')])
def test_another_way_is_refused(detrend, window):
    with pytest.raises(FeatureError, match='must be one of none, mean, linear and of none, hann'):
        compute_spectrum(np.arange(10.0), detrend, window)
