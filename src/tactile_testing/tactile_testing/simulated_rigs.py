# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers for tests with a simulated rig."""

import serial

from tactile_testing.waiting import DEADLINE_S, wait_until

PATIENT = {'heartbeat_timeout_s': 10.0, 'strain_timeout_s': 1.5}
"""Parameters of a trial runner that tolerate late messages, as on a busy computer."""

GUARD = {'guard_timeout_s': 2.0}
"""Parameters of the tendon actuator that tolerate late samples, as on a busy computer."""


def let_servos_pause(monkeypatch):
    """Let the driver tolerate that a simulated servo does not respond for about 1 s.

    On a busy computer, the process of the simulated servo can be suspended for some time, which
    must not fail tests with other purposes.
    """
    monkeypatch.setattr('linear_guide_driver.dynamixel.servo_monitor.FAILED_POLLS', 25)
    monkeypatch.setattr('linear_guide_driver.dynamixel.bus.ATTEMPTS', 20)


def home_fast(rig):
    """Make the guide home at its highest speed, so that tests take less time."""
    home_at(rig, slow_mm_min=1000, fast_mm_min=6000)


def home_at(rig, slow_mm_min, fast_mm_min):
    """Set the homing speeds of the guide, which are the settings $24 and $25 of Grbl."""
    with serial.Serial(rig.ports.guide, 115200, timeout=DEADLINE_S) as port:
        port.write(f'$24={slow_mm_min}\n$25={fast_mm_min}\n'.encode())
        said = port.read_until(b'ok\r\nok\r\n')
        assert said.endswith(b'ok\r\nok\r\n'), said


def advance_rig(rig, seconds):
    """Wait until the simulated time has advanced by ``seconds``; return the state of the rig."""
    until_s = rig.truth()['time_s'] + seconds

    def truth_then():
        truth = rig.truth()
        return truth if truth['time_s'] >= until_s else None

    # The time is not read more often, because every request delays the rig.
    return wait_until(truth_then, 'the simulated time does not advance', poll_s=0.01)


def truth_at_rest(rig):
    """Wait until guide and tendon move by less than 1 µm in 0.1 s; return the state of the rig.

    The positions are not compared exactly, because a tendon without torque slackens ever more
    slowly.
    """
    keys = ('time_s', 'guide_position_m', 'tendon_displacement_m')
    looks = [rig.truth()]

    def truth_if_at_rest():
        looks.append(advance_rig(rig, 0.1))
        earlier, now = looks[-2:]
        return now if all(abs(earlier[key] - now[key]) < 1e-6 for key in keys[1:]) else None

    def describe():
        shown = [[look[key] for key in keys] for look in (*looks[:5], *looks[-5:])]
        return f'the rig does not come to rest: {keys}: {shown} of {len(looks)}'

    return wait_until(truth_if_at_rest, describe)
