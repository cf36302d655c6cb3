# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Waiting in tests: always for a condition, never for time to pass."""

import os
import time

DEADLINE_S = 20.0
"""Far more than anything needs, and less than the 30 s after which a tendon slackens anyway."""


def read_stderr():
    """Return all that has come on standard error under pytest's ``capfd``, and leave it there.

    ``capfd.readouterr`` loses what another thread writes while it empties the file.
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
    function that returns it. Give ``timeout_s`` if the time is tested, or if whole programs have
    to start. ``step`` is called between two checks, for example to spin an executor once.
    ``poll_s`` is the pause between two checks.
    """
    deadline_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what() if callable(what) else what
        if step is not None:
            step()
        else:
            time.sleep(poll_s)
    return found
