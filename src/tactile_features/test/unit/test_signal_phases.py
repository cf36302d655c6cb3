# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Phases found in the tension: made-up pulls whose bends and jumps are known."""

import dataclasses
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_features import (
    FeatureConfig,
    FeatureError,
    find_phases,
    Outcome,
    spec_for,
    TrialEvent,
    TrialFeatureExtractor,
    WantedFeatures,
)
from tactile_features.phases import (
    estimate_noise_n,
    locate_bend,
    locate_step,
    measure_step,
    SignalPhases,
)
from tactile_features.windows import SAMPLE
from tactile_ros.strain import StrainBlock, StrainStatus

RATE_HZ = 60.0
STIFFNESS = FeatureConfig(phases='stiffness', detected_contact='flexion')
TEXTURE = FeatureConfig(phases='texture', partial_samples=(60, 120))
BENDS = {'contact': 1.0, 'hold': 1.5, 'glide': 2.0, 'release': 6.5, 'done': 6.9}
"""When the made-up pull begins, is held, glides, is released and is over [s]."""


def stamps(count, rate_hz=RATE_HZ):
    return np.rint(np.arange(count) * 1e9 / rate_hz).astype(np.int64)


def pull(*, rate_hz=RATE_HZ, level_n=5.0, step_n=0.3, noise_n=0.004, rest_n=0.0, seed=0):
    """A pull at the times of `BENDS`: rise, relaxing hold with a jump at the glide, fall."""
    t = np.arange(round(8.0 * rate_hz)) / rate_hz
    held = level_n * (0.7 + 0.3 * np.exp(-(t - BENDS['hold']) / 3.0))
    held -= step_n * np.clip((t - BENDS['glide']) / 0.05, 0.0, 1.0)
    up = np.clip((t - BENDS['contact']) / (BENDS['hold'] - BENDS['contact']), 0.0, 1.0)
    down = np.clip((BENDS['done'] - t) / (BENDS['done'] - BENDS['release']), 0.0, 1.0)
    noise = np.random.default_rng(seed).normal(0.0, noise_n, len(t))
    return rest_n + np.where(t < BENDS['hold'], level_n * up, held * down) + noise


def find(tension_n, config, rate_hz=RATE_HZ):
    return find_phases(stamps(len(tension_n), rate_hz), tension_n, config)


def times_s(events):
    return {event.phase: event.stamp_ns / 1e9 for event in events}


def check_times(events, expected, tolerance_s=0.04):
    assert [event.phase for event in events] == expected
    found = times_s(events)
    assert found == pytest.approx({name: BENDS[name] for name in expected}, abs=tolerance_s)


IN_STIFFNESS = ['contact', 'hold', 'release', 'done']
IN_TEXTURE = ['contact', 'glide', 'release', 'done']


@pytest.mark.parametrize('level_n', [1.0, 5.0, 14.0])
@pytest.mark.parametrize('rest_n', [-3.0, 0.0, 250.0])
def test_a_press_bends_the_tension_four_times(level_n, rest_n):
    events = find(pull(level_n=level_n, rest_n=rest_n, step_n=0.0), STIFFNESS)
    check_times(events, IN_STIFFNESS)


@pytest.mark.parametrize('step_n', [0.2, -0.2, 0.6])
def test_a_glide_makes_the_tension_jump_either_way(step_n):
    check_times(find(pull(step_n=step_n), TEXTURE), IN_TEXTURE)


def test_a_held_tension_that_does_not_relax_is_a_hold():
    t = np.arange(480) / RATE_HZ
    tension_n = 3.0 * np.clip(np.minimum((t - 1.0) / 0.5, (6.9 - t) / 0.4), 0.0, 1.0)
    check_times(find(tension_n, STIFFNESS), IN_STIFFNESS)


def test_what_is_known_is_in_the_events():
    config = dataclasses.replace(
        STIFFNESS,
        detected_simulated=True,
        detected_pull_speed_m_s=0.01,
        detected_object_label='apple',
        detected_session_id='s7',
    )
    events = find(pull(step_n=0.0), config)
    assert {(e.object_label, e.session_id) for e in events} == {('apple', 's7')}
    assert {(e.pull_speed_m_s, e.glide_speed_m_s) for e in events} == {(0.01, 0.0)}
    assert all(e.detected and e.simulated and e.contact == 'flexion' for e in events)
    assert {e.protocol for e in events} == {'stiffness'}
    assert {e.trial_id for e in events} == {f'detected-{events[0].stamp_ns}'}


