# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures that run the nodes over real DDS, and a test node that publishes their inputs."""

from functools import partial

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from tactile_classifier.conversions import classification_from_msg
from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_features.conversions import feature_window_to_msg
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_msgs.msg import Classification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_testing.waiting import wait_until

START_NS = 1_760_000_000_000_000_000
PERIOD_NS = 16_666_667
NAME = 'tactile_classifier'
FEATURES = 'tactile_features/features'
ANSWERS = f'{NAME}/classification'


def make_header(since_ns):
    stamp_ns = START_NS + since_ns
    return Header(stamp=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9))


class Finger:
    """The classifier node, optionally the feature node, and a test node that uses their topics."""

    def __init__(self, context, parameters, features):
        def make(node_class, parameters):
            overrides = [Parameter(name, value=value) for name, value in parameters.items()]
            return node_class(context=context, parameter_overrides=overrides)

        self.classifier = make(TactileClassifierNode, parameters)
        self.features = None if features is None else make(TactileFeaturesNode, features)
        # Without models, the feature node publishes its specifications after the first samples.
        self.announces = features is not None and 'models' in features
        self.nodes = [node for node in (self.features, self.classifier) if node is not None]
        self.peer = Node('peer', context=context)
        self.heard, self.diagnostics = [], []
        self.listen(Classification, ANSWERS, self.heard)
        self.peer.create_subscription(DiagnosticArray, '/diagnostics', self._hear_health, 10)
        publish = self.peer.create_publisher
        if features is None:
            self.windows = publish(TactileFeatures, FEATURES, RESULTS)
        else:
            self.strain = publish(StrainBlock, 'tendon_sensor/strain', STREAM)
            self.events = publish(TrialEvent, 'trial_runner/events', EVENTS)
        self.executor = SingleThreadedExecutor(context=context)
        for node in (*self.nodes, self.peer):
            self.executor.add_node(node)

    def _hear_health(self, message):
        self.diagnostics += [status for status in message.status if status.name == NAME]

    def listen(self, message_type, topic, heard, qos=RESULTS):
        self.peer.create_subscription(message_type, topic, heard.append, qos)

    @property
    def answers(self):
        """Classification results that the test node has received."""
        return [classification_from_msg(message) for message in self.heard]

    @property
    def models(self):
        return self.classifier.models

    def wait_for_count(self, name, value):
        """Wait for diagnostics in which ``name`` has this value, and return their status."""

        def find():
            for status in self.diagnostics:
                if (name, value) in [(pair.key, pair.value) for pair in status.values]:
                    return status
            return None

        self.spin_until(find)
        return find()

    def spin_until(self, condition):
        wait_until(condition, step=partial(self.executor.spin_once, timeout_sec=0.05))

    def bring_up(self):
        for node in self.nodes:
            assert node.bring_up()
        self.connect()

    def connect(self):
        """Wait for all subscriptions, and for the specifications of the feature node."""
        topics = {f'/{FEATURES}', f'/{ANSWERS}'}
        publishers = [
            publisher
            for node in (*self.nodes, self.peer)
            for publisher in node.publishers
            if publisher.topic_name in topics
        ]
        if self.features is not None:
            publishers += [self.strain, self.events]
        self.spin_until(
            lambda: (
                all(publisher.get_subscription_count() for publisher in publishers)
                and (not self.announces or self.models.is_announced)
            )
        )

    def send(self, *windows):
        """Publish windows of features."""
        for window in windows:
            self.windows.publish(feature_window_to_msg(window))

    def play(self, events, blocks):
        """Publish events and samples of trials."""
        for event in events:
            self.events.publish(event)
        for block in blocks:
            self.strain.publish(block)

    def close(self):
        self.executor.shutdown()
        for node in reversed(self.nodes):
            node.take_down()
        self.peer.destroy_node()


@pytest.fixture
def make_finger(context, model_path):
    """Return a function that makes a `Finger`; ``features`` are feature node parameters."""
    fingers = []

    def make(features=None, **parameters):
        fingers.append(Finger(context, {'models': str(model_path), **parameters}, features))
        return fingers[-1]

    yield make
    for finger in fingers:
        finger.close()


@pytest.fixture
def make_trials():
    """Return a function that makes events and blocks of two trials; one sample can be lost."""
    tension_n = np.random.default_rng(0).normal(3.0, 0.1, 900)
    facts = {'protocol': 'texture', 'contact': 'flexion', 'glide_speed_m_s': 0.02}

    def make(lost=-1):
        events = [
            TrialEvent(header=make_header(round(time_s * 1e9)), trial_id=i, phase=phase, **facts)
            for i, time_s, phase in (
                ('t1', 1.0, 'glide'),
                ('t1', 6.0, 'done'),
                ('t2', 6.5, 'glide'),
                ('t2', 11.0, 'hold'),
                ('t2', 14.0, 'done'),
            )
        ]
        blocks = [
            StrainBlock(
                header=make_header(n * PERIOD_NS),
                sequence=n,
                period_ns=PERIOD_NS,
                tension_n=[each],
            )
            for n, each in enumerate(tension_n)
            if n != lost
        ]
        return events, blocks

    return make
