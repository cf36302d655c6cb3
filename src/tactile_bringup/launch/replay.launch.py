# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Replay of a recording: ``ros2 launch tactile_bringup replay.launch.py bag:=FOLDER``."""

import dataclasses

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction

from tactile_bringup.launch_config.graph import (
    choose_fingers,
    ModelChoice,
    player_parameters,
    recorder_parameters,
    require_package,
)
from tactile_bringup.launch_config.launching import Arguments, Node, shared_arguments, start
from tactile_ros.errors import TactileError

ARGUMENTS = [
    DeclareLaunchArgument('bag', description='folder of the recording to play'),
    DeclareLaunchArgument(
        'rate', default_value='1.0', description='speed relative to the recording'
    ),
    DeclareLaunchArgument(
        'models',
        default_value='',
        description='folder of model files, or one file. Default: the models that were used '
        'during the recording, if any',
    ),
    # By default, the nodes use the time on /clock. The namespace selects one finger.
    *shared_arguments(use_sim_time='true', respawn='false'),
]


def launch_setup(context):
    require_package('tactile_bags', 'a replay')
    from tactile_bags.bag_reader import TactileBag
    from tactile_bags.recorded_setup import recorded_features

    arguments = Arguments(context, ARGUMENTS)
    file, path = arguments.file, arguments.path('bag')
    if path is None:
        raise TactileError('name the recording to play, as bag:=FOLDER')
    try:
        rate = float(arguments['rate'])
    except ValueError:
        raise TactileError(f'rate is "{arguments["rate"]}"; it must be a number') from None
    common = arguments.of_every_node
    process = arguments.process
    nodes, has_classifier = [], False
    with TactileBag(path) as bag:
        simulated = bool(bag.metadata.get('simulated'))
        namespaces = choose_fingers(bag, arguments['namespace'])
        for namespace in namespaces:
            models = ModelChoice.of_recording(
                bag, namespace, arguments.path('models'), arguments.scratch
            )
            of_models = models.parameters if models else {}
            recorded = dataclasses.asdict(recorded_features(bag, namespace).config)
            # The feature node computes a feature vector from each window of samples.
            nodes.append(
                Node(
                    package='tactile_features',
                    executable='tactile_features_node',
                    name='tactile_features',
                    namespace=namespace,
                    parameters=[recorded, file, of_models, common],
                    **process,
                )
            )
            if models:
                # The classifier node computes a label from each feature vector.
                has_classifier = True
                nodes.append(
                    Node(
                        package='tactile_classifier',
                        executable='tactile_classifier_node',
                        name='tactile_classifier',
                        namespace=namespace,
                        parameters=[file, of_models, common],
                        **process,
                    )
                )
    if arguments['record']:
        recorder = recorder_parameters(
            arguments['record'],
            namespaces=namespaces,
            simulated=simulated,
            rig=False,
            classifier=has_classifier,
        )
        nodes.append(
            Node(
                package='tactile_bags',
                executable='bag_recorder_node',
                name='bag_recorder',
                parameters=[file, recorder, common],
                **{**process, 'respawn': False},
            )
        )
    # The player publishes the recorded messages, and their time on /clock.
    player = Node(
        package='tactile_bags',
        executable='bag_player_node',
        name='bag_player',
        parameters=[file, player_parameters(path, rate, arguments['namespace'])],
        **{**process, 'respawn': False},
    )
    return start(arguments, None, [*nodes, player], ends_with=player)


def generate_launch_description():
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=launch_setup)])
