# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Phases are detected in the tension of synthetic pulls, whose bends and jumps are known."""

import dataclasses
from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from trials import event, extract, make_block

from tactile_features import (
    FeatureConfig,
    FeatureError,
    find_phases,
    spec_for,
    TrialFeatureExtractor,
    WindowOutcome,
)
from tactile_features.phases import estimate_noise_n, locate_step, measure_step, SignalPhases
from tactile_features.windows import SAMPLE
from tactile_ros.strain import StrainStatus

RATE_HZ = 60.0
STIFFNESS = FeatureConfig(phases='stiffness', detected_contact='flexion')
TEXTURE = FeatureConfig(phases='texture')
EARLY = FeatureConfig(phases='texture', texture_samples=60, early_windows=True)
BENDS = {'contact': 1.0, 'hold': 1.5, 'glide': 2.0, 'release': 6.5, 'done': 6.9}
"""Times at which the phases of the synthetic pull begin [s]."""


def stamps(count, rate_hz=RATE_HZ):
    return np.rint(np.arange(count) * 1e9 / rate_hz).astype(np.int64)


def pull(*, rate_hz=RATE_HZ, level_n=5.0, step_n=0.3, noise_n=0.004, rest_n=0.0, seed=0):
    """Return the tension of a pull: rise, relaxing hold with a jump at the glide, fall.

    The times are in `BENDS`.
    """
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


T_S = np.arange(480) / RATE_HZ
LEVEL = 3.0 * np.clip(np.minimum((T_S - 1.0) / 0.5, (6.9 - T_S) / 0.4), 0.0, 1.0)
FAST = pull(rate_hz=7000.0, step_n=0.0)


@pytest.mark.parametrize(
    ('tension_n', 'config', 'tolerance_s'),
    [
        *(
            (pull(level_n=level_n, rest_n=rest_n, step_n=0.0), STIFFNESS, 0.04)
            for level_n, rest_n in ((1.0, -3.0), (1.0, 250.0), (5.0, 0.0), (14.0, 250.0))
        ),
        *((pull(step_n=step_n), TEXTURE, 0.04) for step_n in (0.2, -0.2, 0.6)),
        (LEVEL, STIFFNESS, 0.04),  # the tension does not relax
        *(
            (
                pull(rate_hz=rate_hz, step_n=0.0),
                dataclasses.replace(STIFFNESS, rate_hz=rate_hz),
                0.07,
            )
            for rate_hz in (30.0, 100.0, 7000.0)
        ),
        (np.where(np.random.default_rng(2).random(480) < 0.02, np.nan, pull()), TEXTURE, 0.05),
    ],
)
def test_a_pull_bends_the_tension_where_its_phases_begin(tension_n, config, tolerance_s):
    events = find(tension_n, config, config.rate_hz)
    check_times(events, IN_TEXTURE if config is TEXTURE else IN_STIFFNESS, tolerance_s)


def test_lost_samples_are_passed_over():
    kept = np.random.default_rng(2).random(480) > 0.02
    check_times(find_phases(stamps(480)[kept], pull()[kept], TEXTURE), IN_TEXTURE, 0.05)


def test_events_state_what_the_parameters_know():
    config = dataclasses.replace(
        STIFFNESS,
        detected_object_label='apple',
        detected_session_id='s7',
    )
    events = find(pull(step_n=0.0), config)
    assert len(events) == 4
    for each in events:
        assert (each.object_label, each.session_id, each.protocol) == ('apple', 's7', 'stiffness')
        assert each.glide_speed_m_s == 0.0
        assert (each.detected, each.simulated, each.contact) == (True, False, 'flexion')
        assert each.trial_id == f'detected-{events[0].stamp_ns}'
    # Feature windows do not depend on the parameters of the detection.
    assert config.without_detection() == FeatureConfig()
    assert dataclasses.replace(config, max_gap_samples=2).without_detection() != FeatureConfig()


def test_a_known_sliding_speed_serves_the_features_that_need_one():
    config = FeatureConfig(
        phases='texture',
        texture_features='texture_spatial',
        detected_glide_speed_m_s=0.015,
    )
    (window,), events = run(config, blocks_of(pull(), Random(0)))
    assert events[1].glide_speed_m_s == window.speed_m_s == 0.015
    assert window.outcome == WindowOutcome.OK


