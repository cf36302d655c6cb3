# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording, on its own time: ``ros2 launch tactile_bringup replay.launch.py``."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from tactile_bringup.launch_config.launching import declare_arguments, Planned


def start(context):
    # The plan says how often each node is started, and with which name, namespace, parameters.
    plan = Planned('replay', context)
    return plan.start(
        [
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
            # with record:=FOLDER
            *[
                Node(package='tactile_bags', executable='bag_recorder_node', **options)
                for options in plan.options('bag_recorder_node')
            ],
            # plays the recording
            *[
                Node(package='tactile_bags', executable='bag_player_node', **options)
                for options in plan.options('bag_player_node')
            ],
        ]
    )


def generate_launch_description():
    return LaunchDescription([*declare_arguments('replay'), OpaqueFunction(function=start)])
