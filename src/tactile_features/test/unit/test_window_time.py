# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Windows whose time is not what it seems: wrong stamps, a clock that is set, samples that end."""

import dataclasses

import numpy as np
import pytest

from tactile_features import FeatureConfig, Outcome, TrialEvent, TrialFeatureExtractor
from tactile_features.extraction.extractor import GRACE_S, LONGEST_STEP_S, SampleTimeout
from tactile_ros.strain import StrainBlock, StrainStatus

S = 1_000_000_000
PERIOD_NS = S // 10
CONFIG = FeatureConfig(
    rate_hz=10.0,
    texture_samples=12,
    texture_crop_start_s=0.3,
    texture_crop_end_s=0.1,
    stiffness_settle_s=0.2,
    stiffness_crop_end_s=0.1,
    stiffness_min_s=0.5,
    buffer_s=60.0,
)
TENSION_N = np.random.default_rng(0).normal(5.0, 1.0, 1000)


def event(time_s, phase, trial_id='t1', **fields):
    return TrialEvent(round(time_s * S), trial_id, 's1', '', 'flexion', 'R1', phase, **fields)


def block(sequence, count=1, *, shift_s=0.0, **fields):
    stamp_ns = sequence * PERIOD_NS + round(shift_s * S)
    return StrainBlock(
        stamp_ns, sequence, PERIOD_NS, TENSION_N[sequence : sequence + count], **fields
    )


def feed(extractor, *inputs):
    windows = []
    for item in inputs:
        add = extractor.add_block if isinstance(item, StrainBlock) else extractor.add_event
        windows += add(item)
    return windows


def run(*inputs, config=CONFIG):
    return feed(TrialFeatureExtractor(config), *inputs)


# -- errors of stamps ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ('phase', 'most_s'),
    [('glide', 0.01 * 11 * 0.1), ('hold', 0.01 * (1.5 - 0.3))],
)
def test_a_window_allows_a_hundredth_of_its_length(phase, most_s):
    for error_s, outcome in ((0.999 * most_s, Outcome.OK), (1.001 * most_s, Outcome.BAD_TIME)):
        (window,) = run(
            event(2.0, phase), block(0, 50, stamp_error_s=error_s), event(3.5, 'release')
        )
        assert (window.outcome, window.stamp_error_s) == (outcome, error_s)
        assert (outcome == Outcome.OK) == (window.reason == '')
    assert f'{error_s:.4f} s' in window.reason
    assert f'allows {most_s:.4f} s (max_stamp_error_share)' in window.reason


def test_a_short_crop_allows_less():
    for crop_s, outcome in ((0.05, Outcome.BAD_TIME), (0.0, Outcome.OK)):
        config = dataclasses.replace(CONFIG, texture_crop_start_s=crop_s)
        inputs = event(2.0, 'glide'), block(0, 50, stamp_error_s=0.008), event(3.5, 'release')
        (window,) = run(*inputs, config=config)
        assert window.outcome == outcome


def test_the_worst_sample_of_the_window_counts():
    def glide(*blocks):
        (window,) = run(event(2.0, 'glide'), *blocks, event(3.5, 'release'))
        return window

    one = block(30, stamp_error_s=0.01)
    good = {'stamp_error_s': 0.001}
    window = glide(block(0, 30, **good), one, block(31, 20, **good))
    assert (window.outcome, window.stamp_error_s) == (Outcome.OK, 0.01)
    window = glide(block(0, 30, **good), block(30), block(31, 20, **good))
    assert (window.outcome, window.stamp_error_s) == (Outcome.OK, -1.0)
    outside = block(0, 23, stamp_error_s=1.0)
    window = glide(outside, block(23, 12, **good), block(35, 20, stamp_error_s=1.0))
    assert (window.outcome, window.stamp_error_s) == (Outcome.OK, 0.001)
    config = dataclasses.replace(CONFIG, max_gap_samples=2)
    inputs = event(2.0, 'glide'), block(0, 30, **good), block(31, 20, stamp_error_s=0.002)
    (window,) = run(*inputs, event(3.5, 'release'), config=config)
    assert (window.interpolated_count, window.stamp_error_s) == (1, 0.002)


