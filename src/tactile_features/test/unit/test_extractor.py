# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature windows of a trial at 10 Hz: their samples, or the reason why they have no features."""

import dataclasses

import numpy as np
import pytest
from trials import event, feed, make_block, S

from tactile_features import (
    compute_regression,
    compute_spectrum,
    FeatureConfig,
    FeatureError,
    spec_for,
    TrialFeatureExtractor,
    WindowOutcome,
)
from tactile_features.extraction.extractor import GRACE_S, LONGEST_STEP_S, SampleTimeout
from tactile_ros.strain import StrainStatus

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
EARLY = dataclasses.replace(CONFIG, early_windows=True)
FILLING = dataclasses.replace(CONFIG, max_gap_samples=2)
TENSION_N = np.random.default_rng(0).normal(5.0, 1.0, 1000)
OK, GAP, BAD_TIME = WindowOutcome.OK, WindowOutcome.GAP, WindowOutcome.BAD_TIME


def block(sequence, count=1, *, tension_n=TENSION_N, period_ns=PERIOD_NS, **fields):
    return make_block(tension_n[sequence : sequence + count], sequence, period_ns, **fields)


def run(*inputs, config=CONFIG):
    extractor = TrialFeatureExtractor(config)
    windows = feed(extractor, *inputs)
    assert sum(extractor.window_counts.values()) == len(windows)
    return windows


def glide(*blocks, end_s=3.5, config=CONFIG, **fields):
    """Return the only window of a glide that begins at 2 s: without faults, samples 23 to 34."""
    (window,) = run(event(2.0, 'glide'), *blocks, event(end_s, 'release', **fields), config=config)
    return window


def hold(*blocks, end_s=4.0, config=CONFIG):
    """Return the only window of a hold that begins at 2 s: without faults, samples 22 to 39."""
    (window,) = run(event(2.0, 'hold'), *blocks, event(end_s, 'release'), config=config)
    return window


def around(lost, count=20):
    """Return the blocks before and after these missing samples."""
    return block(0, lost[0]), block(lost[-1] + 1, count)


def test_texture_is_the_spectrum_of_the_first_samples_after_the_crop():
    window = glide(block(0, 50))
    assert (window.outcome, window.reason) == (OK, '')
    assert window.values.tobytes() == compute_spectrum(TENSION_N[23:35], 'linear').tobytes()
    assert (window.window_start_ns, window.window_end_ns) == (2_300_000_000, 3_400_000_000)
    assert (window.first_sequence, window.sample_count, window.interpolated_count) == (23, 12, 0)
    assert (window.feature_set, window.feature_set_version) == ('texture_spectrum', 2)
    assert (window.rate_hz, window.frame_id, window.trial_id) == (10.0, 'cell_link', 't1')
    assert (window.contact, window.simulated, window.status) == ('flexion', False, 0)
    start = event(2.0, 'glide', contact='abduction', simulated=True)
    harmless = StrainStatus.HOST_TIME | StrainStatus.RESYNCHRONISED
    (window,) = run(start, block(0, 30), block(30, 20, status=harmless), event(3.5, 'release'))
    assert (window.contact, window.simulated, window.status) == ('abduction', True, harmless)
    assert window.outcome == OK


def test_stiffness_is_the_regression_over_the_hold_between_its_crops():
    window = hold(block(0, 50))
    time_ns = PERIOD_NS * np.arange(22, 40)
    assert window.outcome == OK
    assert window.values.tobytes() == compute_regression(time_ns, TENSION_N[22:40]).tobytes()
    assert (window.window_start_ns, window.window_end_ns) == (2_200_000_000, 3_900_000_000)
    assert (window.first_sequence, window.sample_count) == (22, 18)
    assert window.feature_set == 'stiffness_regression'


def test_windows_are_equal_when_every_bit_is():
    window = glide(block(0, 50))
    assert window == glide(block(0, 50))
    nudged = window.values.copy()
    nudged[3] = np.nextafter(nudged[3], 1.0)
    assert window != dataclasses.replace(window, values=nudged)
    assert window != dataclasses.replace(window, window_end_ns=window.window_end_ns + 1)
    assert window != 'window'


