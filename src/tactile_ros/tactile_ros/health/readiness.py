# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publisher of a node's readiness for goals, on its latched topic ``~/ready``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import threading

from tactile_msgs.msg import Readiness
from tactile_ros.node.lifecycle import TactileNode
from tactile_ros.qos import LATEST

PERIOD_S = 0.1


class ReadinessPublisher:
    """Publishes ``~/ready`` once at the start and then at each change.

    Parameters
    ----------
    node : TactileNode
    find_missing : callable
        Returns a sentence for each thing that is missing; asked ten times a second on the
        thread of periodic calls, and by `update`. Not asked any more when `close` has returned.

    Attributes
    ----------
    missing : list of str or None
        The sentences published last; None: none yet.
    """

    def __init__(self, node: TactileNode, find_missing: Callable[[], Sequence[str]]) -> None:
        self._node, self._find_missing = node, find_missing
        self._lock = threading.Lock()  # no older answer is published after a newer one
        self._is_closed = False
        self.missing: list[str] | None = None
        self._publisher = node.create_publisher(Readiness, '~/ready', LATEST)
        self._calls = node.call_every(PERIOD_S, self.update)

    def update(self) -> None:
        """Publish if something has changed."""
        with self._lock:
            if self._is_closed:
                return
            missing = list(self._find_missing())
            if missing == self.missing:
                return
            self.missing = missing
            message = Readiness(ready=not missing, missing=missing)
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._publisher.publish(message)

    def close(self) -> None:
        """Publish no more. Harmless when called twice."""
        self._calls.cancel()
        with self._lock:
            if not self._is_closed:
                self._is_closed = True
                self._node.destroy_publisher(self._publisher)