def test_a_trial_without_a_glide_is_aborted_and_says_so():
    events = find(pull(step_n=0.0), TEXTURE)
    assert [e.phase for e in events] == ['contact', 'aborted']
    assert 'no glide' in events[-1].message


DRIFT = 7.0 + np.cumsum(np.random.default_rng(1).normal(0.0, 2e-3, 6_000))
WEAK = pull(level_n=0.5, step_n=0.0)


@pytest.mark.parametrize(
    ('tension_n', 'config'),
    [
        *(
            (DRIFT + np.random.default_rng(2).normal(0.0, noise_n, len(DRIFT)), STIFFNESS)
            for noise_n in (0.0, 0.004, 0.1)
        ),
        (np.where(np.arange(300) // 2 == 50, 5.0, 0.0), STIFFNESS),  # a glitch of two samples
        (WEAK, dataclasses.replace(STIFFNESS, detected_rise_n=0.6)),
    ],
)
def test_what_is_no_pull(tension_n, config):
    assert find(tension_n, config) == ()
    assert len(find(WEAK, STIFFNESS)) == 4


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


def test_a_sensor_at_its_end_still_shows_when():
    events = find(np.minimum(pull(level_n=14.0, step_n=0.0), 9.0), STIFFNESS)
    assert [e.phase for e in events] == IN_STIFFNESS
    # The tension stops rising when the sensor saturates, and begins to fall when that ends.
    assert BENDS['contact'] < times_s(events)['hold'] < BENDS['hold'] + 0.04
    assert times_s(events)['release'] > BENDS['release'] - 0.04


def blocks_of(tension_n, random, period_ns=16_666_667):
    """Return the tension in blocks of random lengths."""
    made, first = [], 0
    while first < len(tension_n):
        count = min(random.choice([1, 1, 7, 60, 400]), len(tension_n) - first)
        made.append(make_block(tension_n[first : first + count], first, period_ns))
        first += count
    return made


def run(config, blocks, wanted=()):
    extractor = TrialFeatureExtractor(config, wanted)
    windows, events = [], []
    for block in blocks:
        windows += extractor.add_block(block)
        events += extractor.take_detected_events()
    return windows, events


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([STIFFNESS, TEXTURE]), st.booleans())
def test_phases_do_not_depend_on_grouping_nor_on_the_features_that_are_wanted(
    seed, config, is_lossy
):
    random = Random(seed)
    tension_n = np.concatenate([pull(seed=seed + n) for n in range(2)])
    whole = [
        block
        for block in blocks_of(tension_n, Random(0))
        if not is_lossy or len(block.tension_n) > 1 or random.random() > 0.02
    ]
    pieces = [
        dataclasses.replace(
            block,
            stamp_ns=block.stamp_ns + n * block.period_ns,
            sequence=block.sequence + n,
            tension_n=block.tension_n[n : n + 1],
        )
        for block in whole
        for n in range(len(block.tension_n))
    ]
    task = config.phases
    wanted = [
        spec_for(task, FeatureConfig(**changes))
        for changes in (
            {'max_gap_samples': 2},
            {'texture_samples': 90, 'stiffness_settle_s': 0.2, 'max_gap_samples': 1},
            {'texture_samples': 60, 'early_windows': True},
        )
    ]
    windows, events = run(config, whole, wanted)
    again, same_events = run(config, pieces, wanted)
    assert same_events == events
    found = sum(event.phase == ('glide' if task == 'texture' else 'hold') for event in events)
    assert found == 2 or is_lossy
    for each in wanted:
        alone, events_alone = run(config, whole, [each])
        assert events_alone == events
        of_digest = [w for w in windows if w.specification_digest == each.digest]
        assert len(of_digest) == found
        for others in (again, alone):
            assert [w for w in others if w.specification_digest == each.digest] == of_digest


@pytest.mark.parametrize('config', [TEXTURE, EARLY])
def test_features_are_those_of_the_same_events_stated(config):
    blocks = blocks_of(pull(), Random(3))
    windows, events = run(config, blocks)
    stated = dataclasses.replace(config, phases='stated')
    assert extract(stated, *events, *blocks) == windows
    assert [w.outcome for w in windows] == [WindowOutcome.OK]


def test_stated_events_are_passed_over_where_phases_are_found():
    stated = event(1.0, 'hold'), event(5.0, 'release')
    windows = extract(STIFFNESS, *stated, make_block(pull(step_n=0.0), 0, 16_666_667))
    assert [w.trial_id[:8] for w in windows] == ['detected']


def test_a_clock_set_back_within_a_trial_aborts_it():
    tension_n, period_ns = pull(step_n=0.0), 16_666_667
    before = make_block(tension_n[:200], 0, period_ns, shift_ns=10**12)
    _, events = run(STIFFNESS, [before, make_block(tension_n, 0, period_ns)])
    assert [e.phase for e in events] == ['contact', 'hold', 'aborted', *IN_STIFFNESS]
    assert events[3].stamp_ns < 2 * 10**9 < events[2].stamp_ns


def test_what_cannot_be_searched_is_refused():
    for make in (lambda: SignalPhases(FeatureConfig()), lambda: FeatureConfig(phases='smell')):
        with pytest.raises(FeatureError, match='phases'):
            make()
    with pytest.raises(FeatureError, match='20 Hz'):
        FeatureConfig(phases='texture', rate_hz=10.0)
    with pytest.raises(FeatureError, match='shapes'):
        find_phases(stamps(3), np.zeros(4), STIFFNESS)
    with pytest.raises(FeatureError, match='integer'):
        find_phases(np.arange(4.0), np.zeros(4), STIFFNESS)
    assert find_phases(stamps(0), np.zeros(0), STIFFNESS) == ()


@pytest.mark.parametrize('size', [1, 1000])
def test_phases_in_simulated_samples_say_so(size):
    blocks, first = [], 0
    for seed, status in enumerate((StrainStatus.OK, StrainStatus.SIMULATED, StrainStatus.OK)):
        tension_n = pull(seed=seed)
        for n in range(0, len(tension_n), size):
            some = tension_n[n : n + size]
            blocks.append(make_block(some, first, 16_666_667, status=status))
            first += len(some)
    windows, events = run(STIFFNESS, blocks)
    assert [each.simulated for each in events] == [*[False] * 4, *[True] * 4, *[False] * 4]
    assert [window.simulated for window in windows] == [False, True, False]


# -- detection that starts late finds the same trials --------------------------------------

SETTLED_NS = 1_300_000_000
"""Detection that starts late must find a trial if the rest before it is longer than this [ns].

The detection needs at least 60 and at most 75 samples at rest."""


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
    for joined in range(1, len(samples) - 1, 131):
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


# -- noise and a jump, against numpy --------------------------------------------------------


def test_noise_is_told_from_level_slope_and_what_happens_once():
    noise = np.random.default_rng(0).normal(0.0, 0.1, 20_000)
    signal = 7.0 + 1e-4 * np.arange(20_000) + 50.0 * (np.arange(20_000) > 9_999) + noise
    assert estimate_noise_n(signal) == pytest.approx(0.1, rel=0.05)
    assert estimate_noise_n(signal[:1]) == 0.0


def test_a_jump_that_takes_some_samples_begins_with_the_first():
    share = np.clip((np.arange(20) - 8) / 4, 0.0, 1.0)
    noise = np.random.default_rng(0).normal(0.0, 0.004, 20)
    assert locate_step(np.arange(20) / 60, 3.0 - np.arange(20) / 30 - 0.5 * share + noise, 6) in (
        8,
        9,
    )


def test_a_jump_and_its_uncertainty_are_those_of_least_squares():
    signal, time_s = np.random.default_rng(0).normal(0.0, 1.0, 20), np.arange(20) / 60
    step = measure_step(time_s, signal, 8)
    design = np.stack([np.ones(20), time_s, np.arange(20) >= 8], axis=1)
    _, slope, height = np.linalg.lstsq(design, signal, rcond=None)[0]
    assert step.height_n == pytest.approx(height, rel=1e-9)
    assert step.slope_n_s == pytest.approx(slope, rel=1e-9)
    covariance = np.linalg.inv(design.T @ design)
    assert step.spread == pytest.approx(np.sqrt(covariance[2, 2]), rel=1e-9)
    line = np.polynomial.Polynomial.fit(time_s[:8], signal[:8], 1)
    left = np.sum((signal[:8] - line(time_s[:8])) ** 2) / 6
    assert step.before_n == pytest.approx(np.sqrt(left), rel=1e-9)
