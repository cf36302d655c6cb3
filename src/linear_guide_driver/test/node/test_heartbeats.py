# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Heartbeats of real drivers: hung workers, two rigs in one domain, a frozen tendon driver."""

from contextlib import contextmanager
import signal
import subprocess

from action_msgs.msg import GoalStatus
import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter
from scripted_grbl import ScriptedGrbl
from scripted_servo import ScriptedServo

from linear_guide_driver.config import REST_CYCLE_S
from linear_guide_driver.linear_guide_node import LinearGuideNode
from linear_guide_driver.tendon_actuator_node import TendonActuatorNode
from tactile_msgs.action import HomeGuide, MoveGuide, PullTendon
from tactile_ros.health import HeartbeatWatch, LEASE_S
from tactile_ros.node_group import NodeGroup
from tactile_testing.requests import send
from tactile_testing.waiting import wait_until

START_S = 60.0
"""Longest time [s] until a process has started on a busy computer."""

HANG_S = 0.5
RIVALS = 'ROS_DOMAIN_ID'
SLACK = 2048
TAUT_M = 0.004
TENDON = {'watchdog_s': 1.0, 'unguarded': True, 'speed_m_s': 0.02}
PULL = {'displacement_m': TAUT_M, 'speed_m_s': 0.02, 'contact': 'flexion'}


def test_a_lease_lasts_for_three_heartbeats_at_rest():
    assert round(LEASE_S / REST_CYCLE_S) >= 3


@pytest.fixture
def twins(context):
    """Return a function that starts a second node in a separate participant of the same domain."""
    other = Context()
    rclpy.init(context=other, domain_id=context.get_domain_id())

    @contextmanager
    def bring_up(node_class, **parameters):
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = node_class(context=other, parameter_overrides=overrides)
        assert node.bring_up()
        with NodeGroup([node], context=other):
            yield node

    yield bring_up
    rclpy.shutdown(context=other)


def watch_heartbeat(bench, name):
    watch = HeartbeatWatch(bench.peer, f'{name}/heartbeat')
    wait_until(lambda: not watch.find_loss())
    return watch


def test_a_guide_whose_poll_hangs_gives_no_sign_of_life(bench, grbl):
    bench.start(LinearGuideNode, port=grbl.port)
    watch = watch_heartbeat(bench, 'linear_guide')
    client, is_lost = bench.node._client, False

    def find_link():
        connection = client._connection
        return None if connection is None else connection._link

    while not is_lost:  # on a busy computer, the driver may have reconnected
        link = wait_until(find_link)
        with link._write_lock:  # blocks the poll, like a write that hangs
            wait_until(lambda link=link: watch.find_loss() or find_link() is not link)
            is_lost = bool(watch.find_loss())
    wait_until(lambda: not watch.find_loss())
    watch.close()


def test_a_tendon_driver_whose_poll_hangs_gives_no_sign_of_life(bench, servo):
    bench.start(TendonActuatorNode, port=servo.port, **TENDON)
    watch = watch_heartbeat(bench, 'tendon_actuator')
    with bench.node._client._servo.bus.lock:
        wait_until(watch.find_loss)
    wait_until(lambda: not watch.find_loss())
    watch.close()


def test_a_driver_notices_the_loss_of_a_peer_while_its_executor_hangs(bench, servo, peers):
    bench.start(
        TendonActuatorNode,
        port=servo.port,
        heartbeat_topics=['heart'],
        slack_after_s=0.2,
        **TENDON,
    )
    handle = bench.send(PullTendon, '/tendon_actuator/pull', **PULL)
    assert bench.result(handle)[0] == 'succeeded'
    is_over = []

    def hang():
        peers.beats = False
        wait_until(lambda: abs(servo.position - SLACK) <= 33)
        is_over.append(True)

    bench.executor.create_task(hang)
    wait_until(lambda: is_over)


def test_of_two_tendon_drivers_none_tightens_and_both_slacken(bench, servo, twins):
    bench.start(TendonActuatorNode, port=servo.port, slack_after_s=0.2, **TENDON)
    handle = bench.send(PullTendon, '/tendon_actuator/pull', **PULL)
    assert bench.result(handle)[0] == 'succeeded'
    second_servo = ScriptedServo()
    try:
        with twins(TendonActuatorNode, port=second_servo.port, **TENDON) as second:
            named = 'tendon_actuator/presence (/tendon_actuator, /tendon_actuator)'
            for node in (bench.node, second):
                wait_until(lambda node=node: named in ' '.join(node._find_missing()))
            # the taut tendon has been slackened
            wait_until(lambda: abs(servo.position - SLACK) <= 33)
            handle = bench.send(PullTendon, '/tendon_actuator/pull', **PULL)
            bench.aborts(handle, named)
            assert max(abs(each.position - SLACK) for each in (servo, second_servo)) <= 33
            handle = bench.send(PullTendon, '/tendon_actuator/pull', displacement_m=0.0)
            assert bench.result(handle)[0] == 'succeeded'
    finally:
        second_servo.close()
    wait_until(lambda: not bench.node._find_missing())
    handle = bench.send(PullTendon, '/tendon_actuator/pull', **PULL)
    assert bench.result(handle)[0] == 'succeeded'


