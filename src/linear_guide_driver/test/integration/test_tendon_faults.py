# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon's driver when servo, bus or the driver itself fail."""

from functools import partial
import time

from background import Background, begin_pull
import pytest
from samples import feed

from linear_guide_driver import LinearGuideDriverError, MotionFailedError, MotionRefusedError
from linear_guide_driver.dynamixel import registers
from linear_guide_driver.safety import Zero
from tactile_testing.waiting import wait_until

COUNT_M = 2 * 3.141592653589793 * 0.01 / 4096


def test_a_tripped_watchdog_ends_the_pull_and_the_goals_are_unlocked(tendon, servo):
    pull = begin_pull(tendon, servo)
    servo.put(98, 1, 255)
    pull.ends_by(MotionFailedError, 'watchdog has stopped it')
    stopped_at = servo.position
    wait_until(lambda: servo.table[98] == 20)
    assert (tendon.trouble, tendon.recoveries) == (None, 1)
    tendon.pull_to(COUNT_M * (stopped_at - 2048), 0.01)


def test_a_watchdog_that_trips_unseen_does_not_stop_a_fresh_command(tendon, servo):
    for recoveries, register in enumerate((112, 116), 1):
        tendon.pull_to(0.01)
        servo.trips_before = register  # the watchdog trips after the last poll
        tendon.pull_to(0.0)
        assert servo.trips_before is None
        assert (servo.position, servo.table[98]) == (2048, 20)
        assert (tendon.trouble, tendon.recoveries) == (None, recoveries)


def test_an_idle_trip_of_the_servos_watchdog_mends_itself(tendon, servo):
    lost = []

    def lose(address):  # loses the packet that arms the watchdog again
        if address == 98 and servo.table[98] == 0 and len(lost) < 3:
            lost.append(address)
            return True
        return False

    servo.put(98, 1, 255)
    wait_until(lambda: servo.table[98] == 20)
    assert tendon.recoveries == 1
    servo.lose = lose
    servo.put(98, 1, 255)
    wait_until(lambda: servo.table[98] == 20)
    assert len(lost) == 3
    assert tendon.trouble is None
    tendon.pull_to(0.002)


def test_a_goal_that_is_refused_for_another_reason_says_so(tendon, servo, monkeypatch):
    monkeypatch.setattr(servo, '_write', lambda address, data: 6)
    with pytest.raises(MotionFailedError, match='limit'):
        tendon.pull_to(0.01, 0.04)


def test_the_poll_feeds_the_watchdog_and_its_end_trips_it(tendon, servo):
    polls = servo.packets
    wait_until(lambda: servo.packets > polls + 45)  # 0.7 s, almost twice the watchdog's timeout
    assert servo.table[98] == 20
    servo.is_mute = True  # the driver must stop sending, so that the watchdog trips
    pull = Background(tendon.pull_to, 0.02, 0.01)
    assert 'silent' in str(pull.end()) or 'failed' in str(pull.error)
    wait_until(lambda: servo.table[98] == 255)
    servo.is_mute = False
    wait_until(lambda: tendon.state.displacement_m < 0.02)
    tendon.pull_to(0.0)
    assert tendon.trouble is None


def test_a_hardware_alert_ends_the_pull_for_good(tendon, servo):
    pull = begin_pull(tendon, servo)
    servo.shut_down(0x20)
    pull.ends_by(MotionFailedError, 'shut down: overload')
    with pytest.raises(MotionRefusedError, match='overload'):
        tendon.pull_to(0.0)


def test_a_fault_with_the_torque_on_refuses_winding_in_alone(connect, servo):
    tendon = connect(slack_after_s=30.0)
    tendon.pull_to(0.01)
    servo.put(70, 1, 0x01)
    wait_until(lambda: tendon.trouble)
    with pytest.raises(MotionRefusedError, match='voltage'):
        tendon.pull_to(0.02)
    tendon.pull_to(0.005)
    assert feed(tendon.safety, [16.0], time.monotonic_ns())
    tendon.supervise()
    wait_until(lambda: servo.position == 2048)
    tendon.pull_to(0.0)
    tendon.request_release()
    assert 'voltage' in str(tendon.trouble)


def test_a_servo_that_lost_its_power_is_set_up_again_at_rest(connect, servo):
    tendon = connect(slack_after_s=0.2)
    pull = begin_pull(tendon, servo)
    servo.is_silent = True
    pull.ends_by(MotionFailedError, 'silent')
    servo.lose_power()
    rest = servo.position
    servo.is_silent = False
    wait_until(lambda: not tendon.trouble and servo.table[64])
    assert tendon.safety.zero is Zero.UNCONFIRMED
    assert (servo.position, servo.goal) == (rest, rest)
    tendon.pull_to(0.005)
    assert servo.goal == rest + 326
    tendon.pull_to(0.0)
    assert servo.position == rest


