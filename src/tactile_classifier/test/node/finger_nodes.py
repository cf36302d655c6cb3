# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A finger over real DDS: its nodes, and a peer that plays the rest."""

from functools import partial

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
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
ANSWERS = 'tactile_classifier/classification'
PARTIAL = 'tactile_classifier/partial_classification'


def _overrides(parameters):
    return [Parameter(name, value=value) for name, value in parameters.items()]


def make_header(time_s):
    stamp_ns = START_NS + round(time_s * 1e9)
    return Header(stamp=Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9))


class Finger:
    """Both nodes, or the classifier alone, and a peer that sends what they need and listens."""

    def __init__(self, context, parameters, features):
        self.classifier = TactileClassifierNode(
            context=context, parameter_overrides=_overrides(parameters)
        )
        self.features = None
        if features is not None:
            self.features = TactileFeaturesNode(
                context=context, parameter_overrides=_overrides(features)
            )
        self.peer = Node('peer', context=context)
        self.heard, self.heard_partial, self.diagnostics = [], [], []
        for topic, heard in ((ANSWERS, self.heard), (PARTIAL, self.heard_partial)):
            self.peer.create_subscription(Classification, topic, heard.append, RESULTS)
        self.peer.create_subscription(DiagnosticArray, '/diagnostics', self._hear_health, 10)
        publish = self.peer.create_publisher
        if features is None:
            self.windows, self.parts = (
                publish(TactileFeatures, f'tactile_features/{topic}', RESULTS)
                for topic in ('features', 'partial_features')
            )
        else:
            self.strain = publish(StrainBlock, 'tendon_sensor/strain', STREAM)
            self.events = publish(TrialEvent, 'trial_runner/events', EVENTS)
        self.executor = SingleThreadedExecutor(context=context)
        self.nodes = [node for node in (self.features, self.classifier) if node is not None]
        for node in (*self.nodes, self.peer):
            self.executor.add_node(node)

    def _hear_health(self, message):
        self.diagnostics += [status for status in message.status if status.name == NAME]

    @property
    def answers(self):
        """Answers on whole windows that were heard."""
        return [classification_from_msg(message) for message in self.heard]

    @property
    def partial_answers(self):
        return [classification_from_msg(message) for message in self.heard_partial]

    @property
    def answering(self):
        return self.classifier.answering

    def spin_until(self, condition):
        wait_until(condition, step=partial(self.executor.spin_once, timeout_sec=0.05))

    def bring_up(self):
        for node in self.nodes:
            assert node.bring_up()
        self.connect()

    def connect(self):
        """Wait until everybody hears everybody."""
        has_parts = bool(self.answering.models.partial_samples)
        topics = [ANSWERS, *([PARTIAL] if has_parts else [])]
        if self.features is None:
            inputs = [self.windows, *([self.parts] if has_parts else [])]
        else:
            inputs = [self.strain, self.events]
        windows = 'tactile_features/partial_features' if has_parts else 'tactile_features/features'
        self.spin_until(
            lambda: (
                all(publisher.get_subscription_count() for publisher in inputs)
                and all(self.peer.count_publishers(topic) for topic in topics)
                and self.classifier.count_publishers(windows)
                and (self.features is None or self.answering.is_told)
            )
        )

    def send(self, *windows):
        """Send windows of features, whole and partial ones."""
        for window in windows:
            publisher = self.parts if window.partial else self.windows
            publisher.publish(feature_window_to_msg(window))

    def close(self):
        self.executor.shutdown()
        for node in reversed(self.nodes):
            node.take_down()
        self.peer.destroy_node()
