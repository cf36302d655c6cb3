# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import threading
import time

from background import begin_pull
import pytest
from samples import feed
from scripted_servo import compute_crc

from linear_guide_driver import (
    DeviceConnectionError,
    DeviceRefusedError,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
    TendonActuatorClient,
)
from linear_guide_driver.dynamixel import registers, servo_monitor, tendon_client
from linear_guide_driver.dynamixel import servo as tendon_servo
from linear_guide_driver.dynamixel.bus import DynamixelBus, SilentServoError
from linear_guide_driver.safety import State, Zero
from tactile_testing.waiting import wait_until


def test_the_peers_checksum_is_the_documented_one():
    # Example packet of the e-Manual: ping of ID 1.
    assert compute_crc(bytes.fromhex('FFFFFD00010300 01'.replace(' ', ''))) == 0x4E19


def test_connect_sets_the_servo_up_in_a_safe_order(tendon, servo):
    assert tendon.identification == 'Dynamixel XM430-W350 firmware 45'
    order = [address for address, _ in servo.writes]
    assert order == [11, 20, 220, 102, 108, 112, 116, 98, 64]
    assert dict(servo.writes) == {
        98: 20,
        11: 5,
        20: -2048,
        102: 112,
        108: 0,
        112: 167,
        116: 0,
        64: 1,
        220: registers.OUR_MARK,
    }
    assert tendon.state.displacement_m == 0.0
    assert tendon.state.voltage_v == pytest.approx(12.1)


def test_a_missed_goal_is_not_repeated_once_safety_orders_another(tendon, servo):
    def lose(address):
        if address != 116:
            return False
        servo.lose = lambda address: False
        feed(tendon.safety, [16.0], time.monotonic_ns())
        servo._answer(0)  # a late answer to the previous write
        return True

    servo.lose = lose
    with pytest.raises(MotionFailedError, match=' N'):
        tendon.pull_to(0.005)
    wait_until(lambda: servo.writes.count((116, 0)) == 2)  # once at the start, and once to slacken
    assert {value for address, value in servo.writes if address == 116} == {0}


@pytest.fixture
def bus(config):
    bus = DynamixelBus(config.port, config.baud, config.device_id)
    yield bus
    bus.close()


def test_a_lost_answer_is_asked_for_again_and_a_third_one_is_silence(bus, servo):
    servo.lost_answers = 2
    assert bus.ping() == 1020
    servo.lost_answers = 2
    bus.write(registers.GOAL_CURRENT, 7)
    assert servo.writes == [(102, 7)] * 3
    servo.lost_answers = 3
    with pytest.raises(SilentServoError, match='register 64'):
        bus.read(registers.TORQUE_ENABLE)
    servo.lost_answers = 1
    with pytest.raises(SilentServoError):
        bus.read_block(registers.STATE_BLOCK)


def test_a_late_answer_is_not_taken_for_the_next_one(bus, servo):
    servo.late_s = 0.1
    with pytest.raises(SilentServoError):
        bus.read_block(registers.VELOCITY_LIMIT)
    # Both answers have four bytes, and the late one arrives before the second request is sent.
    wait_until(lambda: bus._port.ser.in_waiting)
    assert bus.read(registers.PRESENT_POSITION) == 2048


def test_pull_and_release(tendon, servo):
    states = []
    state = tendon.pull_to(0.01, 0.04, states.append)
    assert state.displacement_m == pytest.approx(0.01, abs=0.0005)
    assert servo.goal == 2048 + 652  # 0.01 m / (2 pi 0.01 m) * 4096 = 651.9
    assert servo.get(112) == 167  # 0.04 m/s / (2 pi 0.01 m) * 60 / 0.229 rpm = 166.8
    assert 0.02 < max(s.velocity_m_s for s in states) < 0.06
    assert tendon.pull_to(0.0).displacement_m == pytest.approx(0.0, abs=0.0005)


def test_a_reversed_tendon_tightens_as_counts_fall(connect, servo):
    tendon = connect(reverse=True)
    states = []
    assert tendon.pull_to(0.005, 0.0, states.append).displacement_m > 0.0045
    assert servo.goal == 2048 - 326
    assert max(s.velocity_m_s for s in states) > 0


def test_a_servo_that_was_wound_below_zero_is_read_signed(connect, servo):
    servo.put(132, 4, -100)
    connect().pull_to(0.001)
    assert servo.goal == -100 + 65


def test_a_bad_command_moves_nothing(tendon, servo):
    count = len(servo.writes)
    for displacement_m, speed_m_s, text in (
        (-0.001, 0.01, 'max_displacement_m'),
        (0.0201, 0.01, 'max_displacement_m'),
        (float('nan'), 0.01, 'max_displacement_m'),
        (0.01, 0.05, '0.0480'),
        (0.01, -0.01, 'peed'),
        (0.01, float('nan'), 'peed'),
    ):
        with pytest.raises(MotionRefusedError, match=text):
            tendon.pull_to(displacement_m, speed_m_s)
    assert len(servo.writes) == count


