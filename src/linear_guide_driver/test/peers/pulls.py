# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A pull in the background."""

from background import Background

from tactile_testing.waiting import wait_until


def begin_pull(tendon, servo, *arguments):
    """Return a pull by 20 mm that is on its way."""
    pull = Background(tendon.pull_to, 0.02, 0.01, *arguments)
    wait_until(lambda: servo.position > 2100)
    return pull
