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
    """Return a condition's first true value; fail when none comes in time.

    ``condition``: asked again and again. ``what``: what is said, or returns what is said, when the
    time is over. ``timeout_s``: give it where the time is what is tested, or where whole programs
    have to start. ``step``: what is done between two looks, such as spinning an executor once.
    ``poll_s``: pause between two looks.
    """
    deadline_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what() if callable(what) else what
        if step is not None:
            step()
        else:
            time.sleep(poll_s)
    return found
