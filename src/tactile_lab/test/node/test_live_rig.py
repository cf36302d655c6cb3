# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials on the simulated rig through every real part: serial lines, drivers, DDS."""

from contextlib import contextmanager
import threading
import time

import pytest
from rclpy.action import ActionClient, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from linear_guide_driver.grbl import protocol
from tactile_bringup.launch_config.graph import ModelChoice, NodeDescription, Ports, rig_graph
from tactile_bringup.nodes.graph_runner import running_graph
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_msgs.action import HomeGuide, RunTrial
from tactile_msgs.msg import TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.goals import send
from tactile_ros.qos import EVENTS
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.simulated_rigs import (
    home_at,
    home_fast,
    let_servos_pause,
    PATIENT,
    truth_at_rest,
)
from tactile_testing.waiting import wait_until

DEADLINE_S = 20.0

STAMP_BOUND_S = 0.1
"""Reports may come late on a busy machine; on a quiet one the stamps are within 0.02 s."""

QUICK = {'approach_speed_m_s': 0.1, **PATIENT}
"""Parameters of the trial runner that shorten, or bear, what no test here looks at."""

LATE_S = 0.6


class Watcher(Node):
    """Keeps the trial events, and can send a goal without waiting for its end."""

    def __init__(self, context):
        super().__init__('watcher', context=context)
        self.events = []
        self.create_subscription(TrialEvent, 'trial_runner/events', self.events.append, EVENTS)
        self.client = ActionClient(self, RunTrial, 'trial_runner/run_trial')
        self.homing = ActionClient(self, HomeGuide, 'linear_guide/home')

    def phases(self):
        return [event.phase for event in self.events]

    def wait_for_phase(self, phase):
        def has_begun():
            assert phase == 'aborted' or 'aborted' not in self.phases(), self.events[-1].message
            return phase in self.phases()

        wait_until(has_begun, lambda: f'{phase} never began; seen: {self.phases()}')

    def start_trial(self, protocol):
        assert self.client.wait_for_server(timeout_sec=DEADLINE_S)
        goal = RunTrial.Goal(protocol=protocol, contact='flexion', trial_id='t')
        return send(self, lambda: self.client.send_goal_async(goal)).result(DEADLINE_S)

    def start_homing(self):
        assert self.homing.wait_for_server(timeout_sec=DEADLINE_S)
        return send(self, lambda: self.homing.send_goal_async(HomeGuide.Goal())).result(DEADLINE_S)


@pytest.fixture(autouse=True)
def patient_driver(monkeypatch):
    let_servos_pause(monkeypatch)


@pytest.fixture
def rig():
    """Return a rig of the test's own: one that was left in a motion may not be slack yet."""
    with SimulatedRig(seed=3) as rig:
        home_fast(rig)
        yield rig


@contextmanager
def running_rig(rig, context, models=None, parameters=None, sensor_topic=''):
    ports = Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor, sensor_topic)
    operator = OperatorNode(context, answers=models is not None)
    watcher = Watcher(context)
    parameters = {'trial_runner': {**QUICK, **(parameters or {})}}
    graph = rig_graph(ports, models, parameters, simulated=True)
    if sensor_topic:  # the hand's own driver of the load cell
        driver = NodeDescription('tendon_sensor', {'port': rig.ports.sensor}, namespace='hand')
        graph.append(driver)
    with running_graph(graph, context, others=[operator, watcher]) as nodes:
        yield operator, watcher, nodes


