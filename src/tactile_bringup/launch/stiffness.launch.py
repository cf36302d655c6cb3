# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig for the stiffness protocol: ``ros2 launch tactile_bringup stiffness.launch.py``."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from tactile_bringup.launch_config.launching import declare_arguments, Planned


def start(context):
    # The plan says how often each node is started, and with which name, namespace, parameters.
    plan = Planned('stiffness', context)
    return plan.start(
        [
            # tension from the load cell: strain
            *[
                Node(package='tendon_sensor_driver', executable='tendon_sensor_node', **options)
                for options in plan.options('tendon_sensor_node')
            ],
            # the linear guide: action move, home
            *[
                Node(package='linear_guide_driver', executable='linear_guide_node', **options)
                for options in plan.options('linear_guide_node')
            ],
            # the tendon: action pull, release
            *[
                Node(package='linear_guide_driver', executable='tendon_actuator_node', **options)
                for options in plan.options('tendon_actuator_node')
            ],
            # trials by the protocol: action run_trial, events
            *[
                Node(package='tactile_bringup', executable='trial_runner_node', **options)
                for options in plan.options('trial_runner_node')
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
            # with record:=FOLDER
            *[
                Node(package='tactile_bags', executable='bag_recorder_node', **options)
                for options in plan.options('bag_recorder_node')
            ],
        ]
    )


def generate_launch_description():
    return LaunchDescription([*declare_arguments('stiffness'), OpaqueFunction(function=start)])
