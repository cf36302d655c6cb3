# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0


import pytest
from sensor_msgs.msg import JointState
from topic_peers import Peers

from linear_guide_driver.grbl.connection import GrblConnection
from linear_guide_driver.grbl.guide_client import HOME, HOMING, HOMING_FAILED
from linear_guide_driver.linear_guide_node import LinearGuideNode
from linear_guide_driver.motion_node import FEEDBACK_PERIOD_S
from tactile_msgs.action import HomeGuide, MoveGuide
from tactile_msgs.msg import Readiness
from tactile_ros.qos import LATEST
from tactile_testing.requests import send
from tactile_testing.waiting import wait_until

ALONE = {'poll_rate_hz': 20.0, 'tendon_topic': ''}


@pytest.fixture
def guide(bench, grbl):
    bench.start(LinearGuideNode, port=grbl.port, **ALONE)
    return bench


def home(bench):
    status, result = bench.result(bench.send(HomeGuide, '/linear_guide/home'))
    assert status == 'succeeded', result.message
    return result


def move(bench, position_m, speed_m_s):
    return bench.send(MoveGuide, '/linear_guide/move', position_m=position_m, speed_m_s=speed_m_s)


def test_home_and_move_succeed_with_feedback_joint_states_and_diagnostics(
    guide, grbl, diagnostics
):
    joints = []
    guide.peer.create_subscription(JointState, '/linear_guide/joint_states', joints.append, 10)
    grbl.home_s = 0.3
    result = home(guide)
    assert result.position_m == pytest.approx(0.001)
    assert guide.feedback

    status, result = guide.result(move(guide, 0.051, 0.1))
    assert status == 'succeeded'
    assert '0.0510 m' in result.message
    assert result.position_m == pytest.approx(0.051)
    assert result.duration_s >= 0.5
    moved = [f for f in guide.feedback if isinstance(f, MoveGuide.Feedback)]
    assert 1 <= len(moved) <= result.duration_s / FEEDBACK_PERIOD_S + 2
    assert all(0.001 <= f.position_m <= 0.051 for f in moved)

    wait_until(lambda: joints and joints[-1].position[0] == pytest.approx(0.051))
    assert joints[-1].name == ['linear_guide_joint']
    assert joints[-1].header.frame_id == 'linear_guide_link'
    assert max(j.velocity[0] for j in joints) == pytest.approx(0.1)
    assert len(joints[-1].effort) == 0
    wait_until(lambda: diagnostics and diagnostics[-1].level == b'\x00')
    assert diagnostics[-1].hardware_id == 'Grbl 1.1h.20190830'


def test_a_stop_brakes_ends_the_goal_and_keeps_the_position(guide, grbl):
    assert guide.call('/linear_guide/stop').success
    assert guide.call('/linear_guide/reset').success
    home(guide)
    for way, end in (('cancel', 'canceled'), ('stop', 'aborted'), ('deactivate', 'aborted')):
        handle = move(guide, 0.15, 0.05)
        wait_until(lambda: grbl.is_moving)
        if way == 'cancel':
            guide.ask(handle.cancel_goal_async)
        elif way == 'stop':
            assert guide.call('/linear_guide/stop').success
        else:
            guide.node.trigger_deactivate()
        status, result = guide.result(handle)
        assert guide.call('/linear_guide/reset').success
        assert status == end, result.message
        assert guide.node._client.state.position_m is not None
        assert not grbl.is_moving
    guide.aborts(move(guide, 0.002, 0.1), 'not active')


def test_a_fault_right_after_the_last_report_is_told(guide, monkeypatch):
    home(guide)
    wait_report = GrblConnection.wait_report

    def wait_report_then_fail(connection, timeout_s):
        report = wait_report(connection, timeout_s)
        connection._fail('the controller restarted by itself')
        return report

    monkeypatch.setattr(GrblConnection, 'wait_report', wait_report_then_fail)
    lost = 'the controller restarted by itself'
    guide.aborts(move(guide, 0.01, 0.1), lost)
    guide.aborts(guide.send(HomeGuide, '/linear_guide/home'), lost)


