# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Any fingers of a hand that moves itself: ``ros2 launch tactile_bringup hand.launch.py``."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from tactile_bringup.launch_config.launching import declare_arguments, Planned


def start(context):
    # The plan says how often each node is started, and with which name, namespace, parameters.
    plan = Planned('hand', context)
    return plan.start(
        [
            # tension from the load cell: strain
            *[
                Node(package='tendon_sensor_driver', executable='tendon_sensor_node', **options)
                for options in plan.options('tendon_sensor_node')
            ],
            # windows to feature vectors
            *[
                Node(package='tactile_features', executable='tactile_features_node', **options)
                for options in plan.options('tactile_features_node')
            ],
            # a classifier for each model
            *[
                Node(package='tactile_classifier', executable='tactile_classifier_node', **options)
                for options in plan.options('tactile_classifier_node')
            ],
            # with slip:=true
            *[
                Node(package='tactile_features', executable='slip_detector_node', **options)
                for options in plan.options('slip_detector_node')
            ],
            # with record:=FOLDER
            *[
                Node(package='tactile_bags', executable='bag_recorder_node', **options)
                for options in plan.options('bag_recorder_node')
            ],
        ]
    )


def generate_launch_description():
    return LaunchDescription([*declare_arguments('hand'), OpaqueFunction(function=start)])
