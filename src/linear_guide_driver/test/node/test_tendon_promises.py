# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Statements of docs/motion.md about the tendon: the real node with a scripted servo."""

import time

from rclpy.node import Node
from topic_peers import Peers

from linear_guide_driver.safety import Zero
from linear_guide_driver.tendon_actuator_node import TendonActuatorNode
from tactile_msgs.action import PullTendon
from tactile_msgs.msg import Readiness, StrainBlock
from tactile_ros.qos import LATEST, STREAM
from tactile_testing.waiting import wait_until

SLACK = 2048
"""Position of the scripted servo at its start, where the tendon is slack [counts]."""

TAUT_M = 0.004
TAUT = SLACK + 261

SLOW = 40
"""A velocity limit at which 4 mm of tendon take 0.4 s [0.229 rpm]."""


def start(bench, servo, **parameters):
    servo.put(44, 4, SLOW)
    bench.start(
        TendonActuatorNode,
        port=servo.port,
        watchdog_s=1.0,
        speed_m_s=0.005,
        heartbeat_topics=['heart'],
        **{
            'guard_timeout_s': 0.5,
            'heartbeat_timeout_s': 0.5,
            'slack_after_s': 30.0,
            **parameters,
        },
    )


def pull(bench, displacement_m, speed_m_s=0.009, contact='flexion'):
    return bench.send(
        PullTendon,
        '/tendon_actuator/pull',
        displacement_m=displacement_m,
        speed_m_s=speed_m_s,
        contact=contact,
    )


def pull_taut(bench, peers):
    status, result = bench.result(pull(bench, TAUT_M))
    assert status == 'succeeded', result.message
    peers.tension_n = 5.0


def is_slack(servo):
    return abs(servo.position - SLACK) <= 33  # 0.5 mm


def test_above_the_limit_nothing_turns_slackening_into_holding(bench, servo, peers):
    start(bench, servo)
    pull_taut(bench, peers)
    handle = pull(bench, TAUT_M + 0.001, 0.001)
    before = servo.position
    peers.tension_n = 20.0
    wait_until(lambda: servo.position < before - 10)
    bench.ask(handle.cancel_goal_async)
    assert '20.00 N' in bench.call('/tendon_actuator/stop').message
    peers.beats = False
    wait_until(lambda: is_slack(servo))


def fall_silent(peers, who, is_silent=True):
    """Stop (or resume) the messages of ``who``: the heartbeat, or the samples of the sensor."""
    setattr(peers, 'beats' if who == 'heartbeat' else 'samples', not is_silent)


def test_slackening_is_accepted_whoever_is_silent(bench, servo, peers):
    start(bench, servo)
    for lost, speed_m_s in (('heartbeat', -1.0), ('sensor', 99.0)):
        pull_taut(bench, peers)
        fall_silent(peers, lost)
        wait_until(lambda: bench.node._client.safety.alarm)
        bench.aborts(pull(bench, 0.006), 'sample' if lost == 'sensor' else 'heart')
        # Slackening is accepted with any requested speed and contact.
        assert bench.result(pull(bench, 0.0, speed_m_s, contact=''))[0] == 'succeeded'
        assert is_slack(servo)
        peers.tension_n = 0.0
        fall_silent(peers, lost, False)
        wait_until(lambda: not bench.node._find_missing())


def test_taut_is_not_rest_after_a_loss_though_the_clock_stands(bench, servo, peers):
    start(bench, servo, slack_after_s=0.2)
    bench.stop_clock()
    for lost in ('heartbeat', 'sensor'):
        pull_taut(bench, peers)
        fall_silent(peers, lost)
        wait_until(lambda: is_slack(servo))
        peers.tension_n = 0.0
        fall_silent(peers, lost, False)
        wait_until(lambda: not bench.node._find_missing())


def test_slackening_ends_a_running_pull_instead_of_being_refused(bench, servo, peers):
    start(bench, servo)
    tightening = pull(bench, 0.02, 0.002)
    wait_until(lambda: servo.position > SLACK + 60)
    slow = pull(bench, 0.0, 0.001)
    assert bench.result(tightening)[0] == 'aborted'
    rest = servo.position
    wait_until(lambda: servo.position < rest)  # the slow pull has begun
    assert bench.call('/tendon_actuator/release').success
    bench.aborts(slow, 'released')
    wait_until(lambda: is_slack(servo))


def test_a_goal_that_is_sent_while_the_tendon_slackens_is_judged_by_where_it_is(
    bench, servo, peers
):
    start(bench, servo)
    pull_taut(bench, peers)
    peers.samples = False
    wait_until(lambda: bench.node._client.safety.alarm)
    bench.node._client.request_release()
    wait_until(lambda: servo.position < TAUT - 50)
    lowest = servo.position
    bench.aborts(pull(bench, 0.0035), 'sample')  # below the last goal, above the position
    wait_until(lambda: is_slack(servo))
    assert servo.position <= lowest


def test_all_samples_that_wait_count_at_once(bench, servo):
    start(bench, servo)
    taken = []
    safety = bench.node._client.safety
    add_blocks = safety.add_blocks

    def note(blocks, *arguments):
        changes = add_blocks(blocks, *arguments)
        taken.append([block.tension_n[0] for block in blocks])
        return changes

    safety.add_blocks = note
    publisher = bench.peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
    wait_until(publisher.get_subscription_count)
    values = [0.001 * i for i in range(800)]
    values[400] = 20.0  # above the limit, in the middle
    with bench.node.lock:  # the node takes no samples during this block
        for number, value in enumerate(values):
            publisher.publish(StrainBlock(sequence=number, tension_n=[value]))
        assert publisher.wait_for_all_acked()
    wait_until(lambda: sum(map(len, taken)) == 800)
    assert len(taken) <= 2  # the last samples may not be in the queue yet
    assert taken[0][:700] == values[:700]
    assert safety.tension.latest_n == values[-1]


