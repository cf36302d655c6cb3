# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One trial at 10 Hz: what the window of each phase is, or why there is none."""

import dataclasses

import numpy as np
import pytest

from tactile_features import (
    compute_regression,
    compute_spectrum,
    FeatureConfig,
    Outcome,
    TrialEvent,
    TrialFeatureExtractor,
)
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
    buffer_s=20.0,
    frame_id='cell_link',
)
TENSION_N = np.random.default_rng(0).normal(5.0, 1.0, 1000)


def event(time_s, phase, trial_id='t1', **fields):
    protocol = 'stiffness' if phase == 'hold' else 'texture'
    return TrialEvent(
        round(time_s * S), trial_id, 's1', protocol, 'flexion', 'R1', phase, **fields
    )


def block(sequence, count=1, *, shift_ns=0, status=0, tension_n=TENSION_N, **fields):
    """Samples whose times follow from their sequence numbers, from 0 s on."""
    values = tension_n[sequence : sequence + count]
    return StrainBlock(
        sequence * PERIOD_NS + shift_ns, sequence, PERIOD_NS, values, status=status, **fields
    )


def feed(extractor, *inputs):
    windows = []
    for item in inputs:
        add = extractor.add_block if isinstance(item, StrainBlock) else extractor.add_event
        windows += add(item)
    return windows


def run(*inputs, config=CONFIG):
    extractor = TrialFeatureExtractor(config)
    windows = feed(extractor, *inputs)
    assert sum(extractor.window_counts.values()) == len(windows)
    return windows


def glide(*blocks, end_s=3.5, config=CONFIG, **fields):
    """The only window of a glide from 2 s on: nominally samples 23 to 34."""
    (window,) = run(event(2.0, 'glide'), *blocks, event(end_s, 'release', **fields), config=config)
    return window


def hold(*blocks, end_s=4.0, config=CONFIG):
    """The only window of a hold from 2 s on: nominally samples 22 to 39."""
    (window,) = run(event(2.0, 'hold'), *blocks, event(end_s, 'release'), config=config)
    return window


def test_texture_is_the_spectrum_of_the_first_samples_after_the_crop():
    window = glide(block(0, 50))
    assert window.outcome == Outcome.OK
    assert window.reason == ''
    assert window.values.tobytes() == compute_spectrum(TENSION_N[23:35], 'linear').tobytes()
    assert (window.window_start_ns, window.window_end_ns) == (2_300_000_000, 3_400_000_000)
    assert (window.first_sequence, window.sample_count, window.interpolated_count) == (23, 12, 0)
    assert (window.feature_set, window.feature_set_version) == ('texture_spectrum', 2)
    assert (window.rate_hz, window.frame_id, window.trial_id) == (10.0, 'cell_link', 't1')
    assert (window.contact, window.simulated, window.status) == ('flexion', False, 0)
    start = dataclasses.replace(event(2.0, 'glide'), contact='abduction', simulated=True)
    harmless = StrainStatus.HOST_TIME | StrainStatus.RESYNCHRONISED
    (window,) = run(start, block(0, 30), block(30, 20, status=harmless), event(3.5, 'release'))
    assert (window.contact, window.simulated, window.status) == ('abduction', True, harmless)
    assert window.outcome == Outcome.OK


SIMULATED = StrainStatus.SIMULATED


@pytest.mark.parametrize('first', [0, 34, 35])
def test_one_simulated_sample_makes_a_window_simulated(first):
    window = glide(block(0, first), block(first, 50 - first, status=SIMULATED))
    assert window.outcome == Outcome.OK  # it refuses nothing
    assert window.simulated is (first < 35)
    assert window.values.tobytes() == compute_spectrum(TENSION_N[23:35], 'linear').tobytes()


def test_a_window_without_samples_is_simulated_where_the_stream_is():
    for status in (0, SIMULATED):
        stream = (block(0, 25, status=status), event(2.0, 'glide'))
        (window,) = run(*stream, event(2.2, 'aborted'))
        assert (window.outcome, window.sample_count) == (Outcome.ABORTED, 0)
        assert window.simulated is bool(status)


def test_a_partial_window_is_simulated_by_its_samples():
    config = dataclasses.replace(CONFIG, partial_samples=(30,), texture_samples=40)
    extractor = TrialFeatureExtractor(config)
    extractor.add_event(event(2.0, 'glide'))
    windows = extractor.add_block(block(0, 55, status=SIMULATED))
    assert [(window.partial, window.simulated) for window in windows] == [(True, True)]


def test_stiffness_is_the_regression_over_the_hold_between_its_crops():
    window = hold(block(0, 50))
    time_ns = PERIOD_NS * np.arange(22, 40)
    assert window.outcome == Outcome.OK
    assert window.values.tobytes() == compute_regression(time_ns, TENSION_N[22:40]).tobytes()
    assert (window.window_start_ns, window.window_end_ns) == (2_200_000_000, 3_900_000_000)
    assert (window.first_sequence, window.sample_count) == (22, 18)
    assert window.feature_set == 'stiffness_regression'


