# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile check` and `tactile devices` for a sensor that another node publishes over DDS."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict
import math
import time

from geometry_msgs.msg import WrenchStamped
import pytest
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import JointState
from tactile_command import answer_of

from tactile_lab.devices.checks import check_sensor_samples
from tactile_lab.force_topics import sensors_on_topics
from tactile_ros.node_group import NodeGroup
from tendon_sensor_driver.config import TendonSensorConfig

MEASURED = {'sensor': 'topic', 'rate_hz': 0.0}
"""Parameters of a sensor node that reads a topic and measures its rate."""


class Hand(Node):
    """Publishes a wrench, or the efforts of two joints, at 100 Hz."""

    def __init__(self, context, topic, kind, offset_ns=0):
        super().__init__('their_hand', context=context)
        self.kind, self.offset_ns, self.count = kind, offset_ns, 0
        self.publisher = self.create_publisher(kind, topic, 10)
        self.start_ns = time.time_ns()
        self.create_timer(0.01, self.send)

    def send(self):
        value = math.sin(self.count / 7)
        stamp_ns = self.start_ns + self.count * 10_000_000 + self.offset_ns
        self.count += 1
        message = self.kind()
        message.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
        if self.kind is WrenchStamped:
            message.wrench.force.x = value
        else:
            message.name, message.effort = ['thumb', 'index'], [value, 2 * value]
        self.publisher.publish(message)


@pytest.fixture(autouse=True)
def _domain(context, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(context.get_domain_id()))


@contextmanager
def publishing(context, *nodes):
    with NodeGroup([Hand(context, *options) for options in nodes], context):
        yield


def describe(problems):
    return ' '.join(problem['what'] + problem['remedy'] for problem in problems)


def test_faults_of_a_topic_are_reported_with_a_remedy(context):
    nodes = (
        ('/wrench', WrenchStamped),
        ('/late', WrenchStamped, -(5 * 10**9)),
        ('/joints', JointState),
    )
    topics = {
        'sound': {'topic': '/wrench', 'axis': 'fx'},
        'wrong rate': {'topic': '/wrench', 'axis': 'fx', 'rate_hz': 60.0},
        'late': {'topic': '/late', 'axis': 'fx'},
        'no joint': {'topic': '/joints', 'joint': 'ring'},
    }
    configs = [TendonSensorConfig(**{**MEASURED, **values}) for values in topics.values()]
    with publishing(context, *nodes), sensors_on_topics() as make, ThreadPoolExecutor() as pool:
        reports = pool.map(lambda config: asdict(check_sensor_samples(config, 4.0, make)), configs)
        found = dict(zip(topics, reports, strict=True))
    facts, problems = found['sound']['facts'], describe(found['sound']['problems'])
    assert 'rate [Hz]' in facts, problems
    assert facts['rate [Hz]'] == pytest.approx(100.0, rel=0.02)
    assert facts['samples'] > 50
    for fault in ('no reading', 'rate_hz', 'publishers', 'no effort'):
        assert fault not in problems
    for name, said in (
        ('wrong rate', 'rate_hz is 60'),
        ('late', 's behind the time of this node'),
        ('no joint', 'there is no joint ring, only thumb, index'),
    ):
        assert said in describe(found[name]['problems'])


def test_topic_without_a_publisher_is_reported():
    code, document = answer_of('check', '--seconds', 1, '--sensor-topic', '/nothing')
    assert code == 1
    assert '/nothing has no publisher' in describe(document['devices'][0]['problems'])


def test_topics_with_a_force_are_listed_with_their_parameters(context):
    with publishing(context, ('/ft/wrench', WrenchStamped), ('/joint_states', JointState)):
        _, document = answer_of('devices', '--topics', '--listen', 1.5)
    wrench, joints = document['devices']
    assert wrench['parameters'] == {'sensor': 'topic', 'topic': '/ft/wrench'}
    assert 'WrenchStamped of their_hand' in wrench['what']
    assert 'joints with effort: thumb, index' in joints['what']
    assert joints['device'] == wrench['device'] == 'sensor'
    _, document = answer_of('devices', '--topics', '--listen', 0.1)
    assert document['devices'] == []
