# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Start and end of a process that runs one node."""

import os
import signal
import subprocess
import sys
import time

import pytest

from tactile_testing.waiting import wait_until

PROGRAM = """
import ctypes
import sys
import time
from dataclasses import dataclass, field
from tactile_ros import node_group, process
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import run_node

@dataclass(frozen=True)
class Config:
    device: str = field(default='', metadata={'description': 'device'})

class Node(TactileNode):
    def __init__(self):
        if 'slow' in sys.argv:
            print('constructing', flush=True)
            while not process.held_signals().received:
                time.sleep(0.001)
        super().__init__('probe', Config)
    def set_up(self, config):
        if config.device == 'waiting':
            print('configuring', flush=True)
            self.ending.wait()
        if config.device == 'stuck':
            process.INTERRUPT_TIMEOUT_S = 0.2
            print('configuring', flush=True)
            time.sleep(60)
        if config.device == 'broken':
            raise RuntimeError('device broken')
    def start(self):
        print('started', flush=True)
        if self.config.device == 'faulty':
            self.create_timer(0.01, self.fail)
    def fail(self):
        raise ZeroDivisionError('a bug')
    def tear_down(self):
        print('torn down', flush=True)

node_group.PEERS_END_S = 0.0  # there are none
if 'hanging' in sys.argv:
    node_group.PARTICIPANT_ENDS_S = 0.3
code = run_node(Node)
if 'hanging' in sys.argv:
    ctypes.PyDLL(None).sleep(60)  # with the interpreter's lock held, as Fast DDS does
sys.exit(code)
"""

END_S = 60.0
"""Timeout for the end of a process on a busy computer [s]."""


def start(*arguments):
    return subprocess.Popen(
        [sys.executable, '-c', PROGRAM, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'ROS_DOMAIN_ID': str(os.getpid() % 100)},
        process_group=0,
    )


@pytest.mark.parametrize(
    ('device', 'number'),
    [('waiting', signal.SIGINT), ('stuck', signal.SIGTERM), ('waiting', signal.SIGHUP)],
)
def test_signal_ends_a_configuration_that_is_under_way(device, number):
    process = start('--ros-args', '-p', f'device:={device}')
    assert process.stdout.readline().strip() == 'configuring'
    process.send_signal(number)
    output, errors = process.communicate(timeout=END_S)
    assert process.returncode == 0, errors
    assert 'torn down' in output
    assert 'started' not in output
    assert 'Traceback' not in errors


def test_signal_while_the_node_is_made_ends_the_process_cleanly():
    process = start('slow')
    assert process.stdout.readline().strip() == 'constructing'
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=END_S)
    assert process.returncode == 0, errors
    assert output.strip() == 'torn down'
    assert 'Traceback' not in errors


@pytest.mark.parametrize(
    ('device', 'last', 'error'),
    [
        ('broken', 'torn down', 'device broken'),
        ('7', '', 'cannot start'),
        ('faulty', 'torn down', 'ZeroDivisionError: a bug'),
    ],
)
def test_a_node_that_cannot_go_on_exits_with_one_and_says_why(device, last, error):
    process = start('--ros-args', '-p', f'device:={device}')
    output, errors = process.communicate(timeout=END_S)
    assert process.returncode == 1
    assert output.rstrip().endswith(last)
    assert error in errors
    assert ('Traceback' in errors) == (device == 'faulty')


def test_ctrl_z_does_not_stop_a_node():
    process = start()
    assert process.stdout.readline().strip() == 'started'
    for number in (signal.SIGTSTP, signal.SIGTTOU):
        os.killpg(process.pid, number)
    process.send_signal(signal.SIGINT)  # a suspended process would ignore this
    try:
        output, errors = process.communicate(timeout=END_S)
    finally:
        process.kill()
    assert (process.returncode, output.strip()) == (0, 'torn down'), errors


def test_a_second_signal_does_not_change_the_exit_code():
    process = start()
    assert process.stdout.readline().strip() == 'started'

    def send():  # called until the process has ended
        process.send_signal(signal.SIGINT)
        time.sleep(0.001)

    wait_until(lambda: process.poll() is not None, step=send)
    output, errors = process.communicate(timeout=END_S)
    assert process.returncode == 0, errors
    assert output.strip() == 'torn down'


def test_a_process_that_hangs_after_its_node_is_ended_with_one():
    process = start('hanging')
    assert process.stdout.readline().strip() == 'started'
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=END_S)
    assert process.returncode == 1
    assert output.strip() == 'torn down'
    assert 'Timeout' in errors  # the traceback of the hanging thread is printed
