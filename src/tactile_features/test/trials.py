# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials as an extractor sees them: events, blocks of samples, and the windows that come out."""

import numpy as np

from tactile_features import TrialEvent, TrialFeatureExtractor
from tactile_ros.strain import StrainBlock

S = 1_000_000_000


def event(time_s, phase, trial_id='t1', *, protocol='texture', **fields):
    fields = {'contact': 'flexion', 'object_label': 'R1', 'session_id': 's1', **fields}
    return TrialEvent(round(time_s * S), trial_id, protocol=protocol, phase=phase, **fields)


def make_block(tension_n, sequence, period_ns, *, shift_ns=0, **fields):
    """Samples whose times follow from their sequence numbers, from 0 s on."""
    stamp_ns = sequence * period_ns + shift_ns
    return StrainBlock(stamp_ns, sequence, period_ns, np.asarray(tension_n), **fields)


def feed(extractor, *inputs):
    """Return the windows that come of blocks and events, in the order given."""
    windows = []
    for item in inputs:
        add = extractor.add_block if isinstance(item, StrainBlock) else extractor.add_event
        windows += add(item)
    return windows


def extract(config, *inputs, wanted=()):
    """Return all windows, also those that still wait at the end."""
    extractor = TrialFeatureExtractor(config, wanted)
    return [*feed(extractor, *inputs), *extractor.finish()]


def hard_windows(samples):
    """Noise, a steep line, an offset of 1e9 times the signal, steps, a tiny and a huge signal."""
    noise = np.random.default_rng(4).standard_normal((6, samples)).cumsum(axis=1)
    noise[1] += 1e3 * np.arange(samples)
    noise[2] += 1e9
    noise[3] = np.sign(np.sin(np.arange(samples) / 9.0)) + 1e-3 * noise[3]
    noise[4] *= 1e-150
    noise[5] *= 1e60
    return noise