def test_old_samples_are_no_live_ones(bench, servo, peers):
    start(bench, servo, slack_after_s=0.2)
    pull_taut(bench, peers)
    peers.delay_s = 1.0
    wait_until(lambda: is_slack(servo))
    bench.aborts(pull(bench, TAUT_M), 's late')
    peers.delay_s = 0.0
    peers.tension_n = 0.0
    wait_until(lambda: not bench.node._find_missing())
    pull_taut(bench, peers)


def test_a_step_of_the_clock_makes_no_sample_old(bench, servo, peers):
    # The timeouts must be shorter than the steps of the clock.
    start(bench, servo, guard_timeout_s=2.0, heartbeat_timeout_s=2.0)
    bench.node.now_ns = lambda: time.time_ns() + round(peers.step_s * 1e9)
    pull_taut(bench, peers)
    for step_s in (-3600.0, 3600.0):
        peers.step_s = step_s
        published = peers.published
        wait_until(lambda published=published: peers.published > published + 100)
        assert bench.node._client.safety.alarm is None
    assert bench.result(pull(bench, TAUT_M + 0.001))[0] == 'succeeded'


def test_a_goal_right_after_the_start_waits_for_peers(bench, servo):
    start(bench, servo, peer_wait_s=20.0)
    readiness = []
    bench.peer.create_subscription(Readiness, '/tendon_actuator/ready', readiness.append, LATEST)
    wait_until(lambda: readiness)
    assert not readiness[0].ready
    assert 'heart' in readiness[0].missing[0]
    handle = pull(bench, 0.002)
    with Peers(bench):
        assert bench.result(handle)[0] == 'succeeded'
        wait_until(lambda: readiness[-1].ready)


def test_a_driver_whose_cable_is_plugged_in_again_is_ready_by_itself(bench, servo, peers):
    start(bench, servo)
    pull_taut(bench, peers)
    servo.unplug()
    wait_until(lambda: servo.port in ' '.join(bench.node._find_missing()))
    answer = bench.call('/tendon_actuator/release')
    assert (answer.success, servo.port in answer.message) == (False, True), answer.message
    servo.plug_in()
    wait_until(lambda: is_slack(servo))  # slackening was requested during the outage
    peers.tension_n = 0.0
    wait_until(lambda: not bench.node._find_missing())
    pull_taut(bench, peers)
    assert bench.call('/tendon_actuator/release').success
    wait_until(lambda: is_slack(servo))


def test_tension_at_the_zero_asks_for_homing_and_slackening_goes_by_the_sensor(
    bench, servo, peers
):
    # A tendon that stays taut without torque, because friction of the gear holds a tension of 2 N.
    peers.tension_n = 2.0
    start(bench, servo)
    wait_until(lambda: bench.node._client.safety.zero is Zero.UNKNOWN)
    bench.aborts(pull(bench, 0.002), 'zero')
    handle = pull(bench, 0.0, 0.005)
    wait_until(lambda: servo.position < SLACK - 130)
    peers.tension_n = 0.0
    assert bench.result(handle)[0] == 'succeeded'
    wait_until(lambda: servo.goal == servo.position)
    rest = servo.position
    assert SLACK - 400 < rest < SLACK - 130
    bench.aborts(pull(bench, 0.002), 'zero')
    peers.tension_n = 2.0
    wait_until(lambda: bench.node._client.safety.tension.latest_n == 2.0)
    assert bench.call('/tendon_actuator/release').success
    wait_until(lambda: servo.position < rest - 65)
    peers.tension_n = 0.0
    wait_until(lambda: servo.goal == servo.position)
    assert rest - 400 < servo.position < rest - 65


class Other:
    """Another node that publishes samples. `Peers` can use it in place of a `Bench`."""

    def __init__(self, context):
        self.peer = Node('other_sensor', context=context)


def test_two_publishers_let_a_taut_tendon_out_and_are_named(bench, servo, peers, context):
    start(bench, servo, slack_after_s=0.2)
    pull_taut(bench, peers)
    other = Other(context)
    try:
        with Peers(other) as second:
            second.beats = False
            wait_until(lambda: is_slack(servo))
            peers.tension_n = 0.0
            wait_until(lambda: '(/other_sensor, /peer)' in ' '.join(bench.node._find_missing()))
            bench.aborts(pull(bench, TAUT_M), 'tendon_sensor/strain')
    finally:
        other.peer.destroy_node()
    wait_until(lambda: not bench.node._find_missing(), timeout_s=20.0)
    pull_taut(bench, peers)


def test_a_sensor_driver_that_starts_again_is_believed_after_a_still_reading(bench, servo, peers):
    start(bench, servo, slack_after_s=0.2)
    pull_taut(bench, peers)
    peers.published = 0
    wait_until(lambda: is_slack(servo))
    peers.tension_n = -1.9  # the restarted sensor has no tare
    wait_until(lambda: bench.node._client.safety.tension.latest_n == -1.9)
    bench.aborts(pull(bench, TAUT_M), '-1.90 N')
    peers.tension_n = 0.0
    wait_until(lambda: not bench.node._find_missing())
    pull_taut(bench, peers)


def test_a_saturated_sensor_that_is_stuck_slackens_and_stop_does_not_hold(bench, servo, peers):
    start(bench, servo)  # a loss would hold the tendon for 30 s
    pull_taut(bench, peers)
    peers.status = StrainBlock.STATUS_SATURATED | StrainBlock.STATUS_STUCK
    wait_until(lambda: bench.node._client.safety.alarm)
    assert bench.call('/tendon_actuator/stop').success
    wait_until(lambda: is_slack(servo))
