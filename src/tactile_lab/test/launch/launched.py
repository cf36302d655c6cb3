# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers of the launch tests: launch descriptions, models, and a listener on topics."""

import atexit
import contextlib
import os
from pathlib import Path
import tempfile

from ament_index_python.packages import get_package_share_directory
from domain_coordinator import domain_id
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
import launch_testing.actions
from rclpy.node import Node

from tactile_analysis.datasets.feature_tables import read_tables
from tactile_bringup.nodes.graph_runner import ros_context
from tactile_bringup.trial_protocols import TrialConfig
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_lab.commands.train import model_path
from tactile_lab.simulation.simulated_bags import write_simulated_bag
from tactile_lab.simulation.simulated_trials import SimulationPlan
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import RESULTS
from tactile_testing.waiting import wait_until

DEADLINE_S = 120.0
"""Longest wait [s]; much longer than usual, because other tests may keep the computer busy."""


def launched(name, **arguments):
    """Return a launch description on a separate ROS domain that is ready to test immediately."""
    # The launched processes read their ROS domain from the environment.
    os.environ['ROS_DOMAIN_ID'] = str(until_end(domain_id()))
    share = Path(get_package_share_directory('tactile_bringup'))
    included = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(share / 'launch' / f'{name}.launch.py')),
        launch_arguments=arguments.items(),
    )
    return LaunchDescription([included, launch_testing.actions.ReadyToTest()])


def until_end(resource):
    """Enter a context manager, which is left when the test process ends."""
    resources = contextlib.ExitStack()
    atexit.register(resources.close)
    return resources.enter_context(resource)


def new_folder():
    """Return a new folder, which is removed when the test process ends."""
    return Path(until_end(tempfile.TemporaryDirectory(prefix='launch_test_')))


def simulated_bag(folder, protocol):
    """Return a bag of two simulated trials on each plate or object."""
    plan = SimulationPlan(protocol, 'flexion', 2, seed=7)
    return write_simulated_bag(folder, plan, TrialConfig(), FeatureConfig()).path


def trained_model(folder, protocol):
    """Return a model file for a protocol in flexion, trained on a small simulated bag."""
    tables = read_tables([simulated_bag(folder, protocol)])
    path = model_path(folder, (protocol, 'flexion'))
    write_model(path, train(tables[protocol, 'flexion'], 'knn'))
    return path


class Ear:
    """Receives topics on the ROS domain of the launched processes. It is a context manager.

    Parameters
    ----------
    topics : mapping of str to type
        Message type of each topic.
    make_others : callable
        Called with the ROS context. Returns further nodes to spin.
    """

    def __init__(self, topics, make_others=lambda context: ()):
        self._stack = contextlib.ExitStack()
        self.context = self._stack.enter_context(ros_context(int(os.environ['ROS_DOMAIN_ID'])))
        self.node = Node('ear', context=self.context)
        self.heard = {topic: [] for topic in topics}
        for topic, message_type in topics.items():
            self.node.create_subscription(message_type, topic, self.heard[topic].append, RESULTS)
        self.others = list(make_others(self.context))
        self._stack.enter_context(NodeGroup([self.node, *self.others], context=self.context))

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._stack.close()

    def wait_for_publishers(self, *topics):
        wait_until(
            lambda: all(self.node.count_publishers(self._full(topic)) for topic in topics),
            lambda: 'no node publishes '
            + ', '.join(t for t in topics if not self.node.count_publishers(self._full(t))),
            timeout_s=60.0,  # the first start compiles Python modules
        )

    def wait_for_messages(self, topic, count=1):
        wait_until(lambda: len(self.heard[topic]) >= count, lambda: f'nothing on {topic}')
        return self.heard[topic]

    def _full(self, topic):
        return self.node.resolve_topic_name(topic)
