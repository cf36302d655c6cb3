# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node in process, over real DDS and a real pty."""

import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from domain_coordinator import domain_id
from geometry_msgs.msg import WrenchStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from tactile_msgs.msg import StrainBlock

from tactile_ros.qos import STREAM
from tendon_sensor_driver.tendon_sensor_node import TendonSensorNode


@pytest.fixture
def context():
    with domain_id() as domain:
        context = Context()
        rclpy.init(context=context, domain_id=int(domain))
        yield context
        rclpy.try_shutdown(context=context)


class Graph:
    """The node under test, and a second one that keeps what it hears."""

    def __init__(self, context, port):
        self.node = TendonSensorNode(
            context=context,
            namespace='left',
            parameter_overrides=[
                Parameter('port', value=port),
                Parameter('frame_id', value='left_link'),
            ],
        )
        self.listener = Node('listener', context=context)
        self.strain, self.wrench, self.diagnostics = [], [], []
        for kind, topic, heard, qos in (
            (StrainBlock, '/left/tendon_sensor/strain', self.strain, STREAM),
            (WrenchStamped, '/left/tendon_sensor/wrench', self.wrench, STREAM),
            (DiagnosticArray, '/diagnostics', self.diagnostics, 10),
        ):
            self.listener.create_subscription(kind, topic, heard.append, qos)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.listener)

    def spin_until(self, condition, timeout_s=10.0):
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, 'the condition did not come true in time'
            self.executor.spin_once(timeout_sec=0.05)

    def is_matched(self):
        return all(
            self.listener.count_publishers(f'/left/tendon_sensor/{topic}')
            and self.node.count_subscribers(f'/left/tendon_sensor/{topic}')
            for topic in ('strain', 'wrench')
        )

    def values(self):
        if not self.diagnostics:
            return {}
        return {pair.key: pair.value for pair in self.diagnostics[-1].status[0].values}

    def close(self):
        self.node.take_down()
        self.listener.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def graph(context, sensor):
    graph = Graph(context, sensor.port)
    yield graph
    graph.close()


def test_samples_arrive_and_a_lost_one_is_visible(graph, sensor):
    assert graph.node.bring_up()
    graph.spin_until(graph.is_matched)
    sensor.write(b'\n')
    numbers = [0, 1, 2, 4, 5]
    for number in numbers:
        sensor.write_reading(1000 + number * 1000 // 60, number / 10)
    graph.spin_until(lambda: len(graph.strain) == len(graph.wrench) == 5)
    assert [message.sequence for message in graph.strain] == numbers
    assert [message.lost_before for message in graph.strain] == [0, 0, 0, 1, 0]
    newtons = [number / 10 * 9.80665 for number in numbers]
    assert [list(message.tension_n) for message in graph.strain] == [[n] for n in newtons]
    assert [message.wrench.force.x for message in graph.wrench] == newtons
    for strain, wrench in zip(graph.strain, graph.wrench, strict=True):
        assert strain.header == wrench.header
        assert strain.header.frame_id == 'left_link'
    graph.spin_until(lambda: graph.values().get('lost_samples') == '1')
    status = graph.diagnostics[-1].status[0]
    assert (status.level, status.name) == (DiagnosticStatus.WARN, 'left/tendon_sensor')
    assert status.hardware_id == sensor.port


def test_deactivate_stops_the_samples_and_keeps_the_link(graph, sensor):
    assert graph.node.bring_up()
    graph.spin_until(graph.is_matched)
    sensor.write(b'\n')
    sensor.write_reading(0)
    graph.spin_until(lambda: graph.strain and graph.wrench)
    assert graph.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    sensor.write_reading(17)
    graph.spin_until(lambda: graph.values().get('readings') == '2')
    assert len(graph.strain) == len(graph.wrench) == 1

    assert graph.node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    sensor.write_reading(33)
    graph.spin_until(lambda: len(graph.strain) == 2)
    assert [message.sequence for message in graph.strain] == [0, 2]


def test_configure_fails_cleanly_without_a_port_and_works_once_there_is_one(graph, sensor):
    sensor.unplug()
    assert graph.node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert not graph.node.bring_up()
    sensor.plug_in()
    assert graph.node.bring_up()
    graph.spin_until(graph.is_matched)
    sensor.write(b'\n')
    sensor.write_reading(0)
    graph.spin_until(lambda: graph.strain)


def test_cleanup_closes_the_port_and_configure_opens_it_again(graph, sensor):
    for _ in range(2):
        assert graph.node.bring_up()
        assert graph.node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
        assert graph.node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
        assert graph.node.count_publishers('/left/tendon_sensor/strain') == 0
    assert graph.node.bring_up()


def test_an_unplugged_sensor_is_an_error_until_it_is_back(graph, sensor):
    assert graph.node.bring_up()
    sensor.unplug()
    graph.spin_until(lambda: graph.values().get('is_connected') == 'False')
    assert graph.diagnostics[-1].status[0].level == DiagnosticStatus.ERROR
    assert sensor.port in graph.diagnostics[-1].status[0].message
    sensor.plug_in()
    graph.spin_until(lambda: graph.values().get('reconnects') == '1')
    assert graph.diagnostics[-1].status[0].level != DiagnosticStatus.ERROR


def test_a_silent_sensor_is_a_warning(graph):
    assert graph.node.bring_up()
    graph.spin_until(
        lambda: graph.diagnostics and 'no reading' in graph.diagnostics[-1].status[0].message
    )
    assert graph.diagnostics[-1].status[0].level == DiagnosticStatus.WARN
