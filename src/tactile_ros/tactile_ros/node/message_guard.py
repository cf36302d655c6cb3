# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages whose content is refused: they are counted, logged now and then, and shown."""

from __future__ import annotations

from collections.abc import Callable
import functools
import time
from typing import Any

from rclpy.node import Node

from tactile_ros.errors import MessageError

LOG_PERIOD_S = 10.0
"""The log mentions refused messages at most this often."""

SHOWN_S = 10.0
"""Diagnostics warn of a refused message for this long."""


class MessageGuard:
    """Keeps a node running when a message cannot be converted.

    A callback that raises `MessageError` ends with that message. Every other exception is a
    fault of the program and ends the node.

    Parameters
    ----------
    node : rclpy.node.Node
        Its logger is used.

    Attributes
    ----------
    refused_count : int
        Messages refused since the node was made.
    last_reason : str
        The topic of the last one, and why it was refused; empty when there is none.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.refused_count = 0
        self.last_reason = ''
        self._refused_at_s: float | None = None
        self._logged_at_s: float | None = None

    def wrap(self, topic: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return the callback of a subscription, guarded."""

        @functools.wraps(callback)  # rclpy looks at the signature
        def guarded(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except MessageError as error:
                self.refuse(topic, error)

        return guarded

    def refuse(self, topic: str, reason: object) -> None:
        """Count one refused message."""
        now_s = time.monotonic()
        self.refused_count += 1
        self.last_reason = f'{topic}: {reason}'
        self._refused_at_s = now_s
        if self._logged_at_s is None or now_s - self._logged_at_s >= LOG_PERIOD_S:
            self._logged_at_s = now_s
            self._node.get_logger().error(
                f'refused a message on {self.last_reason} (refused so far: {self.refused_count})'
            )

    @property
    def warning(self) -> str:
        """A sentence for `SHOWN_S` after a message was refused; empty otherwise."""
        at_s = self._refused_at_s
        if at_s is None or time.monotonic() - at_s > SHOWN_S:
            return ''
        return f'refused a message on {self.last_reason}'

    @property
    def values(self) -> dict[str, object]:
        """Values for diagnostics: count and last reason; empty until a message is refused."""
        if not self.refused_count:
            return {}
        return {'refused_messages': self.refused_count, 'last_refused_message': self.last_reason}