def test_a_known_sliding_speed_serves_the_features_that_need_one():
    config = FeatureConfig(
        phases='texture',
        texture_features='texture_spatial',
        detected_glide_speed_m_s=0.015,
        measures=False,
    )
    (window,), _, events = run(config, blocks_of(pull(), Random(0)))
    assert events[1].glide_speed_m_s == window.speed_m_s == 0.015
    assert window.outcome == Outcome.OK


def test_a_trial_without_a_glide_is_aborted_and_says_so():
    events = find(pull(step_n=0.0), TEXTURE)
    assert [e.phase for e in events] == ['contact', 'aborted']
    assert 'no glide' in events[-1].message


def test_rest_gives_nothing_whatever_its_level_and_drift():
    random = np.random.default_rng(1)
    drift = np.cumsum(random.normal(0.0, 2e-3, 60 * 200))
    for noise_n in (0.0, 0.004, 0.1):
        rest = 7.0 + drift + random.normal(0.0, noise_n, len(drift))
        assert find(rest, STIFFNESS) == ()


def test_a_glitch_is_no_pull():
    tension_n = np.zeros(300)
    tension_n[100:102] = 5.0
    assert find(tension_n, STIFFNESS) == ()


def test_what_is_too_weak_for_the_parameter_is_no_pull():
    weak = pull(level_n=0.5, step_n=0.0)
    assert find(weak, dataclasses.replace(STIFFNESS, detected_rise_n=0.6)) == ()
    assert len(find(weak, dataclasses.replace(STIFFNESS, detected_rise_n=0.3))) == 4


def test_each_of_many_pulls_is_a_trial():
    events = find(np.concatenate([pull(seed=n, step_n=0.0) for n in range(5)]), STIFFNESS)
    assert [e.phase for e in events] == IN_STIFFNESS * 5
    assert len({e.trial_id for e in events}) == 5


def test_a_pull_in_two_goes_holds_again_after_the_second():
    t = np.arange(600) / RATE_HZ
    first = 2.0 * np.clip((t - 1.0) / 0.3, 0.0, 1.0)
    tension_n = first + 3.0 * np.clip((t - 3.0) / 0.3, 0.0, 1.0)
    tension_n *= np.clip((8.0 - t) / 0.3, 0.0, 1.0)
    events = find(tension_n, STIFFNESS)
    assert [e.phase for e in events] == ['contact', 'hold', 'hold', 'release', 'done']
    holds = [e.stamp_ns / 1e9 for e in events if e.phase == 'hold']
    assert holds == pytest.approx([1.3, 3.3], abs=0.04)


def test_a_stream_that_begins_within_a_hold_waits_for_the_next_pull():
    tension_n = np.concatenate([pull(step_n=0.0)[150:], pull(step_n=0.0, seed=1)])
    events = find(tension_n, STIFFNESS)
    shift_s = (480 - 150) / RATE_HZ
    assert [e.phase for e in events] == IN_STIFFNESS
    assert times_s(events)['hold'] == pytest.approx(BENDS['hold'] + shift_s, abs=0.04)


@pytest.mark.parametrize('rate_hz', [30.0, 100.0, 7000.0])
def test_other_rates(rate_hz):
    config = dataclasses.replace(STIFFNESS, rate_hz=rate_hz)
    tension_n = pull(rate_hz=rate_hz, step_n=0.0)
    check_times(find(tension_n, config, rate_hz), IN_STIFFNESS, 0.07)


def test_a_sensor_at_its_end_still_shows_when():
    events = find(np.minimum(pull(level_n=14.0, step_n=0.0), 9.0), STIFFNESS)
    assert [e.phase for e in events] == IN_STIFFNESS
    # The rise ends where the sensor does, and the fall begins there.
    assert BENDS['contact'] < times_s(events)['hold'] < BENDS['hold'] + 0.04
    assert times_s(events)['release'] > BENDS['release'] - 0.04


def test_lost_samples_and_values_that_are_no_numbers_are_passed_over():
    random = np.random.default_rng(2)
    tension_n = pull()
    tension_n[random.random(len(tension_n)) < 0.02] = np.nan
    kept = random.random(len(tension_n)) > 0.02
    events = find_phases(stamps(480)[kept], tension_n[kept], TEXTURE)
    check_times(events, IN_TEXTURE, 0.05)


