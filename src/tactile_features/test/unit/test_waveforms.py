# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets of features that are the tension itself."""

from fractions import Fraction

import numpy as np
import pytest

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.feature_sets.texture_spatial import smooth_over_distance, SpatialWindow
from tactile_features.feature_sets.waveforms import average_parts

WAVEFORMS = ('glide_waveform', 'spatial_waveform', 'hold_waveform')


def average_exactly(row, parts):
    """Return the means of equal parts, in fractions."""
    n = len(row)
    means = []
    for p in range(parts):
        low, high = Fraction(p * n, parts), Fraction((p + 1) * n, parts)
        total = Fraction(0)
        for i, value in enumerate(row):
            share = min(high, i + 1) - max(low, i)
            if share > 0:
                total += share * Fraction(float(value))
        means.append(float(total / (high - low)))
    return np.array(means)


@pytest.mark.parametrize('n', [101, 150, 400])
@pytest.mark.parametrize(('offset', 'slope'), [(0.0, 1.0), (1e9, 1e-4), (-5.0, 0.0)])
def test_means_of_parts_are_those_of_exact_arithmetic(n, offset, slope):
    rng = np.random.default_rng(n)
    row = offset + slope * (np.arange(n) / n + 0.1 * rng.normal(size=n))
    found = average_parts(row, 100)
    size = np.ptp(row) + np.finfo(float).eps * abs(offset)
    np.testing.assert_allclose(
        found, average_exactly(row, 100), rtol=0, atol=1e-12 * size * n + np.spacing(abs(offset))
    )


def test_a_short_window_comes_back_as_it_is():
    row = np.random.default_rng(0).normal(size=(2, 60))
    np.testing.assert_array_equal(average_parts(row, 100), row)


@pytest.mark.parametrize('name', WAVEFORMS)
def test_a_window_gives_the_same_bits_alone_and_in_a_batch_and_keeps_its_level(name):
    task = 'stiffness' if name == 'hold_waveform' else 'texture'
    chooser = 'stiffness_features' if task == 'stiffness' else 'texture_features'
    config = FeatureConfig(**{chooser: name}, spatial_length_m=0.03)
    x = 7.0 + np.random.default_rng(1).normal(size=(5, 240))
    speeds = np.full(5, 0.01)
    together, spec = features_from_trials(task, x, 60.0, config=config, speeds_m_s=speeds)
    alone = [
        features_from_trials(task, row[None], 60.0, config=config, speeds_m_s=speeds[:1])[0][0]
        for row in x
    ]
    assert together.tobytes() == np.array(alone).tobytes()
    assert together.shape == (5, len(spec.names))
    assert set(spec.units) == {'N'}
    assert find_feature_set(name).is_waveform
    raised, _ = features_from_trials(task, x + 3.0, 60.0, config=config, speeds_m_s=speeds)
    np.testing.assert_allclose(raised, together + 3.0, atol=1e-12)


def test_a_straight_line_over_the_surface_stays_one_inside_the_window():
    window = SpatialWindow(0.04, 0.001)
    count = window.sample_count(0.01, 60.0)
    step_m = 0.01 / 60.0
    at_m = step_m * np.arange(count) - (step_m * (count - 1) - window.length_m) / 2
    found = smooth_over_distance(1e6 + 3.0 * at_m, 0.01, 60.0, window)
    inside = slice(20, -20)  # four finest scales from either end
    expected = 1e6 + 3.0 * window.grid_m
    np.testing.assert_allclose(found[inside], expected[inside], rtol=0, atol=1e-6)


def test_a_window_that_is_not_finite_is_refused():
    with pytest.raises(FeatureError, match='not finite'):
        average_parts([1.0, np.nan] * 100, 100)
