# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Listens to a trial, so that its tension can be compared with that of others."""

from __future__ import annotations

import threading
import time

import numpy as np
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.node import Node

from tactile_bags import FEATURES_TOPIC, STRAIN_TOPIC
from tactile_features.conversions import feature_window_from_msg, strain_block_from_msg
from tactile_features.records import FeatureWindow
from tactile_msgs.msg import StrainBlock as StrainBlockMsg
from tactile_msgs.msg import TactileFeatures
from tactile_ros.node.message_guard import MessageGuard
from tactile_ros.qos import RESULTS, STREAM
from tactile_ros.strain import StrainBlock

WINDOW_TIMEOUT_S = 5.0
"""Longest wait for the features of a trial after its end [s]."""


class ObserverNode(Node):  # type: ignore[misc]
    """Keeps the samples since `begin` and the first feature window of each trial.

    Blocking calls, spun elsewhere.
    """

    def __init__(self, context: Context) -> None:
        super().__init__('trial_observer', context=context)
        self._arrived = threading.Condition()
        self._blocks: list[StrainBlock] = []
        self._windows: dict[str, FeatureWindow] = {}
        self._is_on = False
        guard = MessageGuard(self)
        for topic, kind, take, qos in (
            (STRAIN_TOPIC.name, StrainBlockMsg, self._on_block, STREAM),
            (FEATURES_TOPIC.name, TactileFeatures, self._on_window, RESULTS),
        ):
            self.create_subscription(kind, topic, guard.wrap(topic, take), qos)

    def _on_block(self, message: StrainBlockMsg) -> None:
        with self._arrived:
            if self._is_on:
                self._blocks.append(strain_block_from_msg(message))

    def _on_window(self, message: TactileFeatures) -> None:
        window = feature_window_from_msg(message)
        with self._arrived:
            if self._is_on and not window.partial:
                # The windows of one phase come in the order of their specifications.
                self._windows.setdefault(window.trial_id, window)
                self._arrived.notify_all()

    def begin(self) -> None:
        """Forget what came, and keep what comes."""
        with self._arrived:
            self._blocks, self._windows, self._is_on = [], {}, True

    def stop(self) -> None:
        """Forget what came, and keep no more: a person may take hours to answer."""
        with self._arrived:
            self._blocks, self._windows, self._is_on = [], {}, False

    def end(self, trial_id: str) -> tuple[FeatureWindow | None, NDArray[np.float64]]:
        """Return the feature window of a trial, once it has come, and the tension in it [N]."""
        deadline = time.monotonic() + WINDOW_TIMEOUT_S
        with self._arrived:
            while trial_id not in self._windows and (left_s := deadline - time.monotonic()) > 0:
                self._arrived.wait(left_s)
            window = self._windows.get(trial_id)
            values = [
                block.tension_n[i]
                for block in self._blocks
                for i in range(len(block.tension_n))
                if window is not None
                and window.window_start_ns
                <= block.stamp_ns + i * block.period_ns
                <= window.window_end_ns
            ]
        return window, np.array(values, dtype=np.float64)
