# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`PalpationRig`, commanded through its devices, agrees with `simulate_motion`."""

import copy
from functools import lru_cache

from dynamixel_packets import encode_instruction
import numpy as np
import pytest

from linear_guide_driver.dynamixel import registers as known
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.errors import RigError
from tactile_sim.physics.motion import Move, Timeline
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.trials import simulate_motion
from tactile_sim.physics.variation import Variation
from tactile_sim.rig import PalpationRig, STEP_S

SPEED_UNITS = 25
SPEED_M_S = SPEED_UNITS * 0.229 / 60 * 4096 * default_catalogue().rig().tendon.m_per_count


class Driver:
    """Sends bytes to the devices of a rig, and stores the true motion of the rig."""

    def __init__(self):
        self.rig = PalpationRig(seed=1, variation=Variation.none())
        self.lines = b''
        self.tension_n = []

    def wait_until(self, time_s):
        for step in range(round(self.rig.now_s / STEP_S) + 1, round(time_s / STEP_S) + 1):
            self.rig.advance(step * STEP_S + 1e-9)
            self.lines += self.rig.sensor.poll(self.rig.now_s)
            self.tension_n.append(self.rig.read_truth()['tension_n'])

    def guide(self, text):
        return self.rig.guide.receive(text, self.rig.now_s)

    def tendon(self, register, value):
        data = value.to_bytes(register.size, 'little', signed=register.is_signed)
        packet = encode_instruction(1, 3, register.address.to_bytes(2, 'little') + data)
        assert self.rig.tendon.receive(packet, self.rig.now_s)[8] == 0

    @classmethod
    def prepare(cls):
        """Return a driver of a rig at time 10 s, which is homed and has the servo's torque on."""
        return copy.deepcopy(cls._prepare())

    @classmethod
    @lru_cache
    def _prepare(cls):
        self = cls()
        self.guide(b'$H\n')
        for register, value in (
            (known.OPERATING_MODE, 5),
            (known.GOAL_CURRENT, 300),
            (known.PROFILE_VELOCITY, SPEED_UNITS),
            (known.TORQUE_ENABLE, 1),
        ):
            self.tendon(register, value)
        self.wait_until(8.0)
        self.guide(b'G1X-140F6000\n')
        self.wait_until(10.0)
        return self

    def pull(self, displacement_m):
        counts = round(displacement_m / default_catalogue().rig().tendon.m_per_count)
        self.tendon(known.GOAL_POSITION, 2048 + counts)


def test_texture_trial():
    plate, contact, pull_m = 'T1', 'abduction', 0.0075
    driver = Driver.prepare()
    driver.rig.mount('texture', plate, contact)
    driver.wait_until(10.2)
    driver.pull(pull_m)
    driver.wait_until(12.0)
    driver.guide(b'G1X-105F900\n')
    driver.wait_until(14.0)
    timeline = Timeline([Move(2.0, 0.095, 0.015)], [Move(0.2, pull_m, SPEED_M_S)], 4.0)
    motion = simulate_motion(build_scene('texture', plate, contact), timeline, Variation.none())
    times = motion.sample_times_s
    live = np.interp(10.0 + times, STEP_S * np.arange(1, 14001), driver.tension_n)
    fast = motion.truth['tension_n'][0]
    ripple = fast[times > 2.8].std()
    difference = live - fast
    # The results differ only because `PalpationRig` uses longer steps.
    assert np.sqrt(np.mean(difference[times > 2.8] ** 2)) < 0.05 * ripple
    assert np.abs(difference[(times < 0.15) | (times > 1.6)]).max() < 0.04
    assert np.abs(difference).max() < 0.01 * fast.max()
    # The lines that the load cell sent contain the same tension, with noise.
    rows = [line.split(b',') for line in driver.lines.split(b'\r\n')[:-1]]
    sent_s = np.arange(len(rows)) * default_catalogue().rig().load_cell.period_s
    said_n = np.array([float(row[1]) for row in rows]) * 9.80665
    late = sent_s > 12.0
    heard = np.interp(sent_s[late] - 10.0, times, motion.sensed_n[0])
    assert (said_n[late] - heard).std() < 0.02


def test_stiffness_trial_relaxes_alike():
    driver = Driver.prepare()
    driver.rig.mount('stiffness', 'sponge', 'flexion')
    driver.pull(0.0060)
    driver.wait_until(13.0)
    timeline = Timeline([], [Move(0.0, 0.0060, SPEED_M_S)], 3.0)
    scene = build_scene('stiffness', 'sponge', 'flexion')
    motion = simulate_motion(scene, timeline, Variation.none())
    times = motion.sample_times_s
    live = np.interp(10.0 + times, STEP_S * np.arange(1, 13001), driver.tension_n)
    held = times > 1.2
    np.testing.assert_allclose(live[held], motion.truth['tension_n'][0][held], atol=5e-3)


def test_mounting_needs_a_slack_tendon():
    driver = Driver.prepare()
    driver.pull(0.003)
    driver.wait_until(11.0)
    with pytest.raises(RigError, match=r'3\.0 mm'):
        driver.rig.mount('texture', 'F', 'flexion')


def test_the_noise_of_a_trial_does_not_depend_on_when_it_begins():
    heard_n = []
    for waited_s in (0.0, 1.0):  # both are whole sampling periods
        driver = Driver.prepare()
        driver.rig.mount('stiffness', 'none', 'flexion')
        driver.wait_until(10.5 + waited_s)
        driver.lines = b''
        for _ in range(2):
            driver.pull(0.003)
            driver.wait_until(driver.rig.now_s + 2.0)
            driver.pull(0.0)
            driver.wait_until(driver.rig.now_s + 1.0)
        rows = [line.split(b',') for line in driver.lines.split(b'\r\n')[:-1]]
        heard_n.append(9.80665 * np.array([float(row[1]) for row in rows[:360]]))
    difference = np.diff(heard_n, axis=0)[0, 60:]
    noise = heard_n[0][60:120] - heard_n[0][240:300]  # noise of two pulls
    assert difference.std() < 0.1 * noise.std()
