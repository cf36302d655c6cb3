# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests of tests to a simulated rig."""

import serial

from tactile_testing.waiting import DEADLINE_S, wait_until

PATIENT = {'heartbeat_timeout_s': 10.0, 'strain_timeout_s': 1.5}
"""Parameters of a trial runner that bears a computer whose cores are busy."""

GUARD = {'guard_timeout_s': 2.0}
"""The same of the tendon actuator: a busy computer holds samples back."""


def let_servos_pause(monkeypatch):
    """Let a simulated servo be silent for about 1 s: its process may wait for a core.

    How soon a servo counts as silent is tested with the driver. Where a trial is tested, such a
    wait is no fault. `tactile trials` runs a trial again that ended so.
    """
    monkeypatch.setattr('linear_guide_driver.dynamixel.servo_monitor.FAILED_POLLS', 25)
    monkeypatch.setattr('linear_guide_driver.dynamixel.bus.ATTEMPTS', 20)


def home_fast(rig):
    """Let the guide home at its top speed."""
    home_at(rig, slow_mm_min=1000, fast_mm_min=6000)


def home_at(rig, slow_mm_min, fast_mm_min):
    """Let the guide home at these speeds: settings 24 and 25 of Grbl, kept when it restarts."""
    with serial.Serial(rig.ports.guide, 115200, timeout=DEADLINE_S) as port:
        port.write(f'$24={slow_mm_min}\n$25={fast_mm_min}\n'.encode())
        said = port.read_until(b'ok\r\nok\r\n')
        assert said.endswith(b'ok\r\nok\r\n'), said


def advance_rig(rig, seconds):
    """Let some of the rig's time pass; return its truth then."""
    until_s = rig.truth()['time_s'] + seconds

    def truth_then():
        truth = rig.truth()
        return truth if truth['time_s'] >= until_s else None

    return wait_until(truth_then, 'the rig stands still')


def truth_at_rest(rig):
    """Wait until neither guide nor tendon moves by 1 µm in 0.1 s; return the rig's truth.

    A tendon without torque goes slack ever more slowly, and is still for no two looks.
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
