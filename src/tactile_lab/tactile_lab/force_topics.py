# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Forces that other nodes publish on topics, for `tactile devices` and `tactile check`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import functools
import time
from typing import Any

from tactile_bringup.nodes.graph_runner import ros_context
from tactile_lab.devices.checks import MakeSensor
from tactile_lab.devices.device_probe import FoundDevice
from tactile_ros.message_classes import message_class
from tactile_ros.node_group import NodeGroup
from tactile_ros.polling import PollingNode
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.topic_sensor import BEST_EFFORT, TopicClient
from tendon_sensor_driver.topic_stream import READERS

_OWN = '/tendon_sensor/wrench'  # published by our own sensor node


@contextmanager
def sensors_on_topics(namespace: str = '') -> Iterator[MakeSensor]:
    """Provide a function that creates the client of a sensor on a topic.

    The node that receives the topic runs until the block ends.
    """
    with listening_node(namespace) as node:
        yield lambda config, on_block, now_ns: TopicClient(node, config, on_block, now_ns)


@contextmanager
def listening_node(namespace: str = '') -> Iterator[PollingNode]:
    """Provide a node that is spun, on the ROS domain in the environment."""
    with ros_context() as context:
        node = PollingNode(
            'tactile_listener', TendonSensorConfig, context=context, namespace=namespace
        )
        with NodeGroup([node], context):
            yield node


def find_force_topics(listen_s: float) -> list[FoundDevice]:
    """Return the topics whose messages can contain a tension, with a description.

    ``listen_s`` is the time for which topics and messages are received [s].
    """
    heard: dict[str, list[Any]] = {}
    types: dict[str, str] = {}
    with listening_node() as node:
        until_s = time.monotonic() + listen_s
        while time.monotonic() < until_s:
            for topic, names in node.get_topic_names_and_types():
                known = [name for name in names if name in READERS]
                if known and topic not in types and not topic.endswith(_OWN):
                    types[topic] = known[0]
                    messages = heard.setdefault(topic, [])
                    node.poll(
                        message_class(known[0]),
                        topic,
                        functools.partial(_keep, messages),
                        BEST_EFFORT,
                    )
            time.sleep(0.1)
        publishers = {
            topic: [info.node_name for info in node.get_publishers_info_by_topic(topic)]
            for topic in types
        }
    return [
        _describe(topic, types[topic], publishers[topic], messages)
        for topic, messages in sorted(heard.items())
        if publishers[topic]
    ]


def _keep(messages: list[Any], message: Any, _: Any) -> None:
    messages.append(message)


def _describe(topic: str, type_name: str, nodes: list[str], messages: list[Any]) -> FoundDevice:
    what = f'{type_name.rpartition("/")[2]} of {", ".join(sorted(set(nodes)))}'
    parameters: dict[str, Any] = {'sensor': 'topic', 'topic': topic}
    what += f', {len(messages)} messages' if messages else ', silent'
    if messages and hasattr(messages[-1], 'effort'):
        message = messages[-1]
        joints = list(message.name)[: len(message.effort)]
        what += f'; joints with effort: {", ".join(joints) or "none"}'
        if len(joints) == 1:
            parameters['joint'] = joints[0]
    return FoundDevice(topic, 'sensor' if messages else '', what, parameters=parameters)
