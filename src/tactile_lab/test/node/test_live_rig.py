# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials on the simulated rig, with real serial ports, drivers and DDS."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
import threading
import time

from domain_coordinator import domain_id
import pytest
from rclpy.action import GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time

from linear_guide_driver.grbl import protocol
from tactile_bringup.launch_config.graph import ModelChoice, NodeDescription, Ports, rig_graph
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_msgs.action import HomeGuide, MoveGuide, PullTendon, RunTrial
from tactile_msgs.msg import TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.qos import EVENTS
from tactile_ros.rclpy_internals import ActionClient
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.requests import send
from tactile_testing.simulated_rigs import (
    advance_rig,
    GUARD,
    home_at,
    home_fast,
    let_servos_pause,
    PATIENT,
    truth_at_rest,
)
from tactile_testing.waiting import wait_until

DEADLINE_S = 20.0

QUICK = {'approach_speed_m_s': 0.1, **PATIENT}
"""Parameters of the trial runner that shorten phases, and accept delays of a busy computer, which
are not tested here."""

LATE_S = 0.6

GLIDE = {
    'glide_length_m': 0.03,
    'speed_tolerance': 0.5,
    'lag_tolerance_s': 0.4,
    'displacement_tolerance_m': 0.002,
}
"""Parameters of the shared nodes for a short glide. Delays are accepted, but not a pause of 1
s."""

GLIDE_END_M = 0.09


class Watcher(Node):
    """Stores the trial events, and sends goals without waiting for their result."""

    def __init__(self, context):
        super().__init__('watcher', context=context)
        self.events = []
        self.create_subscription(TrialEvent, 'trial_runner/events', self.events.append, EVENTS)
        self.client = ActionClient(self, RunTrial, 'trial_runner/run_trial')
        self.homing = ActionClient(self, HomeGuide, 'linear_guide/home')
        self.moving = ActionClient(self, MoveGuide, 'linear_guide/move')
        self.pulling = ActionClient(self, PullTendon, 'tendon_actuator/pull')

    def phases(self):
        return [event.phase for event in self.events]

    def wait_for_phase(self, phase):
        def has_begun():
            assert phase == 'aborted' or 'aborted' not in self.phases(), self.events[-1].message
            return phase in self.phases()

        wait_until(has_begun, lambda: f'{phase} never began; seen: {self.phases()}')

    def start(self, client, goal):
        assert client.wait_for_server(timeout_sec=DEADLINE_S)
        return send(self, lambda: client.send_goal_async(goal)).result(DEADLINE_S)

    def start_trial(self, protocol, **values):
        goal = RunTrial.Goal(protocol=protocol, contact='flexion', trial_id='t', **values)
        return self.start(self.client, goal)

    def cancel(self, handle):
        send(self, handle.cancel_goal_async).result(DEADLINE_S)

    def result_of(self, handle):
        return send(self, handle.get_result_async).result(DEADLINE_S).result


@contextmanager
def simulated_rig():
    with SimulatedRig(seed=3) as rig:
        home_fast(rig)
        yield rig


@contextmanager
def running_rig(rig, context, models=None, parameters=None, sensor_topic=''):
    ports = Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor, sensor_topic)
    operator = OperatorNode(context, answers=models is not None)
    watcher = Watcher(context)
    parameters = {
        'trial_runner': {**QUICK, **(parameters or {})},
        'tendon_actuator': GUARD,
    }
    graph = rig_graph(ports, models, parameters, simulated=True)
    if sensor_topic:  # the sensor node of the hand, which publishes the topic
        driver = NodeDescription('tendon_sensor', {'port': rig.ports.sensor}, namespace='hand')
        graph.append(driver)
    with running_graph(graph, context, others=[operator, watcher]) as nodes:
        wait_until(lambda: watcher.count_publishers('trial_runner/events'))
        yield operator, watcher, nodes


@pytest.fixture(scope='module', autouse=True)
def patient_driver():
    with pytest.MonkeyPatch.context() as patch:
        let_servos_pause(patch)
        yield


@pytest.fixture
def rig():
    """Return a rig that is not shared with other tests, and not homed."""
    with simulated_rig() as rig:
        yield rig


@pytest.fixture(scope='class')
def running(trained):
    """Return a homed rig with its nodes, which several tests share."""
    models = ModelChoice.read(trained)
    with (
        domain_id() as domain,
        ros_context(int(domain)) as context,
        simulated_rig() as rig,
        running_rig(rig, context, models, GLIDE) as parts,
    ):
        parts[0].home_guide()
        yield rig, *parts


@pytest.fixture
def shared(running):
    """Return the shared rig and its nodes at rest, and a watcher without events."""
    rig, _, watcher, _ = running
    truth_at_rest(rig)
    watcher.events.clear()
    return running


