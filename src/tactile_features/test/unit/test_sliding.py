# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_features import compute_spectrum, FeatureError, sliding_spectrum, SlidingSpectrum
from tactile_features.sliding import _make_kernel, _slide, SlidingState

PI = np.longdouble('3.14159265358979323846264338327950288')


def reference_spectrum(x):
    """Discrete Fourier transform by its definition, in extended precision."""
    x = np.asarray(x, dtype=np.longdouble)
    n = len(x)
    x = x - x.sum() / n
    angle = 2 * PI * (np.outer(np.arange(n // 2 + 1), np.arange(n)) % n).astype(np.longdouble) / n
    amplitude = 2 * np.hypot(np.cos(angle) @ x, np.sin(angle) @ x) / n
    if n % 2 == 0:
        amplitude[-1] /= 2
    amplitude[0] = 0
    return amplitude


def worst_error(tension, n, rows, amplitudes):
    errors = []
    for row in rows:
        exact = reference_spectrum(tension[row : row + n])
        errors.append(np.abs(amplitudes[row] - exact).max() / exact.max())
    return float(max(errors))


@pytest.mark.parametrize('n', [2, 5, 12, 45, 180])
@pytest.mark.parametrize('offset', [0.0, 1e6])
def test_each_row_is_the_spectrum_of_its_window(n, offset):
    tension = offset + np.random.default_rng(n).normal(size=3 * n + 7)
    rows = sliding_spectrum(tension, n)
    assert rows.shape == (2 * n + 8, n // 2 + 1)
    assert worst_error(tension, n, range(0, len(rows), 1 + n // 12), rows) < 2e-14


def test_error_does_not_grow_and_an_offset_costs_nothing():
    rng = np.random.default_rng(1)
    tension = 1e6 + rng.normal(size=30_000)
    rows = sliding_spectrum(tension, 180, bins=None)
    early = worst_error(tension, 180, range(0, 400, 29), rows)
    late = worst_error(tension, 180, range(29_400, 29_800, 29), rows)
    assert early < 3e-14
    assert late < 3e-14
    assert late < 3 * early


def test_a_jump_is_forgotten_after_two_windows():
    tension = np.random.default_rng(2).normal(size=1000)
    tension[300] = 1e6
    rows = sliding_spectrum(tension, 60)
    assert worst_error(tension, 60, range(430, 900, 13), rows) < 1e-14


def test_agrees_with_the_batch_of_windows():
    tension = 5.0 + np.random.default_rng(3).normal(size=500)
    windows = np.lib.stride_tricks.sliding_window_view(tension, 180)
    expected = compute_spectrum(windows)
    np.testing.assert_allclose(sliding_spectrum(tension, 180), expected, rtol=0, atol=2e-15)


@given(st.lists(st.integers(0, 50), max_size=30), st.sampled_from([2, 7, 30]), st.booleans())
@settings(deadline=None)
def test_the_grouping_of_samples_changes_no_bit(sizes, n, some):
    tension = 4.0 + np.random.default_rng(4).normal(size=sum(sizes))
    bins = [n // 2, 1] if some else None
    spectrum = SlidingSpectrum(n, bins)
    parts = [spectrum.add(part) for part in np.split(tension, np.cumsum(sizes)[:-1])]
    whole = sliding_spectrum(tension, n, bins)
    assert np.concatenate([whole[:0], *parts]).tobytes() == whole.tobytes()


def test_a_selection_holds_the_bits_of_all_bins():
    tension = np.random.default_rng(5).normal(size=700)
    whole = sliding_spectrum(tension, 180)
    assert np.array_equal(sliding_spectrum(tension, 180, [3, 90, 0, 41]), whole[:, [3, 90, 0, 41]])


@pytest.mark.parametrize(('n', 'count'), [(180, 91), (12, 7), (300, 151)])
def test_compiled_and_plain_loop_give_the_same_bits(n, count):
    pytest.importorskip('numba', reason='numba compiles the loop, and is not installed')
    from tactile_features.compiled_sliding import slide

    tension = 1e3 + np.random.default_rng(6).normal(size=3 * n + 5)
    kernel = _make_kernel(n, np.arange(count))
    results = []
    for loop in (slide, _slide):
        state = SlidingState(0, 0.0, np.zeros(n), np.zeros((count, 4)))
        out = np.empty((len(tension), count))
        for some in (slice(0, n + 1), slice(n + 1, None)):
            loop(kernel, state, tension[some], out[some])
        results.append((out.tobytes(), state.sums.tobytes(), state.place, state.anchor))
    assert results[0] == results[1]


def test_a_bad_value_is_refused_and_not_taken():
    spectrum = SlidingSpectrum(4)
    spectrum.add([1.0, 2.0])
    with pytest.raises(FeatureError, match='not finite'):
        spectrum.add([3.0, np.nan])
    assert (
        spectrum.add([3.0, 5.0]).tobytes() == sliding_spectrum([1.0, 2.0, 3.0, 5.0], 4).tobytes()
    )


@pytest.mark.parametrize(
    ('n', 'bins', 'message'),
    [(1, None, 'at least 2'), (8, [5], '0 to 4'), (8, [-1], '0 to 4'), (8, [], '0 to 4')],
)
def test_refuses_what_has_no_spectrum(n, bins, message):
    with pytest.raises(FeatureError, match=message):
        SlidingSpectrum(n, bins)


def test_a_table_of_samples_is_refused():
    with pytest.raises(FeatureError, match='one row'):
        SlidingSpectrum(4).add(np.ones((2, 8)))
