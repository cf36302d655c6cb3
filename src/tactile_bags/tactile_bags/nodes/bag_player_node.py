# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Node that plays the samples and events of a recording, and publishes the recorded time."""

from __future__ import annotations

from pathlib import Path
import threading
import time
import traceback
from typing import Any

from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_ros.bag_configs import PlayerConfig
from tactile_ros.lifecycle import TactileNode
from tactile_ros.message_classes import message_class
from tactile_ros.node_group import run_node
from tactile_ros.qos import CLOCK, EVENTS, STREAM
from tactile_ros.topics import EVENT, STRAIN

CLOCK_PERIOD_S = 0.02
"""Longest period of ``/clock``, in wall time [s]."""

ACKNOWLEDGE_TIMEOUT_S = 5.0
"""After the last message, longest time to wait for the acknowledgements of all subscribers [s]."""


class BagPlayerNode(TactileNode):
    """Node that plays a bag with the timing of the recording, and then finishes.

    Only samples and events are published. From these, the nodes of a finger compute features and
    classifications again. For nodes with ``use_sim_time``, ``/clock`` publishes the time of the
    recording. ``message_count`` is the number of messages that were played so far.
    """

    def __init__(self, node_name: str = 'bag_player', **node_options: Any) -> None:
        super().__init__(node_name, PlayerConfig, **node_options)
        self._bag: TactileBag | None = None
        self._outputs: dict[str, Any] = {}
        self._clock_publisher: Any = None
        self._thread: threading.Thread | None = None
        self._end = threading.Event()
        self.message_count = 0

    def set_up(self, config: PlayerConfig) -> None:
        if not config.bag:
            raise ValueError('parameter bag is empty; set it to the folder of the recording')
        bag = self._bag = TactileBag(Path(config.bag))
        wanted = config.namespace.strip('/')
        if wanted and wanted not in bag.namespaces:
            found = ', '.join(bag.namespaces) or 'the root'
            raise ValueError(f'{bag.path} contains no finger {wanted}; it contains {found}')
        for topic in bag.stored_topics:
            if topic.type_name in (STRAIN, EVENT) and not topic.name.endswith('/detected_events'):
                self._outputs[topic.name] = self.create_publisher(
                    message_class(topic.type_name),
                    topic.name,
                    EVENTS if topic.type_name == EVENT else STREAM,
                )
        self._clock_publisher = self.create_publisher(Clock, '/clock', CLOCK)

    def start(self) -> None:
        self._end.clear()
        self._thread = threading.Thread(target=self._play, name='bag player', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._end.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def tear_down(self) -> None:
        self.stop()
        for publisher in self._outputs.values():
            self.destroy_publisher(publisher)
        self._outputs = {}
        if self._clock_publisher is not None:
            self.destroy_publisher(self._clock_publisher)
            self._clock_publisher = None
        if self._bag is not None:
            self._bag.close()
            self._bag = None

    # -- in the player's thread --------------------------------------------------------------

    def _play(self) -> None:
        try:
            self._wait_for_subscribers()
            if self._end.wait(self.config.start_delay_s) or not self._send_all():
                return
            for publisher in self._outputs.values():
                publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT_S))
            self.get_logger().info(f'played {self.message_count} messages')
        except BagError as error:
            self.get_logger().error(f'{error}')
            self.has_failed = True
        except Exception:  # otherwise the node would wait for this thread forever
            self.get_logger().error(f'the recording cannot be played:\n{traceback.format_exc()}')
            self.has_failed = True
        self.is_finished = True

    def _wait_for_subscribers(self) -> None:
        end_s = time.monotonic() + self.config.subscriber_timeout_s
        while (left_s := end_s - time.monotonic()) > 0:
            if all(output.get_subscription_count() for output in self._outputs.values()):
                return
            if self._end.wait(min(left_s, CLOCK_PERIOD_S)):
                return

    def _send_all(self) -> bool:
        """Send every message at its time; return False if playing was stopped."""
        assert self._bag is not None
        namespace = self.config.namespace.strip('/') or None
        first_ns: int | None = None
        started_ns = time.monotonic_ns()
        for message in self._bag.messages(STRAIN, EVENT, namespace=namespace):
            publisher = self._outputs.get(message.topic)
            if publisher is None:
                continue
            if first_ns is None:
                first_ns = message.received_at_ns
            due_ns = started_ns + round((message.received_at_ns - first_ns) / self.config.rate)
            if not self._wait_until(due_ns, message.received_at_ns):
                return False
            publisher.publish(message.data)
            self.message_count += 1
        return True

    def _wait_until(self, due_ns: int, bag_ns: int) -> bool:
        """Wait until the monotonic time ``due_ns``, and publish the time of the recording.

        At ``due_ns``, the published time is ``bag_ns``. Return False if playing was stopped.
        """
        while (left_ns := due_ns - time.monotonic_ns()) > 0:
            self._publish_time(bag_ns - round(left_ns * self.config.rate))
            if self._end.wait(min(left_ns * 1e-9, CLOCK_PERIOD_S)):
                return False
        self._publish_time(bag_ns)
        return not self._end.is_set()

    def _publish_time(self, bag_ns: int) -> None:
        message = Clock()
        sec, message.clock.nanosec = divmod(max(0, bag_ns), 10**9)
        message.clock.sec = min(sec, 2**31 - 1)
        self._clock_publisher.publish(message)


def main() -> int:
    """Run the node in its own process, until the recording has been played."""
    return run_node(BagPlayerNode)
