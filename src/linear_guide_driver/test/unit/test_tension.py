# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reliability of the tension, without ROS."""

import dataclasses
import math

import numpy as np
import pytest

from linear_guide_driver.config import TendonActuatorConfig
from linear_guide_driver.errors import MotionRefusedError
from linear_guide_driver.safety import Order, Pull, State, TendonSafety, Zero
from linear_guide_driver.tension import find_limit_warnings, TensionSource
from tactile_ros.strain import StrainBlock, StrainStatus

MS = 1_000_000
CONFIG = TendonActuatorConfig(guard_timeout_s=0.25, slack_after_s=2.0)
TAUT_M = 0.005
PERIOD_NS = 10 * MS
WALL_NS = 1_700_000_000_000 * MS
"""Time on the clock of the stamps when the monotonic time is 0 [ns]."""

SATURATED, STUCK = StrainStatus.SATURATED, StrainStatus.STUCK
DEVICE_ERROR, RESTARTED = StrainStatus.DEVICE_ERROR, StrainStatus.RESTARTED


class Sensor:
    """A driver of the sensor: publishes one sample every 10 ms, from number ``sequence`` on."""

    def __init__(self, safety, sequence=0):
        self.safety, self.sequence = safety, sequence
        self.tension_n, self.delay_ns = 0.0, 0

    def make(self, now_ns, *tension_n, status=StrainStatus.OK):
        values = np.array(tension_n or (self.tension_n,))
        first_ns = WALL_NS + now_ns - self.delay_ns - (len(values) - 1) * PERIOD_NS
        block = StrainBlock(first_ns, self.sequence, PERIOD_NS, values, status=status)
        self.sequence += len(values)
        return block

    def send(self, now_ns, *tension_n, status=StrainStatus.OK):
        block = self.make(now_ns, *tension_n, status=status)
        return self.safety.add_blocks([block], now_ns, WALL_NS + now_ns)


def run(safety, sensors, begin_ns, end_ns, displacement_m=TAUT_M):
    """Let sensors publish periodically; return the order of each poll by its time [ns]."""
    orders = {}
    for now_ns in range(begin_ns, end_ns, PERIOD_NS):
        for sensor in sensors:
            sensor.send(now_ns)
        orders[now_ns] = safety.decide(displacement_m, now_ns)
    return orders


@pytest.fixture
def safety():
    return make()


def make(**changes):
    """Return a `TendonSafety` with a known zero and a confirmed tare."""
    safety = TendonSafety(dataclasses.replace(CONFIG, **changes))
    safety.set_zero(Zero.UNCONFIRMED)
    Sensor(safety, sequence=-1).send(0)
    safety.decide(0.0, 0)
    assert safety.zero is Zero.KNOWN
    assert safety.tension.find_loss(0) is None
    return safety


def hold_taut(safety, sensor, contact='flexion', tension_n=1.0):
    sensor.send(0)
    safety.admit(Pull(TAUT_M, contact), 0.0, 0)
    safety.finish()
    sensor.tension_n = tension_n
    sensor.send(0)
    assert safety.decide(TAUT_M, 0) is Order.FOLLOW


@pytest.mark.parametrize('displacement_m', [0.0049, 0.003])
def test_the_lower_limit_counts_for_a_pull_that_does_not_tighten(safety, displacement_m):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    sensor.send(10 * MS, 2.0)
    safety.admit(Pull(displacement_m, 'abduction'), TAUT_M, 10 * MS)
    assert sensor.send(20 * MS, 4.0)
    assert safety.decide(TAUT_M, 20 * MS) is Order.RELEASE
    assert '4.00 N' in safety.reason


# -- one publisher ------------------------------------------------------------------------------


@pytest.mark.parametrize('first', [0, 50, 10_000])
def test_two_publishers_are_a_loss_as_long_as_both_publish(safety, first):
    own, other = Sensor(safety, 50), Sensor(safety, first)
    hold_taut(safety, own)
    orders = run(safety, [own, other], 10 * MS, 1000 * MS)
    assert orders[30 * MS] is Order.HOLD
    assert safety.reason
    with pytest.raises(MotionRefusedError, match='tendon_sensor/strain'):
        safety.admit(Pull(0.006), TAUT_M, 990 * MS)
    own.tension_n = other.tension_n = 0.0
    run(safety, [own], 1000 * MS, 8000 * MS, 0.0)
    # The tension becomes reliable again after a still, slack reading, without a command.
    assert safety.tension.find_loss(8000 * MS) is None