@pytest.mark.parametrize('first', [0, 34, 35])
def test_one_simulated_sample_makes_a_window_simulated_and_refuses_nothing(first):
    window = glide(block(0, first), block(first, 50 - first, status=StrainStatus.SIMULATED))
    assert (window.outcome, window.simulated) == (OK, first < 35)


@pytest.mark.parametrize('status', [0, StrainStatus.SIMULATED])
def test_a_window_without_samples_and_an_early_one_are_simulated_where_the_stream_is(status):
    (window,) = run(block(0, 25, status=status), event(2.0, 'glide'), event(2.2, 'aborted'))
    assert (window.outcome, window.sample_count) == (WindowOutcome.ABORTED, 0)
    assert window.simulated is bool(status)
    (window,) = run(event(2.0, 'glide'), block(0, 55, status=status), config=EARLY)
    assert window.simulated is bool(status)


def test_the_ends_of_a_window_belong_to_it_to_the_nanosecond():
    assert glide(block(0, 50, shift_ns=-1)).first_sequence == 24
    assert glide(block(0, 50, shift_ns=1)).outcome == WindowOutcome.TOO_SHORT
    early, late = hold(block(0, 50, shift_ns=-1)), hold(block(0, 50, shift_ns=1))
    assert (early.first_sequence, early.sample_count) == (23, 17)
    assert (late.first_sequence, late.sample_count) == (22, 17)


def test_a_window_comes_as_soon_as_no_sample_can_change_it():
    extractor = TrialFeatureExtractor(CONFIG)
    assert feed(extractor, event(2.0, 'glide'), event(3.5, 'hold'), event(5.5, 'release')) == []
    assert [n for n in range(60) if extractor.add_block(block(n))] == [34, 55]


@pytest.mark.parametrize(('start', 'end_s'), [('glide', 3.4), ('glide', 2.1), ('hold', 2.79)])
def test_a_phase_that_is_too_short_says_so_without_waiting_for_samples(start, end_s):
    (window,) = run(event(2.0, start), event(end_s, 'release'))
    assert window.outcome == WindowOutcome.TOO_SHORT
    assert 'between its crops' in window.reason
    assert len(window.values) == 0
    assert (window.window_start_ns, window.window_end_ns) == (2 * S, round(end_s * S))
    assert hold(block(0, 50), end_s=2.8).outcome == OK


def test_an_aborted_phase_says_why_and_an_abort_after_it_leaves_its_window():
    (window,) = run(event(2.0, 'glide'), event(3.5, 'aborted', message='tension limit'))
    assert window.outcome == WindowOutcome.ABORTED
    assert window.reason == 'the trial was aborted: tension limit'
    events = event(2.0, 'glide'), event(3.5, 'release'), event(3.6, 'aborted')
    assert run(*events, block(0, 50)) == [glide(block(0, 50))]


def marked(status, at=34):
    """Return the blocks of a stream in which only sample ``at`` has this status."""
    return block(0, at), block(at, status=status), block(at + 1, 20)


def replaced(value, at=slice(None)):
    tension_n = TENSION_N.copy()
    tension_n[at] = value
    return (block(0, 50, tension_n=tension_n),)


