# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the tendon's driver does when servo, bus or the driver itself fail."""

from background import Background
from pulls import begin_pull, check_failure
import pytest

from linear_guide_driver import MotionFailedError, MotionRefusedError
from linear_guide_driver.dynamixel import registers
from tactile_testing.waiting import wait_until

COUNT_M = 2 * 3.141592653589793 * 0.01 / 4096


def test_a_tripped_watchdog_ends_the_pull_and_the_goals_are_unlocked(connect, servo):
    tendon = connect(watchdog_s=0.3)
    pull = begin_pull(tendon, servo)
    servo.put(98, 1, 255)
    check_failure(pull, 'watchdog has stopped it')
    stopped_at = servo.position
    wait_until(lambda: servo.table[98] == 15)
    assert (tendon.trouble, tendon.recoveries) == ('', 1)
    tendon.pull_to(COUNT_M * (stopped_at - 2048), 0.01)


@pytest.mark.parametrize('register', [112, 116])
def test_a_watchdog_that_trips_unseen_does_not_stop_a_fresh_command(connect, servo, register):
    tendon = connect()
    tendon.pull_to(0.01, 0.04)
    servo.trips_before = register  # later than the last poll
    tendon.pull_to(0.0)
    assert servo.trips_before is None
    assert servo.position == 2048
    assert servo.table[98] == 50
    assert (tendon.trouble, tendon.recoveries) == ('', 1)


def test_a_goal_that_is_refused_for_another_reason_says_so(tendon, servo, monkeypatch):
    monkeypatch.setattr(servo, '_write', lambda address, data: 6)
    with pytest.raises(MotionFailedError, match='beyond a limit register'):
        tendon.pull_to(0.01, 0.04)


def test_the_poll_feeds_the_watchdog_and_its_end_trips_it(connect, servo):
    tendon = connect(watchdog_s=0.3)
    polls = servo.packets
    wait_until(lambda: servo.packets > polls + 45)  # 0.7 s at 60 Hz, twice the watchdog's time
    assert servo.table[98] == 15
    servo.is_mute = True  # the answers are lost; the driver must fall silent to stop it
    pull = Background(tendon.pull_to, 0.02, 0.01)
    assert 'silent' in str(pull.end()) or 'failed' in str(pull.error)
    wait_until(lambda: servo.table[98] == 255)
    servo.is_mute = False
    wait_until(lambda: tendon.state.displacement_m < 0.02)
    tendon.pull_to(0.0)
    assert tendon.trouble == ''


def test_a_hardware_alert_ends_the_pull_for_good(tendon, servo):
    pull = begin_pull(tendon, servo)
    servo.shut_down(0x20)
    check_failure(pull, 'shut down: overload')
    with pytest.raises(MotionRefusedError, match=r'overload.*configure the driver again'):
        tendon.pull_to(0.0)


def test_a_servo_that_restarted_has_lost_its_reference(tendon, servo):
    servo.put(64, 1, 0)
    wait_until(lambda: tendon.trouble != '')
    with pytest.raises(MotionRefusedError, match='slack reference is lost'):
        tendon.pull_to(0.01)


def test_a_silent_servo_ends_the_pull_and_can_be_commanded_again(connect, servo):
    tendon = connect(slack_after_s=0.2, watchdog_s=0.5)
    pull = begin_pull(tendon, servo)
    servo.is_silent = True
    check_failure(pull, 'silent')
    wait_until(lambda: servo.table[98] == 255)
    servo.is_silent = False
    wait_until(lambda: servo.position == 2048, 8.0)  # nobody commands it: held, then let out


def test_an_unplugged_bus_ends_the_pull(tendon, servo):
    pull = begin_pull(tendon, servo)
    servo.close()
    check_failure(pull, 'is lost')
    wait_until(lambda: tendon.trouble != '')
    with pytest.raises(MotionRefusedError, match='configure the driver again'):
        tendon.pull_to(0.0)


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_a_fault_of_the_reading_itself_is_trouble(tendon, servo, monkeypatch):
    def fail(_):
        raise ValueError('a bug')

    pull = begin_pull(tendon, servo)
    monkeypatch.setattr(registers, 'decode_state', fail)
    check_failure(pull, "Reading the servo failed: ValueError('a bug')")
    assert 'a bug' in tendon.trouble