def test_publishers_are_named_even_if_one_is_silent(safety):
    sensor = Sensor(safety)
    safety.tension.set_publishers({b'1': '/tendon_sensor'})
    hold_taut(safety, sensor)
    safety.tension.set_publishers({b'1': '/tendon_sensor', b'2': '/player'})
    assert safety.decide(TAUT_M, 0) is Order.HOLD
    assert '(/player, /tendon_sensor)' in safety.reason


def test_a_driver_that_was_killed_stays_in_the_graph_and_is_no_second_publisher(safety):
    safety.tension.set_publishers({b'1': '/tendon_sensor'})
    old, new = Sensor(safety, 5000), Sensor(safety)
    run(safety, [old], 0, 100 * MS, 0.0)
    run(safety, [new], 100 * MS, 700 * MS, 0.0)
    safety.tension.set_publishers({b'1': '/tendon_sensor', b'2': '/tendon_sensor'})
    run(safety, [new], 700 * MS, 1400 * MS, 0.0)
    assert safety.tension.find_loss(1400 * MS) is None


# -- the tare -----------------------------------------------------------------------------------


def start_again(safety, sensor):
    sensor.sequence = 0


def restart_device(safety, sensor):
    sensor.send(0, status=RESTARTED)


def tare(safety, sensor):
    safety.tension.note_tare(1)
    assert safety.tension.find_loss(0) is None  # the first tare is no change
    safety.tension.note_tare(2)


def exchange(safety, sensor):
    safety.tension.set_publishers({b'1': '/tendon_sensor'})
    assert safety.tension.find_loss(0) is None
    safety.tension.set_publishers({b'2': '/tendon_sensor'})


@pytest.mark.parametrize('change', [start_again, restart_device, tare, exchange])
def test_another_tare_is_a_loss_until_a_still_reading_of_a_slack_tendon(safety, change):
    sensor = Sensor(safety, 100)
    hold_taut(safety, sensor)
    change(safety, sensor)
    orders = run(safety, [sensor], 10 * MS, 2500 * MS)
    assert orders[10 * MS] is Order.HOLD
    assert orders[2490 * MS] is Order.RELEASE
    assert 'tare' in safety.reason
    sensor.tension_n = 0.1
    run(safety, [sensor], 2500 * MS, 2900 * MS, 0.0)
    with pytest.raises(MotionRefusedError, match='tare'):
        safety.admit(Pull(TAUT_M), 0.0, 2900 * MS)
    run(safety, [sensor], 2900 * MS, 3100 * MS, 0.0)
    safety.admit(Pull(TAUT_M), 0.0, 3100 * MS)


def test_a_tare_that_is_wrong_is_not_confirmed_by_waiting(safety):
    sensor = Sensor(safety, 100)
    run(safety, [sensor], 0, 100 * MS, 0.0)
    sensor.sequence, sensor.tension_n = 0, -1.9
    run(safety, [sensor], 100 * MS, 5000 * MS, 0.0)
    with pytest.raises(MotionRefusedError, match=r'-1\.90 N.* tare the sensor'):
        safety.admit(Pull(TAUT_M), 0.0, 5000 * MS)
    with pytest.raises(MotionRefusedError, match=r'-1\.90 N.* sign'):
        safety.admit(Pull(0.02, 'abduction', is_homing=True), 0.0, 5000 * MS)
    sensor.tension_n = 0.0
    run(safety, [sensor], 5000 * MS, 5600 * MS, 0.0)
    safety.admit(Pull(TAUT_M), 0.0, 5600 * MS)


def test_a_reading_that_does_not_stay_still_confirms_nothing(safety):
    sensor = Sensor(safety, 100)
    run(safety, [sensor], 0, 100 * MS, 0.0)
    sensor.sequence = 0
    for begin_ms in range(100, 3000, 200):
        sensor.tension_n = 0.5
        run(safety, [sensor], begin_ms * MS, (begin_ms + 20) * MS, 0.0)
        sensor.tension_n = 0.0
        run(safety, [sensor], (begin_ms + 20) * MS, (begin_ms + 200) * MS, 0.0)
    with pytest.raises(MotionRefusedError, match='tare'):
        safety.admit(Pull(TAUT_M), 0.0, 3000 * MS)


def test_without_a_known_zero_only_homing_confirms_a_tare(safety):
    sensor = Sensor(safety, 100)
    run(safety, [sensor], 0, 100 * MS, 0.0)
    sensor.sequence = 0
    safety.set_zero(Zero.UNKNOWN, 'the torque went off')
    run(safety, [sensor], 100 * MS, 3000 * MS, 0.0)
    assert 'tare' in str(safety.tension.find_loss(2990 * MS))
    assert not safety.is_slack(0.0, 2990 * MS)  # the sensor does not confirm a slack tendon either
    safety.admit(Pull(0.02, 'abduction', is_homing=True), 0.0, 2990 * MS)
    assert run(safety, [sensor], 3000 * MS, 3100 * MS, 0.001)[3090 * MS] is Order.FOLLOW
    safety.set_zero(Zero.KNOWN)
    safety.finish()
    assert safety.tension.find_loss(3090 * MS) is None


