# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers that wait for a condition. Tests never wait for a fixed time."""

import os
import time

DEADLINE_S = 20.0
"""Time-out [s]. It is much longer than any condition needs, but shorter than the 30 s after which
the tendon actuator slackens an unused tendon."""


def read_stderr():
    """Return the text on standard error that pytest's ``capfd`` has captured, without removing it.

    ``capfd.readouterr`` empties the file, and loses text that another thread writes meanwhile.
    """
    return os.pread(2, 2**20, 0).decode(errors='replace')


def wait_until(
    condition,
    what='the condition was not met in time',
    timeout_s=DEADLINE_S,
    step=None,
    poll_s=0.002,
):
    """Return the first true value of a condition; fail after a time-out.

    ``condition`` is called repeatedly. ``what`` is the error message after the time-out, or a
    function that returns it. Set ``timeout_s`` only if the test is about time, or if programs have
    to start. ``step`` is called between two checks, for example to spin an executor once. If it is
    None, the pause between two checks is ``poll_s``.
    """
    deadline_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what() if callable(what) else what
        if step is not None:
            step()
        else:
            time.sleep(poll_s)
    return found
