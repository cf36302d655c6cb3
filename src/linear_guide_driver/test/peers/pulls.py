# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A pull in the background, and how it ends."""

from background import Background

from linear_guide_driver import MotionFailedError
from tactile_testing.waiting import wait_until


def begin_pull(tendon, servo, *arguments):
    """Return a pull by 20 mm that is on its way."""
    pull = Background(tendon.pull_to, 0.02, 0.01, *arguments)
    wait_until(lambda: servo.position > 2100)
    return pull


def check_failure(pull, text):
    error = pull.end()
    assert isinstance(error, MotionFailedError)
    assert text in str(error)