def test_a_second_tendon_driver_that_is_not_well_is_a_rival_too(bench, servo, twins):
    bench.start(TendonActuatorNode, port=servo.port, slack_after_s=0.2, **TENDON)
    second_servo = ScriptedServo()
    try:
        with twins(TendonActuatorNode, port=second_servo.port, **TENDON) as second:
            wait_until(lambda: RIVALS in ' '.join(bench.node._find_missing()))
            watch = HeartbeatWatch(bench.peer, 'tendon_actuator/heartbeat')
            wait_until(lambda: '2 nodes' in str(watch.find_loss()))
            second_servo.unplug()
            wait_until(lambda: not second.is_usable() and not watch.find_loss())
            for _ in range(3):  # either of the two nodes may answer
                bench.aborts(bench.send(PullTendon, '/tendon_actuator/pull', **PULL), RIVALS)
            assert abs(servo.position - SLACK) <= 33
            watch.close()
    finally:
        second_servo.close()
    wait_until(lambda: not bench.node._find_missing())
    handle = bench.send(PullTendon, '/tendon_actuator/pull', **PULL)
    assert bench.result(handle)[0] == 'succeeded'


def test_of_two_guides_a_moving_one_stops_and_none_moves(bench, grbl, twins):
    alone = {'poll_rate_hz': 20.0, 'tendon_topic': ''}
    bench.start(LinearGuideNode, port=grbl.port, **alone)
    assert bench.result(bench.send(HomeGuide, '/linear_guide/home'))[0] == 'succeeded'
    move = {'position_m': 0.19, 'speed_m_s': 0.005}
    handle = bench.send(MoveGuide, '/linear_guide/move', **move)
    wait_until(lambda: grbl.is_moving)
    # The result is requested before the second guide starts, which would answer that it does not
    # know the goal.
    end = send(bench.peer, handle.get_result_async)
    second_grbl = ScriptedGrbl()
    try:
        with twins(LinearGuideNode, port=second_grbl.port, **alone) as second:
            # Each guide must have discovered the other, because either may answer the next goal.
            for node in (bench.node, second):
                wait_until(lambda node=node: RIVALS in ' '.join(node._find_missing()))
            wait_until(end.done)
            reply = end.result()
            assert reply.status == GoalStatus.STATUS_ABORTED
            assert RIVALS in reply.result.message
            assert not grbl.is_moving
            bench.aborts(bench.send(MoveGuide, '/linear_guide/move', **move), RIVALS)
            assert not grbl.is_moving
    finally:
        second_grbl.close()
    wait_until(lambda: not bench.node._find_missing())


# -- a frozen tendon driver, in a separate process --------------------------------------------


def test_a_tendon_driver_that_waits_is_left_and_a_frozen_one_is_killed_and_the_next_slackens(
    bench, servo, start_driver
):
    driver = start_driver(hang_timeout_s=HANG_S, **TENDON)
    watch = HeartbeatWatch(bench.peer, 'tendon_actuator/heartbeat')
    wait_until(lambda: not watch.find_loss(), timeout_s=START_S)
    servo.unplug()
    wait_until(watch.find_loss)
    # the driver waits for its servo and does not hang
    with pytest.raises(subprocess.TimeoutExpired):
        driver.wait(4 * HANG_S)
    servo.plug_in()
    wait_until(lambda: not watch.find_loss())
    handle = bench.send(PullTendon, '/tendon_actuator/pull', **PULL)
    assert bench.result(handle)[0] == 'succeeded'
    driver.send_signal(signal.SIGSTOP)
    assert driver.wait(START_S) == -signal.SIGKILL
    assert servo.position > SLACK + 200
    driver = start_driver(hang_timeout_s=HANG_S, **TENDON)
    wait_until(lambda: abs(servo.position - SLACK) <= 33, timeout_s=START_S)
    wait_until(lambda: not watch.find_loss(), timeout_s=START_S)
    driver.send_signal(signal.SIGINT)
    assert driver.wait(START_S) == 0
    watch.close()