def test_an_answer_to_a_driver_that_was_killed_is_not_taken_for_the_model(connect, servo):
    servo.owed = b'\x01\x00\x00\x00'
    connect()
    assert servo.owed == b''


@pytest.mark.parametrize(
    ('address', 'size', 'value', 'text'),
    [
        (0, 2, 1200, '1200'),
        (6, 1, 37, r'firmware 37\b'),
        (68, 1, 1, ''),
        (38, 2, 50, r'0\.1[0-9]+ A'),
        (44, 4, 10, 'm/s'),
    ],
)
def test_an_unfit_servo_is_refused_and_left_without_torque(
    config, servo, address, size, value, text
):
    servo.put(address, size, value)
    with pytest.raises(DeviceRefusedError, match=text):
        TendonActuatorClient(config).connect()
    assert servo.table[64] == 0


def test_a_servo_that_has_shut_down_is_restarted_and_refused_when_that_does_not_help(
    connect, servo
):
    servo.shut_down(0x24)
    tendon = connect()
    assert servo.table[64] == 1
    tendon.close()
    servo.lasting_error = 0x04
    servo.shut_down(0x24)
    with pytest.raises(DeviceRefusedError, match='overheating'):
        tendon.connect()
    assert servo.table[64] == 0


@pytest.mark.parametrize(
    ('registers_', 'words'),
    [
        ({0: 1120, 64: 1, 98: 255}, r'1120.* XM430'),
        ({6: 37, 64: 1}, r'firmware 37\b'),
        ({68: 1, 64: 1}, ''),
        ({64: 1}, ''),
        ({64: 1, 11: 5, 102: 1193, 112: 50}, ''),
        ({64: 1, 11: 5, 102: 1193, 112: 50, 98: 255}, ''),
        ({64: 1, 11: 5, 102: 56, 112: 50, 98: 0}, ''),
        ({64: 1, 11: 5, 60: 1}, 'Startup Configuration'),
    ],
)
def test_nothing_is_written_to_a_servo_that_is_not_known_to_be_the_tendons(
    connect, servo, registers_, words
):
    sizes = {0: 2, 102: 2, 112: 4}
    for address, value in registers_.items():
        servo.put(address, sizes.get(address, 1), value)
    with pytest.raises(DeviceRefusedError, match=words):
        connect()
    assert servo.writes == []
    assert servo.table[64] == 1


def test_a_servo_with_limits_below_the_configuration_is_refused_and_left_slack(connect, servo):
    servo.leave_as_a_driver(2048, 2048 + 65)
    servo.put(44, 4, 100)
    with pytest.raises(DeviceRefusedError):
        connect()
    assert servo.table[64] == 0


def test_a_servo_whose_driver_was_killed_before_it_armed_the_watchdog_is_taken_over(
    connect, servo
):
    servo.leave_as_a_driver(2048, 2048 + 261)
    servo.put(98, 1, 0)
    servo.put(220, 4, registers.OUR_MARK)
    tendon = connect()
    wait_until(lambda: abs(servo.position - 2048) <= 33)
    assert servo.table[98] == 20
    tendon.close()
    assert servo.get(220) == registers.NO_MARK


def test_a_tendon_held_where_its_zero_cannot_be_must_be_homed(connect, servo):
    servo.leave_as_a_driver(2048, 2048 - 1000)
    tendon = connect()
    assert (64, 0) in servo.writes
    assert servo.table[64] == 1
    with pytest.raises(MotionRefusedError, match='zero'):
        tendon.pull_to(0.001)


def test_no_release_tightens(connect, servo):
    servo.leave_as_a_driver(0, 2048)  # tightened by more than any pull, so the zero is unknown
    tendon = connect(max_displacement_m=0.002)
    below = 2048 - 652  # 10 mm below the zero, as after failed homings
    servo.turn_to(below)
    servo.put(116, 4, servo.get(132))
    wait_until(lambda: tendon.state.displacement_m < -0.009)
    assert tendon.pull_to(0.0).displacement_m < -0.009
    tendon.request_release()
    feed(tendon.safety, [5.0], time.monotonic_ns())
    wait_until(lambda: tendon.safety.state is State.RELEASING)
    tendon.supervise()
    tendon.close()
    written = [value for address, value in servo.writes if address == 116]
    assert max(written) <= 0
    assert written[-1] == -652
    assert servo.position == below


