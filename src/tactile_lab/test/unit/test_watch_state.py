# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""State of the live page, without ROS."""

import dataclasses
import json
from pathlib import Path
import re

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_classifier.types import ModelInfo, PredictionOutcome, WindowPrediction
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.types import FeatureWindow, TrialEvent, WindowOutcome
from tactile_lab import watch
from tactile_lab.watch.finger import Finger
from tactile_lab.watch.state import Frames, MOST_FINGERS, SPECTRUM_PERIOD_S, WatchState
from tactile_ros.strain import StrainBlock, StrainStatus

PERIOD_NS = 16_666_667
START_NS = 1_700_000_000 * 10**9


class Clock:
    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def state(clock):
    return WatchState('ROS domain 3', clock=clock)


def block(number, tension_n=(1.0,), status=0, **fields):
    stamp_ns = START_NS + number * PERIOD_NS
    return StrainBlock(stamp_ns, number, PERIOD_NS, np.array(tension_n), status=status, **fields)


def event(number, phase, label='R1', trial='t1'):
    stamp_ns = START_NS + number * PERIOD_NS
    return TrialEvent(stamp_ns, trial, 's', 'texture', 'flexion', label, phase, simulated=True)


def answer(label='R1', outcome=PredictionOutcome.LABEL, trial='t1', model='m', **fields):
    is_label = outcome == PredictionOutcome.LABEL
    reason = '' if is_label else 'unlike all training trials'
    return WindowPrediction(
        'texture', trial, 'flexion', model, True, outcome, label if is_label else '', reason,
        ('C1', 'R1'), (0.1, 0.9), 'probability', -1.0, -1.0, START_NS, START_NS + 1, '', **fields,
    )  # fmt: skip


def window(values, feature_set='texture_spectrum', **fields):
    return FeatureWindow(
        feature_set, 2, 't1', 'flexion', True, WindowOutcome.OK, '', np.array(values), START_NS,
        START_NS + 10**9, 0, 60.0, 180, 0, 0, '', **fields,
    )  # fmt: skip


def take_blocks(state, *blocks, finger=''):
    for each in blocks:
        state.update(finger, Finger.take_block, each)


def take_events(state, *events):
    for each in events:
        state.update('', Finger.take_event, each)


def test_frames_contain_each_point_once_and_the_state_if_it_changed(state, clock):
    frames = Frames(state)
    first = frames.next()
    assert first['state']['fingers'] == []
    assert frames.next() is None
    take_blocks(state, *map(block, range(5)), finger='index')
    frame = frames.next()
    assert [f['name'] for f in frame['state']['fingers']] == ['index']
    assert frame['live']['index']['y'] == [1.0] * 5
    take_blocks(state, block(5, (2.0,)), finger='index')
    frame = frames.next()
    assert 'state' not in frame
    assert frame['live']['index']['y'] == [2.0]
    assert frame['live']['index']['x'] == [pytest.approx(5 * PERIOD_NS * 1e-9, abs=1e-4)]
    assert frames.next() is None
    frames.restart()
    assert frames.next()['live']['index']['y'] == [1.0] * 5 + [2.0]


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2), st.integers(1, 70)), max_size=30))
def test_early_and_late_pages_get_the_same_points(steps):
    state = WatchState(clock=Clock())
    frames, seen, number = Frames(state), [], 0
    for kind, count in steps:
        if kind:
            take_blocks(state, block(number, np.arange(number, number + count, dtype=float)))
            number += count
        else:
            frame = frames.next()
            seen += ((frame or {}).get('live') or {}).get('', {}).get('y', [])
    seen += ((frames.next() or {}).get('live') or {}).get('', {}).get('y', [])
    frame = Frames(state).next() or {}
    late = (frame.get('live') or {}).get('', {}).get('y', [])
    assert seen == [float(i) for i in range(number)]
    assert late == seen[len(seen) - len(late) :]
    json.dumps(frame, allow_nan=False)


def test_state_follows_a_trial_from_contact_to_label(state):
    take_blocks(state, block(0, np.zeros(600)))
    take_events(state, event(60, 'approach'), event(120, 'contact'), event(180, 'glide'))
    (finger,) = state.describe()['fingers']
    assert finger['trial']['phase'] == 'glide'
    assert finger['trial']['runs']
    assert [(s['phase'], s['from'], s['to']) for s in finger['spans']] == [
        ('approach', 1.0, 2.0),
        ('contact', 2.0, 3.0),
        ('glide', 3.0, None),
    ]
    take_events(state, event(420, 'release'))
    state.take_answer('', answer())
    take_events(state, event(480, 'done'))
    (finger,) = state.describe()['fingers']
    assert not finger['trial']['runs']
    assert finger['spans'][-1] == {'phase': 'release', 'from': 7.0, 'to': 8.0}
    (said,) = finger['answers']
    assert said['scores'] == [['R1', 0.9], ['C1', 0.1]]
    assert said['true'] == 'R1'
    assert said['right'] is True
    assert state.describe()['simulated']


