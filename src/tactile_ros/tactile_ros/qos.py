# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The quality of service of every topic, in one place.

Publishers are reliable, which best-effort subscribers (REP-2003 sensor data)
can read too: a lost sample is a gap in a window, so nobody loses one by default.
"""

from functools import partial

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

_reliable = partial(
    QoSProfile, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE
)

STREAM = _reliable(depth=1000, durability=DurabilityPolicy.VOLATILE)
"""Samples: strain blocks, wrenches, joint states."""

NEWEST = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE
)
"""For who wants to know that samples come, and not each of them."""

RESULTS = _reliable(depth=100, durability=DurabilityPolicy.VOLATILE)
"""Features and classifications: a few a trial, each of them wanted."""

EVENTS = _reliable(depth=16, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Trial events, latched: the depth holds all the events of one trial."""

CLOCK = _reliable(depth=1, durability=DurabilityPolicy.VOLATILE)
"""Time on ``/clock``: nobody wants what it was before; best-effort listeners fit, too."""

LATEST = _reliable(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A state, latched: a late subscriber receives the present one."""
