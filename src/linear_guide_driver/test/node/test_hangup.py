# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon driver's program in a terminal that is closed."""

import fcntl
import os
import signal
import termios

import pytest

from tactile_msgs.action import PullTendon
from tactile_ros.health import HeartbeatWatch
from tactile_testing.waiting import wait_until

START_S = 60.0
"""Longest time [s] in which a process starts or ends on a busy computer."""

SLACK = 2048
PULL = {'displacement_m': 0.004, 'speed_m_s': 0.02, 'contact': 'flexion'}
TENDON = {'watchdog_s': 1.0, 'unguarded': True, 'speed_m_s': 0.02}


class Terminal:
    """A pseudo-terminal that controls the process started with the options `popen`."""

    def __init__(self, *, is_nohup=False):
        self._master, self._slave = os.openpty()
        self._is_nohup = is_nohup

    @property
    def popen(self):
        """Options of Popen."""
        streams = dict.fromkeys(('stdin', 'stdout', 'stderr'), self._slave)
        return {**streams, 'start_new_session': True, 'preexec_fn': self._become_terminal}

    def _become_terminal(self):
        fcntl.ioctl(self._slave, termios.TIOCSCTTY, 0)
        if self._is_nohup:
            signal.signal(signal.SIGHUP, signal.SIG_IGN)

    def type(self, keys):
        os.write(self._master, keys)

    def close(self):
        """Close the terminal, which sends SIGHUP to its processes."""
        os.close(self._slave)
        os.close(self._master)


@pytest.mark.parametrize('way', ['closed', 'Ctrl-C, then closed', 'nohup, closed, then SIGINT'])
def test_a_driver_whose_terminal_is_closed_slackens_the_tendon(bench, servo, start_driver, way):
    terminal = Terminal(is_nohup='nohup' in way)
    driver = start_driver(terminal.popen, **TENDON)
    watch = HeartbeatWatch(bench.peer, 'tendon_actuator/heartbeat')
    wait_until(lambda: not watch.find_loss(), timeout_s=START_S)
    handle = bench.send(PullTendon, '/tendon_actuator/pull', **PULL)
    assert bench.result(handle)[0] == 'succeeded'
    assert servo.position > SLACK + 200
    if 'Ctrl-C' in way:
        terminal.type(b'\x03')
    terminal.close()
    if 'nohup' in way:
        assert driver.poll() is None
        driver.send_signal(signal.SIGINT)
    assert driver.wait(START_S) == 0
    assert abs(servo.position - SLACK) <= 33
    assert not servo.table[64]
    watch.close()
