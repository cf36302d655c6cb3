# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""SIMULATED: the driver's comparison of motor current and sensor, with a simulated rig."""

import math

import numpy as np
import pytest

from linear_guide_driver.config import TendonActuatorConfig
from linear_guide_driver.dynamixel import registers as known
from linear_guide_driver.safety import Order, Pull, TendonSafety, Zero
from tactile_ros.strain import StrainBlock
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.dynamixel import VELOCITY_COUNTS_S
from tactile_sim.rig import PalpationRig

CATALOGUE = default_catalogue()
# The force limits are high, because the pulls in these tests are faster than in any trial.
CONFIG = TendonActuatorConfig(flexion_limit_n=19.0, saturation_n=19.6)
M_PER_COUNT = math.tau * CONFIG.pulley_radius_m / known.COUNTS_PER_TURN
DISPLACEMENT_M = {'flexion': 0.0049, 'abduction': 0.0074}
POLL_NS = 16_666_667
SENSOR_DELAY_NS = 10_000_000
"""Delay of a sample from the measurement to the tendon driver [ns]."""

OBJECTS = [
    (protocol, label)
    for protocol in ('texture', 'stiffness')
    for label in CATALOGUE.labels(protocol)
]


class Bench:
    """A simulated rig in virtual time, and the `TendonSafety` of the tendon driver."""

    def __init__(self, protocol, label, contact):
        self.contact = contact
        self.rig = PalpationRig(catalogue=CATALOGUE)
        self.rig.mount(protocol, label, contact)
        start_m = CATALOGUE.rig().placement.texture_guide_m
        self.rig.guide.position_m = lambda _: start_m
        self.now_ns, self.sequence, self.text, self.tension_n = 0, 0, b'', 0.0
        self.write(known.OPERATING_MODE, known.MODE_CURRENT_BASED_POSITION)
        self.write(known.TORQUE_ENABLE, 1)
        self.safety = TendonSafety(CONFIG)
        self.safety.set_zero(Zero.UNCONFIRMED)
        self.most_n = -math.inf  # largest excess of the current over the sensor for 0.1 s [N]
        self.excesses = []
        for _ in range(30):
            self.cycle()

    def write(self, register, value):
        data = value.to_bytes(register.size, 'little', signed=register.is_signed)
        self.rig.tendon._write(register.address, data)

    def read_sensor(self):
        self.rig.advance((self.now_ns - SENSOR_DELAY_NS) / 1e9)
        *lines, self.text = (self.text + self.rig.sensor.poll(self.rig.now_s)).split(b'\r\n')
        self.tension_n = [float(line.split(b',')[1]) * 9.80665 for line in lines][-1:] or [
            self.tension_n
        ]
        self.tension_n = self.tension_n[0]

    def cycle(self, frozen_n=None):
        """Simulate one poll of the servo; return the order that `TendonSafety` then gives."""
        self.now_ns += POLL_NS
        self.read_sensor()
        tension_n = self.tension_n if frozen_n is None else frozen_n
        block = StrainBlock(0, self.sequence, POLL_NS, np.array([tension_n]))
        self.sequence += 1
        self.safety.add_blocks([block], self.now_ns)
        self.rig.advance(self.now_ns / 1e9)
        self.rig.tendon._refresh()
        current_a = self.rig.tendon._table[known.PRESENT_CURRENT] * known.CURRENT_UNIT_A
        self.safety.add_current(current_a, self.now_ns)
        self.excesses.append(CONFIG.to_tension_n(current_a) - abs(tension_n))
        if len(self.excesses) >= 7:
            self.most_n = max(self.most_n, min(self.excesses[-7:]))
        return self.safety.decide(self.rig.tendon.displacement_m, self.now_ns)

    def pull(self, displacement_m, speed_m_s, frozen_n=None):
        """Pull for at most 3 s, or until `TendonSafety` stops the pull; return its last order."""
        pull = Pull(displacement_m, self.contact)
        self.safety.admit(pull, 0.0, self.now_ns)
        velocity = round(speed_m_s / M_PER_COUNT / VELOCITY_COUNTS_S)
        self.write(known.PROFILE_VELOCITY, velocity)
        current_a = self.safety.find_current_limit_a(pull)
        self.write(known.GOAL_CURRENT, round(current_a / known.CURRENT_UNIT_A))
        goal = CATALOGUE.rig().tendon.slack_count + round(displacement_m / M_PER_COUNT)
        self.write(known.GOAL_POSITION, goal)
        self.excesses.clear()
        order, end_ns = Order.FOLLOW, self.now_ns + 3_000_000_000
        while order is Order.FOLLOW and self.now_ns < end_ns:
            if self.rig.tendon.displacement_m > displacement_m - 2e-5:
                break
            order = self.cycle(frozen_n)
        return order


@pytest.mark.parametrize('contact', ['flexion', 'abduction'])
@pytest.mark.parametrize(('protocol', 'label'), OBJECTS)
def test_no_trial_is_ended_because_current_and_sensor_disagree(protocol, label, contact):
    for speed_m_s in (0.010, 0.048):
        bench = Bench(protocol, label, contact)
        assert bench.pull(DISPLACEMENT_M[contact], speed_m_s) is Order.FOLLOW, bench.safety.reason
        assert bench.most_n < CONFIG.current_mismatch_n / 3


def test_a_sensor_that_freezes_as_a_pull_starts_is_found_by_the_current():
    bench = Bench('stiffness', 'none', 'flexion')
    assert bench.pull(0.02, 0.010, frozen_n=0.01) is Order.HOLD
    assert 'The servo pulls with' in bench.safety.reason
    assert bench.rig.read_truth()['tension_n'] < 8.0


def test_an_abduction_pull_with_a_frozen_sensor_stalls_at_its_current_limit():
    bench = Bench('stiffness', 'none', 'abduction')
    bench.pull(0.02, 0.010, frozen_n=0.01)
    assert bench.rig.read_truth()['tension_n'] < 6.0