def test_slack_is_read_when_the_tendon_has_unwound_though_the_torque_was_off(connect, servo):
    # As if a driver had just been closed: the finger springs back and still turns the servo.
    servo.put(132, 4, 2448)
    began_s = time.monotonic()
    servo.lose = lambda _: servo.turn_to(
        max(2048, 2448 - int(1000 * (time.monotonic() - began_s)))
    )
    connect()
    assert abs(servo.goal - 2048) <= 2


def test_lost_packets_lose_no_stop(tendon, servo):
    pull = begin_pull(tendon, servo)
    left = {'read': 2, 'goal': 2}

    def lose(address):
        kind = 'goal' if address == 116 else 'read'
        left[kind] -= 1
        return left[kind] >= 0

    servo.lose = lose
    tendon.hold_here()
    pull.ends_by(MotionStoppedError)
    wait_until(lambda: servo.position == servo.goal)
    assert servo.position < 2500


@pytest.mark.parametrize(('reverse', 'count'), [(False, 1), (True, 2)])
def test_no_hold_tightens_while_its_packets_are_lost(connect, servo, reverse, count):
    tendon = connect(reverse=reverse)
    tendon.pull_to(0.01)
    lost, out = [], 100 if reverse else -100

    def lose(address):
        if address != 116 or len(lost) == count:
            return False
        lost.append(servo.position)
        servo.turn_to(servo.position + out)  # the servo is slackening the tendon
        servo.put(116, 4, servo.get(132))
        return True

    servo.lose = lose
    tendon.hold_here()
    assert servo.goal == servo.position == lost[-1] + out


# Number of times that the pull calls ``should_stop`` before it returns True.
@pytest.mark.parametrize('looks', [0, 1])
def test_a_stop_before_the_goal_is_written_moves_nothing(tendon, servo, looks):
    count = len(servo.writes)
    answers = iter([False] * looks)
    with pytest.raises(MotionStoppedError, match='began'):
        tendon.pull_to(0.01, should_stop=lambda: next(answers, True))
    assert len(servo.writes) == count


def test_a_pull_whose_watcher_fails_is_held_and_a_failing_consumer_ends_nothing(connect, servo):
    def fail(state):
        if state.displacement_m > 0.001:
            raise ZeroDivisionError

    tendon = connect(fail)
    with pytest.raises(ZeroDivisionError):
        tendon.pull_to(0.02, 0.01, fail)
    wait_until(lambda: servo.position == servo.goal)
    assert servo.position < 2500
    assert tendon.pull_to(0.008).displacement_m == pytest.approx(0.008, abs=0.0005)


def test_missing_port_wrong_baud_and_absent_servo_are_told_apart(config, monkeypatch):
    monkeypatch.setattr(tendon_servo, 'CONNECT_S', 0.0)
    for change, text in (
        ({'port': '/dev/does-not-exist'}, 'cannot open'),
        ({'baud': 1_250_000}, '1250000 baud'),
        ({'device_id': 9}, 'no answer from servo 9'),
    ):
        with pytest.raises(DeviceConnectionError, match=text):
            TendonActuatorClient(dataclasses.replace(config, **change)).connect()


def test_a_pull_that_is_told_to_stop_by_a_release_does_not_hold_the_tendon_first(
    tendon, servo, monkeypatch
):
    monkeypatch.setattr(tendon_client, 'POLL_WAIT_S', 0.1)
    told, asked = threading.Event(), threading.Event()

    def should_stop():
        if told.is_set():
            asked.set()
        return told.is_set()

    def end_pull():
        told.set()
        assert asked.wait(5.0)  # the pull must stop, but the release is not written yet

    pull = begin_pull(tendon, servo, lambda _: None, should_stop)
    tendon.request_release(end_pull)
    pull.ends_by(MotionStoppedError, 'released')
    wait_until(lambda: servo.position == servo.goal == 2048)


def test_a_pull_against_the_current_limit_is_given_up_and_released(tendon, servo, monkeypatch):
    monkeypatch.setattr(tendon_client, 'SLACK_S', 0.2)
    servo.stuck_at = 2200
    with pytest.raises(MotionFailedError, match=r'0\.3 A'):
        tendon.pull_to(0.02, 0.04)
    wait_until(lambda: servo.position == 2048)


def test_one_pull_at_a_time_and_close_slackens_the_tendon_before_the_torque_goes_off(
    tendon, servo
):
    pull = begin_pull(tendon, servo)
    with pytest.raises(MotionRefusedError, match='busy'):
        tendon.pull_to(0.01)
    tendon.close()
    pull.ends_by(MotionStoppedError)
    assert servo.table[64] == 0
    assert abs(servo.position - 2048) <= 33
    with pytest.raises(MotionRefusedError, match='not connected'):
        tendon.pull_to(0.0)


