# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fingers of a hand that other nodes move: ``ros2 launch tactile_bringup hand.launch.py``.

By default, the nodes of all fingers run in one process; see the argument ``processes``.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction

from tactile_bringup.launch_config.graph import (
    DEVICES,
    ModelChoice,
    Ports,
    recorder_parameters,
    sensor_parameters,
)
from tactile_bringup.launch_config.hand import find_fingers, place_fingers, refuse_shared_ports
from tactile_bringup.launch_config.launching import (
    Arguments,
    in_processes,
    Node,
    shared_arguments,
    SimulatedRigProcess,
    start,
)

ARGUMENTS = [
    DeclareLaunchArgument(
        'fingers',
        default_value='',
        description='comma-separated namespaces of the fingers, such as index,middle; / means '
        'one finger in the namespace of the hand. Default: all fingers in params_file',
    ),
    DeclareLaunchArgument(
        'processes',
        default_value='one',
        choices=['one', 'finger', 'node'],
        description='one process for all nodes, one per finger, or one per node, for isolation or '
        'to replace a node. Recorders always run in separate processes',
    ),
    DeclareLaunchArgument(
        'rig',
        default_value='hardware',
        choices=['hardware', 'simulated'],
        description='devices behind the ports: hardware, or simulated rigs, which are started for '
        'fingers without a port. All data from a simulated sensor are marked',
    ),
    DeclareLaunchArgument(
        'sensor_port',
        default_value='',
        description='serial port of the load cell, for a single finger; none if another node '
        'publishes tendon_sensor/strain. Default: the port in params_file, or '
        '/dev/tactile/<finger>; for a finger without a name /dev/tactile/sensor',
    ),
    DeclareLaunchArgument(
        'sensor_topic',
        default_value='',
        description='topic of a force that another node publishes, instead of a port: '
        'WrenchStamped, Wrench, Float64, Float32 or JointState. An axis (fx to tz, norm) or the '
        'name of a joint may follow after a colon, such as /ft/wrench:fx. A relative name is '
        'resolved in the namespace of each finger. The rate is measured unless '
        'params_file states it',
    ),
    DeclareLaunchArgument(
        'models',
        default_value='',
        description='folder of model files as written by "tactile train", or one file. The models '
        'determine which features are computed. Default: the models in params_file; without any, '
        'no classifier is started',
    ),
    DeclareLaunchArgument(
        'phases',
        default_value='',
        choices=['', 'stated', 'texture', 'stiffness'],
        description='source of the phases: stated takes trial events on trial_runner/events; '
        'texture and stiffness detect glides or holds in the tension. Default: the value in '
        'params_file, or stated',
    ),
    DeclareLaunchArgument(
        'contact',
        default_value='',
        choices=['', 'flexion', 'abduction'],
        description='contact of the finger; selects the models, and is stated in detected phases. '
        'Default: the value in params_file; without one the contact is unknown and all models '
        'are loaded',
    ),
    *shared_arguments(),
]


def launch_setup(context):
    arguments = Arguments(context, ARGUMENTS)
    file, hand = arguments.file, arguments['namespace']
    is_single = arguments['fingers'] == '/'
    fingers = [''] if is_single else find_fingers(arguments['fingers'], file, hand)
    places = place_fingers(fingers, file, hand, arguments['sensor_port'])
    simulated = arguments['rig'] == 'simulated'
    common = arguments.of_every_node
    links, nodes, recorders = [], [], []
    for finger, namespace in zip(fingers, places, strict=True):
        process = {'namespace': namespace, **arguments.process}
        stated = {
            name: file.of(name, namespace)
            for name in ('tendon_sensor', 'tactile_features', 'tactile_classifier')
        }

        # -- the models determine the features and the classifier -----------------------------
        phases = arguments['phases'] or stated['tactile_features'].get('phases', 'stated')
        contact = arguments['contact']
        models = ModelChoice.of_finger(
            arguments['models'],
            stated,
            '' if phases == 'stated' else phases,
            contact,
        )
        of_models = models.parameters if models else {}
        found = {} if phases == 'stated' else {'phases': phases, 'detected_contact': contact}

        # -- source of the tension --------------------------------------------------------------
        port, topic = arguments['sensor_port'], arguments['sensor_topic']
        is_stated = {'port', 'sensor'} & stated['tendon_sensor'].keys()
        if simulated and not (port or topic or is_stated):
            links.append(arguments.scratch / f'rig_{finger or "finger"}')
            port = Ports.in_folder(links[-1]).sensor
        sensor = sensor_parameters(stated, port=port, topic=topic, simulated=simulated)

        # -- the nodes -------------------------------------------------------------------------
        if sensor is not None:
            # The sensor node reads the load cell, and publishes the tension.
            nodes.append(
                Node(
                    package='tendon_sensor_driver',
                    executable='tendon_sensor_node',
                    name='tendon_sensor',
                    parameters=[
                        {'port': str(DEVICES / (finger or 'sensor'))},
                        file,
                        sensor,
                        common,
                    ],
                    **process,
                )
            )
        # The feature node computes a feature vector from each window of samples.
        nodes.append(
            Node(
                package='tactile_features',
                executable='tactile_features_node',
                name='tactile_features',
                parameters=[file, found, of_models, common],
                **process,
            )
        )
        if models:
            # The classifier node computes a label from each feature vector.
            nodes.append(
                Node(
                    package='tactile_classifier',
                    executable='tactile_classifier_node',
                    name='tactile_classifier',
                    parameters=[file, of_models, common],
                    **process,
                )
            )
        if record := arguments.path('record'):
            # The recorder writes a separate bag for each finger.
            recorder = recorder_parameters(
                record / finger,
                namespaces=[namespace],
                rig=False,
                classifier=models is not None,
            )
            recorders.append(
                Node(
                    package='tactile_bags',
                    executable='bag_recorder_node',
                    name='bag_recorder',
                    parameters=[file, recorder, common],
                    # The recorder is not restarted, because it cannot continue a bag.
                    **{**process, 'respawn': False},
                )
            )
    refuse_shared_ports(node.description for node in nodes)
    processes = arguments['processes']
    together = in_processes(nodes, processes, arguments)
    rig = SimulatedRigProcess(links) if links else None
    return start(arguments, rig, [*together, *in_processes(recorders, processes, arguments)])


def generate_launch_description():
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=launch_setup)])