@pytest.mark.parametrize('error_s', [-1.0, float('nan')])
def test_an_unknown_error_is_accepted_unless_told_otherwise(error_s):
    inputs = event(2.0, 'hold'), block(0, 50, stamp_error_s=error_s), event(3.5, 'release')
    assert [(w.outcome, w.stamp_error_s) for w in run(*inputs)] == [(Outcome.OK, -1.0)]
    config = dataclasses.replace(CONFIG, accept_unknown_stamp_error=False)
    (window,) = run(*inputs, config=config)
    assert window.outcome == Outcome.BAD_TIME
    assert 'accept_unknown_stamp_error' in window.reason


@pytest.mark.parametrize('accepts_unknown', [True, False])
def test_an_unknown_error_does_not_hide_a_known_one_above_the_limit(accepts_unknown):
    config = dataclasses.replace(CONFIG, accept_unknown_stamp_error=accepts_unknown)
    blocks = block(0, 28, stamp_error_s=0.5), block(28), block(29, 21, stamp_error_s=0.001)
    (window,) = run(event(2.0, 'hold'), *blocks, event(3.5, 'release'), config=config)
    assert (window.outcome, window.stamp_error_s) == (Outcome.BAD_TIME, -1.0)
    assert 'wrong by 0.5000 s' in window.reason


def test_the_partial_windows_of_a_glide_allow_what_the_whole_one_does():
    config = dataclasses.replace(CONFIG, texture_samples=60, partial_samples=(30,))
    for error_s, outcome in ((0.03, Outcome.OK), (0.06, Outcome.BAD_TIME)):
        (window,) = run(event(2.0, 'glide'), block(0, 60, stamp_error_s=error_s), config=config)
        assert (window.partial, window.outcome) == (True, outcome)


# -- the host's clock is set ---------------------------------------------------------------


def stepped(at, step_s, count=100):
    """Samples around a step of the clock before sample ``at``."""
    first = block(at, shift_s=step_s, status=StrainStatus.CLOCK_STEP)
    return block(0, at), first, block(at + 1, count, shift_s=step_s)


@pytest.mark.parametrize('step_s', [5.0, -0.3])
@pytest.mark.parametrize('phase', ['glide', 'hold'])
@pytest.mark.parametrize('at', [21, 23, 30])
def test_a_window_across_a_step_of_the_clock_is_refused(phase, at, step_s):
    before, *after = stepped(at, step_s)
    inputs = event(2.0, phase), before, *after, event(5.0 + step_s, 'release')
    (window,) = run(*inputs)
    assert window.outcome == Outcome.BAD_TIME
    way = 'forward' if step_s > 0 else 'back'
    assert f"the host's clock was set {way} by {abs(step_s):.3f} s" in window.reason


@pytest.mark.parametrize('phase', ['glide', 'hold'])
def test_an_end_that_comes_before_its_start_is_a_clock_that_was_set_back(phase):
    before, *after = stepped(30, -5.0)
    inputs = event(2.0, phase), before, event(3.5 - 5.0, 'release'), *after
    (window,) = run(*inputs)
    assert window.outcome == Outcome.BAD_TIME
    assert '3.500 s before its start' in window.reason


@pytest.mark.parametrize('step_s', [5.0, -5.0])
def test_windows_before_and_after_a_step_are_whole(step_s):
    before, first, after = stepped(40, step_s)
    start, end = event(4.5 + step_s, 'glide', 't2'), event(6.0 + step_s, 'done', 't2')
    one, other = run(event(2.0, 'glide'), before, event(3.5, 'done'), first, start, after, end)
    assert (one.outcome, other.outcome) == (Outcome.OK, Outcome.OK)
    assert (one.first_sequence, other.first_sequence) == (23, 48)