def blocks_of(tension_n, random, period_ns=16_666_667):
    """The stream in blocks of any length, a few samples lost."""
    made, first = [], 0
    while first < len(tension_n):
        count = min(random.choice([1, 1, 7, 60, 400]), len(tension_n) - first)
        values = tension_n[first : first + count]
        made.append(StrainBlock(first * period_ns, first, period_ns, values))
        first += count
    return made


def run(config, blocks, wanted=()):
    extractor = TrialFeatureExtractor(config, wanted)
    windows, events = [], []
    for block in blocks:
        windows += extractor.add_block(block)
        events += extractor.take_detected_events()
    return [w for w in windows if not w.partial], [w for w in windows if w.partial], events


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([STIFFNESS, TEXTURE]))
def test_any_grouping_gives_the_same_bits(seed, config):
    random = Random(seed)
    tension_n = np.concatenate([pull(seed=seed + n) for n in range(2)])
    expected = run(config, blocks_of(tension_n, Random(0)))
    assert run(config, blocks_of(tension_n, random)) == expected
    assert len(expected[0]) == 2


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([STIFFNESS, TEXTURE]), st.booleans())
def test_phases_found_for_several_specifications_are_those_found_for_one(seed, config, is_lossy):
    random = Random(seed)
    tension_n = np.concatenate([pull(seed=seed + n) for n in range(2)])
    blocks = [
        block
        for block in blocks_of(tension_n, random)
        if not is_lossy or len(block.tension_n) > 1 or random.random() > 0.02
    ]
    task = config.phases
    wanted = [
        WantedFeatures(spec_for(task, FeatureConfig(**changes)), counts)
        for changes, counts in (
            ({'max_gap_samples': 2}, ()),
            ({'texture_samples': 90, 'stiffness_settle_s': 0.2, 'max_gap_samples': 1}, ()),
            ({}, (60,) if task == 'texture' else ()),
        )
    ]
    windows, partial, events = run(config, blocks, wanted)
    found = sum(event.phase == ('glide' if task == 'texture' else 'hold') for event in events)
    assert found == 2 or is_lossy
    for each in wanted:
        alone = run(config, blocks, [each])
        assert alone[2] == events
        assert sum(w.specification_digest == each.spec.digest for w in windows) == found
        for mine, of_alone in zip((windows, partial), alone, strict=False):
            of_digest = [w for w in mine if w.specification_digest == each.spec.digest]
            assert of_digest == [w for w in of_alone if w.specification_digest == each.spec.digest]


def test_features_are_those_of_the_same_events_stated():
    blocks = blocks_of(pull(), Random(3))
    windows, partial, events = run(TEXTURE, blocks)
    stated = TrialFeatureExtractor(dataclasses.replace(TEXTURE, phases='stated'))
    for event in events:
        stated.add_event(event)
    expected = [w for block in blocks for w in stated.add_block(block)]
    assert [w for w in expected if not w.partial] == windows
    assert [w for w in expected if w.partial] == partial
    assert [w.outcome for w in windows + partial] == [Outcome.OK] * 3


def test_stated_events_are_passed_over_where_phases_are_found():
    extractor = TrialFeatureExtractor(STIFFNESS)
    for stamp_ns, phase in ((10**9, 'hold'), (5 * 10**9, 'release')):
        extractor.add_event(TrialEvent(stamp_ns, 't', '', 'stiffness', '', '', phase))
    (block,) = [StrainBlock(0, 0, 16_666_667, pull(step_n=0.0))]
    assert all(w.trial_id.startswith('detected-') for w in extractor.add_block(block))
    assert extractor.event_count == 2


def test_a_clock_set_back_within_a_trial_aborts_it():
    extractor = TrialFeatureExtractor(STIFFNESS)
    tension_n, period_ns = pull(step_n=0.0), 16_666_667
    extractor.add_block(StrainBlock(10**12, 0, period_ns, tension_n[:200]))
    extractor.add_block(StrainBlock(0, 200, period_ns, tension_n))
    events = extractor.take_detected_events()
    assert [e.phase for e in events] == ['contact', 'hold', 'aborted', *IN_STIFFNESS]
    assert events[3].stamp_ns < 2 * 10**9 < events[2].stamp_ns


def test_parameters_of_the_search_alone_can_be_left_out_of_a_comparison():
    one = dataclasses.replace(STIFFNESS, detected_object_label='apple', detected_rise_n=1.0)
    assert one.without_detection() == FeatureConfig()
    assert dataclasses.replace(one, max_gap_samples=2).without_detection() != FeatureConfig()