def test_a_tare_that_changes_during_homing_ends_it(safety):
    sensor = Sensor(safety, 100)
    run(safety, [sensor], 0, 100 * MS, 0.0)
    safety.admit(Pull(0.02, 'abduction', is_homing=True), 0.0, 90 * MS)
    sensor.sequence = 0
    assert run(safety, [sensor], 100 * MS, 110 * MS, 0.001)[100 * MS] is Order.HOLD
    safety.set_zero(Zero.KNOWN)
    assert safety.tension.find_loss(100 * MS)


# -- values -------------------------------------------------------------------------------------


@pytest.mark.parametrize('also', [StrainStatus.OK, STUCK, DEVICE_ERROR, STUCK | DEVICE_ERROR])
def test_saturation_comes_before_every_other_status(safety, also):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    assert sensor.send(10 * MS, 12.0, status=SATURATED | also)
    assert safety.decide(TAUT_M, 10 * MS) is Order.RELEASE
    safety.hold(10 * MS)
    assert sensor.send(20 * MS, 12.0, status=SATURATED | also)
    assert safety.decide(TAUT_M, 20 * MS) is Order.RELEASE


@pytest.mark.parametrize('status', [STUCK, DEVICE_ERROR])
def test_without_saturation_a_stuck_sensor_is_a_silent_one(safety, status):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    for now_ns in range(10 * MS, 400 * MS, PERIOD_NS):
        assert not sensor.send(now_ns, 99.0, status=status)
    assert safety.decide(TAUT_M, 390 * MS) is Order.HOLD


def test_readings_from_saturation_n_on_are_saturated():
    safety = make(saturation_n=12.0)
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    assert not sensor.send(10 * MS, -11.9)
    assert sensor.send(20 * MS, -12.0)
    assert safety.decide(TAUT_M, 20 * MS) is Order.RELEASE
    assert safety.tension.latest_n == math.inf


def test_what_is_no_number_hides_no_sample_above_the_limit(safety):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    assert not sensor.send(10 * MS, 1.0, math.nan)
    assert safety.tension.latest_n == 1.0
    assert sensor.send(20 * MS, math.nan, 16.0, 1.0)
    assert sensor.send(30 * MS, math.nan, 1.0)  # does not prove that the tension has fallen
    assert safety.decide(TAUT_M, 30 * MS) is Order.RELEASE


def test_blocks_that_are_never_whole_are_no_live_ones(safety):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    for now_ns in range(10 * MS, 400 * MS, PERIOD_NS):
        sensor.send(now_ns, 1.0, math.nan)
    assert safety.decide(TAUT_M, 390 * MS) is Order.HOLD
    assert 'sample' in safety.reason


# -- age ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('delay_s', 'text'),
    [(1.0, '1.00 s late'), (-1.0, '1.00 s in the future')],
)
def test_a_delay_from_the_start_is_seen_by_the_stamps(delay_s, text):
    safety = make()
    sensor = Sensor(safety)
    sensor.delay_ns = round(delay_s * 1e9)
    run(safety, [sensor], 0, 2000 * MS, 0.0)
    with pytest.raises(MotionRefusedError, match=text):
        safety.admit(Pull(TAUT_M), 0.0, 2000 * MS)
    apart = make(shares_sensor_clock=False)
    sensor.safety = apart
    sensor.sequence = 0
    run(apart, [sensor], 0, 2000 * MS, 0.0)
    apart.admit(Pull(TAUT_M), 0.0, 2000 * MS)


def test_a_delay_that_grows_slowly_is_seen(safety):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    for now_ns in range(10 * MS, 60_000 * MS, PERIOD_NS):
        sensor.delay_ns = round(0.015 * now_ns)
        sensor.send(now_ns)
        if safety.decide(TAUT_M, now_ns) is not Order.FOLLOW:
            break
    assert safety.state is State.HOLDING
    assert 0.2 < sensor.delay_ns / 1e9 < 0.26
    assert 's late' in safety.reason


