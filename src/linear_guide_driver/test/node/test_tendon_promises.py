# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""What docs/motion.md promises of the tendon, through the real node and real bytes."""

import signal
import subprocess
import sys
import threading

import pytest
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Empty

from linear_guide_driver import TendonActuatorClient, TendonActuatorConfig
from linear_guide_driver.safety.states import Zero
from linear_guide_driver.tendon_actuator_node import TendonActuatorNode
from tactile_msgs.action import PullTendon
from tactile_msgs.msg import Readiness, StrainBlock
from tactile_ros.qos import LATEST, STREAM
from waiting import wait_until

SLACK = 2048
"""Counts of the shaft at which the peer begins."""

SLOW = 40
"""A velocity limit at which 10 mm of tendon take a second [0.229 rpm]."""


class Peers:
    """Publishes strain and a heartbeat at 50 Hz until told otherwise."""

    def __init__(self, bench):
        self.tension_n = 0.0
        self.beats = self.samples = True
        self._strain = bench.peer.create_publisher(StrainBlock, 'tendon_sensor/strain', STREAM)
        self._heart = bench.peer.create_publisher(Empty, 'heart', qos_profile_sensor_data)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        while not self._end.wait(0.02):
            if self.samples:
                self._strain.publish(StrainBlock(tension_n=[self.tension_n]))
            if self.beats:
                self._heart.publish(Empty())

    def close(self):
        self._end.set()
        self._thread.join()


@pytest.fixture
def peers(bench):
    peers = Peers(bench)
    yield peers
    peers.close()


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
    status, result = bench.result(pull(bench, 0.01))
    assert status == 'succeeded', result.message
    peers.tension_n = 5.0


def is_slack(servo):
    return abs(servo.position - SLACK) <= 33  # 0.5 mm


@pytest.mark.parametrize('way', ['stop', 'heartbeat', 'cancel'])
def test_above_the_limit_nothing_turns_letting_out_into_holding(bench, servo, peers, way):
    start(bench, servo)
    pull_taut(bench, peers)
    handle = pull(bench, 0.011, 0.001) if way == 'cancel' else None
    before = servo.position
    peers.tension_n = 20.0
    wait_until(lambda: servo.position < before - 30)
    if way == 'stop':
        bench.call_stop('/tendon_actuator/stop')
    elif way == 'heartbeat':
        peers.beats = False
    else:
        bench.ask(handle.cancel_goal_async)
    wait_until(lambda: is_slack(servo))


def test_a_stop_above_the_limit_says_that_the_tendon_is_let_out(bench, servo, peers):
    start(bench, servo)
    pull_taut(bench, peers)
    before = servo.position
    peers.tension_n = 20.0
    wait_until(lambda: servo.position < before)
    assert 'above the limit' in bench.call_stop('/tendon_actuator/stop').message


@pytest.mark.parametrize('lost', ['heartbeat', 'sensor'])
def test_letting_out_is_accepted_whoever_is_silent(bench, servo, peers, lost):
    start(bench, servo)
    pull_taut(bench, peers)
    if lost == 'heartbeat':
        peers.beats = False
    else:
        peers.samples = False
    client = bench.node._client
    wait_until(lambda: client.safety.is_alarm)
    status, result = bench.result(pull(bench, 0.012))
    assert status == 'aborted'
    assert 'heart' in result.message or 'strain sample' in result.message
    assert bench.result(pull(bench, 0.0))[0] == 'succeeded'
    assert is_slack(servo)


@pytest.mark.parametrize('lost', ['heartbeat', 'sensor'])
def test_taut_is_not_rest_after_a_loss(bench, servo, peers, lost):
    start(bench, servo, slack_after_s=0.5)
    pull_taut(bench, peers)
    if lost == 'heartbeat':
        peers.beats = False
    else:
        peers.samples = False
    wait_until(lambda: is_slack(servo))


def test_letting_out_ends_a_running_pull_instead_of_being_refused(bench, servo, peers):
    start(bench, servo)
    winding = pull(bench, 0.02, 0.002)
    wait_until(lambda: servo.position > SLACK + 60)
    assert bench.result(pull(bench, 0.0))[0] == 'succeeded'
    status, result = bench.result(winding)
    assert status == 'aborted', result.message
    assert is_slack(servo)


def test_the_release_service_lets_out_whatever_runs(bench, servo, peers):
    start(bench, servo)
    winding = pull(bench, 0.02, 0.005)
    wait_until(lambda: servo.position > SLACK + 200)
    assert bench.call_stop('/tendon_actuator/release').success
    assert bench.result(winding)[0] == 'aborted'
    wait_until(lambda: is_slack(servo))


def test_the_release_service_goes_on_with_a_slow_letting_out(bench, servo, peers):
    start(bench, servo)
    pull_taut(bench, peers)
    slow = pull(bench, 0.0, 0.001)
    wait_until(lambda: servo.position < SLACK + 640)
    assert bench.call_stop('/tendon_actuator/release').success
    status, result = bench.result(slow)
    assert (status, 'released' in result.message) == ('aborted', True), result.message
    wait_until(lambda: is_slack(servo))


def test_letting_out_is_accepted_without_contact_and_at_any_speed(bench, servo, peers):
    start(bench, servo)
    for speed_m_s in (-1.0, 99.0):
        peers.tension_n = 0.0
        pull_taut(bench, peers)
        assert bench.result(pull(bench, 0.0, speed_m_s, contact=''))[0] == 'succeeded'
        assert is_slack(servo)


