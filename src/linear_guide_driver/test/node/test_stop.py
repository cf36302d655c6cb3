# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stop, release and reset as described in docs/motion.md: real nodes, simulated devices."""

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool

from linear_guide_driver.linear_guide_node import LinearGuideNode
from linear_guide_driver.stop_latch import RESET
from linear_guide_driver.tendon_actuator_node import TendonActuatorNode
from tactile_msgs.action import HomeGuide, HomeTendon, MoveGuide, PullTendon
from tactile_msgs.msg import Readiness
from tactile_ros.qos import LATEST
from tactile_testing.waiting import wait_until

SLACK = 2048
"""Position of the scripted servo at its start, where the tendon is slack [counts]."""

TAUT_M = 0.004
PRESSED = 'Stop was pressed on'


def start_tendon(bench, servo, **parameters):
    defaults = {'speed_m_s': 0.04, 'watchdog_s': 1.0, 'heartbeat_topics': ['heart']}
    timeouts = {'guard_timeout_s': 0.5, 'heartbeat_timeout_s': 0.5}
    bench.start(TendonActuatorNode, port=servo.port, **{**defaults, **timeouts, **parameters})


def add_guide(bench, grbl, **parameters):
    guide = bench.make(LinearGuideNode, port=grbl.port, poll_rate_hz=20.0, **parameters)
    assert guide.bring_up()
    bench.executor.add_node(guide)
    return guide


def pull(bench, displacement_m, speed_m_s=0.04):
    fields = {'displacement_m': displacement_m, 'speed_m_s': speed_m_s, 'contact': 'flexion'}
    return bench.send(PullTendon, '/tendon_actuator/pull', **fields)


def pull_taut(bench, peers):
    peers.tension_n = 0.0
    wait_until(lambda: not bench.node._find_missing())
    status, result = bench.result(pull(bench, TAUT_M))
    assert status == 'succeeded', result.message
    peers.tension_n = 2.0


def is_slack(servo):
    return abs(servo.position - SLACK) <= 33  # 0.5 mm


def hear_readiness(bench, *names):
    """Return the latest sentences of each node's ``~/ready``."""
    heard = {}
    for name in names:
        bench.peer.create_subscription(
            Readiness,
            f'/{name}/ready',
            lambda message, name=name: heard.update({name: ' '.join(message.missing)}),
            LATEST,
        )
    wait_until(lambda: len(heard) == len(names))
    return heard


def test_a_stopped_tendon_becomes_slack_however_often_stop_is_pressed(bench, servo, peers):
    start_tendon(bench, servo, slack_after_s=0.5)
    heard = hear_readiness(bench, 'tendon_actuator')
    pull_taut(bench, peers)
    answer = bench.call('/tendon_actuator/stop')
    assert answer.success
    assert PRESSED in answer.message
    assert '0.5 s' in answer.message
    wait_until(lambda: not bench.call('/tendon_actuator/stop').success or is_slack(servo))
    assert is_slack(servo)
    wait_until(lambda: PRESSED in heard['tendon_actuator'])
    peers.tension_n = 0.0
    for begin in (
        lambda: pull(bench, 0.001),
        lambda: bench.send(HomeTendon, '/tendon_actuator/home'),
    ):
        assert RESET in bench.aborts(begin(), f'{PRESSED} /tendon_actuator')
    assert bench.result(pull(bench, 0.0))[0] == 'succeeded'
    assert bench.call('/tendon_actuator/release').success
    assert bench.call('/tendon_actuator/reset').success
    wait_until(lambda: not heard['tendon_actuator'])
    assert is_slack(servo)
    assert bench.result(pull(bench, TAUT_M))[0] == 'succeeded'


@pytest.mark.parametrize('begin', ['pull', 'release'])
def test_a_stop_does_not_end_slackening(bench, servo, peers, begin):
    servo.put(44, 4, 10)  # velocity limit at which 4 mm of tendon take 1.6 s
    start_tendon(bench, servo, speed_m_s=0.002, slack_after_s=30.0)
    wait_until(lambda: not bench.node._find_missing())
    assert bench.result(pull(bench, TAUT_M, 0.0023))[0] == 'succeeded'
    peers.tension_n = 2.0
    handle = None
    if begin == 'pull':
        handle = pull(bench, 0.0, 0.002)
    else:
        assert bench.call('/tendon_actuator/release').success
    before = servo.position
    wait_until(lambda: servo.position < before - 10)
    for _ in range(3):
        assert bench.call('/tendon_actuator/stop').success
    wait_until(lambda: is_slack(servo))
    assert handle is None or bench.result(handle)[0] == 'succeeded'


def test_a_cancelled_goal_holds_and_latches_nothing(bench, servo, peers):
    start_tendon(bench, servo)
    wait_until(lambda: not bench.node._find_missing())
    handle = pull(bench, 0.02, 0.005)
    wait_until(lambda: servo.position > SLACK + 60)
    bench.ask(handle.cancel_goal_async)
    assert bench.result(handle)[0] == 'canceled'
    assert bench.result(pull(bench, TAUT_M))[0] == 'succeeded'


