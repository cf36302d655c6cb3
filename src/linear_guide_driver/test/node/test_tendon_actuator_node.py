# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0


import pytest
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from topic_peers import Peers

from linear_guide_driver import tendon_actuator_node
from linear_guide_driver.config import REST_CYCLE_S
from linear_guide_driver.dynamixel import servo_monitor
from linear_guide_driver.motion_node import FEEDBACK_PERIOD_S
from linear_guide_driver.safety import Zero
from linear_guide_driver.tendon_actuator_node import TendonActuatorNode
from tactile_msgs.action import HomeTendon, PullTendon
from tactile_msgs.msg import StrainBlock, TendonSlack
from tactile_ros.health import ERROR, OK, WARN
from tactile_ros.polling import POLL_S
from tactile_ros.qos import LATEST
from tactile_testing.waiting import wait_until


def start(bench, servo, **parameters):
    parameters = {'watchdog_s': 1.0, 'slack_after_s': 30.0, 'peer_wait_s': 0.0, **parameters}
    bench.start(TendonActuatorNode, port=servo.port, **parameters)


@pytest.fixture
def tendon(bench, servo):
    start(bench, servo, unguarded=True)
    return bench


@pytest.fixture
def sensor(tendon, servo, peers):
    # Stiffness of 1 N per millimetre of tendon; 10 mm are 651.9 counts.
    peers.tension_n = lambda: (servo.position - 2048) / 65.19
    # Before a test sets a tension, the sensor must have confirmed the zero by a slack reading.
    wait_until(lambda: tendon.node._client.safety.zero is Zero.KNOWN)
    return peers


def pull(bench, displacement_m, speed_m_s=0.02, contact='flexion', **fields):
    fields |= {'displacement_m': displacement_m, 'speed_m_s': speed_m_s, 'contact': contact}
    return bench.send(PullTendon, '/tendon_actuator/pull', **fields)


def test_pull_and_release_succeed_with_feedback_joint_states_and_diagnostics(
    tendon, servo, diagnostics
):
    joints = []
    tendon.peer.create_subscription(JointState, '/tendon_actuator/joint_states', joints.append, 10)
    status, result = tendon.result(pull(tendon, 0.008))
    assert (status, result.stopped_by_tension) == ('succeeded', False)
    assert result.displacement_m == pytest.approx(0.008, abs=0.0005)
    assert result.duration_s > 0.3
    assert 1 <= len(tendon.feedback) <= result.duration_s / FEEDBACK_PERIOD_S + 2
    wait_until(lambda: joints and joints[-1].position[0] == pytest.approx(0.008, abs=0.0005))
    assert joints[-1].name == ['tendon_joint']
    assert joints[-1].header.frame_id == 'tendon_link'
    assert len(joints[-1].effort) == 0
    wait_until(lambda: diagnostics)
    assert diagnostics[-1].hardware_id == 'Dynamixel XM430-W350 firmware 45'
    assert diagnostics[-1].level == WARN  # the tension limit is not guarded
    assert tendon.result(pull(tendon, 0.0, 0.04))[0] == 'succeeded'
    wait_until(lambda: servo.position == 2048)


def test_joint_states_come_seldom_at_rest_and_with_each_poll_in_a_hold(tendon, servo, monkeypatch):
    monkeypatch.setattr(servo_monitor, 'REST_AFTER_S', 0.1)
    monkeypatch.setattr(tendon_actuator_node, 'REST_REPORT_S', 1e3)
    joints = []
    tendon.peer.create_subscription(JointState, '/tendon_actuator/joint_states', joints.append, 10)
    wait_until(lambda: joints)
    wait_until(lambda: tendon.node._client.is_at_rest)
    polls = servo.packets
    wait_until(lambda: servo.packets > polls + 3)
    at_rest = len(joints)
    wait_until(lambda: servo.packets > polls + 9)
    assert len(joints) == at_rest
    assert tendon.result(pull(tendon, 0.004))[0] == 'succeeded'
    held = len(joints)
    wait_until(lambda: len(joints) > held + 30)


