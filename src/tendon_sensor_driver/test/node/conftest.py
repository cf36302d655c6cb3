# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures with the sensor node, which runs in the process of the test."""

from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from tactile_msgs.msg import StrainBlock, Tare
from tactile_ros.qos import STREAM
from tactile_testing.waiting import wait_until
from tendon_sensor_driver.tendon_sensor_node import TendonSensorNode


class Graph:
    """The sensor node, and a second node that stores the messages of the sensor node."""

    def __init__(self, context, port, **parameters):
        self.node = TendonSensorNode(
            context=context,
            namespace='left',
            parameter_overrides=[
                Parameter('port', value=port),
                Parameter('frame_id', value='left_link'),
                *(Parameter(name, value=value) for name, value in parameters.items()),
            ],
        )
        self.listener = Node('listener', context=context)
        self.strain, self.wrench, self.diagnostics, self.tares = [], [], [], []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for kind, topic, heard, qos in (
            (StrainBlock, '/left/tendon_sensor/strain', self.strain, STREAM),
            (WrenchStamped, '/left/tendon_sensor/wrench', self.wrench, STREAM),
            (DiagnosticArray, '/diagnostics', self.diagnostics, 10),
            (Tare, '/left/tendon_sensor/tare_state', self.tares, latched),
        ):
            self.listener.create_subscription(kind, topic, heard.append, qos)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.listener)

    def bring_up(self):
        assert self.node.bring_up()
        self.spin_until(self.is_matched)

    def spin_until(self, condition):
        step = partial(self.executor.spin_once, timeout_sec=0.05)
        wait_until(condition, lambda: f'diagnostics: {self.sentence()!r}', step=step)

    def await_health(self, level, named=''):
        """Wait for diagnostics with this level and a message that contains ``named``."""

        def is_there():
            if not self.diagnostics:
                return False
            status = self.diagnostics[-1].status[0]
            return status.level == level and named in status.message

        self.spin_until(is_there)

    def await_more(self, count=1):
        """Wait for ``count`` more blocks; return the index of the first one in ``strain``."""
        first = len(self.strain)
        self.spin_until(lambda: len(self.strain) >= first + count)
        return first

    def is_matched(self):
        """Return True if all publishers and subscriptions of the two nodes have matched."""
        topics = {f'/left/tendon_sensor/{topic}' for topic in ('strain', 'wrench')}
        writers = [p for p in self.node.publishers if p.topic_name in topics]
        readers = [s for s in self.listener.subscriptions if s.topic_name in topics]
        return (
            len(writers) == len(readers) == 2
            and all(writer.get_subscription_count() for writer in writers)
            and all(reader.get_publisher_count() for reader in readers)
        )

    def call(self, name):
        """Call a service of the sensor node, and return its response."""
        client = self.listener.create_client(Trigger, f'/left/tendon_sensor/{name}')
        self.spin_until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.spin_until(future.done)
        return future.result()

    def sentence(self):
        return self.diagnostics[-1].status[0].message if self.diagnostics else ''

    def values(self):
        if not self.diagnostics:
            return {}
        return {pair.key: pair.value for pair in self.diagnostics[-1].status[0].values}

    def close(self):
        self.node.take_down()
        self.listener.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def make_graph(context, monkeypatch):
    monkeypatch.setattr('tactile_ros.health.PERIOD_S', 0.25)
    monkeypatch.setattr('tendon_sensor_driver.topic_sensor.LOOK_PERIOD_S', 0.05)
    graphs = []

    def make(port, **parameters):
        graphs.append(Graph(context, port, **parameters))
        return graphs[-1]

    yield make
    for graph in graphs:
        graph.close()


@pytest.fixture
def graph(make_graph, sensor):
    return make_graph(sensor.port)
