# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials found in the tension have the same names for all who look, whenever they joined."""

import numpy as np
import pytest

from tactile_features import FeatureConfig
from tactile_features.phases import SignalPhases
from tactile_features.windows import SAMPLE

RATE_HZ = 60.0
SETTLED_NS = 1_300_000_000
"""Rest after which a late one finds the same trials [ns]: 60 samples and up to 15 more."""


def make_session(seed, step_n, first_sequence):
    """Return the samples of five pulls with 0.4 s to 4 s of rest between them."""
    random = np.random.default_rng(seed)
    parts = []
    for _ in range(5):
        t = np.arange(400) / RATE_HZ
        held_n = 3.5 + 1.5 * np.exp(-t / 3.0) - step_n * np.clip((t - 1.0) / 0.05, 0.0, 1.0)
        shape = np.clip(np.minimum(t / 0.5, (6.0 - t) / 0.4), 0.0, 1.0)
        parts += [np.zeros(random.integers(24, 240)), held_n * shape]
    tension_n = np.concatenate(parts)
    samples = np.zeros(len(tension_n), SAMPLE)
    samples['stamp_ns'] = 10**18 + np.rint(np.arange(len(tension_n)) * 1e9 / RATE_HZ)
    samples['sequence'] = first_sequence + np.arange(len(tension_n))
    samples['tension_n'] = tension_n + random.normal(0.0, 0.02, len(tension_n))
    return samples


@pytest.mark.parametrize(('phases', 'step_n'), [('stiffness', 0.0), ('texture', 0.3)])
def test_a_late_one_finds_the_same_trials_or_none(phases, step_n):
    config = FeatureConfig(phases=phases)
    samples = make_session(1, step_n, 0)
    expected = SignalPhases(config).add(samples)
    assert len({event.trial_id for event in expected}) == 5
    contacts = [event for event in expected if event.phase == 'contact']
    ends_ns = [0, *(event.stamp_ns for event in expected if event.phase == 'done')]
    for joined in range(1, len(samples) - 1, 67):
        found = SignalPhases(config).add(samples[joined:])
        names = {event.trial_id for event in found}
        assert found == [event for event in expected if event.trial_id in names]
        at_ns = int(samples['stamp_ns'][joined])
        sure = {
            event.trial_id
            for event, rest_ns in zip(contacts, ends_ns, strict=False)
            if event.stamp_ns - max(at_ns, rest_ns) > SETTLED_NS
        }
        assert sure <= names


def test_a_stream_is_not_joined_late_where_its_first_sample_is_seen():
    config = FeatureConfig(phases='stiffness')
    samples = make_session(0, 0.0, 0)
    contact = SignalPhases(config).add(samples)[0]
    short_rest = samples[samples['stamp_ns'] > contact.stamp_ns - SETTLED_NS // 2]
    for first_sequence, count in ((0, 5), (1000, 4)):
        short_rest['sequence'] = first_sequence + np.arange(len(short_rest))
        found = SignalPhases(config).add(short_rest)
        assert len({event.trial_id for event in found}) == count