def test_stiffness_trial_is_felt_and_named(rig, context, trained):
    with running_rig(rig, context, ModelChoice.read(trained)) as (operator, watcher, nodes):
        assert nodes['tactile_features'].is_fed_by_calls  # not one sample in a message
        operator.home_guide()
        rig.mount('stiffness', 'none', 'flexion')
        request = TrialRequest('stiffness', 'flexion', 'none', 'first')
        assert operator.run_trial(request) == 'first'
        (model,) = operator.wait_for_models()
        (answer,) = operator.wait_for_answers('first', [model.model_id])
        assert answer.label == 'none', answer.reason
        assert answer.simulated
        watcher.wait_for_phase('done')  # the result may come before the event
        assert watcher.phases() == ['approach', 'contact', 'hold', 'release', 'done']
        assert {event.trial_id for event in watcher.events} == {'first'}
        assert truth_at_rest(rig)['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)


def test_a_rig_feels_a_force_that_another_node_publishes(rig, context, trained):
    topic = '/hand/tendon_sensor/wrench:norm'
    with running_rig(rig, context, ModelChoice.read(trained), sensor_topic=topic) as (
        operator,
        *_,
    ):
        operator.home_guide()
        rig.mount('stiffness', 'none', 'flexion')
        trial = 'first'
        try:
            operator.run_trial(TrialRequest('stiffness', 'flexion', 'none', trial))
        except TactileError as error:  # a computer that gives this process no core for 0.2 s
            if 'of silence' not in str(error):
                raise
            trial = operator.run_trial(TrialRequest('stiffness', 'flexion', 'none', 'second'))
        (model,) = operator.wait_for_models()
        (answer,) = operator.wait_for_answers(trial, [model.model_id])
        assert answer.label == 'none', answer.reason


def test_guide_that_was_not_homed_ends_the_trial_with_a_sentence(rig, context):
    with running_rig(rig, context, parameters={'server_timeout_s': 1.0}) as (operator, watcher, _):
        rig.mount('texture', 'F', 'flexion')
        with pytest.raises(TactileError, match=r'(?i)home'):
            operator.run_trial(TrialRequest('texture', 'flexion'))
        watcher.wait_for_phase('aborted')
        assert watcher.phases() == ['approach', 'aborted']


@pytest.mark.parametrize('is_canceled_first', [False, True])
def test_a_trial_right_after_a_slow_homing_runs(rig, context, is_canceled_first):
    """A homing that takes longer than a trial waits for devices, as those of real guides do."""
    timeout_s = 1.0
    home_at(rig, slow_mm_min=300, fast_mm_min=300)  # 100 mm at 5 mm/s
    with running_rig(rig, context, parameters={'server_timeout_s': timeout_s}) as parts:
        operator, watcher, nodes = parts
        rig.mount('stiffness', 'none', 'flexion')
        if is_canceled_first:
            canceled_s = time.monotonic()
            handle = watcher.start_homing()
            wait_until(lambda: 'being homed' in nodes['linear_guide']._client.trouble)
            send(watcher, handle.cancel_goal_async).result(DEADLINE_S)
            wait_until(lambda: time.monotonic() > canceled_s + 2 * timeout_s)
        homed_s = time.monotonic()
        operator.home_guide()
        assert time.monotonic() > homed_s + timeout_s
        assert operator.run_trial(TrialRequest('stiffness', 'flexion', 'none', 'first')) == 'first'


def test_cancelled_glide_stops_the_guide_and_releases_the_tendon(rig, context):
    with running_rig(rig, context) as (operator, watcher, _):
        operator.home_guide()
        rig.mount('texture', 'R1', 'flexion')
        handle = watcher.start_trial('texture')
        watcher.wait_for_phase('glide')
        send(watcher, handle.cancel_goal_async).result(DEADLINE_S)
        reply = send(watcher, handle.get_result_async).result(DEADLINE_S)
        assert reply.result.message == 'trial t ended in glide: cancelled'
        assert reply.result.trial_id == 't'
        watcher.wait_for_phase('aborted')
        truth = truth_at_rest(rig)
        assert truth['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)
        assert 0.059 < truth['guide_position_m'] < 0.120


def test_rig_that_dies_in_a_trial_aborts_it(rig, context):
    with running_rig(rig, context) as (operator, watcher, _):
        operator.home_guide()
        rig.mount('stiffness', 'pla', 'flexion')
        handle = watcher.start_trial('stiffness')
        watcher.wait_for_phase('contact')
        rig.close()
        reply = send(watcher, handle.get_result_async).result(DEADLINE_S)
        assert 'ended in' in reply.result.message
        watcher.wait_for_phase('aborted')


def test_closing_the_graph_in_a_glide_brings_the_rig_to_rest(rig, context):
    with running_rig(rig, context) as (operator, watcher, _):
        operator.home_guide()
        rig.mount('texture', 'R1', 'flexion')
        watcher.start_trial('texture')
        watcher.wait_for_phase('glide')
    truth = truth_at_rest(rig)
    assert truth['guide_position_m'] < 0.120
    assert truth['tension_n'] < 1.0


class Truth:
    """Where guide and tendon of the simulated rig really were, and when."""

    def __init__(self, rig):
        self._rig = rig
        self._samples = []
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._read)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._is_over.set()
        self._thread.join()

    def _read(self):
        while not self._is_over.wait(0.02):  # each look costs the rig some of its time
            self._samples.append((time.time_ns(), self._rig.truth()))

    def first_ns(self, condition):
        return next(stamp_ns for stamp_ns, state in self._samples if condition(state))


def stamp_ns(watcher, phase):
    (event,) = (event for event in watcher.events if event.phase == phase)
    return Time.from_msg(event.header.stamp).nanoseconds


def test_phases_are_stamped_by_the_rigs_motion_however_late_a_server_accepts(rig, context):
    # How well it moves is not asked here.
    parameters = {
        'speed_tolerance': 0.1,
        'displacement_tolerance_m': 0.002,
    }
    with running_rig(rig, context, parameters=parameters) as (operator, watcher, nodes):
        operator.home_guide()
        rig.mount('texture', 'R1', 'flexion')
        timers = []

        async def accept_late(_):
            late = Future()
            timers.append(threading.Timer(LATE_S, late.set_result, [None]))
            timers[-1].start()
            await late
            return GoalResponse.ACCEPT

        for name in ('linear_guide', 'tendon_actuator'):
            nodes[name].goal_runners[0]._server.register_goal_callback(accept_late)
        with Truth(rig) as truth:
            result = operator.run_trial(TrialRequest('texture', 'flexion', 'R1', 'late'))
            watcher.wait_for_phase('done')
        assert result == 'late'
        moments = {
            'contact': truth.first_ns(lambda s: s['tendon_displacement_m'] > 5e-5),
            'glide': truth.first_ns(
                lambda s: s['tendon_displacement_m'] > 0.004 and s['guide_position_m'] > 0.06001
            ),
            'release': truth.first_ns(lambda s: s['guide_position_m'] > 0.1249),
        }
        for phase, true_ns in moments.items():
            assert abs(stamp_ns(watcher, phase) - true_ns) < STAMP_BOUND_S * 1e9, phase
        assert stamp_ns(watcher, 'glide') - stamp_ns(watcher, 'contact') > LATE_S * 1e9


def test_a_sensor_that_dies_in_the_hold_fails_the_trial(rig, context):
    with running_rig(rig, context) as (operator, watcher, _):
        operator.home_guide()
        rig.mount('stiffness', 'pla', 'flexion')
        handle = watcher.start_trial('stiffness')
        watcher.wait_for_phase('hold')
        rig.fault('sensor', 'unplug')
        reply = send(watcher, handle.get_result_async).result(DEADLINE_S)
        assert 'No valid sample came on tendon_sensor/strain' in reply.result.message
        watcher.wait_for_phase('aborted')
        assert 'No valid sample' in watcher.events[-1].message
        assert truth_at_rest(rig)['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)


def test_a_glide_that_pauses_because_its_host_does_fails_the_trial(rig, context, monkeypatch):
    encode_pieces = protocol.encode_pieces

    def encode_and_pause(start_mm, end_mm, speed_mm_s, piece_s):
        for number, line in enumerate(encode_pieces(start_mm, end_mm, speed_mm_s, piece_s)):
            if speed_mm_s == 15.0 and number == 50:
                time.sleep(0.6)  # the pause is what is tested: longer than run_on_s
            yield line

    monkeypatch.setattr(protocol, 'encode_pieces', encode_and_pause)
    with running_rig(rig, context) as (operator, watcher, nodes):
        operator.home_guide()
        rig.mount('texture', 'R1', 'flexion')
        handle = watcher.start_trial('texture')
        result = send(watcher, handle.get_result_async).result(DEADLINE_S).result
        assert 'ended in glide' in result.message
        assert 0.1 < result.glide_lag_s < 0.8
        assert nodes['linear_guide']._client.late_moves == 1
        watcher.wait_for_phase('aborted')
