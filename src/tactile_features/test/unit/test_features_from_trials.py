# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from tactile_features import (
    FeatureConfig,
    FeatureError,
    features_from_trials,
    spec_for,
    TrialEvent,
    TrialFeatureExtractor,
    UndefinedFeatureError,
)
from tactile_ros.strain import StrainBlock

RNG = np.random.default_rng(0)


@pytest.mark.parametrize('trials', [0, 7])
@pytest.mark.parametrize('n', [2, 181])
def test_texture_takes_all_samples(trials, n):
    values, spec = features_from_trials('texture', RNG.normal(size=(trials, n)), 60.0)
    assert values.shape == (trials, n // 2 + 1) == (trials, len(spec.names))
    assert (spec.sample_count, spec.rate_hz) == (n, 60.0)


def test_stiffness_takes_all_samples():
    t = np.arange(240) / 60
    x = np.stack([12.62 - 0.9 * t, 3.0 + 0.1 * t])
    values, spec = features_from_trials('stiffness', x, 60.0)
    np.testing.assert_allclose(values, [[-0.9, 12.62, -1.0], [0.1, 3.0, 1.0]], rtol=1e-8)
    assert spec.names[0] == 'tension__regression__slope'


@pytest.mark.parametrize(
    ('task', 'phase', 'count'), [('texture', 'glide', 180), ('stiffness', 'hold', 204)]
)
def test_gives_the_bits_of_the_stream(task, phase, count):
    first = 10
    # 62.5 Hz: a period of whole nanoseconds, so that both sides see the same times.
    period_ns = 16_000_000
    config = FeatureConfig(
        rate_hz=62.5, texture_crop_start_s=0.16, stiffness_settle_s=0.16, stiffness_crop_end_s=0.1
    )
    tension_n = RNG.normal(5.0, 1.0, 400)
    extractor = TrialFeatureExtractor(config)
    end_ns = (first + count - 1) * period_ns + 100_000_000
    for stamp_ns, name in ((0, phase), (end_ns, 'release')):
        extractor.add_event(TrialEvent(stamp_ns, 't', '', task, 'flexion', '', name))
    (window,) = extractor.add_block(StrainBlock(0, 0, period_ns, tension_n))
    values, spec = features_from_trials(task, tension_n[None, first : first + count], 62.5)
    assert window.reason == ''
    assert values[0].tobytes() == window.values.tobytes()
    assert spec.mismatch(spec_for(task, config)) == ''


def test_a_constant_trial_is_named():
    x = RNG.normal(size=(5, 100))
    x[3] = 2.0
    with pytest.raises(UndefinedFeatureError, match='trial 3'):
        features_from_trials('stiffness', x, 60.0)
    assert not features_from_trials('texture', x, 60.0)[0][3].any()


@pytest.mark.parametrize('task', ['texture', 'stiffness'])
def test_a_trial_with_values_that_are_no_numbers_is_named(task):
    x = RNG.normal(size=(5, 100))
    x[2, 50] = np.nan
    with pytest.raises(FeatureError, match='trial 2'):
        features_from_trials(task, x, 60.0)


@pytest.mark.parametrize(
    ('task', 'shape', 'rate_hz', 'message'),
    [
        ('texture', (180,), 60.0, 'shape'),
        ('stiffness', (4, 1), 60.0, 'samples >= 2'),
        ('weight', (4, 180), 60.0, 'weight'),
        ('texture', (4, 180), 0.0, 'rate'),
        ('stiffness', (4, 180), np.inf, 'rate'),
    ],
)
def test_refuses_what_is_no_set_of_trials(task, shape, rate_hz, message):
    with pytest.raises(FeatureError, match=message):
        features_from_trials(task, np.zeros(shape), rate_hz)