def test_samples_are_polled_slowly_at_rest_and_a_pull_restores_the_rate(
    tendon, servo, sensor, monkeypatch
):
    monkeypatch.setattr(servo_monitor, 'REST_AFTER_S', 0.1)
    node, reports = tendon.node, []
    tendon.peer.create_subscription(TendonSlack, '/tendon_actuator/slack', reports.append, LATEST)
    wait_until(lambda: reports and reports[-1].at_rest)
    wait_until(lambda: node.poll_s == REST_CYCLE_S)
    assert node._poller._calls[0].period_s == REST_CYCLE_S
    before = len(reports)
    assert tendon.result(pull(tendon, 0.004))[0] == 'succeeded'
    assert node.poll_s == POLL_S
    first = reports[before:][next(i for i, r in enumerate(reports[before:]) if not r.at_rest)]
    assert first.displacement_m < 0.001  # reported before the tendon has moved
    assert not any(report.at_rest for report in reports[-2:])
    assert tendon.result(pull(tendon, 0.0, 0.04))[0] == 'succeeded'
    wait_until(lambda: reports[-1].at_rest and reports[-1].state == TendonSlack.SLACK)


def test_a_stop_tension_ends_the_pull_as_a_success(tendon, servo, sensor):
    status, result = tendon.result(pull(tendon, 0.02, 0.01, stop_tension_n=3.0))
    assert (status, result.stopped_by_tension) == ('succeeded', True)
    assert 0.003 <= result.displacement_m < 0.006
    assert ' 3.' in result.message
    wait_until(lambda: servo.goal == servo.position)


def test_the_limit_is_guarded_while_holding_and_a_release_that_fails_is_tried_again(
    tendon, servo, sensor
):
    assert tendon.result(pull(tendon, 0.005, 0.04))[0] == 'succeeded'
    lost = []

    def lose(address):  # loses more packets than one command sends
        if address == 116 and len(lost) < 4:
            lost.append(address)
            return True
        return False

    servo.lose = lose
    sensor.tension_n = 16.0
    wait_until(
        lambda: servo.position == 2048,
        lambda: f'at {servo.position}, {len(lost)} lost: {tendon.node._health().message}',
    )
    assert len(lost) == 4


def test_a_lost_goal_that_seems_to_be_answered_is_written_again(tendon, servo, sensor):
    lost, to_lose = [], 1

    def lose(address):
        if address == 116 and len(lost) < to_lose:
            lost.append(address)
            servo._answer(0)  # a late answer to the previous write
            return True
        return False

    servo.lose = lose
    assert tendon.result(pull(tendon, 0.005, 0.04))[0] == 'succeeded'
    assert len(lost) == 1
    to_lose = 2
    sensor.tension_n = 16.0
    wait_until(lambda: servo.position == 2048)
    assert len(lost) == 2


def test_the_health_tells_of_a_dead_sensor_and_a_hot_servo(tendon, servo, sensor):
    def wait_for_health(level, named=''):
        wait_until(
            lambda: (health := tendon.node._health()).level == level and named in health.message
        )

    wait_for_health(OK)
    sensor.status = StrainBlock.STATUS_STUCK
    wait_for_health(WARN, 'sample')
    servo.put(146, 1, 71)
    wait_for_health(WARN, '80 C')


def test_a_second_life_works_like_the_first(tendon, servo):
    for _ in range(2):
        assert tendon.result(pull(tendon, 0.005, 0.04))[0] == 'succeeded'
        node = tendon.node
        for transition in ('deactivate', 'cleanup', 'configure', 'activate'):
            assert getattr(node, f'trigger_{transition}')().name == 'SUCCESS', transition
        assert len(node.goal_runners) == 2
        assert len(node._managed_entities) == 1


def test_a_stop_holds_the_tendon_where_it_is_and_ends_the_goal(tendon, servo):
    for way, end, named in (('cancel', 'canceled', ''), ('stop', 'aborted', '/tendon_actuator')):
        handle = pull(tendon, 0.02, 0.01)
        before = servo.position
        wait_until(lambda before=before: servo.position > before + 50)
        if way == 'cancel':
            tendon.ask(handle.cancel_goal_async)
        else:
            assert tendon.call('/tendon_actuator/stop').success
        status, result = tendon.result(handle)
        assert (status, named in result.message) == (end, True), result.message
        wait_until(lambda: servo.goal == servo.position)
        assert servo.position < 3300