def test_what_cannot_be_searched_is_refused():
    with pytest.raises(FeatureError, match='phases'):
        SignalPhases(FeatureConfig())
    with pytest.raises(FeatureError, match='phases'):
        FeatureConfig(phases='slip')
    with pytest.raises(FeatureError, match='20 Hz'):
        FeatureConfig(phases='texture', rate_hz=10.0)
    with pytest.raises(FeatureError, match='shapes'):
        find_phases(stamps(3), np.zeros(4), STIFFNESS)
    with pytest.raises(FeatureError, match='integer'):
        find_phases(np.arange(4.0), np.zeros(4), STIFFNESS)
    assert find_phases(stamps(0), np.zeros(0), STIFFNESS) == ()


@pytest.mark.parametrize('size', [1, 7, 1000])
def test_phases_in_simulated_samples_say_so(size):
    tension_n = np.concatenate([pull(), pull(seed=1), pull(seed=2)])
    each = len(pull())
    simulated = np.arange(len(tension_n)) // each == 1  # the second pull
    extractor = TrialFeatureExtractor(STIFFNESS)
    windows = []
    for first in range(0, len(tension_n), size):
        # A block has one status, as the driver makes it.
        part = np.arange(first, min(first + size, len(tension_n)))
        for run in np.split(part, np.flatnonzero(np.diff(simulated[part])) + 1):
            windows += extractor.add_block(
                StrainBlock(
                    int(stamps(len(tension_n))[run[0]]),
                    int(run[0]),
                    16_666_667,
                    tension_n[run],
                    status=StrainStatus.SIMULATED if simulated[run[0]] else StrainStatus.OK,
                )
            )
    events = extractor.take_detected_events()
    assert [event.simulated for event in events] == [*[False] * 4, *[True] * 4, *[False] * 4]
    assert [window.simulated for window in windows] == [False, True, False]


# -- whoever joins late finds the same trials ----------------------------------------------

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


# -- bends and jumps, against numpy ---------------------------------------------------------

RNG = np.random.default_rng(0)
TIME_S = np.arange(20) / 60


def test_noise_is_told_from_level_slope_and_what_happens_once():
    noise = RNG.normal(0.0, 0.1, 20_000)
    signal = 7.0 + 1e-4 * np.arange(20_000) + noise
    signal[10_000:] += 50.0
    assert estimate_noise_n(signal) == pytest.approx(0.1, rel=0.05)
    assert estimate_noise_n(signal[:1]) == 0.0


@pytest.mark.parametrize('at', [3, 9, 15])
def test_a_bend_is_where_two_lines_meet(at):
    bent = np.minimum(20.0 * (TIME_S - TIME_S[at]), -1.0 * (TIME_S - TIME_S[at]))
    assert locate_bend(TIME_S, 5.0 + bent) == at


def test_a_jump_and_its_uncertainty_are_those_of_least_squares():
    signal = RNG.normal(0.0, 1.0, 20)
    step = measure_step(TIME_S, signal, 8)
    design = np.stack([np.ones(20), TIME_S, np.arange(20) >= 8], axis=1)
    _, slope, height = np.linalg.lstsq(design, signal, rcond=None)[0]
    assert step.height_n == pytest.approx(height, rel=1e-9)
    assert step.slope_n_s == pytest.approx(slope, rel=1e-9)
    covariance = np.linalg.inv(design.T @ design)
    assert step.spread == pytest.approx(np.sqrt(covariance[2, 2]), rel=1e-9)
    line = np.polynomial.Polynomial.fit(TIME_S[:8], signal[:8], 1)
    left = np.sum((signal[:8] - line(TIME_S[:8])) ** 2) / 6
    assert step.before_n == pytest.approx(np.sqrt(left), rel=1e-9)


@pytest.mark.parametrize('height_n', [0.4, -0.4])
@pytest.mark.parametrize('first_after', [8, 12])
def test_a_jump_is_found_where_it_is(height_n, first_after):
    signal = 3.0 - 2.0 * TIME_S + height_n * (np.arange(20) >= first_after)
    assert locate_step(TIME_S, signal, 6) == first_after - 1


def test_a_jump_that_takes_some_samples_begins_with_the_first():
    share = np.clip((np.arange(20) - 8) / 4, 0.0, 1.0)
    signal = 3.0 - 2.0 * TIME_S - 0.5 * share + RNG.normal(0.0, 0.004, 20)
    assert locate_step(TIME_S, signal, 6) in (8, 9)
