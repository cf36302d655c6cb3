# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each protocol's launch file: the graph comes up, a trial runs, all processes end with 0."""

import atexit
import contextlib
import os
import threading
import time
import unittest
from pathlib import Path

import pytest

pytest.importorskip(
    'launch_testing.actions', reason='launch_testing comes with an ordinary ROS 2, not from PyPI'
)

import launch_testing
import launch_testing.actions
import launch_testing.asserts
import launch_testing.markers
from ament_index_python.packages import get_package_share_directory
from domain_coordinator import domain_id
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from rclpy.node import Node
from tactile_msgs.msg import TactileFeatures

from tactile_bringup.graph_runner import ros_context
from tactile_bringup.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import RESULTS
from tactile_sim.rig_process import SimulatedRig

DEADLINE_S = 60.0
OUTPUTS = (
    'tendon_sensor/strain',
    'linear_guide/joint_states',
    'tendon_actuator/joint_states',
    'trial_runner/events',
    'tactile_features/features',
)
OBJECTS = {'texture': 'R1', 'stiffness': 'sponge'}


@pytest.mark.launch_test
@launch_testing.markers.keep_alive
@launch_testing.parametrize('protocol', list(OBJECTS))
def generate_test_description(protocol):
    resources = contextlib.ExitStack()
    atexit.register(resources.close)
    # The launched processes take their domain from the environment.
    os.environ['ROS_DOMAIN_ID'] = str(resources.enter_context(domain_id()))
    rig = resources.enter_context(SimulatedRig(seed=3))
    share = Path(get_package_share_directory('tactile_bringup'))
    arguments = {
        'guide_port': rig.ports.guide,
        'tendon_port': rig.ports.tendon,
        'sensor_port': rig.ports.sensor,
        'rig': 'simulated',
    }
    launched = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(share / 'launch' / f'{protocol}.launch.py')),
        launch_arguments=arguments.items(),
    )
    return (
        LaunchDescription([launched, launch_testing.actions.ReadyToTest()]),
        {'rig': rig},
    )


class TestTrial(unittest.TestCase):
    def test_trial_gives_features(self, rig, protocol):
        with ros_context(int(os.environ['ROS_DOMAIN_ID'])) as context:
            operator = OperatorNode((), context)
            listener = Node('listener', context=context)
            felt = threading.Event()
            windows = []

            def on_features(message):
                windows.append(message)
                felt.set()

            listener.create_subscription(
                TactileFeatures, 'tactile_features/features', on_features, RESULTS
            )
            with NodeGroup([operator, listener], context=context):
                deadline_s = time.monotonic() + DEADLINE_S
                while not all(listener.count_publishers(topic) for topic in OUTPUTS):
                    self.assertLess(time.monotonic(), deadline_s, 'not every node has come up')
                    time.sleep(0.1)
                operator.home_guide()
                rig.mount(protocol, OBJECTS[protocol], 'flexion')
                operator.run_trial(TrialRequest(protocol, 'flexion', OBJECTS[protocol], 't1'))
                self.assertTrue(felt.wait(DEADLINE_S), 'no features')
            self.assertEqual(windows[0].trial_id, 't1')
            self.assertEqual(windows[0].outcome, TactileFeatures.OUTCOME_OK, windows[0].reason)
            self.assertTrue(windows[0].simulated)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    def test_every_process_ends_with_zero(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
