# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signals are never lost, whichever thread takes them and whatever the main thread waits for."""

import signal
import subprocess
import sys

import pytest

DEADLINE_S = 20.0

TAKEN_ELSEWHERE = """
import os, signal, sys, threading, time
from tactile_ros.programs.signals import hold_signals, ignore_signals

signals = hold_signals()
NUMBER = int(sys.argv[1])

def take():
    # As when the system gives the signal to a thread that is not the main one.
    time.sleep(0.2)  # nobody else sees when the main thread has begun to wait
    signal.pthread_kill(threading.get_ident(), NUMBER)
    time.sleep(60)

threading.Thread(target=take, daemon=True).start()
"""


def run(program, *arguments):
    return subprocess.run(
        [sys.executable, '-c', program, *arguments],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_wait_without_limit_ends_with_a_signal_that_another_thread_takes(number):
    program = TAKEN_ELSEWHERE + 'assert signals.wait() and signals.received == NUMBER'
    done = run(program, str(int(number)))
    assert done.returncode == 0, done.stderr


def test_a_signal_just_before_a_wait_ends_it():
    done = run(
        'import os, signal\n'
        'from tactile_ros.programs.signals import hold_signals\n'
        'signals = hold_signals()\n'
        'os.kill(os.getpid(), signal.SIGTERM)\n'
        'assert signals.wait()\n'
        'assert signals.received == signal.SIGTERM\n'
        'assert hold_signals() is signals\n'
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_work_is_interrupted_in_any_wait_and_only_once(number):
    program = (
        TAKEN_ELSEWHERE
        + """
try:
    with signals.raising():
        threading.Event().wait()
except KeyboardInterrupt:
    os.kill(os.getpid(), NUMBER)  # clearing up is not interrupted
    time.sleep(0.2)  # for an interrupt that must not come
    print('cleared up')
"""
    )
    done = run(program, str(int(number)))
    assert done.stdout == 'cleared up\n', done.stderr
    assert done.returncode == 0


def test_a_signal_that_came_before_interrupts_at_once():
    done = run(
        'import os, signal\n'
        'from tactile_ros.programs.signals import hold_signals\n'
        'signals = hold_signals()\n'
        'os.kill(os.getpid(), signal.SIGINT)\n'
        'try:\n'
        '    with signals.raising():\n'
        '        print("work")\n'
        'except KeyboardInterrupt:\n'
        '    print("interrupted")\n'
    )
    assert done.stdout == 'interrupted\n', done.stderr


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_for_the_end_of_what_must_not_be_interrupted(number):
    done = run(
        'import os, signal, sys, time\n'
        'from tactile_ros.programs.signals import hold_signals, uninterrupted\n'
        'signals = hold_signals()\n'
        'try:\n'
        '    with signals.raising():\n'
        '        with uninterrupted():\n'
        '            print("quiet")\n'
        '        with uninterrupted():\n'
        '            os.kill(os.getpid(), int(sys.argv[1]))\n'
        '            time.sleep(0.2)  # for an interrupt that must not come\n'
        '            with uninterrupted():\n'
        '                print("at rest")\n'
        '        print("not reached")\n'
        'except KeyboardInterrupt:\n'
        '    print("interrupted")\n',
        str(int(number)),
    )
    assert done.stdout == 'quiet\nat rest\ninterrupted\n', done.stderr


def test_a_forked_child_has_the_usual_handlers_and_does_not_disturb_its_parent():
    done = run(
        'import os, signal, time\n'
        'from tactile_ros.programs.signals import hold_signals\n'
        'signals = hold_signals()\n'
        'child = os.fork()\n'
        'if not child:\n'
        '    time.sleep(60)\n'
        'os.kill(child, signal.SIGTERM)\n'
        '_, status = os.waitpid(child, 0)\n'
        'assert os.WTERMSIG(status) == signal.SIGTERM\n'
        'assert not signals.wait(0.1)\n'
    )
    assert done.returncode == 0, done.stderr


def test_interruptible_work_returns_raises_or_is_given_up():
    done = run(
        'import os, signal, threading\n'
        'from tactile_ros.programs import signals as module\n'
        'module.INTERRUPT_TIMEOUT_S = 0.1\n'
        'signals = module.hold_signals()\n'
        'assert signals.run(lambda: 7, print) == 7\n'
        'try:\n'
        '    signals.run(lambda: 1 / 0, print)\n'
        'except ZeroDivisionError:\n'
        '    print("raised")\n'
        'ending = threading.Event()\n'
        'def work():\n'
        '    os.kill(os.getpid(), signal.SIGINT)\n'
        '    ending.wait()\n'
        '    return "ended"\n'
        'module.INTERRUPT_TIMEOUT_S = 10.0\n'
        'assert signals.run(work, ending.set) == "ended"\n'
        'assert signals.run(lambda: print("not begun"), print) is None\n'
        'signals.received = 0\n'
        'module.INTERRUPT_TIMEOUT_S = 0.1\n'
        'ending.clear()\n'
        'assert signals.run(work, lambda: None) is None\n'
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == 'raised\n'


def test_ignored_signals_leave_the_exit_code():
    done = run(
        'import os, signal\n'
        'from tactile_ros.programs.signals import hold_signals, ignore_signals\n'
        'hold_signals()\n'
        'ignore_signals()\n'
        'os.kill(os.getpid(), signal.SIGTERM)\n'
        'os.kill(os.getpid(), signal.SIGINT)\n'
    )
    assert done.returncode == 0, done.stderr