@pytest.mark.parametrize(
    ('result', 'right', 'line'),
    [
        (answer('C1'), False, 'wrong, it is R1'),
        (answer(outcome=PredictionOutcome.UNKNOWN), None, 'unknown: unlike all'),
        (answer(outcome=PredictionOutcome.NO_FEATURES), None, 'no label: '),
        (answer(trial='another'), None, 'R1            (0.90 probability)'),
    ],
)
def test_prediction_is_only_compared_if_the_trial_has_a_label(state, result, right, line):
    lines = []
    state.on_answer = lambda *what: lines.append(what)
    take_events(state, event(0, 'glide'))
    state.take_answer('', result)
    (said,) = state.describe()['fingers'][0]['answers']
    assert said['right'] is right
    sentences = [s['text'] for s in state.describe()['said']]
    if line is None:
        assert sentences == []
        assert lines == []
    else:
        assert line in sentences[0]
        assert 'SIMULATED' in sentences[0]
        assert len(lines) == 1


def test_line_names_the_model_if_several_models_have_the_task_and_contact(state):
    def model(name, task, contact):
        return ModelInfo(name, '', '', task, contact, (), '', 0, True)

    models = [model('a', 'texture', ''), model('b', 'stiffness', 'flexion')]
    lines = []
    state.on_answer = lines.append
    for more in ([], [model('c', 'texture', 'abduction')], [model('d', 'texture', 'flexion')]):
        state.update('', Finger.take_models, [*models, *more])
        state.take_answer('', answer(model='a'))
    assert ['  a  ' in line for line in lines] == [False, False, True]
    for name in 'ba':
        state.take_answer('', answer(model=name))
    assert [a['model'] for a in state.describe()['fingers'][0]['answers']] == ['b', 'a']


def test_spectrum_is_computed_from_last_seconds_phase_or_window():
    finger = Finger('')
    assert finger.spectrum() is None
    tension_n = 3.0 + 0.1 * np.sin(2 * np.pi * 10.0 * np.arange(600) / 60.0)
    finger.take_block(block(0, tension_n))
    spectrum = finger.spectrum()
    assert spectrum['part'] == 'last 3 s'
    expected = compute_spectrum(tension_n[-180:], 'linear', 'none')
    assert spectrum['values'] == pytest.approx(expected, rel=1e-3, abs=1e-4)
    assert np.argmax(spectrum['values']) * spectrum['step_hz'] == pytest.approx(10.0, rel=1e-6)
    finger.take_event(event(540, 'glide'))
    finger.take_window(window([1.0, 2.0, 3.0], 'stiffness_regression', specification_digest='1'))
    spectrum = finger.spectrum()
    assert spectrum['part'] == 'glide so far'
    assert len(spectrum['values']) == 59 // 2 + 1
    finger.take_window(window(np.arange(91) / 100.0))
    spectrum = finger.spectrum()
    assert spectrum['part'] == 'window of 1.0 s'
    assert spectrum['step_hz'] == pytest.approx(1 / 3)
    assert spectrum['values'][-1] == 0.9
    finger.take_window(window(np.ones(91), 'texture_spatial', specification_digest='2'))
    assert finger.spectrum() == spectrum  # this window has no spectrum
    finger.take_event(event(700, 'approach', trial='t2'))
    assert finger.spectrum()['part'] == 'last 3 s'


def test_stiffness_finger_shows_the_hold_with_the_fitted_line(state, clock):
    assert 'spectrum' in Finger('').detail()
    time_s = np.arange(600) * PERIOD_NS * 1e-9
    # The hold phase begins after 2 s. In it, the tension decreases by 0.2 N/s.
    take_blocks(state, block(0, np.where(time_s < 2.0, 1.0, 3.0 - 0.2 * (time_s - 2.0))))
    (finger,) = state.fingers
    finger.take_event(dataclasses.replace(event(60, 'contact'), protocol='stiffness'))
    assert finger.detail() == {'hold': None}
    finger.take_event(dataclasses.replace(event(120, 'hold'), protocol='stiffness'))
    hold = finger.detail()['hold']
    assert hold['part'] == 'hold so far'
    assert hold['slope_n_s'] == pytest.approx(-0.2, abs=0.001)
    assert hold['line'][0] == pytest.approx([0.0, 3.0], abs=0.02)
    finger.take_event(dataclasses.replace(event(420, 'release'), protocol='stiffness'))
    start_ns = event(180, 'hold').stamp_ns
    finger.take_window(
        dataclasses.replace(
            window([1.0, 2.0, 3.0], 'stiffness_regression'),
            window_start_ns=start_ns,
            window_end_ns=start_ns + 3 * 10**9,
        )
    )
    hold = finger.detail()['hold']
    assert hold['part'] == 'window of 3.0 s'
    assert [t for t, _ in hold['line']] == pytest.approx([1.0, 4.0], abs=0.02)
    assert hold['x'][-1] == pytest.approx(5.0, abs=0.02)
    json.dumps(hold, allow_nan=False)
    take_blocks(state, block(600, np.ones(3000)))
    finger.take_event(event(3590, 'approach', trial='t2'))
    assert finger.hold() == hold, 'a hold that has ended is kept'
    clock.now_s += 2 * SPECTRUM_PERIOD_S
    assert 'hold' in Frames(state).next()['live']['']
    finger.take_event(event(3595, 'glide', trial='t2'))
    assert 'spectrum' in finger.detail()