def test_no_pull_runs_at_the_speed_of_another(tendon, servo, monkeypatch):
    # a busy computer delays the answers of the servo
    monkeypatch.setattr(servo_monitor, 'FAILED_POLLS', 50)
    tendon.pull_to(0.002)
    tendon.request_release()  # at the highest speed of the servo
    wait_until(lambda: servo.position == 2048)
    lost, speeds = [], []

    def lose(address):
        if address not in (112, 116) or lost:
            return False
        lost.append(address)
        servo._answer(0)  # a late answer to an earlier write
        return True

    servo.lose = lose
    tendon.pull_to(0.004, 0.004, lambda state: speeds.append(state.velocity_m_s))
    assert lost
    assert 0.0035 < max(speeds) < 0.0045


def test_a_current_limit_whose_packet_is_lost_is_in_force_before_the_torque_is(connect, servo):
    def lose(address):
        if address != 102:
            return False
        servo.lose = lambda address: False
        servo._answer(0)  # a late answer to an earlier write
        return True

    servo.lose = lose
    servo.put(102, 2, 1193)
    servo.put(11, 1, 5)
    tendon = connect()
    order = [address for address, _ in servo.writes]
    assert order.index(102) < order.index(64)
    assert servo.get(102, 2) == 112
    servo.put(102, 2, 1193)
    wait_until(lambda: servo.get(102, 2) == 112)
    tendon.pull_to(0.002)


def test_a_pull_has_the_current_limit_of_its_contact(connect, servo):
    tendon = connect(flexion_current_a=0.15, abduction_current_a=0.05)
    for contact, current in (('flexion', 56), ('abduction', 19)):
        tendon.pull_to(0.002, contact=contact)
        assert servo.get(102, 2) == current
        tendon.pull_to(0.0)
        assert servo.get(102, 2) == 112


def test_nothing_tightens_before_the_current_limit_is_confirmed(tendon, servo):
    count, lost = len(servo.writes), []

    def lose(address):
        if address == 116 and not lost:
            # as if the packet of the goal was lost and the servo has another limit
            servo.put(102, 2, 1193)
            lost.append(address)
            return True
        return False

    servo.lose = lose
    tendon.pull_to(0.002)
    order = [address for address, _ in servo.writes[count:]]
    assert order[:2] == [102, 108]
    assert servo.get(102, 2) == 112


def test_a_restarted_driver_keeps_the_zero_and_slackens_the_tendon(tendon, connect, servo):
    tendon.pull_to(0.004)
    tendon._monitor.close()  # as if the driver was killed: it sends nothing more
    tendon._servo.bus.close()
    assert servo.position == pytest.approx(2048 + 261, abs=2)
    client = connect(unguarded=False)
    wait_until(lambda: abs(servo.position - 2048) <= 33)
    wait_until(lambda: client.state.displacement_m == pytest.approx(0.0, abs=0.0006))
    feed(client.safety, [0.0], 2**62)
    wait_until(lambda: client.safety.zero is Zero.KNOWN)


def test_a_slack_tendon_at_rest_is_polled_slowly_and_a_pull_wakes_the_poll(
    connect, servo, monkeypatch
):
    monkeypatch.setattr(servo_monitor, 'REST_AFTER_S', 0.1)
    # With these values, the period of polls at rest is longer than this test.
    monkeypatch.setattr(servo_monitor, 'REST_POLLS', 1e-3)
    monkeypatch.setattr(servo_monitor, 'REST_CYCLE_S', 1e3)
    monitor = (tendon := connect())._monitor
    wait_until(lambda: tendon.is_at_rest and monitor.period_s > 100.0)
    polls = [monitor.wait_poll(0.2) for _ in range(2)]
    assert polls[1] is None  # the first poll may have been running already
    tendon.pull_to(0.004)
    held = servo.packets
    wait_until(lambda: servo.packets > held + 30)  # a held tendon is polled at the full rate
    assert not tendon.is_at_rest
    assert monitor.period_s == pytest.approx(1 / 60)
    tendon.pull_to(0.0)
    wait_until(lambda: monitor.period_s > 100.0)


def test_the_rate_at_rest_feeds_the_watchdog_and_a_failed_poll_ends_the_rest(
    connect, servo, monkeypatch
):
    monkeypatch.setattr(servo_monitor, 'REST_AFTER_S', 0.1)
    tendon = connect(watchdog_s=0.12)
    wait_until(lambda: tendon.is_at_rest)
    assert tendon._monitor.period_s == pytest.approx(0.12 / 4)
    servo.lost_answers = 1
    wait_until(lambda: not tendon.is_at_rest)
    wait_until(lambda: tendon.is_at_rest)
    servo.is_silent = True
    wait_until(lambda: 'silent' in str(tendon.trouble))
    servo.is_silent = False
    wait_until(lambda: not tendon.trouble)
