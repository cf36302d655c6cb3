# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The described graph as launch actions; the launch files are thin wrappers of this.

Imports ``launch``, which comes with an ordinary ROS 2 and not from PyPI.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from tactile_bringup.graph import (
    NodeDescription,
    Ports,
    classifier_name,
    recorder_node,
    rig_graph,
)
from tactile_bringup.model_folder import find_model
from tactile_bringup.parameter_files import read_parameters
from tactile_bringup.records import CONTACTS

PORT_ARGUMENTS = {
    'guide_port': 'serial port of the linear guide (Grbl)',
    'tendon_port': 'serial port of the tendon actuator (Dynamixel)',
    'sensor_port': 'serial port of the load cell',
}
"""Launch arguments that name a serial port; none of them has a default."""


def protocol_launch_description(protocol: str) -> LaunchDescription:
    """Return what the launch file of a protocol starts: every node of the rig.

    Parameters
    ----------
    protocol : str
        ``texture`` or ``stiffness``: whose classifier is started with the rig.
    """
    arguments = [
        DeclareLaunchArgument(name, description=text) for name, text in PORT_ARGUMENTS.items()
    ]
    arguments += [
        DeclareLaunchArgument(
            'contact',
            default_value='flexion',
            choices=list(CONTACTS),
            description='how the finger touches: which model is loaded',
        ),
        DeclareLaunchArgument(
            'models',
            default_value='',
            description='folder with model files, as "tactile train" writes them; '
            'empty: no classifier',
        ),
        DeclareLaunchArgument(
            'rig',
            default_value='hardware',
            choices=['hardware', 'simulated'],
            description='what is behind the ports; marks all results of a simulated rig',
        ),
        DeclareLaunchArgument(
            'record', default_value='', description='folder of the bag to record; empty: none'
        ),
        DeclareLaunchArgument(
            'params_file',
            default_value='',
            description='YAML file with ROS parameters for the nodes; empty: the defaults',
        ),
        DeclareLaunchArgument(
            'namespace', default_value='', description='namespace of all nodes; empty: none'
        ),
        DeclareLaunchArgument(
            'log_level',
            default_value='info',
            choices=['debug', 'info', 'warn', 'error', 'fatal'],
            description='least severity that the nodes log',
        ),
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_rig_actions, args=[protocol])])


def _rig_actions(context: LaunchContext, protocol: str) -> list[Node]:
    def value(name: str) -> str:
        return str(LaunchConfiguration(name).perform(context))

    simulated = value('rig') == 'simulated'
    models = {}
    if value('models'):
        wanted = classifier_name(protocol, value('contact'))
        models = {wanted: find_model(Path(value('models')), wanted)}
    of_features = {}
    if value('params_file'):
        # The nodes read the file themselves; but what the feature node is told about windows,
        # its classifiers and the recording must know, too.
        of_features = read_parameters(
            Path(value('params_file')),
            ['tactile_features'],
            value('namespace'),
            others_allowed=True,
        ).get('tactile_features', {})
    ports = Ports(value('guide_port'), value('tendon_port'), value('sensor_port'))
    graph = rig_graph(
        ports, models, {'tactile_features': of_features}, simulated=simulated, watched=True
    )
    if value('record'):
        graph.append(
            recorder_node(
                Path(value('record')),
                Path(value('models')) if value('models') else None,
                tuple(models),
                of_features,
                namespace=value('namespace'),
                simulated=simulated,
            )
        )
    return [
        _launch_node(node, value('namespace'), value('params_file'), value('log_level'))
        for node in graph
    ]


def _launch_node(
    description: NodeDescription, namespace: str, params_file: str, log_level: str
) -> Node:
    parameters: list[Any] = [dict(description.parameters)]
    if params_file:
        parameters.append(params_file)
    return Node(
        package=description.package,
        executable=description.executable,
        name=description.name,
        namespace=namespace,
        parameters=parameters,
        arguments=['--ros-args', '--log-level', log_level],
        output='screen',
    )