@pytest.mark.parametrize('phase', ['glide', 'hold'])
def test_a_pause_of_the_samples_is_not_told_as_a_step_of_the_clock(phase):
    first = block(30, shift_s=1.38, status=StrainStatus.RESYNCHRONISED)
    after = block(31, 100, shift_s=1.38)
    (window,) = run(event(2.0, phase), block(0, 30), first, after, event(6.0, 'release'))
    assert window.outcome == Outcome.GAP
    assert 'the samples paused for 1.480 s before sequence number 30' in window.reason
    assert 'clock' not in window.reason


# -- samples that do not come --------------------------------------------------------------

HOLD = event(2.0, 'hold'), block(0, 30), event(4.0, 'release')
LATE_S = 4.0 + CONFIG.samples_timeout_s


def test_whatever_tells_that_no_samples_come_the_window_is_the_same():
    extractor = TrialFeatureExtractor(CONFIG)
    assert feed(extractor, *HOLD) == []
    assert extractor.waits_since_ns == 4 * S
    (expected,) = extractor.time_out()
    assert expected.outcome == Outcome.GAP
    assert 'no samples came within 5 s of the end of the hold' in expected.reason
    assert extractor.time_out() == []
    assert extractor.window_counts[Outcome.GAP] == 1
    # Samples that come later, of the same stream or of another, with or without a loss.
    for sequence in (30, 95, 0):
        late = dataclasses.replace(block(sequence, 5), stamp_ns=round(LATE_S * S) + 1)
        assert run(*HOLD, late) == [expected]
        assert run(event(2.0, 'hold'), event(4.0, 'release'), block(0, 30), late) == [expected]
        assert run(block(0, 30), late, event(2.0, 'hold'), event(4.0, 'release')) == [expected]
    # The end of the data.
    extractor = TrialFeatureExtractor(CONFIG)
    feed(extractor, *HOLD)
    assert extractor.pass_time(round((LATE_S + GRACE_S) * S)) == []
    assert extractor.pass_time(round((LATE_S + GRACE_S) * S) + 1) == [expected]
    # An event long after.
    assert run(*HOLD, event(65.0, 'approach', 't2')) == [expected]


def test_samples_that_come_in_time_are_taken():
    late = dataclasses.replace(block(95, 5), stamp_ns=round(LATE_S * S))
    (window,) = run(*HOLD, late)
    assert 'samples are missing' in window.reason
    assert run(*HOLD, block(30, 20))[0].outcome == Outcome.OK


def test_the_timeout_is_told_by_a_clock_that_nobody_stops():
    extractor = TrialFeatureExtractor(CONFIG)
    now_s = [100.0]
    timeout = SampleTimeout(extractor, lambda: now_s[0])
    most_s = CONFIG.samples_timeout_s + GRACE_S

    def waited_s():
        """Return the time that it takes, asked four times a second."""
        began_s = now_s[0]
        while not timeout.is_over():
            now_s[0] += 0.25
            assert now_s[0] < began_s + 60.0
        return now_s[0] - began_s

    feed(extractor, *HOLD[:2])
    for _ in range(100):
        assert not timeout.is_over()  # nothing waits
        now_s[0] += 0.25
    feed(extractor, HOLD[2])
    assert waited_s() == pytest.approx(most_s, abs=0.3)
    extractor.time_out()
    assert not timeout.is_over()
    feed(extractor, event(5.0, 'hold', 't2'), event(6.0, 'release', 't2'))
    assert not timeout.is_over()
    now_s[0] += 3600.0  # the process was stopped: that is no waiting
    assert waited_s() == pytest.approx(most_s - LONGEST_STEP_S, abs=0.3)
    feed(extractor, block(30, 1))  # a block that is not enough begins it anew
    assert waited_s() == pytest.approx(most_s, abs=0.3)
