# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any fingers of a hand that moves itself: ``ros2 launch tactile_bringup hand.launch.py``."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from tactile_bringup.launch_config.launching import declare_arguments, Planned

NODES = (
    ('tendon_sensor_driver', 'tendon_sensor_node'),  # tension from the load cell: strain
    ('tactile_features', 'tactile_features_node'),  # windows to feature vectors
    ('tactile_classifier', 'tactile_classifier_node'),  # a classifier for each model
    ('tactile_features', 'slip_detector_node'),  # with slip:=true
    ('tactile_bags', 'bag_recorder_node'),  # with record:=FOLDER
)


def start(context):
    # How often each is started, with which name, namespace and parameters, says the plan.
    plan = Planned('hand', context)
    return plan.start(
        [
            Node(package=package, executable=executable, **options)
            for package, executable in NODES
            for options in plan.options(executable)
        ]
    )


def generate_launch_description():
    return LaunchDescription([*declare_arguments('hand'), OpaqueFunction(function=start)])
