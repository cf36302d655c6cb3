# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig for the stiffness protocol: ``ros2 launch tactile_bringup stiffness.launch.py``."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from tactile_bringup.launch_config.launching import declare_arguments, Planned

NODES = (
    ('tendon_sensor_driver', 'tendon_sensor_node'),  # tension from the load cell: strain
    ('linear_guide_driver', 'linear_guide_node'),  # the guide: actions move, home
    ('linear_guide_driver', 'tendon_actuator_node'),  # the tendon: actions pull, home; release
    ('tactile_bringup', 'trial_runner_node'),  # trials by the protocol: action run_trial, events
    ('tactile_features', 'tactile_features_node'),  # windows to feature vectors
    ('tactile_classifier', 'tactile_classifier_node'),  # a classifier for each model
    ('tactile_bags', 'bag_recorder_node'),  # with record:=FOLDER
)


def start(context):
    # How often each is started, with which name, namespace and parameters, says the plan.
    plan = Planned('stiffness', context)
    return plan.start(
        [
            Node(package=package, executable=executable, **options)
            for package, executable in NODES
            for options in plan.options(executable)
        ]
    )


def generate_launch_description():
    return LaunchDescription([*declare_arguments('stiffness'), OpaqueFunction(function=start)])
