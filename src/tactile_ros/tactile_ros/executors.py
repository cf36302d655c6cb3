# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The executor that all nodes run on, chosen by measurement; see docs/benchmarks.md."""

from __future__ import annotations

from typing import Any

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

try:
    from rclpy.experimental.events_executor import EventsExecutor
except ImportError:  # early Jazzy
    EventsExecutor = None


def make_executor(context: Context | None = None) -> Any:
    """Return a single-threaded executor: rclpy's events executor, where there is one.

    It waits for what comes; the older one goes through every subscription, service and timer
    of every node each time, which for a hand's nodes costs several times the work itself.
    Call its ``spin_once`` in a loop: in some releases its ``spin`` never dispatches.
    """
    if EventsExecutor is None:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)
