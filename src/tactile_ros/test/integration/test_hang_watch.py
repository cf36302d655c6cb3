# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The watch of a hung process; each parent is a process of its own, which may be killed."""

from pathlib import Path
import signal
import subprocess
import sys

import pytest

from tactile_ros import hang_watch
from tactile_testing.waiting import wait_until

TIMEOUT_S = 0.5

PARENT = f"""
import sys, time
from tactile_ros.hang_watch import HangWatch
watch = HangWatch({TIMEOUT_S})
print(watch._child.pid, flush=True)
for line in sys.stdin:
    if line.strip() == 'turn':
        end_s = time.monotonic() + 3 * {TIMEOUT_S}
        while time.monotonic() < end_s:
            watch.turn()
            time.sleep(0.02)
    elif line.strip() == 'close':
        watch.close()
        watch.close()
        watch.turn()
    else:
        watch.turn(float(line))
    print('did', line.strip(), flush=True)
"""


class Parent:
    """A process with a `HangWatch` that does what it is told."""

    def __init__(self):
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            [sys.executable, '-c', PARENT], stdin=pipe, stdout=pipe, stderr=pipe, text=True
        )
        self.child = int(self.process.stdout.readline())

    def tell(self, line):
        """Tell what to do and wait until it is done."""
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
def parent():
    parent = Parent()
    yield parent
    parent.process.kill()
    parent.process.communicate()
    wait_until(lambda: not parent.has_child)  # it ends with its parent


def test_a_frozen_process_is_killed_and_one_that_turns_is_not(parent):
    assert 'did turn' in parent.tell('turn')
    parent.process.send_signal(signal.SIGSTOP)
    parent.wait_for_the_kill()


def test_a_process_whose_worker_hangs_is_killed(parent):
    parent.tell('0')
    parent.wait_for_the_kill()


@pytest.mark.parametrize('last', ['', '60', 'inf', 'close'])
def test_a_process_that_need_not_turn_is_left_alone(parent, last):
    if last:
        parent.tell('0')
        parent.tell(last)
    else:
        pass  # it has not begun to turn: its device is still being set up
    with pytest.raises(subprocess.TimeoutExpired):
        parent.process.wait(4 * TIMEOUT_S)
    assert parent.has_child == (last != 'close')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_the_child_outlives_a_signal_to_all_and_watches_on(parent, number):
    parent.tell('0')
    subprocess.run(['kill', f'-{number.value}', str(parent.child)], check=True)
    parent.wait_for_the_kill()


def test_without_the_child_the_process_goes_on(parent):
    parent.tell('0')
    subprocess.run(['kill', '-9', str(parent.child)], check=True)
    wait_until(lambda: not parent.has_child)
    assert 'did turn' in parent.tell('turn')
    assert 'did close' in parent.tell('close')


def test_a_slice_that_took_long_counts_once(monkeypatch):
    """Where the child itself got no core for long, it waits for further slices."""
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
