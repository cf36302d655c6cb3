# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""QoS profiles of all topics.

Publishers are reliable, because a lost sample is a gap in a window. Best-effort subscriptions
(sensor data of REP-2003) are compatible with them.
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
"""Latest sample only, best effort; for liveness checks."""

RESULTS = _reliable(depth=100, durability=DurabilityPolicy.VOLATILE)
"""Features and classifications: a few per trial, none of which may be lost."""

EVENTS = _reliable(depth=16, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Trial events, latched; the depth is sufficient for all events of one trial."""

CLOCK = _reliable(depth=1, durability=DurabilityPolicy.VOLATILE)
"""Time on ``/clock``: only the latest value; compatible with best-effort subscriptions."""

LATEST = _reliable(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A latched state: a late subscriber receives the present state."""