def test_the_age_of_a_block_is_that_of_its_newest_sample_and_a_clock_may_be_unusable():
    source = TensionSource(dataclasses.replace(CONFIG, shares_sensor_clock=False))

    def is_live(stamp_ms, arrived_ms, count=1, status=StrainStatus.OK, clock_ns=0):
        tension_n = np.zeros(count)
        block = StrainBlock(stamp_ms * MS, stamp_ms, MS, tension_n, status=status)
        source.add([block], arrived_ms * MS, clock_ns)
        return source.is_live(arrived_ms * MS)

    assert is_live(100, 1000)
    assert is_live(101, 1040, count=40)
    assert is_live(201, 1300, count=40)  # newest sample is 0.16 s late
    assert not is_live(900, 5000)
    assert is_live(901, 5001, status=StrainStatus.CLOCK_STEP)
    assert is_live(902, 9000, clock_ns=None)


def test_stamps_that_are_wrong_for_a_moment_make_no_loss(safety):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    # The clock was set, and the sensor driver has not detected it yet.
    sensor.delay_ns = 3600 * 1000 * MS
    assert set(run(safety, [sensor], 10 * MS, 200 * MS).values()) == {Order.FOLLOW}
    sensor.delay_ns = 0
    assert set(run(safety, [sensor], 200 * MS, 900 * MS).values()) == {Order.FOLLOW}


# -- the current of the servo -------------------------------------------------------------------


def pull_with(safety, sensor, current_a, tension_n, begin_ns, end_ns):
    for now_ns in range(begin_ns, end_ns, PERIOD_NS):
        sensor.tension_n = tension_n(now_ns)
        sensor.send(now_ns)
        safety.add_current(current_a(now_ns), now_ns)
        if safety.decide(0.002, now_ns) is not Order.FOLLOW:
            return now_ns
    return None


def test_a_sensor_that_freezes_in_a_pull_is_found_by_the_current(safety):
    sensor = Sensor(safety)
    sensor.send(0)
    safety.admit(Pull(0.02, 'abduction'), 0.0, 0)

    def true_n(now_ns):
        return 50.0 * now_ns / 1e9  # tension of a stiff finger that is pulled fast

    def current_a(now_ns):
        return CONFIG.to_current_a(true_n(now_ns))

    seen_ns = pull_with(safety, sensor, current_a, lambda _: 0.01, 10 * MS, 800 * MS)
    assert true_n(seen_ns) < CONFIG.current_mismatch_n + 50.0 * 0.12
    assert 'The servo pulls with 0.' in safety.reason
    assert 'the sensor reads 0.01 N' in safety.reason
    assert safety.state is State.HOLDING
    assert safety.decide(0.002, seen_ns + 2001 * MS) is Order.RELEASE


def test_the_current_is_not_compared_where_friction_may_hold_the_tendon(safety):
    sensor = Sensor(safety)
    hold_taut(safety, sensor)
    for now_ns in range(10 * MS, 500 * MS, PERIOD_NS):
        sensor.send(now_ns)
        safety.add_current(0.3, now_ns)
        assert safety.decide(TAUT_M, now_ns) is Order.FOLLOW


@pytest.mark.parametrize('mismatch_n', [5.0, 0.0])
def test_a_short_peak_of_the_current_is_no_disagreement(mismatch_n):
    safety = make(current_mismatch_n=mismatch_n)
    sensor = Sensor(safety)
    sensor.send(0)
    safety.admit(Pull(0.02), 0.0, 0)
    end_ns = 400 * MS

    def current_a(now_ns):
        return 0.15 if mismatch_n == 0.0 or now_ns < 90 * MS else CONFIG.to_current_a(4.9)

    assert pull_with(safety, sensor, current_a, lambda _: 0.0, 10 * MS, end_ns) is None


def test_each_contact_has_its_current_limit(safety):
    assert safety.find_current_limit_a(Pull(0.004)) == 0.15
    assert safety.find_current_limit_a(Pull(0.004, 'abduction')) == 0.05
    assert safety.find_current_limit_a(Pull(0.0, '')) == 0.3
    assert make(current_limit_a=0.04).find_current_limit_a(Pull(0.004)) == 0.04


# -- what is said at the start -------------------------------------------------------------------


def test_limits_that_cannot_be_guarded_are_said():
    def warn(**changes):
        return ' '.join(find_limit_warnings(dataclasses.replace(CONFIG, **changes)))

    assert 'The range of the tendon sensor is not known' in warn()
    assert warn(saturation_n=19.6) == ''
    assert 'saturates at 10 N (saturation_n), which is not above flexion_limit_n, 15 N' in warn(
        saturation_n=10.0
    )
    assert 'abduction' in warn(saturation_n=3.0)
    text = warn(saturation_n=50.0, flexion_limit_n=40.0)
    assert 'flexion_current_a, 0.15 A, is too low for flexion_limit_n, 40 N' in text
    assert 'which needs 0.245 A' in text
