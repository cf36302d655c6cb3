# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The watchdog kills a process that hangs. The tests start processes that it watches."""

import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

from tactile_ros import hang_watch
from tactile_testing.waiting import wait_until

TIMEOUT_S = 0.4

PARENT = f"""
import sys, time
from tactile_ros.hang_watch import HangWatch
watch = HangWatch({TIMEOUT_S})
print(watch._child.pid, flush=True)
for line in sys.stdin:
    if line.strip() == 'turn':
        end_s = time.monotonic() + 3 * {TIMEOUT_S}
        while time.monotonic() < end_s:
            watch.feed()
            time.sleep(0.02)
    elif line.strip() == 'close':
        watch.close()
        watch.close()
        watch.feed()
    else:
        watch.feed(float(line))
    print('did', line.strip(), flush=True)
"""


class Parent:
    """A separate process with a `HangWatch`, which executes commands from its standard input."""

    def __init__(self):
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            [sys.executable, '-c', PARENT],
            stdin=pipe,
            stdout=pipe,
            stderr=pipe,
            text=True,
            process_group=0,
        )
        self.child = int(self.process.stdout.readline())

    def tell(self, line):
        """Send a command to the process, and return the line that it prints after execution."""
        self.process.stdin.write(line + '\n')
        self.process.stdin.flush()
        return self.process.stdout.readline()

    def wait_for_the_kill(self):
        assert self.process.wait(20.0) == -signal.SIGKILL
        assert f'Process {self.process.pid} has hung for' in self.process.stderr.read()

    @property
    def has_child(self):
        try:
            return 'Z' not in Path(f'/proc/{self.child}/stat').read_text().rpartition(')')[2]
        except OSError:
            return False


@pytest.fixture
def start():
    """Return a function that starts a `Parent` and sends commands to it."""
    parents = []

    def start_and_tell(*lines):
        parents.append(Parent())
        for line in lines:
            parents[-1].tell(line)
        return parents[-1]

    yield start_and_tell
    for parent in parents:
        parent.process.kill()
        parent.process.communicate()
    # Each watchdog process must end after its parent.
    wait_until(lambda: not any(parent.has_child for parent in parents))


def test_a_frozen_process_is_killed_and_one_that_turns_is_not(start):
    parent = start('turn')
    assert parent.process.poll() is None
    parent.process.send_signal(signal.SIGSTOP)
    parent.wait_for_the_kill()


@pytest.mark.parametrize('number', [signal.SIGTSTP, signal.SIGSTOP])
def test_a_process_is_killed_when_its_whole_process_group_is_stopped_as_by_ctrl_z(start, number):
    parent = start('turn')
    os.killpg(parent.process.pid, number)
    parent.wait_for_the_kill()


def test_a_process_whose_worker_hangs_is_killed_though_all_its_processes_got_a_signal(start):
    parent = start('0')
    subprocess.run(['kill', '-INT', str(parent.child)], check=True)
    subprocess.run(['kill', '-TERM', str(parent.child)], check=True)
    parent.wait_for_the_kill()


def test_a_process_that_need_not_turn_is_left_alone_also_without_the_child(start):
    # The first process has not called `feed` yet, as a driver that is still being configured.
    parents = [start(), start('0', '60'), start('0', 'inf'), start('0', 'close')]
    alone = start('0')
    subprocess.run(['kill', '-9', str(alone.child)], check=True)
    wait_until(lambda: not alone.has_child)
    assert 'did turn' in alone.tell('turn')  # calls `feed` for three times the timeout
    assert [parent.process.poll() for parent in parents] == [None] * 4
    assert [parent.has_child for parent in parents] == [True, True, True, False]
    assert 'did close' in alone.tell('close')


def test_a_slice_that_took_long_counts_once(monkeypatch):
    """The watchdog waits for all parts of its timeout, even if one part takes very long."""
    slices, killed = [], []
    answers = [([0], [], [])]

    def select(readers, _writers, _errors, timeout_s):
        slices.append(timeout_s)
        return answers.pop() if answers else ([], [], [])

    monkeypatch.setattr(hang_watch.select, 'select', select)
    monkeypatch.setattr(hang_watch.os, 'read', lambda *_: hang_watch._ALLOWANCE.pack(1.0))
    monkeypatch.setattr(hang_watch.os, 'getppid', lambda: 7)
    monkeypatch.setattr(hang_watch.os, 'kill', lambda *what: killed.append(what))
    hang_watch.watch(7, 3)
    assert slices == [None, 0.25, 0.25, 0.25, 0.25]
    assert killed == [(7, signal.SIGKILL)]
