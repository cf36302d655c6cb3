# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The first parts of a texture window, while the rest still fills."""

import numpy as np
import pytest

from tactile_features import (
    FeatureConfig,
    FeatureError,
    features_from_trials,
    Outcome,
    TrialEvent,
    TrialFeatureExtractor,
)
from tactile_ros.strain import StrainBlock

S = 1_000_000_000
PERIOD_NS = S // 50
CONFIG = FeatureConfig(
    rate_hz=50.0, texture_samples=100, texture_crop_start_s=0.2, partial_samples=(30, 60)
)
TENSION_N = np.random.default_rng(0).normal(5.0, 1.0, 400)


def event(time_s, phase, trial_id='t'):
    return TrialEvent(round(time_s * S), trial_id, '', 'texture', 'flexion', '', phase)


def block(sequence, count, *, lost_before=0):
    values = TENSION_N[sequence : sequence + count]
    return StrainBlock(sequence * PERIOD_NS, sequence, PERIOD_NS, values, lost_before=lost_before)


def test_it_comes_with_its_last_sample_before_the_end_of_the_glide_is_known():
    extractor = TrialFeatureExtractor(CONFIG)
    extractor.add_event(event(1.0, 'glide'))
    came = {n: w for n in range(200) for w in extractor.add_block(block(n, 1))}
    assert list(came) == [60 + 30 - 1, 60 + 60 - 1]
    assert [w.sample_count for w in came.values()] == [30, 60]
    assert all(w.partial and w.outcome == Outcome.OK for w in came.values())
    assert {w.window_start_ns for w in came.values()} == {60 * PERIOD_NS}
    assert [w.window_end_ns for w in came.values()] == [89 * PERIOD_NS, 119 * PERIOD_NS]
    (window,) = extractor.add_event(event(3.5, 'release'))
    assert not window.partial
    assert window.window_start_ns == 60 * PERIOD_NS
    assert extractor.window_counts[Outcome.OK] == 1


def test_it_gives_the_bits_of_a_batch_of_whole_windows():
    extractor = TrialFeatureExtractor(CONFIG)
    extractor.add_event(event(1.0, 'glide'))
    partial = extractor.add_block(block(0, 200))
    whole = np.stack([TENSION_N[60:160], TENSION_N[100:200]])
    for window in partial:
        values, spec = features_from_trials(
            'texture', whole, 50.0, first_samples=window.sample_count
        )
        assert values[0].tobytes() == window.values.tobytes()
        assert values.shape == (2, len(spec.names))


def test_a_gap_within_is_said_and_one_behind_does_not_matter():
    extractor = TrialFeatureExtractor(CONFIG)
    extractor.add_event(event(1.0, 'glide'))
    early, late = extractor.add_block(block(0, 100)) + extractor.add_block(
        block(101, 99, lost_before=1)
    )
    assert early.outcome == Outcome.OK
    assert (late.outcome, late.partial) == (Outcome.GAP, True)
    assert 'sequence number 99' in late.reason


def test_what_never_filled_is_no_longer_waited_for():
    extractor = TrialFeatureExtractor(CONFIG)
    extractor.add_event(event(1.0, 'glide', 'a'))
    extractor.add_event(event(300.0, 'glide', 'b'))
    far = StrainBlock(299 * S, 0, PERIOD_NS, TENSION_N)
    assert [w.trial_id for w in extractor.add_block(far)] == ['b', 'b']


@pytest.mark.parametrize('counts', [(29,), (100,), (60, 60), (60, 40)])
def test_counts_that_do_not_rise_within_the_window_are_refused(counts):
    with pytest.raises(FeatureError, match='partial_samples'):
        FeatureConfig(rate_hz=50.0, texture_samples=100, partial_samples=counts)


def test_a_list_from_a_file_is_as_good():
    assert FeatureConfig(partial_samples=[60, 120]) == FeatureConfig(partial_samples=(60, 120))


@pytest.mark.parametrize(('task', 'first'), [('stiffness', 60), ('texture', 101), ('texture', 1)])
def test_batches_refuse_parts_that_are_none(task, first):
    with pytest.raises(FeatureError):
        features_from_trials(task, TENSION_N[None, :100], 50.0, first_samples=first)
