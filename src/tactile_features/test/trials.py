# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers of the tests: events and blocks of samples of trials, and their feature windows."""

import numpy as np

from tactile_features import TrialEvent, TrialFeatureExtractor
from tactile_ros.strain import StrainBlock

S = 1_000_000_000


def event(time_s, phase, trial_id='t1', *, protocol='texture', **fields):
    fields = {'contact': 'flexion', 'object_label': 'R1', 'session_id': 's1', **fields}
    return TrialEvent(round(time_s * S), trial_id, protocol=protocol, phase=phase, **fields)


def make_block(tension_n, sequence, period_ns, *, shift_ns=0, **fields):
    """Return a block of samples. The time of sample 0 of its stream is ``shift_ns``."""
    stamp_ns = sequence * period_ns + shift_ns
    return StrainBlock(stamp_ns, sequence, period_ns, np.asarray(tension_n), **fields)


def feed(extractor, *inputs):
    """Add blocks and events in this order; return the feature windows."""
    windows = []
    for item in inputs:
        add = extractor.add_block if isinstance(item, StrainBlock) else extractor.add_event
        windows += add(item)
    return windows


def extract(config, *inputs, wanted=()):
    """Return all feature windows, including those that still wait for samples at the end."""
    extractor = TrialFeatureExtractor(config, wanted)
    return [*feed(extractor, *inputs), *extractor.finish()]


def hard_windows(samples):
    """Return windows with which rounding errors are large.

    They are a random walk, a steep line, an offset of 1e9 N, steps, and a tiny and a huge signal.
    """
    noise = np.random.default_rng(4).standard_normal((6, samples)).cumsum(axis=1)
    noise[1] += 1e3 * np.arange(samples)
    noise[2] += 1e9
    noise[3] = np.sign(np.sin(np.arange(samples) / 9.0)) + 1e-3 * noise[3]
    noise[4] *= 1e-150
    noise[5] *= 1e60
    return noise
