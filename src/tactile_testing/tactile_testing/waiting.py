# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers that wait for a condition. Tests never wait for a fixed time."""

import os
import time

DEADLINE_S = 20.0
"""Default time-out [s].

It is long enough for any condition, but shorter than the 30 s after which the tendon actuator
slackens an unused tendon.
"""


def read_stderr():
    """Return the text on standard error that pytest's ``capfd`` has captured, without removing it.

    ``capfd.readouterr`` would empty the captured file, and could lose text that another thread
    writes at that moment.
    """
    return os.pread(2, 2**20, 0).decode(errors='replace')


def wait_until(
    condition,
    what='the condition was not met in time',
    timeout_s=DEADLINE_S,
    step=None,
    poll_s=0.002,
):
    """Call a condition until its result is true, and return this result; fail after a time-out.

    ``what`` is the error message after the time-out, or a function that returns it. Set
    ``timeout_s`` only if the test is about time, or if programs have to start. ``step`` is called
    between two calls of ``condition``, for example to spin an executor once. If ``step`` is None,
    the function sleeps for ``poll_s`` instead.
    """
    deadline_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what() if callable(what) else what
        if step is not None:
            step()
        else:
            time.sleep(poll_s)
    return found