def test_bad_goals_are_aborted_with_a_sentence(tendon, servo):
    for fields, named in (
        ({'displacement_m': 0.03}, 'max_displacement_m'),
        ({'displacement_m': 0.01, 'contact': 'sideways'}, 'flexion, abduction'),
        ({'displacement_m': 0.01, 'stop_tension_n': 5.0}, 'unguarded'),
    ):
        tendon.aborts(pull(tendon, **fields), named)
    assert servo.position == 2048


def test_configure_fails_cleanly_without_a_port(bench, servo):
    bench.node = bench.make(TendonActuatorNode, port='/dev/does-not-exist')
    assert not bench.node.bring_up()
    bench.node.set_parameters([type(bench.node.get_parameter('port'))('port', value=servo.port)])
    assert bench.node.bring_up()
    bench.node.take_down()
    bench.node = None
    assert servo.table[64] == 0


def home(bench, taut_tension_n=0.0):
    return bench.send(HomeTendon, '/tendon_actuator/home', taut_tension_n=taut_tension_n)


def test_homing_finds_where_the_tendon_is_taut_and_counts_from_there(tendon, servo, sensor):
    for taut_at in (2048 + 65, 2048 - 65):  # the zero is 1 mm too early, then 1 mm too late
        sensor.tension_n = lambda taut_at=taut_at: max(0.0, (servo.position - taut_at) / 65.19)
        present_n = sensor.tension_n()
        wait_until(lambda n=present_n: tendon.node._client.safety.tension.latest_n == n)
        status, result = tendon.result(home(tendon))
        assert status == 'succeeded', result.message
        taut_m = (taut_at - 2048) / 65.19e3 + 0.0002
        zero_m = -servo.get(20) / 65.19e3 - 2048 / 65.19e3
        assert zero_m == pytest.approx(taut_m, abs=0.0002)
        assert tendon.result(pull(tendon, 0.005, 0.04))[0] == 'succeeded'
        assert servo.goal == pytest.approx(-servo.get(20) + 326, abs=1)
        assert tendon.result(pull(tendon, 0.0, 0.04))[0] == 'succeeded'
    assert len(tendon.feedback) > 4


def test_homing_is_refused_or_fails_with_a_sentence(tendon, servo):
    tendon.aborts(home(tendon), 'sensor')
    with Peers(tendon):
        wait_until(lambda: tendon.node._client.safety.tension.latest_n is not None)
        for taut_n in (4.0, -1.0):
            tendon.aborts(home(tendon, taut_n), f'{taut_n} N')
        handle = home(tendon)
        wait_until(lambda: servo.position > 2060)
    tendon.aborts(handle, 'sample')
    wait_until(lambda: servo.goal == servo.position)


def test_without_sensor_and_heartbeats_nothing_tightens(bench, servo):
    start(bench, servo, heartbeat_topics=['heart'], heartbeat_timeout_s=0.5, guard_timeout_s=0.5)
    bench.aborts(pull(bench, 0.01), 'heart')
    with Peers(bench) as peers:
        peers.samples = False
        wait_until(lambda: 'unguarded' in ' '.join(bench.node._find_missing()))
        bench.aborts(pull(bench, 0.01), 'unguarded')
        assert servo.position == 2048
        peers.samples = True
        wait_until(lambda: not bench.node._find_missing())
        handle = pull(bench, 0.02, 0.002)
        wait_until(lambda: servo.position > 2060)
    assert bench.result(handle)[0] == 'aborted'
    wait_until(lambda: servo.goal == servo.position)
    assert servo.position < 2048 + 1304
    bench.aborts(pull(bench, 0.02), 'heart')


def test_a_line_that_is_lost_while_holding_is_told_at_once(tendon, servo, sensor, diagnostics):
    beats = []
    tendon.peer.create_subscription(
        Empty, '/tendon_actuator/heartbeat', beats.append, qos_profile_sensor_data
    )
    wait_until(lambda: beats)
    assert tendon.result(pull(tendon, 0.002))[0] == 'succeeded'
    servo.close()
    wait_until(lambda: any(d.level == ERROR and servo.port in d.message for d in diagnostics))
    wait_until(lambda: tendon.node._client.trouble)
    tendon.call('/tendon_actuator/stop')  # earlier messages have arrived by now
    beats.clear()
    for _ in range(3):
        tendon.call('/tendon_actuator/stop')
    assert beats == []