def test_the_ends_of_a_window_belong_to_it_to_the_nanosecond():
    assert glide(block(0, 50, shift_ns=-1)).first_sequence == 24
    assert glide(block(0, 50, shift_ns=1)).outcome == Outcome.TOO_SHORT
    early, late = hold(block(0, 50, shift_ns=-1)), hold(block(0, 50, shift_ns=1))
    assert (early.first_sequence, early.sample_count) == (23, 17)
    assert (late.first_sequence, late.sample_count) == (22, 17)


def test_a_window_comes_as_soon_as_no_sample_can_change_it():
    extractor = TrialFeatureExtractor(CONFIG)
    for item in (event(2.0, 'glide'), event(3.5, 'hold'), event(5.5, 'release')):
        assert extractor.add_event(item) == []
    came = [n for n in range(60) if extractor.add_block(block(n))]
    assert came == [34, 55]


def test_a_phase_that_is_too_short_says_so_without_waiting_for_samples():
    for start, end_s in (('glide', 3.4), ('glide', 2.1), ('hold', 2.79)):
        (window,) = run(event(2.0, start), event(end_s, 'release'))
        assert window.outcome == Outcome.TOO_SHORT
        assert 'between its crops' in window.reason
        assert len(window.values) == 0
        assert window.window_start_ns == 2 * S
        assert window.window_end_ns == round(end_s * S)
    assert hold(block(0, 50), end_s=2.8).outcome == Outcome.OK


def test_an_aborted_phase_says_why():
    (window,) = run(event(2.0, 'glide'), event(3.5, 'aborted', message='tension limit'))
    assert window.outcome == Outcome.ABORTED
    assert window.reason == 'the trial was aborted: tension limit'


def test_an_abort_after_the_phase_leaves_its_window():
    (window,) = run(
        event(2.0, 'glide'), event(3.5, 'release'), event(3.6, 'aborted'), block(0, 50)
    )
    assert window.outcome == Outcome.OK


def test_a_lost_sample_is_a_gap_and_not_a_shorter_window():
    for lost in (24, 30, 34):
        window = glide(block(0, lost), block(lost + 1, 50))
        assert window.outcome == Outcome.GAP, lost
        assert 'samples are missing' in window.reason
    for lost in (22, 23, 30, 39):
        assert hold(block(0, lost), block(lost + 1, 50)).outcome == Outcome.GAP, lost


def test_a_loss_outside_the_window_does_no_harm():
    assert glide(block(0, 22), block(23, 12), block(36, 20)).outcome == Outcome.OK
    assert hold(block(0, 21), block(22, 18), block(41, 20)).outcome == Outcome.OK


def test_a_short_loss_is_interpolated_when_allowed_and_stated():
    config = dataclasses.replace(CONFIG, max_gap_samples=2)
    window = glide(block(0, 30), block(32, 20), config=config)
    tension = TENSION_N[23:35].copy()
    tension[7:9] = tension[6] + (tension[9] - tension[6]) * (np.array([1, 2]) / 3)
    assert window.outcome == Outcome.OK
    assert (window.sample_count, window.interpolated_count) == (12, 2)
    assert window.values.tobytes() == compute_spectrum(tension, 'linear').tobytes()
    assert (window.window_start_ns, window.window_end_ns) == (2_300_000_000, 3_400_000_000)
    window = hold(block(0, 22), block(24, 30), config=config)
    assert (window.first_sequence, window.sample_count, window.interpolated_count) == (22, 18, 2)
    assert glide(block(0, 30), block(33, 20), config=config).outcome == Outcome.GAP


@pytest.mark.parametrize(
    ('status', 'word'),
    [
        (StrainStatus.SATURATED, 'saturated'),
        (StrainStatus.STUCK, 'stuck'),
        (StrainStatus.DEVICE_ERROR, 'faulty'),
    ],
)
def test_bad_samples_in_the_window_refuse_it(status, word):
    window = glide(block(0, 34), block(34, status=status), block(35, 20))
    assert window.outcome == Outcome.BAD_SIGNAL
    assert word in window.reason
    assert window.status == status
    window = glide(block(0, 23, status=status), block(23, 12), block(35, 20, status=status))
    assert window.outcome == Outcome.OK
    assert window.status == 0


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_value_that_is_no_number_refuses_the_window(value):
    tension_n = TENSION_N.copy()
    tension_n[30] = value
    for window in (
        glide(block(0, 50, tension_n=tension_n)),
        hold(block(0, 50, tension_n=tension_n)),
    ):
        assert window.outcome == Outcome.BAD_SIGNAL
        assert len(window.values) == 0


def test_a_constant_has_a_spectrum_but_no_correlation():
    constant = np.full(100, 3.0)
    assert np.array_equal(glide(block(0, 50, tension_n=constant)).values, np.zeros(7))
    window = hold(block(0, 50, tension_n=constant))
    assert window.outcome == Outcome.UNDEFINED
    assert 'constant' in window.reason