@pytest.mark.parametrize(
    ('make', 'blocks', 'outcome', 'word'),
    [
        *((glide, around([lost], 50), GAP, 'samples are missing') for lost in (24, 30, 34)),
        *((hold, around([lost], 50), GAP, 'missing') for lost in (22, 23, 30, 39)),
        (hold, [block(24, 30)], GAP, 'at the start of the window'),
        (glide, [block(25, 30)], GAP, 'at the start'),
        (glide, marked(StrainStatus.RECONNECTED, 30), GAP, 'restarted at'),
        (glide, [block(0, 30), block(0, 20, shift_ns=3 * S)], GAP, 'restarted at'),
        (glide, [block(0, 30), block(30, 20, lost_before=4)], GAP, 'restarted at'),
        (glide, marked(StrainStatus.SATURATED), WindowOutcome.BAD_SIGNAL, 'saturated'),
        (glide, marked(StrainStatus.STUCK), WindowOutcome.BAD_SIGNAL, 'stuck'),
        (glide, marked(StrainStatus.DEVICE_ERROR), WindowOutcome.BAD_SIGNAL, 'faulty'),
        (glide, replaced(np.nan, 30), WindowOutcome.BAD_SIGNAL, 'not finite'),
        (hold, replaced(np.inf, 30), WindowOutcome.BAD_SIGNAL, 'not finite'),
        *(
            (
                make,
                [block(0, 100, period_ns=S // rate_hz)],
                WindowOutcome.BAD_SIGNAL,
                'features need',
            )
            for make in (glide, hold)
            for rate_hz in (8, 15)
        ),
    ],
)
def test_a_window_that_is_not_sound_has_no_features_and_says_why(make, blocks, outcome, word):
    window = make(*blocks, end_s=6.0 if word == 'features need' else 4.0 if make is hold else 3.5)
    assert (window.outcome, len(window.values)) == (outcome, 0)
    assert word in window.reason


@pytest.mark.parametrize('lost', [[23], [22, 23], range(15, 26)])
def test_a_loss_at_the_start_does_not_move_a_window_that_has_room_behind_it(lost):
    window = glide(*around(lost, 40), end_s=5.0)
    assert window.outcome == GAP
    assert 'at the start' in window.reason


def test_what_is_wrong_outside_the_window_does_no_harm():
    assert glide(block(0, 22), block(23, 12), block(36, 20)).outcome == OK
    assert glide(block(0, 22), block(23, 40), end_s=5.0).first_sequence == 23
    assert glide(block(23, 30), end_s=4.0).first_sequence == 23
    assert hold(block(0, 21), block(22, 18), block(41, 20)).outcome == OK
    stuck = {'status': StrainStatus.STUCK}
    window = glide(block(0, 23, **stuck), block(23, 12), block(35, 20, **stuck))
    assert (window.outcome, window.status) == (OK, 0)
    assert glide(*marked(StrainStatus.STUCK)).status == StrainStatus.STUCK


def test_a_short_loss_is_interpolated_when_allowed_and_stated():
    window = glide(*around([30, 31]), config=FILLING)
    tension = TENSION_N[23:35].copy()
    tension[7:9] = tension[6] + (tension[9] - tension[6]) * (np.array([1, 2]) / 3)
    assert window.outcome == OK
    assert (window.sample_count, window.interpolated_count) == (12, 2)
    assert window.values.tobytes() == compute_spectrum(tension, 'linear').tobytes()
    assert (window.window_start_ns, window.window_end_ns) == (2_300_000_000, 3_400_000_000)
    window = hold(*around([22, 23], 30), config=FILLING)
    assert (window.first_sequence, window.sample_count, window.interpolated_count) == (22, 18, 2)
    assert glide(*around([30, 31, 32]), config=FILLING).outcome == GAP


def test_a_stream_that_ends_inside_the_phase():
    extractor = TrialFeatureExtractor(CONFIG)
    assert feed(extractor, block(0, 30), event(2.0, 'hold'), event(4.0, 'release')) == []
    (window,) = extractor.finish()
    assert window.outcome == GAP
    assert extractor.finish() == []
    assert extractor.window_counts[GAP] == 1


@pytest.mark.parametrize(('count', 'outcome'), [(223, OK), (224, GAP)])
def test_the_buffer_holds_a_window_to_the_last_sample(count, outcome):
    # The window begins with sample 22. The buffer keeps the last 20 s, which are 200 periods.
    blocks = (block(n) for n in range(count))
    (window,) = run(*blocks, event(2.0, 'hold'), event(4.0, 'done'))
    assert window.outcome == outcome
    assert ('buffer_s' in window.reason) is (outcome == GAP)


def test_an_event_that_is_repeated_ends_no_phase():
    start, end = event(2.0, 'glide'), event(3.5, 'done')
    assert run(block(0, 50), start, start, end, end) == [glide(block(0, 50))]


def test_a_recording_played_again_gives_the_same_windows_again():
    begin = event(1.0, 'approach'), event(2.0, 'glide'), block(0, 30)
    rest = event(3.5, 'hold'), block(30, 40), event(5.5, 'done'), block(70, 10)
    once = run(*begin, *rest)
    assert [w.outcome for w in once] == [OK, OK]
    assert run(*begin, *rest, *begin, *rest) == once + once
    # The playback is stopped in the middle, and starts again from the beginning.
    assert run(*begin, *begin, *rest) == once


# -- early windows: the first samples of a phase -------------------------------------------


def test_an_early_window_comes_with_its_last_sample_and_ignores_what_the_phase_does_later():
    extractor = TrialFeatureExtractor(EARLY)
    extractor.add_event(event(2.0, 'glide'))
    came = {n: w for n in range(50) for w in extractor.add_block(block(n))}
    assert list(came) == [23 + 12 - 1]
    (early,) = came.values()
    assert (early.outcome, early.first_sequence, early.sample_count) == (OK, 23, 12)
    assert extractor.add_event(event(4.9, 'aborted')) == []
    whole = glide(block(0, 50), end_s=4.9)
    assert early.values.tobytes() == whole.values.tobytes()
    (spec, _), (full, _) = (TrialFeatureExtractor(c).specifications for c in (EARLY, CONFIG))
    assert (early.specification_digest, whole.specification_digest) == (spec.digest, full.digest)
    assert spec.digest != full.digest
    assert extractor.waits_since_ns is None


@pytest.mark.parametrize(
    ('end_s', 'phase', 'outcome', 'word'),
    [
        (3.39, 'aborted', WindowOutcome.ABORTED, 'aborted inside the window: cable'),
        (3.401, 'aborted', None, ''),
        (3.49, 'release', WindowOutcome.TOO_SHORT, 'the glide ended after 1.490 s'),
        (3.5, 'release', None, ''),
        (1.9, 'release', BAD_TIME, '0.100 s before'),
    ],
)
def test_a_refusal_follows_an_early_window_in_which_its_phase_ended(end_s, phase, outcome, word):
    start, end = event(2.0, 'glide'), event(end_s, phase, message='cable')
    windows = run(start, block(0, 50), end, config=EARLY)
    for inputs in ((start, end, block(0, 50)), (block(0, 50), start, end)):
        assert run(*inputs, config=EARLY) == windows
    first, *following = windows
    assert first.outcome == OK
    assert [w.outcome for w in following] == ([] if outcome is None else [outcome])
    for refusal in following:
        assert word in refusal.reason
        assert len(refusal.values) == 0
        names = ('specification_digest', 'trial_id', 'window_start_ns', 'window_end_ns')
        assert all(getattr(refusal, name) == getattr(first, name) for name in names)


def test_early_windows_of_several_lengths_and_the_full_one_come_each_in_its_time():
    lengths = {n: dataclasses.replace(EARLY, texture_samples=n) for n in (6, 12)}
    full = dataclasses.replace(CONFIG, texture_samples=60)
    wanted = [spec_for('texture', each) for each in (full, *lengths.values())]
    extractor = TrialFeatureExtractor(CONFIG, wanted)
    extractor.add_event(event(2.0, 'glide'))
    came = {n: w for n in range(84) for w in extractor.add_block(block(n))}
    assert {n: w.sample_count for n, w in came.items()} == {28: 6, 34: 12}
    (whole,) = extractor.add_event(event(8.5, 'release'))
    assert (whole.outcome, whole.sample_count) == (OK, 60)
    assert extractor.window_counts[OK] == 3


def test_a_loss_within_an_early_window_is_said_and_one_behind_does_not_matter():
    (window,) = run(event(2.0, 'glide'), *around([30]), config=EARLY)
    assert (window.outcome, len(window.values)) == (GAP, 0)
    (window,) = run(event(2.0, 'glide'), *around([36]), event(9.0, 'release'), config=EARLY)
    assert window.outcome == OK


def test_sets_without_a_first_part_have_full_windows_alone():
    config = dataclasses.replace(EARLY, texture_features='texture_spatial')
    assert not any(s.is_early for s in TrialFeatureExtractor(config).specifications)
    wanted = spec_for('stiffness', CONFIG)
    forged = dataclasses.replace(wanted, parameters={**wanted.parameters, 'early_windows': 1.0})
    with pytest.raises(FeatureError, match='early_windows'):
        forged.bind(CONFIG)


def test_an_early_window_of_a_hold_is_the_waveform_of_its_first_samples():
    config = dataclasses.replace(EARLY, stiffness_features='hold_waveform', stiffness_samples=9)
    (window,) = run(event(2.0, 'hold'), block(0, 40), config=config)
    assert window.outcome == OK
    np.testing.assert_array_equal(window.values, TENSION_N[22:31])


def test_of_a_start_from_before_the_samples_only_a_whole_early_window_is_told():
    extractor = TrialFeatureExtractor(EARLY)
    assert extractor.add_event(event(2.0, 'glide'), is_past=True) == []
    assert extractor.add_block(block(26, 40)) == []
    extractor = TrialFeatureExtractor(EARLY)
    extractor.add_event(event(2.0, 'glide'), is_past=True)
    (window,) = extractor.add_block(block(22, 40))
    assert window.outcome == OK


# -- errors of stamps ----------------------------------------------------------------------

GOOD = {'stamp_error_s': 0.001}


@pytest.mark.parametrize(
    ('make', 'most_s'), [(glide, 0.01 * 11 * 0.1), (hold, 0.01 * (1.5 - 0.3))]
)
def test_a_window_allows_a_hundredth_of_its_length(make, most_s):
    for error_s, outcome in ((0.999 * most_s, OK), (1.001 * most_s, BAD_TIME)):
        window = make(block(0, 50, stamp_error_s=error_s), end_s=3.5)
        assert (window.outcome, window.stamp_error_s) == (outcome, error_s)
        assert (outcome == OK) == (window.reason == '')
    assert f'{error_s:.4f} s' in window.reason
    assert f'allows {most_s:.4f} s (max_stamp_error_share)' in window.reason


@pytest.mark.parametrize(('crop_s', 'outcome'), [(0.05, BAD_TIME), (0.0, OK)])
def test_a_short_crop_allows_less(crop_s, outcome):
    config = dataclasses.replace(CONFIG, texture_crop_start_s=crop_s)
    assert glide(block(0, 50, stamp_error_s=0.008), config=config).outcome == outcome


@pytest.mark.parametrize(
    ('blocks', 'config', 'error_s'),
    [
        (
            (block(0, 30, **GOOD), block(30, stamp_error_s=0.01), block(31, 20, **GOOD)),
            CONFIG,
            0.01,
        ),
        ((block(0, 30, **GOOD), block(30), block(31, 20, **GOOD)), CONFIG, -1.0),
        (
            (
                block(0, 23, stamp_error_s=1.0),
                block(23, 12, **GOOD),
                block(35, 20, stamp_error_s=1.0),
            ),
            CONFIG,
            0.001,
        ),
        ((block(0, 30, **GOOD), block(31, 20, stamp_error_s=0.002)), FILLING, 0.002),
    ],
    ids=['worst', 'unknown', 'outside', 'interpolated'],
)
def test_the_worst_sample_of_the_window_counts(blocks, config, error_s):
    window = glide(*blocks, config=config)
    assert (window.outcome, window.stamp_error_s) == (OK, error_s)


@pytest.mark.parametrize('error_s', [-1.0, float('nan')])
def test_an_unknown_error_is_accepted_unless_told_otherwise(error_s):
    samples = block(0, 50, stamp_error_s=error_s)
    assert (hold(samples).outcome, hold(samples).stamp_error_s) == (OK, -1.0)
    strict = dataclasses.replace(CONFIG, accept_unknown_stamp_error=False)
    window = hold(samples, config=strict)
    assert window.outcome == BAD_TIME
    assert 'accept_unknown_stamp_error' in window.reason
    # An unknown error of one sample does not hide a known error above the limit.
    blocks = block(0, 28, stamp_error_s=0.5), block(28), block(29, 21, **GOOD)
    for config in (CONFIG, strict):
        window = hold(*blocks, config=config)
        assert (window.outcome, window.stamp_error_s) == (BAD_TIME, -1.0)
        assert 'wrong by 0.5000 s' in window.reason


# -- the host's clock is set ---------------------------------------------------------------


def stepped(at, step_s, status=StrainStatus.CLOCK_STEP):
    """Return blocks in which the clock of the host steps before sample ``at``."""
    shift_ns = round(step_s * S)
    first = block(at, shift_ns=shift_ns, status=status)
    return block(0, at), first, block(at + 1, 100, shift_ns=shift_ns)


@pytest.mark.parametrize('step_s', [5.0, -0.3])
@pytest.mark.parametrize('make', [glide, hold])
@pytest.mark.parametrize('at', [21, 23, 30])
def test_a_window_across_a_step_of_the_clock_is_refused(make, at, step_s):
    window = make(*stepped(at, step_s), end_s=5.0 + step_s)
    assert window.outcome == BAD_TIME
    way = 'forward' if step_s > 0 else 'back'
    assert f"the host's clock was set {way} by {abs(step_s):.3f} s" in window.reason


@pytest.mark.parametrize('phase', ['glide', 'hold'])
def test_an_end_that_comes_before_its_start_is_a_clock_that_was_set_back(phase):
    before, *after = stepped(30, -5.0)
    (window,) = run(event(2.0, phase), before, event(3.5 - 5.0, 'release'), *after)
    assert window.outcome == BAD_TIME
    assert '3.500 s before its start' in window.reason


@pytest.mark.parametrize('phase', ['glide', 'hold'])
def test_a_clock_that_is_set_back_within_a_phase_refuses_it_before_it_ends(phase):
    (window,) = run(event(0.4, phase), *stepped(30, -20.0))
    assert window.outcome == BAD_TIME
    assert 'back by 20.000 s' in window.reason


def test_phases_that_wait_when_the_stream_begins_at_an_earlier_time_are_refused():
    waiting = block(0, 30), event(2.0, 'glide'), event(3.5, 'done')
    (window,) = run(*waiting, block(0, 1))
    assert window.outcome == GAP
    assert 'set back' in window.reason


@pytest.mark.parametrize('step_s', [5.0, -5.0])
def test_windows_before_and_after_a_step_are_whole(step_s):
    before, first, after = stepped(40, step_s)
    start, end = event(4.5 + step_s, 'glide', 't2'), event(6.0 + step_s, 'done', 't2')
    one, other = run(event(2.0, 'glide'), before, event(3.5, 'done'), first, start, after, end)
    assert (one.outcome, other.outcome) == (OK, OK)
    assert (one.first_sequence, other.first_sequence) == (23, 48)


@pytest.mark.parametrize('make', [glide, hold])
def test_a_pause_of_the_samples_is_not_told_as_a_step_of_the_clock(make):
    window = make(*stepped(30, 1.38, StrainStatus.RESYNCHRONISED), end_s=6.0)
    assert window.outcome == GAP
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
    assert expected.outcome == GAP
    assert 'no samples arrived within 5 s after the end of the hold' in expected.reason
    assert extractor.time_out() == []
    assert extractor.window_counts[GAP] == 1
    # First case: late samples arrive, without or with a loss, or of a restarted stream.
    start, samples, end = HOLD
    for sequence in (30, 95, 0):
        late = dataclasses.replace(block(sequence, 5), stamp_ns=round(LATE_S * S) + 1)
        assert run(*HOLD, late) == [expected]
        assert run(start, end, samples, late) == [expected]
        assert run(samples, late, start, end) == [expected]
    # Second case: data of another kind arrive, but no samples.
    extractor = TrialFeatureExtractor(CONFIG)
    feed(extractor, *HOLD)
    assert extractor.pass_time(round((LATE_S + GRACE_S) * S)) == []
    assert extractor.pass_time(round((LATE_S + GRACE_S) * S) + 1) == [expected]
    # Third case: an event arrives much later.
    assert run(*HOLD, event(25.0, 'approach', 't2')) == [expected]


def test_an_early_window_whose_samples_do_not_come_is_refused_whatever_tells_so():
    start, some = event(2.0, 'glide'), block(0, 30)  # the window ends with sample 34, at 3.4 s
    late_ns = round((3.4 + CONFIG.samples_timeout_s) * S)

    def begin():
        extractor = TrialFeatureExtractor(EARLY)
        assert feed(extractor, start, some) == []
        return extractor

    extractor = begin()
    assert extractor.waits_since_ns == round(3.4 * S)
    assert extractor.remaining_s == pytest.approx(0.5)
    (expected,) = extractor.time_out()
    assert (expected.outcome, 'did not arrive within 5 s' in expected.reason) == (GAP, True)
    assert feed(extractor, event(3.0, 'release'), block(30, 20)) == []
    for sequence in (30, 95, 0):
        late = dataclasses.replace(block(sequence, 5), stamp_ns=late_ns + 1)
        for inputs in ((start, some, late), (some, late, start)):
            assert run(*inputs, config=EARLY) == [expected]
    assert begin().pass_time(late_ns + round(GRACE_S * S)) == []
    assert begin().pass_time(late_ns + round(GRACE_S * S) + 1) == [expected]
    assert begin().add_event(event(25.0, 'approach', 't2')) == [expected]
    # If the data end during the phase, the window is not refused; after the phase, it is.
    assert begin().finish() == []
    extractor = begin()
    extractor.add_event(event(3.2, 'release'))
    assert [w.outcome for w in extractor.finish()] == [GAP]


def test_samples_that_come_in_time_are_taken():
    late = dataclasses.replace(block(95, 5), stamp_ns=round(LATE_S * S))
    (window,) = run(*HOLD, late)
    assert 'samples are missing' in window.reason
    assert run(*HOLD, block(30, 20))[0].outcome == OK


def test_the_timeout_is_told_by_a_clock_that_nobody_stops():
    extractor = TrialFeatureExtractor(CONFIG)
    now_s = 100.0
    timeout = SampleTimeout(extractor, lambda: now_s)
    most_s = CONFIG.samples_timeout_s + GRACE_S

    def waited_s():
        """Return the time until the timeout, which is polled four times per second [s]."""
        nonlocal now_s
        began_s = now_s
        while not timeout.is_over() and now_s < began_s + 60.0:
            now_s += 0.25
        return now_s - began_s

    feed(extractor, *HOLD[:2])
    assert waited_s() == 60.0  # no window waits for samples
    feed(extractor, HOLD[2])
    assert waited_s() == pytest.approx(most_s, abs=0.3)
    extractor.time_out()
    assert not timeout.is_over()
    feed(extractor, event(5.0, 'hold', 't2'), event(6.0, 'release', 't2'))
    assert not timeout.is_over()
    now_s += 3600.0  # the process was suspended, so this time hardly counts
    assert waited_s() == pytest.approx(most_s - LONGEST_STEP_S, abs=0.3)
    feed(extractor, block(30, 1))  # the window stays incomplete, but the timeout restarts
    assert waited_s() == pytest.approx(most_s, abs=0.3)


def test_an_extractor_is_idle_between_trials_when_no_window_waits():
    extractor = TrialFeatureExtractor(CONFIG)
    assert extractor.is_idle
    for phase, start_s in (('approach', 1.0), ('glide', 2.0), ('release', 3.5)):
        extractor.add_event(event(start_s, phase))
        assert not extractor.is_idle
    extractor.add_event(event(3.6, 'done'))
    assert not extractor.is_idle  # the window waits for its samples
    assert len(extractor.add_block(block(0, 40))) == 1
    assert extractor.is_idle


def test_an_extractor_that_detects_phases_is_never_idle():
    assert not TrialFeatureExtractor(FeatureConfig(phases='texture')).is_idle