class TestSharedRig:
    """Trials on one shared rig. Its nodes end before the nodes of other tests start."""

    def test_stiffness_trial_is_classified(self, shared):
        rig, operator, watcher, nodes = shared
        # Samples are passed in memory, not in messages.
        assert nodes['tactile_features'].is_fed_by_calls
        rig.mount('stiffness', 'none', 'flexion')
        request = TrialRequest('stiffness', 'flexion', 'none', 'first')
        assert operator.run_trial(request) == 'first'
        (model,) = operator.wait_for_models()
        (answer,) = operator.wait_for_answers('first', [model.model_id])
        assert answer.label == 'none', answer.reason
        assert answer.simulated
        watcher.wait_for_phase('done')  # the result may arrive before the event
        assert watcher.phases() == ['approach', 'contact', 'hold', 'release', 'done']
        assert {event.trial_id for event in watcher.events} == {'first'}
        assert truth_at_rest(rig)['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)

    def test_cancelled_glide_stops_the_guide_and_slackens_the_tendon(self, shared):
        rig, _, watcher, _ = shared
        rig.mount('texture', 'R1', 'flexion')
        handle = watcher.start_trial('texture', glide_speed_m_s=0.005)
        watcher.wait_for_phase('glide')
        watcher.cancel(handle)
        result = watcher.result_of(handle)
        assert result.message == 'trial t ended in glide: cancelled'
        assert result.trial_id == 't'
        watcher.wait_for_phase('aborted')
        truth = truth_at_rest(rig)
        assert truth['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)
        assert 0.059 < truth['guide_position_m'] < GLIDE_END_M - 0.005

    def test_stamps_of_phases_follow_the_motion_also_if_goals_are_accepted_late(
        self, shared, monkeypatch
    ):
        """Takes more than 10 s: a complete texture trial in which each goal is accepted late."""
        rig, operator, watcher, nodes = shared
        rig.mount('texture', 'R1', 'flexion')

        async def accept_late(_):
            late = Future()
            threading.Timer(LATE_S, late.set_result, [None]).start()
            await late
            return GoalResponse.ACCEPT

        for name in ('linear_guide', 'tendon_actuator'):
            server = nodes[name].goal_runners[0]._server
            monkeypatch.setattr(server, '_goal_callback', accept_late)
        looks = []
        with ThreadPoolExecutor() as pool:
            trial = pool.submit(
                operator.run_trial, TrialRequest('texture', 'flexion', 'R1', 'late')
            )

            def is_over():
                looks.append((time.time_ns(), rig.truth()))
                return trial.done()

            # Poll rarely, because each query delays the simulated rig.
            wait_until(is_over, poll_s=0.02)
        assert trial.result() == 'late'
        watcher.wait_for_phase('done')
        seen_ns = {}
        for event in watcher.events:
            seen_ns[event.phase] = Time.from_msg(event.header.stamp).nanoseconds
        for phase, has_begun in (
            ('contact', lambda s: s['tendon_displacement_m'] > 5e-5),
            (
                'glide',
                lambda s: min(s['tendon_displacement_m'] - 4e-3, s['guide_position_m'] - 0.06001)
                > 0,
            ),
            ('release', lambda s: s['guide_position_m'] > GLIDE_END_M - 1e-4),
        ):
            true_ns = next(at_ns for at_ns, state in looks if has_begun(state))
            # A stamp at the time of the goal would be early by LATE_S. Half of it allows for
            # delays.
            assert abs(seen_ns[phase] - true_ns) < LATE_S / 2 * 1e9, phase
        assert seen_ns['glide'] - seen_ns['contact'] > LATE_S * 1e9

    def test_glide_that_pauses_because_the_computer_pauses_fails_the_trial(
        self, shared, monkeypatch
    ):
        encode_pieces = protocol.encode_pieces

        def encode_and_pause(start_mm, end_mm, speed_mm_s, piece_s):
            for number, line in enumerate(encode_pieces(start_mm, end_mm, speed_mm_s, piece_s)):
                if speed_mm_s == 15.0 and number == 30:
                    time.sleep(1.0)  # longer than run_on_s
                yield line

        monkeypatch.setattr(protocol, 'encode_pieces', encode_and_pause)
        rig, _, watcher, nodes = shared
        late_moves = nodes['linear_guide']._client.late_moves
        rig.mount('texture', 'R1', 'flexion')
        result = watcher.result_of(watcher.start_trial('texture'))
        assert 'ended in glide' in result.message
        assert GLIDE['lag_tolerance_s'] < result.glide_lag_s < 2.0
        assert nodes['linear_guide']._client.late_moves > late_moves
        watcher.wait_for_phase('aborted')

    def test_taut_tendon_prevents_homing_and_is_slackened_before_a_trial(self, shared):
        rig, operator, watcher, _ = shared
        rig.mount('texture', 'R1', 'flexion')
        goal = MoveGuide.Goal(position_m=0.13, speed_m_s=0.1)
        watcher.result_of(watcher.start(watcher.moving, goal))
        goal = PullTendon.Goal(displacement_m=0.0049, speed_m_s=0.01, contact='flexion')
        watcher.result_of(watcher.start(watcher.pulling, goal))
        at_m = truth_at_rest(rig)['guide_position_m']
        with pytest.raises(TactileError, match=r'taut.*ros2 service call /tendon_actuator/rel'):
            operator.home_guide()
        assert rig.truth()['guide_position_m'] == pytest.approx(at_m, abs=1e-5)
        handle = watcher.start_trial('texture')
        last, dragged_m = rig.truth(), 0.0

        def has_approached():
            nonlocal last, dragged_m
            truth, is_over = rig.truth(), 'contact' in watcher.phases()
            least_m = min(truth['tendon_displacement_m'], last['tendon_displacement_m'])
            if least_m > 0.001 and not is_over:
                dragged_m += abs(truth['guide_position_m'] - last['guide_position_m'])
            last = truth
            return is_over

        wait_until(has_approached)
        assert dragged_m < 2e-4
        assert 'done after' in watcher.result_of(handle).message

    def test_guide_that_moves_during_a_hold_aborts_the_trial_and_the_tendon_is_slackened(
        self, shared
    ):
        rig, _, watcher, _ = shared
        rig.mount('stiffness', 'none', 'flexion')
        handle = watcher.start_trial('stiffness', hold_s=100.0)
        watcher.wait_for_phase('hold')
        watcher.start(watcher.moving, MoveGuide.Goal(position_m=0.1, speed_m_s=0.02))
        advance_rig(rig, 1.0)
        assert watcher.phases()[-1] == 'hold', 'the interlock refuses to move'
        goal = MoveGuide.Goal(position_m=0.1, speed_m_s=0.02, allow_taut=True)
        watcher.start(watcher.moving, goal)
        message = watcher.result_of(handle).message
        assert 'ended in hold: the guide moved from 0.0600 m to ' in message
        truth = truth_at_rest(rig)
        assert truth['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)
        assert truth['guide_position_m'] < 0.09


def test_force_of_another_node_is_classified_and_the_rig_stops_when_the_nodes_end(
    rig, context, trained
):
    """Takes more than 10 s: one complete trial, and another one up to its glide."""
    topic = '/hand/tendon_sensor/wrench:norm'
    models = ModelChoice.read(trained)
    with running_rig(rig, context, models, sensor_topic=topic) as (operator, watcher, _):
        operator.home_guide()
        rig.mount('stiffness', 'none', 'flexion')
        trial = 'first'
        try:
            operator.run_trial(TrialRequest('stiffness', 'flexion', 'none', trial))
        except TactileError as error:
            # On a busy computer, the process may have been suspended for 0.2 s.
            if 'of silence' not in str(error):
                raise
            trial = operator.run_trial(TrialRequest('stiffness', 'flexion', 'none', 'second'))
        (model,) = operator.wait_for_models()
        (answer,) = operator.wait_for_answers(trial, [model.model_id])
        assert answer.label == 'none', answer.reason
        watcher.events.clear()
        rig.mount('texture', 'R1', 'flexion')
        watcher.start_trial('texture')
        watcher.wait_for_phase('glide')
    truth = truth_at_rest(rig)
    assert truth['guide_position_m'] < 0.120
    assert truth['tension_n'] < 1.0


def test_trial_requires_homing_and_a_sensor_also_if_homing_is_slow(rig, context):
    """Homing of a real guide may take longer than a trial waits for its devices.

    Takes more than 10 s: slow homing, and a trial up to its hold.
    """
    timeout_s = 1.0
    home_at(rig, slow_mm_min=1000, fast_mm_min=1500)  # 100 mm at 25 mm/s
    with running_rig(rig, context, parameters={'server_timeout_s': timeout_s}) as parts:
        operator, watcher, nodes = parts
        rig.mount('stiffness', 'pla', 'flexion')
        with pytest.raises(TactileError, match=r'(?i)home'):
            operator.run_trial(TrialRequest('stiffness', 'flexion'))
        watcher.wait_for_phase('aborted')
        assert watcher.phases() == ['approach', 'aborted']
        watcher.events.clear()
        handle = watcher.start(watcher.homing, HomeGuide.Goal())
        wait_until(lambda: 'being homed' in str(nodes['linear_guide']._client.trouble))
        watcher.cancel(handle)
        watcher.result_of(handle)
        homed_s = time.monotonic()
        operator.home_guide()
        assert time.monotonic() > homed_s + timeout_s
        handle = watcher.start_trial('stiffness')
        watcher.wait_for_phase('hold')
        rig.fault('sensor', 'unplug')
        assert 'No valid sample has arrived on' in watcher.result_of(handle).message
        watcher.wait_for_phase('aborted')
        assert 'No valid sample' in watcher.events[-1].message
        assert truth_at_rest(rig)['tendon_displacement_m'] == pytest.approx(0.0, abs=1e-4)
