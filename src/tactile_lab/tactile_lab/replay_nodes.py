# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Replay of a recording through the nodes of features and classifier."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
import time
from typing import Any

from rclpy.context import Context
from rclpy.node import Node

from tactile_bags.bag_reader import TactileBag
from tactile_bags.replay import sensed_messages, TactileResults
from tactile_bringup.launch_config.graph import (
    FEATURES_NODE,
    ModelChoice,
    NO_PORT,
    sensing_graph,
)
from tactile_bringup.nodes.graph_runner import create_node
from tactile_classifier.conversions import classification_from_msg
from tactile_features.config import FeatureConfig
from tactile_features.conversions import feature_window_from_msg
from tactile_msgs.msg import Classification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.errors import TactileError
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.rclpy_internals import Executor
from tactile_ros.topics import (
    CLASSIFICATION_TOPIC,
    EVENT,
    EVENT_TOPIC,
    FEATURES_TOPIC,
    STRAIN,
    STRAIN_TOPIC,
)

DEADLINE_S = 30.0
"""Longest wait for the results of the nodes [s]."""

BATCH = 200
"""Number of strain blocks to send before waiting for the nodes. It is smaller than the QoS depth
of the topics, so no block is lost."""


def replay_through_nodes(
    bag: TactileBag,
    models: Path | None,
    config: FeatureConfig,
    context: Context,
    *,
    expected: TactileResults,
    namespace: str = '',
    contact: str = '',
) -> TactileResults:
    """Send strain blocks and trial events of a recording to new nodes; return their results.

    The messages are sent, byte for byte, as fast as the nodes process them. This does not change
    the results, which depend on sample times and not on arrival times.

    Parameters
    ----------
    models : Path
        Folder of model files, or one file.
    context : rclpy.context.Context
        Context on a ROS domain without other publishers.
    expected : TactileResults
        The function waits for as many windows and classifications as these results contain.
    namespace : str
        Namespace of the finger in the recording.
    contact : str
        Only models of this contact are used; empty for all models.

    Raises
    ------
    TactileError
        When a node cannot be started, or does not respond in time.
    """
    results = TactileResults()
    executor = Executor(context=context)
    nodes: list[Any] = []
    player = Node('bag_player', context=context, namespace=namespace)
    try:
        executor.add_node(player)
        choice = ModelChoice.read(models, contact=contact)
        graph = sensing_graph(
            NO_PORT, choice, {FEATURES_NODE: asdict(config)}, namespace=namespace
        )
        for description in graph:
            node = create_node(description, context, quiet=True)
            nodes.append(node)
            if not node.bring_up():
                raise TactileError(f'the node {description.name} could not be started')
            executor.add_node(node)
        features = nodes[0]
        topics = {FEATURES_TOPIC.name: TactileFeatures}
        if choice:
            topics[CLASSIFICATION_TOPIC.name] = Classification

        def take(message: Any) -> None:
            if isinstance(message, TactileFeatures):
                results.windows.append(feature_window_from_msg(message))
            else:
                results.classifications.append(classification_from_msg(message))

        for topic, message_type in topics.items():
            player.create_subscription(message_type, topic, take, RESULTS)
        publishers = {
            STRAIN: player.create_publisher(StrainBlock, STRAIN_TOPIC.name, STREAM),
            EVENT: player.create_publisher(TrialEvent, EVENT_TOPIC.name, EVENTS),
        }
        _spin_until(
            executor,
            lambda: all(p.get_subscription_count() > 0 for p in publishers.values())
            and all(player.count_publishers(player.resolve_topic_name(t)) > 0 for t in topics)
            and player.count_subscribers(player.resolve_topic_name(FEATURES_TOPIC.name))
            >= len(nodes),
            lambda: 'the nodes have not discovered each other',
        )
        sent = {STRAIN: 0, EVENT: 0}

        def lag() -> str:
            taken = {STRAIN: features.extractor.block_count, EVENT: features.extractor.event_count}
            return f'the nodes have processed {taken} of {sent} messages'

        for message in sensed_messages(bag, namespace):
            publishers[message.type_name].publish(message.data)
            sent[message.type_name] += 1
            # Wait after each event, because the QoS depth of its topic is small.
            if message.type_name == EVENT or sent[STRAIN] % BATCH == 0:
                _spin_until(executor, lambda: _caught_up(features, sent), lag)
        _spin_until(executor, lambda: _caught_up(features, sent), lag)
        _spin_until(
            executor,
            lambda: len(results.windows) >= len(expected.windows)
            and len(results.classifications) >= len(expected.classifications),
            lambda: f'the nodes published {len(results.windows)} windows and '
            f'{len(results.classifications)} classifications instead of '
            f'{len(expected.windows)} and {len(expected.classifications)}',
        )
    finally:
        for node in nodes:
            executor.remove_node(node)
            node.take_down()
        executor.remove_node(player)
        player.destroy_node()
        executor.shutdown()
    return results.sort()


def _caught_up(features: Any, sent: Mapping[str, int]) -> bool:
    extractor = features.extractor
    taken = extractor.block_count + extractor.event_count + features.message_guard.refused.count
    return bool(taken >= sum(sent.values()))


def _spin_until(
    executor: Executor, condition: Callable[[], bool], otherwise: Callable[[], str]
) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        if time.monotonic() > deadline:
            raise TactileError(f'replay through nodes: {otherwise()} within {DEADLINE_S:.0f} s')
        executor.spin_once(timeout_sec=0.05)
