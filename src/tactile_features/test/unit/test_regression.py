# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from decimal import Decimal, localcontext
from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_features import (
    compute_regression,
    FeatureConfig,
    FeatureError,
    features_from_trials,
)

EPOCH_NS = 1_760_000_000_000_000_000
N = 234
GRID_NS = EPOCH_NS + 16_666_667 * np.arange(N)


def reference_regression(time_ns, tension):
    """Return the exact least-squares line in rational numbers; the correlation has 60 digits."""
    t = [Fraction(int(v) - int(time_ns[0]), 10**9) for v in time_ns]
    x = [Fraction(float(v)) for v in tension]
    n = len(t)
    mean_t, mean_x = sum(t) / n, sum(x) / n
    s_tt = sum((a - mean_t) ** 2 for a in t)
    s_xx = sum((b - mean_x) ** 2 for b in x)
    s_tx = sum((a - mean_t) * (b - mean_x) for a, b in zip(t, x, strict=True))
    slope = s_tx / s_tt
    with localcontext() as context:
        context.prec = 60
        product = s_tt * s_xx
        root = (Decimal(product.numerator) / Decimal(product.denominator)).sqrt()
        r = Decimal(s_tx.numerator) / Decimal(s_tx.denominator) / root
    return slope, mean_x - slope * mean_t, Fraction(r), s_tt, s_xx


def assert_close_to_reference(time_ns, tension, tolerance=4e-15):
    slope, intercept, r, s_tt, s_xx = reference_regression(time_ns, tension)
    before = tension.copy()
    got = [Fraction(v) for v in compute_regression(time_ns, tension).tolist()]
    assert np.array_equal(tension, before)
    # The tolerance of the slope is relative to the spread of the tension over that of the time.
    assert (got[0] - slope) ** 2 <= Fraction(tolerance) ** 2 * s_xx / s_tt
    assert abs(got[1] - intercept) <= tolerance * max(abs(float(v)) for v in tension)
    assert abs(got[2] - r) <= tolerance
    assert abs(got[2]) <= 1


@pytest.mark.parametrize('scale', [5e-324, 1e-300, 1e-160, 1e-30, 1e150, 1e300])
def test_extreme_magnitudes_neither_overflow_nor_vanish(scale):
    rng = np.random.default_rng(4)
    steps = np.round(rng.normal(scale=50.0, size=N)) + np.arange(N)
    got = compute_regression(GRID_NS, steps * scale)
    expected = compute_regression(GRID_NS, steps)
    assert got[2] == pytest.approx(expected[2], rel=1e-12)


@given(
    st.lists(
        st.tuples(st.integers(0, 10**10), st.floats(-1e6, 1e6, allow_subnormal=False)),
        min_size=2,
        max_size=12,
        unique_by=lambda pair: pair[0],
    )
)
def test_agrees_with_exact_arithmetic_on_any_series(pairs):
    time_ns, tension = (np.array(v) for v in zip(*sorted(pairs), strict=True))
    if len(set(tension.tolist())) == 1:
        assert compute_regression(time_ns, tension).tolist() == [0.0, tension[0], 0.0]
    else:
        assert_close_to_reference(time_ns, tension)


@pytest.mark.parametrize(
    ('time_ns', 'tension', 'message'),
    [
        ([0, 1, 2], [1.0, 2.0], 'shapes'),
        ([0], [1.0], '2 samples'),
        ([0.0, 1.0], [1.0, 2.0], 'integer'),
        ([5, 5, 5], [1.0, 2.0, 3.0], 'times'),
        ([0, 1], [1.0, np.nan], 'not finite'),
        ([0, 1], [-1.7e308, 1.7e308], 'too large'),
        ([0, 1], [0.0, 1e308], 'too large'),
    ],
)
def test_refuses_what_has_no_regression(time_ns, tension, message):
    with pytest.raises(FeatureError, match=message):
        compute_regression(time_ns, tension)


def test_constant_windows_of_a_batch_have_neither_slope_nor_correlation():
    x = np.random.default_rng(6).normal(5.0, 1.0, (7, N))
    alone = compute_regression(GRID_NS, x)
    x[2] = 5.0
    x[5] = 0.0
    found = compute_regression(GRID_NS, x)
    assert found[[2, 5]].tolist() == [[0.0, 5.0, 0.0], [0.0, 0.0, 0.0]]
    others = [0, 1, 3, 4, 6]
    assert found[others].tobytes() == alone[others].tobytes()


def _gap(time_ns, tension):
    kept = np.r_[0:60, 95:N]
    return time_ns[kept], tension[kept]


@pytest.mark.parametrize(
    'change',
    [
        lambda t, x: (t, x),
        lambda t, x: (t + np.random.default_rng(5).integers(-8_000_000, 8_000_000, N), x),
        lambda t, x: (t, np.minimum(x, 11.0)),  # a saturated sensor
        _gap,
        lambda t, x: (t[:-1], x[:-1]),
        lambda t, x: (t, np.round(x, 2)),  # rounded, so that many values are equal
        lambda t, x: (t[:2], x[:2]),
        lambda t, x: (t, x * 1e-9 + 1e6),
        lambda t, x: (t, 1e6 + 1e-6 * (t - EPOCH_NS) / 1e9),
        lambda t, x: (t, np.where(np.arange(N) == 0, -1e6, x)),
        lambda t, x: (t, np.nextafter(1e6, np.where(x > 11.0, 2e6, 0.0))),  # 1e6 +/- one ulp
        lambda t, x: (t, np.where(np.arange(N) == N // 2, 1e6, x)),
        lambda t, x: (t, np.where(np.arange(N) == N - 1, 1e6, x)),
    ],
)
def test_hard_windows_are_exact_to_1e_15(change):
    rng = np.random.default_rng(8)
    tension = 12.62 - 0.9 * (GRID_NS - EPOCH_NS) / 1e9 + 0.01 * rng.normal(size=N)
    assert_close_to_reference(*change(GRID_NS, tension), tolerance=1e-15)


@pytest.mark.parametrize('offset', [1.0, 1e6])
def test_relaxation_adds_the_slope_over_the_intercept(offset):
    tension = offset - 0.02 * np.arange(240) / 50.0 + np.sin(np.arange(240))
    config = FeatureConfig(stiffness_features='stiffness_relaxation')
    values, spec = features_from_trials('stiffness', tension[None], 50.0, config=config)
    assert spec.names[-1] == 'tension__regression__relative_slope'
    assert spec.units == ('N/s', 'N', '1', '1/s')
    time_ns = 20_000_000 * np.arange(240)
    slope, intercept, *_ = reference_regression(time_ns, tension)
    assert abs(float(Fraction(values[0, 3]) / (slope / intercept) - 1)) <= 1e-12
    assert values[0, :3].tobytes() == compute_regression(time_ns, tension).tobytes()