def test_a_stopped_guide_refuses_to_move_until_it_is_reset(bench, grbl):
    bench.start(LinearGuideNode, port=grbl.port, poll_rate_hz=20.0, tendon_topic='')
    assert bench.result(bench.send(HomeGuide, '/linear_guide/home'))[0] == 'succeeded'
    handle = bench.send(MoveGuide, '/linear_guide/move', position_m=0.15, speed_m_s=0.05)
    wait_until(lambda: grbl.is_moving)
    assert bench.call('/linear_guide/stop').success
    bench.aborts(handle, PRESSED)
    goal = {'position_m': 0.01, 'speed_m_s': 0.05}
    bench.aborts(bench.send(MoveGuide, '/linear_guide/move', **goal), PRESSED)
    bench.aborts(bench.send(HomeGuide, '/linear_guide/home'), PRESSED)
    assert not grbl.is_moving
    assert bench.call('/linear_guide/reset').success
    handle = bench.send(MoveGuide, '/linear_guide/move', **goal)
    assert bench.result(handle)[0] == 'succeeded'


def test_one_stop_stops_the_whole_rig_and_a_restarted_driver_is_stopped_too(
    bench, servo, grbl, peers
):
    start_tendon(bench, servo, slack_after_s=0.3)
    guide = add_guide(bench, grbl)
    try:
        heard = hear_readiness(bench, 'tendon_actuator', 'linear_guide')
        assert bench.result(bench.send(HomeGuide, '/linear_guide/home'))[0] == 'succeeded'
        pull_taut(bench, peers)
        glide = {'position_m': 0.15, 'speed_m_s': 0.02, 'allow_taut': True}
        handle = bench.send(MoveGuide, '/linear_guide/move', **glide)
        wait_until(lambda: grbl.is_moving)
        assert bench.call('/tendon_actuator/stop').success
        bench.aborts(handle, f'{PRESSED} /tendon_actuator')
        wait_until(lambda: is_slack(servo))
        wait_until(lambda: all(PRESSED in sentence for sentence in heard.values()))

        bench.executor.remove_node(guide)
        guide.take_down()
        guide = add_guide(bench, grbl)
        heard.clear()
        goal = {'position_m': 0.01, 'speed_m_s': 0.05}
        bench.aborts(bench.send(MoveGuide, '/linear_guide/move', **goal), PRESSED)
        wait_until(lambda: PRESSED in heard['linear_guide'])

        assert bench.call('/linear_guide/reset').success
        wait_until(lambda: 'stopped' not in heard['linear_guide'])
        wait_until(lambda: not bench.node._find_missing())
        pull_taut(bench, peers)
    finally:
        bench.executor.remove_node(guide)
        guide.take_down()


def test_a_stop_outlives_a_second_life_of_the_only_node(bench, servo, peers):
    start_tendon(bench, servo)
    assert bench.call('/tendon_actuator/stop').success
    for transition in ('deactivate', 'cleanup', 'configure', 'activate'):
        assert getattr(bench.node, f'trigger_{transition}')().name == 'SUCCESS', transition
    bench.aborts(pull(bench, TAUT_M), PRESSED)


@pytest.mark.parametrize('end', ['pressed', 'lost'])
def test_an_emergency_stop_latches_when_it_is_pressed_and_when_it_is_lost(
    bench, servo, peers, end
):
    start_tendon(
        bench,
        servo,
        slack_after_s=0.3,
        peer_wait_s=0.1,
        emergency_stop_topic='/robot/emergency_stop',
        emergency_stop_timeout_s=1.0,
    )
    # The node must also hear a publisher that is transient local and reliable.
    profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = bench.peer.create_publisher(Bool, '/robot/emergency_stop', profile)
    bench.aborts(pull(bench, TAUT_M), '/robot/emergency_stop')
    timer = bench.peer.create_timer(0.05, lambda: publisher.publish(Bool(data=False)))
    pull_taut(bench, peers)
    if end == 'pressed':
        publisher.publish(Bool(data=True))
    else:
        timer.cancel()
    wait_until(lambda: is_slack(servo))
    peers.tension_n = 0.0
    timer.cancel()
    if end == 'pressed':
        publisher.publish(Bool(data=True))
    wait_until(lambda: '/robot/emergency_stop' in ' '.join(bench.node._find_missing()))
    answer = bench.call('/tendon_actuator/reset')
    assert (answer.success, '/robot/emergency_stop' in answer.message) == (False, True)
    timer.reset()
    wait_until(lambda: bench.call('/tendon_actuator/reset').success)
    assert is_slack(servo)  # a reset moves nothing
    pull_taut(bench, peers)


def test_a_driver_that_is_deactivated_slackens_the_tendon(bench, servo, peers):
    start_tendon(bench, servo, slack_after_s=0.5)
    pull_taut(bench, peers)
    assert bench.node.trigger_deactivate().name == 'SUCCESS'
    assert 'not active' in bench.node._client.safety.reason
    wait_until(lambda: is_slack(servo))
    bench.aborts(pull(bench, TAUT_M), 'not active')
    assert bench.node.trigger_activate().name == 'SUCCESS'
    pull_taut(bench, peers)


@pytest.mark.parametrize('way', ['pull', 'release'])
def test_a_driver_that_is_not_active_accepts_slackening(bench, servo, peers, way):
    start_tendon(bench, servo, slack_after_s=30.0)
    pull_taut(bench, peers)
    assert bench.node.trigger_deactivate().name == 'SUCCESS'
    if way == 'pull':
        status, result = bench.result(pull(bench, 0.0))
        assert status == 'succeeded', result.message
    else:
        assert bench.call('/tendon_actuator/release').success
    wait_until(lambda: is_slack(servo))
