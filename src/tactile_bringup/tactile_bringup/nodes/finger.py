# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes of a finger in one process: their stages call each other.

A block goes from the sensor's thread through features and classifier in one call, under a lock
that these nodes share. The nodes keep their names, parameters, services and lifecycle; the same
topics come out, and a message is built only where somebody subscribes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import threading
from typing import Any

from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_features.slip_detector_node import SlipDetectorNode
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_ros.node.stage_node import StageNode
from tactile_ros.strain import StrainBlock
from tendon_sensor_driver.tendon_sensor_node import TendonSensorNode


def connect_fingers(nodes: Iterable[Any]) -> None:
    """Have the nodes of each finger call each other; before they are configured.

    Nodes of one namespace are a finger. Without a sensor node among them, samples come from the
    topic of one elsewhere.

    Parameters
    ----------
    nodes : iterable of rclpy.node.Node
        Others than those of sensing are passed over.
    """
    fingers: dict[str, dict[type, Any]] = {}
    for node in nodes:
        if isinstance(node, StageNode):
            fingers.setdefault(node.get_namespace(), {})[type(node)] = node
    for finger in fingers.values():
        _connect(
            finger.get(TendonSensorNode),
            finger.get(TactileFeaturesNode),
            finger.get(SlipDetectorNode),
            finger.get(TactileClassifierNode),
        )


def sources_last(nodes: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return nodes by name in the order to bring them up: none misses a sensor's first sample."""
    return sorted(nodes.items(), key=lambda item: isinstance(item[1], TendonSensorNode))


def _connect(
    sensor: TendonSensorNode | None,
    features: TactileFeaturesNode | None,
    slip: SlipDetectorNode | None,
    classifier: TactileClassifierNode | None,
) -> None:
    lock = threading.RLock()
    for node in (features, slip, classifier):
        if node is not None:
            node.lock = lock
    if features is not None and classifier is not None:
        classifier.is_fed_by_calls = True
        features.emit = classifier.add_window
    if sensor is None:
        return
    takers = [node for node in (features, slip) if node is not None]
    for taker in takers:
        taker.is_fed_by_calls = True
    if features is not None and slip is not None:
        features.emit_event = slip.add_event
    inputs = [taker.add_block for taker in takers]

    def take(block: StrainBlock) -> None:
        with lock:  # no node sees the next block before the others have seen this one
            for add_block in inputs:
                add_block(block)

    sensor.emit = take
