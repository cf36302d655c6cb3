# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One finger of a hand that moves itself: ``ros2 launch tactile_bringup sense.launch.py``."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from tactile_bringup.launch_config.launching import declare_arguments, Planned


def start(context):
    # The plan says how often each node is started, and with which name, namespace, parameters.
    plan = Planned('sense', context)
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
            # with models:=..., one classifier for all of them
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
    return LaunchDescription([*declare_arguments('sense'), OpaqueFunction(function=start)])