def test_slackening_survives_an_outage(connect, servo):
    tendon = connect(slack_after_s=0.2)
    for begin, end in (
        (partial(setattr, servo, 'status_error', 1), partial(setattr, servo, 'status_error', 0)),
        (partial(setattr, servo, 'status_error', 3), partial(setattr, servo, 'status_error', 0)),
        (partial(setattr, servo, 'is_silent', True), partial(setattr, servo, 'is_silent', False)),
        (partial(servo.stop_flow, True), partial(servo.stop_flow, False)),
        (servo.unplug, servo.plug_in),
    ):
        tendon.pull_to(0.01)
        begin()
        wait_until(lambda: tendon.trouble, str(begin))
        assert 'by itself' in tendon.trouble.remedy
        end()
        # the tendon is slackened without a command
        wait_until(lambda: servo.position == 2048, str(begin))
        wait_until(lambda: not tendon.trouble and tendon.state.displacement_m == 0.0, str(begin))
    tendon.pull_to(0.01)
    feed(tendon.safety, [16.0], time.monotonic_ns())
    wait_until(lambda: servo.position == 2048)


def test_a_release_that_cannot_be_written_is_carried_out_later(connect, servo):
    tendon = connect(slack_after_s=30.0)
    for release in (tendon.request_release, partial(tendon.pull_to, 0.0)):
        tendon.pull_to(0.01)
        servo.unplug()
        wait_until(lambda: 'cannot open' in str(tendon.trouble))
        with pytest.raises(MotionRefusedError, match='cannot open'):
            release()
        servo.plug_in()
        wait_until(lambda: servo.position == 2048 and not tendon.trouble)


def test_a_pull_to_slack_that_a_servo_does_not_hear_is_carried_out_later(connect, servo):
    tendon = connect(slack_after_s=30.0)
    tendon.pull_to(0.01)
    servo.is_silent = True  # the pull detects the silence before it counts as an outage
    with pytest.raises(LinearGuideDriverError):
        tendon.pull_to(0.0)
    servo.is_silent = False
    wait_until(lambda: servo.position == 2048 and not tendon.trouble)


@pytest.mark.parametrize('change', [{11: 3}, {20: 0}, {0: 1030}])
def test_another_servo_behind_the_port_is_left_alone(connect, servo, change):
    told = []
    tendon = connect(lambda _: None, time.time_ns, told.append)
    tendon.pull_to(0.004)
    servo.unplug()
    wait_until(lambda: tendon.trouble)
    sizes = {0: 2, 20: 4}
    before = {address: servo.get(address, sizes.get(address, 1)) for address in change}
    for address, value in change.items():
        servo.put(address, sizes.get(address, 1), value)
    servo.put(102, 2, 1193)
    count = len(servo.writes)
    servo.plug_in()
    wait_until(lambda: 'exchanged' in str(tendon.trouble))
    wait_until(lambda: 'exchanged' in told[-1])
    with pytest.raises(MotionRefusedError, match='exchanged'):
        tendon.pull_to(0.0)
    for address, value in before.items():
        servo.put(address, sizes.get(address, 1), value)
    assert servo.writes[count:] == []
    # the right servo is connected again
    wait_until(lambda: servo.position == 2048 and not tendon.trouble)
    assert servo.get(102, 2) == 112


def test_a_driver_that_ends_leaves_another_servo_alone(connect, servo):
    tendon = connect()
    tendon.pull_to(0.004)
    servo.unplug()
    wait_until(lambda: tendon.trouble)
    servo.put(11, 1, 3)
    count = len(servo.writes)
    servo.plug_in()
    wait_until(lambda: 'exchanged' in str(tendon.trouble))
    tendon.close()
    assert servo.writes[count:] == []
    assert servo.table[64] == 1


def blink(servo):
    """Interrupt the power for a moment; the servo then switches its torque on again."""
    servo.lose_power()
    servo.put(64, 1, 1)
    servo.put(116, 4, servo.get(132))


@pytest.mark.parametrize('is_noticed', [False, True])
def test_a_blink_of_the_power_loses_the_zero_though_the_torque_is_on(connect, servo, is_noticed):
    servo.turn_to(4000)
    tendon = connect(slack_after_s=0.2)
    tendon.pull_to(0.004)  # beyond one turn; the servo loses its turns without power
    assert servo.position == 4261
    servo.is_silent = True
    blink(servo)
    if is_noticed:
        wait_until(lambda: tendon.trouble)
    count = len(servo.writes)
    servo.is_silent = False
    wait_until(lambda: (64, 1) in servo.writes[count:] and not tendon.trouble)
    assert servo.writes[count] == (64, 0)
    assert tendon.safety.zero is Zero.UNCONFIRMED
    rest = servo.position
    tendon.pull_to(0.004)
    assert servo.position == pytest.approx(rest + 261, abs=2)


def test_a_position_that_jumps_loses_the_zero(connect, servo):
    tendon = connect(slack_after_s=0.2)
    tendon.pull_to(0.004)
    count = len(servo.writes)
    servo.put(132, 4, servo.get(132) - 4096)
    servo.put(116, 4, servo.get(132))
    wait_until(lambda: (64, 1) in servo.writes[count:] and not tendon.trouble)
    assert tendon.safety.zero is Zero.UNCONFIRMED
    wait_until(lambda: tendon.state.displacement_m == pytest.approx(0.0, abs=1e-4))


def test_a_fault_of_the_reading_itself_is_trouble(connect, servo, monkeypatch):
    def fail(_):
        raise ValueError('a bug')

    tendon = connect(slack_after_s=0.2)
    pull = begin_pull(tendon, servo)
    with monkeypatch.context() as patch:
        patch.setattr(registers, 'decode_state', fail)
        pull.ends_by(MotionFailedError, "Reading the servo failed: ValueError('a bug')")
        assert 'a bug' in str(tendon.trouble)
    wait_until(lambda: servo.position == 2048)
