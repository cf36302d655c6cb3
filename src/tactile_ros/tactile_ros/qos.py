# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""QoS profiles of all topics.

Publishers are reliable, because a lost sample would be missing in a feature window. Best-effort
subscriptions, such as those with the sensor data QoS of REP-2003, are compatible with them.
"""

from functools import partial

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

_reliable = partial(
    QoSProfile, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE
)

STREAM = _reliable(depth=1000, durability=DurabilityPolicy.VOLATILE)
"""QoS of topics with samples: strain blocks, wrenches and joint states."""

NEWEST = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE
)
"""QoS of subscriptions that need only the latest sample, to check that a publisher is alive."""

RESULTS = _reliable(depth=100, durability=DurabilityPolicy.VOLATILE)
"""QoS of features and classifications. There are a few messages per trial; none must be lost."""

EVENTS = _reliable(depth=16, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of trial events, which are latched. The depth is sufficient for the events of one trial."""

CLOCK = _reliable(depth=1, durability=DurabilityPolicy.VOLATILE)
"""QoS of the simulated time on ``/clock``, of which only the latest value is sent."""

LATEST = _reliable(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of a latched state: a subscriber that joins later receives the present state."""