def test_samples_at_another_rate_are_refused():
    fast = StrainBlock(0, 0, S // 15, TENSION_N[:100])
    slow = StrainBlock(0, 0, S // 8, TENSION_N[:100])
    for start, samples in (('glide', fast), ('glide', slow), ('hold', fast), ('hold', slow)):
        (window,) = run(event(2.0, start), samples, event(6.0, 'release'))
        assert window.outcome == Outcome.BAD_SIGNAL
        assert 'rate_hz' in window.reason


def test_a_reconnection_or_restart_in_the_window_is_a_gap():
    reconnected = glide(block(0, 30), block(30, status=StrainStatus.RECONNECTED), block(31, 20))
    restarted = glide(block(0, 30), block(0, 20, shift_ns=3 * S))
    for window in (reconnected, restarted):
        assert window.outcome == Outcome.GAP
        assert 'began again' in window.reason
    # A loss that the sequence does not show.
    assert glide(block(0, 30), block(30, 20, lost_before=4)).outcome == Outcome.GAP


def test_a_loss_at_the_start_does_not_move_a_window_that_has_room_behind_it():
    for lost in ((23,), (22, 23), range(15, 26)):
        window = glide(block(0, lost[0]), block(lost[-1] + 1, 40), end_s=5.0)
        assert window.outcome == Outcome.GAP, lost
        assert 'at the start of the window' in window.reason
    assert glide(block(0, 22), block(23, 40), end_s=5.0).first_sequence == 23


def test_a_stream_that_begins_inside_the_phase():
    assert glide(block(23, 30), end_s=4.0).first_sequence == 23
    assert glide(block(25, 30), end_s=4.0).outcome == Outcome.GAP
    assert glide(block(25, 30)).outcome == Outcome.GAP
    assert hold(block(24, 30)).outcome == Outcome.GAP


def test_a_stream_that_ends_inside_the_phase():
    extractor = TrialFeatureExtractor(CONFIG)
    extractor.add_block(block(0, 30))
    extractor.add_event(event(2.0, 'hold'))
    assert extractor.add_event(event(4.0, 'release')) == []
    (window,) = extractor.finish()
    assert window.outcome == Outcome.GAP
    assert extractor.finish() == []
    assert extractor.window_counts[Outcome.GAP] == 1


def test_the_buffer_holds_a_window_to_the_last_sample():
    # Sample 22 is the first of the hold; the buffer reaches back 200 samples.
    for count, outcome in ((223, Outcome.OK), (224, Outcome.GAP)):
        blocks = (block(n) for n in range(count))
        (window,) = run(*blocks, event(2.0, 'hold'), event(4.0, 'done'))
        assert window.outcome == outcome
    assert 'buffer_s' in window.reason


def test_an_event_that_is_repeated_ends_no_phase():
    start, end = event(2.0, 'glide'), event(3.5, 'done')
    assert run(block(0, 50), start, start, end, end) == [glide(block(0, 50))]


def test_a_recording_played_again_gives_the_same_windows_again():
    recording = [
        event(1.0, 'approach'),
        event(2.0, 'glide'),
        block(0, 30),
        event(3.5, 'hold'),
        block(30, 40),
        event(5.5, 'done'),
        block(70, 10),
    ]
    once = run(*recording)
    assert [w.outcome for w in once] == [Outcome.OK, Outcome.OK]
    assert run(*recording, *recording) == once + once
    # Broken off in the middle, then played from its start.
    assert run(*recording[:3], *recording) == once


def test_phases_that_wait_when_the_clock_is_set_back_are_refused():
    extractor = TrialFeatureExtractor(CONFIG)
    extractor.add_block(block(0, 30))
    extractor.add_event(event(2.0, 'glide'))
    extractor.add_event(event(3.5, 'done'))
    (window,) = extractor.add_block(block(0, 1))
    assert window.outcome == Outcome.GAP
    assert 'set back' in window.reason


def test_windows_are_equal_when_every_bit_is():
    window = glide(block(0, 50))
    assert window == glide(block(0, 50))
    nudged = window.values.copy()
    nudged[3] = np.nextafter(nudged[3], 1.0)
    assert window != dataclasses.replace(window, values=nudged)
    assert window != dataclasses.replace(window, window_end_ns=window.window_end_ns + 1)
    assert window != 'window'


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
        (window,) = feed(
            TrialFeatureExtractor(config), event(2.0, 'glide'), block(0, 60, stamp_error_s=error_s)
        )
        assert (window.partial, window.outcome) == (True, outcome)


# -- the host's clock is set ---------------------------------------------------------------


def stepped(at, step_s, count=100):
    """Samples around a step of the clock before sample ``at``."""
    first = block(at, shift_ns=round(step_s * S), status=StrainStatus.CLOCK_STEP)
    return block(0, at), first, block(at + 1, count, shift_ns=round(step_s * S))


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
    first = block(30, shift_ns=1_380_000_000, status=StrainStatus.RESYNCHRONISED)
    after = block(31, 100, shift_ns=1_380_000_000)
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
    assert run(*HOLD, event(25.0, 'approach', 't2')) == [expected]


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
