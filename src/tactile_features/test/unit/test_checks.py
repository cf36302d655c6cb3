# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every feature set passes `check_feature_set`, and sets that break the contract do not."""

import numpy as np
import pytest
from trials import hard_windows

from tactile_features import (
    check_feature_set,
    compute_regression,
    compute_spectrum,
    Feature,
    FeatureConfig,
    features_from_trials,
    FeatureSet,
)
from tactile_features.checks import FeatureSetCheckError
from tactile_features.feature_sets.registry import BUILT_IN
from tactile_features.feature_sets.texture_spectrum import TextureSpectrum


@pytest.mark.parametrize('feature_set', [pytest.param(each, id=each.name) for each in BUILT_IN])
@pytest.mark.parametrize('samples', [30, 77])
def test_every_set_keeps_the_contract(feature_set, samples):
    config = FeatureConfig(
        texture_samples=samples,
        stiffness_samples=samples,
        spatial_length_m=(samples - 1.37) * 0.00025,
    )
    check_feature_set(feature_set, config, hard_windows(samples))


@pytest.mark.parametrize('detrend', ['none', 'mean', 'linear'])
@pytest.mark.parametrize('window', ['none', 'hann'])
@pytest.mark.parametrize('samples', [2, 3, 31, 180, 181])
def test_every_way_of_a_spectrum_keeps_the_contract(detrend, window, samples):
    config = FeatureConfig(
        texture_samples=samples, spectrum_detrend=detrend, spectrum_window=window
    )
    check_feature_set(TextureSpectrum, config, hard_windows(samples))


def test_the_order_of_rows_in_memory_changes_no_bit():
    windows = hard_windows(77)
    time_ns = 16_000_000 * np.arange(77)
    columns = np.asfortranarray(windows)
    for compute in (compute_spectrum, lambda x: compute_regression(time_ns, x)):
        assert compute(columns).tobytes() == compute(windows).tobytes()
    for task in ('texture', 'stiffness'):
        one, two = (features_from_trials(task, x, 62.5)[0] for x in (windows, columns))
        assert one.tobytes() == two.tobytes()


class Range(FeatureSet):
    name = 'range'
    version = 1
    phase = 'glide'
    count_field = 'texture_samples'

    def describe(self, sample_count, rate_hz):
        return (Feature('tension__range', 'N'),)

    def compute(self, samples):
        return np.ptp(samples.tension_n, axis=-1, keepdims=True)


def change_input(self, samples):
    samples.tension_n[...] -= samples.tension_n.mean(axis=-1, keepdims=True)
    return np.ptp(samples.tension_n, axis=-1, keepdims=True)


def look_at_neighbours(self, samples):
    return Range.compute(self, samples) + 1e-9 * samples.tension_n.std()


def count_calls(self, samples):
    self.calls = getattr(self, 'calls', 0) + 1
    return Range.compute(self, samples) * self.calls


def divide_by_the_range(self, samples):
    with np.errstate(divide='ignore'):
        return 1.0 / Range.compute(self, samples)


@pytest.mark.parametrize(
    ('code', 'changes'),
    [
        ('attributes', {'version': '1'}),
        ('attributes', {'phase': 'release'}),
        ('attributes', {'cut': ('buffer_s',)}),
        ('attributes', {'count_field': '', 'can_be_early': True}),
        ('names', {'describe': lambda self, count, rate_hz: (Feature('a', 'N'),) * 2}),
        ('names', {'describe': lambda self, count, rate_hz: ()}),
        ('shape', {'compute': lambda self, samples: np.ptp(samples.tension_n, axis=-1)}),
        ('shape', {'compute': lambda self, s: Range.compute(self, s).astype(np.float32)}),
        ('finite', {'compute': lambda self, samples: Range.compute(self, samples) * np.nan}),
        ('input', {'compute': change_input}),
        ('repeatable', {'compute': count_calls}),
        ('batch', {'compute': look_at_neighbours}),
        ('undefined', {'compute': divide_by_the_range}),
    ],
)
def test_a_set_that_breaks_the_contract_is_told_how(code, changes):
    check_feature_set(Range)
    with pytest.raises(FeatureSetCheckError, match='range') as caught:
        check_feature_set(type('Broken', (Range,), changes))
    assert caught.value.code == code
