# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The topics that a node must hear from while it moves something.

The node is passed in, so this module itself knows no ROS.
"""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from linear_guide_driver.heartbeat import Heartbeat

WATCH_PERIOD_S = 0.02


class Needs:
    """Subscriptions whose silence ends motion.

    Parameters
    ----------
    node : rclpy.node.Node
    on_loss : callable
        Called with a sentence, on the executor's thread, when one falls silent.
    """

    def __init__(self, node: Any, on_loss: Callable[[str], None]) -> None:
        self._node, self._on_loss = node, on_loss
        self._hearts: list[Heartbeat] = []
        self._subscriptions: list[Any] = []
        self._timer = node.create_timer(WATCH_PERIOD_S, self._check)

    def add(
        self,
        message_type: type,
        topic: str,
        timeout_s: float,
        qos: Any,
        is_sign: Callable[[Any], bool] = lambda _: True,
    ) -> None:
        """Need messages on a topic.

        Parameters
        ----------
        message_type : type
        topic : str
        timeout_s : float
            Longest silence [s].
        qos : rclpy.qos.QoSProfile
        is_sign : callable
            Whether a message counts.
        """
        heart = Heartbeat(topic, timeout_s)

        def hear(message: Any) -> None:
            if is_sign(message):
                heart.beat(time.monotonic_ns())

        self._hearts.append(heart)
        self._subscriptions.append(self._node.create_subscription(message_type, topic, hear, qos))

    def describe_silence(self) -> str:
        """Return what is missing; empty when nothing is."""
        now_ns = time.monotonic_ns()
        return ' '.join(filter(None, (heart.describe_silence(now_ns) for heart in self._hearts)))

    def close(self) -> None:
        """Take timer and subscriptions away."""
        self._node.destroy_timer(self._timer)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _check(self) -> None:
        now_ns = time.monotonic_ns()
        for heart in self._hearts:
            if loss := heart.take_loss(now_ns):
                self._on_loss(loss)
