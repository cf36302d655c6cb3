# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""No signal is lost, even if another thread receives it or the main thread is waiting."""

import signal
import subprocess
import sys

import pytest

DEADLINE_S = 20.0

HOLD = """
import os, signal, sys, threading, time
from tactile_ros import process as module
from tactile_ros.process import hold_signals, ignore_signals, uninterrupted

signals = hold_signals()
NUMBER = int(sys.argv[1])
"""

TAKEN_ELSEWHERE = """
def take():
    # As when the system gives the signal to a thread that is not the main one.
    time.sleep(0.2)  # the start of the wait cannot be observed
    signal.pthread_kill(threading.get_ident(), NUMBER)
    time.sleep(60)

threading.Thread(target=take, daemon=True).start()
"""


def run(program, number=signal.SIGINT):
    """Run a program that calls `hold_signals` and receives ``number``; return its output."""
    done = subprocess.run(
        [sys.executable, '-c', HOLD + program, str(int(number))],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_wait_without_limit_ends_with_a_signal_before_or_in_it_whoever_takes_that():
    run(TAKEN_ELSEWHERE + 'assert signals.wait() and signals.received == NUMBER', signal.SIGTERM)
    run("""
os.kill(os.getpid(), NUMBER)
assert signals.wait()
assert signals.received == NUMBER
assert hold_signals() is signals
""")


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_work_is_interrupted_in_any_wait_and_only_once(number):
    program = """
try:
    with signals.raising():
        threading.Event().wait()
except KeyboardInterrupt:
    os.kill(os.getpid(), NUMBER)  # clearing up is not interrupted
    time.sleep(0.2)  # for an interrupt that must not come
    print('cleared up')
"""
    assert run(TAKEN_ELSEWHERE + program, number) == 'cleared up\n'


def test_a_signal_interrupts_at_once_or_after_what_must_not_be_interrupted():
    program = """
try:
    with signals.raising():
        with uninterrupted():
            print('quiet')
        with uninterrupted():
            os.kill(os.getpid(), NUMBER)
            time.sleep(0.2)  # for an interrupt that must not come
            with uninterrupted():
                print('at rest')
        print('not reached')
except KeyboardInterrupt:
    print('interrupted')
try:
    with signals.raising():
        print('not reached')
except KeyboardInterrupt:
    print('at once')
ignore_signals()
os.kill(os.getpid(), signal.SIGHUP)
os.kill(os.getpid(), signal.SIGTERM)
os.kill(os.getpid(), signal.SIGINT)
"""
    assert run(program, signal.SIGTERM) == 'quiet\nat rest\ninterrupted\nat once\n'


def test_what_nohup_has_started_goes_on_without_its_terminal():
    program = """
os.kill(os.getpid(), signal.SIGHUP)
assert not signals.wait(0.1)
os.kill(os.getpid(), signal.SIGINT)
assert signals.wait() and signals.received == signal.SIGINT
"""
    ignored = 'import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n'
    subprocess.run(
        [sys.executable, '-c', ignored + HOLD + program, '0'], check=True, timeout=DEADLINE_S
    )


def test_a_forked_child_has_the_usual_handlers_and_does_not_disturb_its_parent():
    run("""
child = os.fork()
if not child:
    time.sleep(60)
os.kill(child, signal.SIGTERM)
_, status = os.waitpid(child, 0)
assert os.WTERMSIG(status) == signal.SIGTERM
assert not signals.wait(0.1)
""")


def test_interruptible_work_returns_raises_or_is_given_up():
    program = """
assert signals.run(lambda: 7, print) == 7
try:
    signals.run(lambda: 1 / 0, print)
except ZeroDivisionError:
    print('raised')
ending = threading.Event()
def work():
    os.kill(os.getpid(), signal.SIGINT)
    ending.wait()
    return 'ended'
assert signals.run(work, ending.set) == 'ended'
assert signals.run(lambda: print('not begun'), print) is None
signals.received = 0
module.INTERRUPT_TIMEOUT_S = 0.1
ending.clear()
assert signals.run(work, lambda: None) is None
"""
    assert run(program) == 'raised\n'