def test_a_stop_of_a_guide_that_is_unplugged_is_not_confirmed(guide, grbl):
    assert guide.call('/linear_guide/stop').success
    grbl.close()
    wait_until(lambda: not guide.node.is_usable())
    assert not guide.call('/linear_guide/stop').success


def test_bad_goals_are_aborted_with_a_sentence(guide, grbl):
    guide.aborts(move(guide, 0.1, 0.05), HOME)
    home(guide)
    guide.aborts(move(guide, 0.3, 0.05), '0.3')
    first = move(guide, 0.15, 0.05)
    wait_until(lambda: grbl.is_moving)
    guide.aborts(guide.send(HomeGuide, '/linear_guide/home'), 'busy')
    guide.call('/linear_guide/stop')
    guide.result(first)


def test_a_second_life_works_like_the_first(guide, grbl):
    for _ in range(2):
        home(guide)
        assert guide.result(move(guide, 0.01, 0.1))[0] == 'succeeded'
        for transition in ('deactivate', 'cleanup', 'configure', 'activate'):
            # A requested transition runs on the executor's thread. On another thread, the executor
            # could use publishers while they are being destroyed.
            task = guide.executor.create_task(getattr(guide.node, f'trigger_{transition}'))
            wait_until(task.done)
            assert task.result().name == 'SUCCESS', transition
        assert len(guide.node.goal_runners) == 2
        assert len(guide.node._managed_entities) == 1


def test_configure_fails_cleanly_without_a_port_and_works_afterwards(bench, grbl):
    bench.node = bench.make(LinearGuideNode, port='/dev/does-not-exist')
    assert not bench.node.bring_up()
    bench.node.set_parameters([type(bench.node.get_parameter('port'))('port', value=grbl.port)])
    assert bench.node.bring_up()


@pytest.mark.parametrize(
    ('topic', 'parameters'),
    [
        ('heart', {'heartbeat_topics': ['heart'], 'heartbeat_timeout_s': 0.5}),
        ('tendon_sensor/strain', {'strain_timeout_s': 0.5}),
    ],
)
def test_a_move_ends_when_what_it_needs_falls_silent_though_the_clock_stands(
    bench, grbl, topic, parameters
):
    bench.start(LinearGuideNode, port=grbl.port, peer_wait_s=0.1, **ALONE, **parameters)
    bench.stop_clock()
    bench.aborts(move(bench, 0.1, 0.05), topic)
    with Peers(bench):
        wait_until(lambda: topic not in ' '.join(bench.node._find_missing()))
        home(bench)
        handle = move(bench, 0.19, 0.01)
        wait_until(lambda: grbl.is_moving)
    # The message of the result must state the reason.
    bench.aborts(handle, f'{topic} for 0.5 s')
    assert not grbl.is_moving


def test_ready_comes_before_the_result_of_a_homing(guide, grbl):
    heard = []  # in the order of their arrival
    guide.peer.create_subscription(
        Readiness, '/linear_guide/ready', lambda m: heard.append(m.missing), LATEST
    )
    grbl.home_s = 1.0
    handle = guide.send(HomeGuide, '/linear_guide/home')
    wait_until(lambda: heard and heard[-1] == [str(HOMING)])
    guide.ask(handle.cancel_goal_async)
    assert guide.result(handle)[0] == 'canceled'
    assert heard[-1] == [str(HOMING_FAILED)]
    grbl.home_s = 0.5
    handle = guide.send(HomeGuide, '/linear_guide/home')
    reply = send(guide.peer, handle.get_result_async)
    reply.add_done_callback(lambda _: heard.append('result'))
    wait_until(lambda: 'result' in heard)
    assert heard[heard.index('result') - 1] == []


def test_ready_says_what_is_missing(guide, grbl, diagnostics):
    readiness, joints = [], []
    guide.peer.create_subscription(Readiness, '/linear_guide/ready', readiness.append, LATEST)
    guide.peer.create_subscription(JointState, '/linear_guide/joint_states', joints.append, 10)
    wait_until(lambda: readiness)
    assert HOME in readiness[0].missing[0]
    assert joints == []
    home(guide)
    wait_until(lambda: readiness[-1].ready and joints)
    grbl.lose_power()  # reported immediately
    wait_until(lambda: diagnostics and HOME in diagnostics[-1].message)
    wait_until(lambda: not readiness[-1].ready)