def test_finger_states_object_session_and_whether_there_are_models(state):
    take_blocks(state, block(0))
    take_events(state, event(1, 'contact'))
    (finger,) = state.describe()['fingers']
    assert (finger['trial']['object'], finger['trial']['session']) == ('R1', 's')
    assert not finger['has_models']
    state.take_answer('', answer())
    (finger,) = state.describe()['fingers']
    assert finger['has_models']


def test_phases_have_the_colours_of_tactile_show():
    from tactile_analysis.plots import PHASE_COLOURS  # imports matplotlib

    css = Path(watch.__file__).with_name('page').joinpath('page.css').read_text()
    shown = dict(re.findall(r'--(approach|contact|glide|hold|release|return): (#\w{6})2e;', css))
    grey = PHASE_COLOURS[None]
    assert shown == {
        name: PHASE_COLOURS.get(name, grey)
        for name in ('approach', 'contact', 'glide', 'hold', 'release', 'return')
    }


def test_a_spectrum_needs_16_samples_since_the_last_gap():
    finger = Finger('')
    finger.take_block(block(0, np.zeros(600)))
    finger.take_block(block(603, np.zeros(15), lost_before=3))
    assert finger.spectrum() is None
    finger.take_block(block(618))
    assert len(finger.spectrum()['values']) == 16 // 2 + 1


def test_spectra_are_sent_five_times_per_second(state, clock):
    frames, count = Frames(state), 0
    for number in range(60):
        clock.now_s += 1 / 60
        take_blocks(state, block(number))
        frame = frames.next()
        count += 'spectrum' in frame['live']['']
    assert count <= 1 / SPECTRUM_PERIOD_S + 1


def test_buffers_of_a_fast_sensor_have_a_limited_size():
    finger = Finger('')
    period_ns = round(1e9 / 7000)
    generator = np.random.default_rng(1)
    tension_n = generator.normal(size=200_000)
    for begin in range(0, len(tension_n), 70):
        part = tension_n[begin : begin + 70]
        finger.take_block(StrainBlock(START_NS + begin * period_ns, begin, period_ns, part))
    expected = compute_spectrum(tension_n[-21_000:], 'linear', 'none')
    spectrum = finger.spectrum()
    assert spectrum['values'] == pytest.approx(expected[: len(spectrum['values'])], rel=1e-2)
    assert len(finger.points_since(0)[0]) <= 3600


def test_clock_step_begins_a_new_epoch_and_a_repeated_block_does_not(state):
    frames = Frames(state)
    take_blocks(state, *map(block, range(600, 610)))
    epoch = frames.next()['live']['']['epoch']
    take_blocks(state, block(605))
    assert frames.next() is None
    take_blocks(state, block(0, (5.0,), status=StrainStatus.CLOCK_STEP))
    live = frames.next()['live']['']
    assert live['epoch'] == epoch + 1
    assert live['y'] == [5.0]
    assert Frames(state).next()['live']['']['y'] == [5.0]


def test_silent_sensors_and_devices_are_reported(state, clock):
    take_blocks(state, block(0, status=StrainStatus.SATURATED))
    state.take_health('tendon_sensor', 0, 'samples arrive', {})
    state.take_readiness('linear_guide', ['Home the guide.'])
    state.take_health('linear_guide', 1, 'not homed; home the guide', {})
    (finger,) = state.describe()['fingers']
    assert 'saturated' in finger['faults'][0]
    frames = Frames(state)
    frames.next()
    clock.now_s += 6.0
    guide, sensor = frames.next()['state']['devices']
    assert guide['missing'] == ['Home the guide.']
    assert sensor['level'] == 'stale'
    assert 'start its node again' in sensor['message']
    assert frames.next() is None
    state.take_health('operator', 0, 'trial 3 of 10', {'trial': '3', 'trials': '10'})
    assert state.describe()['progress'] == 'trial 3 of 10'


def test_untrusted_messages_cannot_fill_the_memory(state):
    for number in range(200):
        state.update(f'f{number}', Finger.take_block, block(0))
        state.take_health(f'd{number}', 9, '', {})
        state.take_readiness(f'd{number}', [])
        state.take_answer('f0', answer(model=f'm{number}'))
        state.update('f0', Finger.take_event, event(number, 'glide'))
    description = state.describe()
    assert len(description['fingers']) == MOST_FINGERS
    assert len(description['devices']) <= 64
    assert len(description['fingers'][0]['answers']) <= 12
    assert len(description['said']) <= 30


def test_nan_sample_causes_a_gap_and_prevents_the_spectrum(state):
    for number in range(200):
        value = np.nan if number == 100 else 1.0 + 0.1 * (number % 5)
        take_blocks(state, block(number, (value,)))
        if number in (100, 103):
            assert state.finger('').spectrum() is None
    frame = json.loads(json.dumps(Frames(state).next(), allow_nan=False))
    assert frame['live']['']['y'].count(None) == 1
    assert state.finger('').spectrum()