def test_a_goal_that_is_sent_while_the_tendon_unwinds_is_judged_by_where_it_is(
    bench, servo, peers
):
    start(bench, servo)
    pull_taut(bench, peers)
    peers.samples = False
    wait_until(lambda: bench.node._client.safety.is_alarm)
    bench.node._client.request_release()
    wait_until(lambda: servo.position < SLACK + 550)
    lowest = servo.position
    status, result = bench.result(pull(bench, 0.009))  # less than 10 mm, but more than now
    assert (status, 'strain sample' in result.message) == ('aborted', True), result.message
    wait_until(lambda: is_slack(servo))
    assert servo.position <= lowest


def test_a_paused_clock_does_not_stop_the_watch(bench, servo, peers):
    start(bench, servo, slack_after_s=0.5)
    clock = bench.peer.create_publisher(Clock, '/clock', 1)
    bench.node.set_parameters([Parameter('use_sim_time', value=True)])
    wait_until(lambda: clock.get_subscription_count() == 1)
    clock.publish(Clock())
    pull_taut(bench, peers)
    peers.beats = False
    wait_until(lambda: is_slack(servo))


def test_a_goal_right_after_the_start_waits_for_peers(bench, servo):
    start(bench, servo, peer_wait_s=20.0)
    readiness = []
    bench.peer.create_subscription(Readiness, '/tendon_actuator/ready', readiness.append, LATEST)
    wait_until(lambda: readiness)
    assert not readiness[0].ready
    assert 'heart' in readiness[0].missing[0]
    handle = pull(bench, 0.005)
    peers = Peers(bench)
    try:
        assert bench.result(handle)[0] == 'succeeded'
        wait_until(lambda: readiness[-1].ready)
    finally:
        peers.close()


def test_an_idle_trip_of_the_servos_watchdog_mends_itself(bench, servo, peers):
    start(bench, servo)
    wait_until(lambda: bench.node._client.safety.zero is Zero.KNOWN)
    servo.put(98, 1, 255)
    wait_until(lambda: servo.table[98] == 50)
    assert bench.node._client.recoveries == 1
    servo.put(98, 1, 0)  # a command that set it anew was cut off half way
    wait_until(lambda: servo.table[98] == 50)
    assert bench.result(pull(bench, 0.005))[0] == 'succeeded'


# -- a driver that dies ---------------------------------------------------------------------------

TAUT_AND_WAITING = """
import sys, time
from linear_guide_driver import TendonActuatorClient, TendonActuatorConfig
client = TendonActuatorClient(TendonActuatorConfig(port=sys.argv[1], unguarded=True))
client.connect()
client.pull_to(0.01)
print('taut', flush=True)
time.sleep(60)
"""


@pytest.fixture
def left_taut(servo):
    """A servo that holds 10 mm of tendon for a driver that was killed."""
    driver = subprocess.Popen(
        [sys.executable, '-c', TAUT_AND_WAITING, servo.port], stdout=subprocess.PIPE, text=True
    )
    assert driver.stdout.readline() == 'taut\n'
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    driver.stdout.close()
    assert servo.position == pytest.approx(SLACK + 652, abs=2)
    return servo


def test_a_restarted_driver_keeps_the_zero_and_lets_the_tendon_out(left_taut):
    client = TendonActuatorClient(TendonActuatorConfig(port=left_taut.port, watchdog_s=1.0))
    client.connect()
    try:
        wait_until(lambda: is_slack(left_taut))
        wait_until(lambda: client.state.displacement_m == pytest.approx(0.0, abs=0.0006))
        client.safety.add_samples([0.0], False, 2**62)
        wait_until(lambda: client.safety.zero is Zero.KNOWN)
    finally:
        client.close()


def test_tension_at_the_zero_asks_for_homing_and_letting_out_goes_by_the_sensor(
    bench, servo, peers
):
    # The gear has kept 2 N on the tendon with the torque off: 1 N a millimetre.
    peers.tension_n = 2.0
    start(bench, servo)
    wait_until(lambda: bench.node._client.safety.zero is Zero.UNKNOWN)
    status, result = bench.result(pull(bench, 0.005))
    assert (status, 'home the tendon' in result.message) == ('aborted', True)
    handle = pull(bench, 0.0, 0.005)
    wait_until(lambda: servo.position < SLACK - 130)
    peers.tension_n = 0.0
    assert bench.result(handle)[0] == 'succeeded'
    assert SLACK - 400 < servo.position < SLACK - 130
    status, result = bench.result(pull(bench, 0.005))
    assert (status, 'home the tendon' in result.message) == ('aborted', True)


def test_the_release_service_without_a_zero_ends_where_the_sensor_reads_slack(bench, servo, peers):
    peers.tension_n = 2.0
    start(bench, servo)
    wait_until(lambda: bench.node._client.safety.zero is Zero.UNKNOWN)
    assert bench.call_stop('/tendon_actuator/release').success
    wait_until(lambda: servo.position < SLACK - 130)
    peers.tension_n = 0.0
    wait_until(lambda: servo.goal == servo.position)
    assert SLACK - 400 < servo.position < SLACK - 130


def test_closing_lets_the_tendon_out_before_the_torque_goes_off(servo):
    client = TendonActuatorClient(
        TendonActuatorConfig(port=servo.port, unguarded=True, watchdog_s=1.0)
    )
    client.connect()
    client.pull_to(0.01)
    client.close()
    assert is_slack(servo)
    assert servo.table[64] == 0
