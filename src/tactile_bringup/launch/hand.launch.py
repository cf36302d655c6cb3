# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any fingers of a hand that moves itself: ``ros2 launch tactile_bringup hand.launch.py``.

The nodes of all fingers are in one process, unless ``processes`` says otherwise.
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
    SimulatedRig,
    start,
)

ARGUMENTS = [
    DeclareLaunchArgument(
        'fingers',
        default_value='',
        description='namespaces of the fingers, with commas between them, such as index,middle; '
        '/: one finger, in the namespace of the hand. Empty: all that params_file describes',
    ),
    DeclareLaunchArgument(
        'processes',
        default_value='one',
        choices=['one', 'finger', 'node'],
        description='one process for all nodes, one a finger, or one a node: for isolation, or to '
        'put another node in the place of one. Recorders are in a process of their own',
    ),
    DeclareLaunchArgument(
        'rig',
        default_value='hardware',
        choices=['hardware', 'simulated'],
        description='what is behind the ports: devices, or simulated rigs, which are started here '
        'for fingers without a port. All that comes from a simulated sensor is marked',
    ),
    DeclareLaunchArgument(
        'sensor_port',
        default_value='',
        description='serial port of the load cell, where there is one finger; none: another node '
        'publishes tendon_sensor/strain. Empty: the port in params_file, or '
        '/dev/tactile/<finger>, for one without a name /dev/tactile/sensor',
    ),
    DeclareLaunchArgument(
        'sensor_topic',
        default_value='',
        description='topic of a force that another node publishes, instead of a port: '
        'WrenchStamped, Wrench, Float64, Float32 or JointState. After a colon an axis (fx to tz, '
        'norm) or the name of a joint, as /ft/wrench:fx. A relative name is within the namespace '
        'of each finger. Its rate is that of the models, or is measured. Empty: none',
    ),
    DeclareLaunchArgument(
        'models',
        default_value='',
        description='folder of model files as "tactile train" writes it, or one file. They say '
        'which features are computed, and each answers the windows that fit it; empty: those in '
        'params_file, or no classifier',
    ),
    DeclareLaunchArgument(
        'phases',
        default_value='',
        choices=['', 'stated', 'texture', 'stiffness'],
        description='who says when a glide or a hold begins and ends: stated by trial events on '
        'trial_runner/events, or found in the tension, for the kind of contact that is named. '
        'Empty: as in params_file, or stated',
    ),
    DeclareLaunchArgument(
        'contact',
        default_value='',
        choices=['', 'flexion', 'abduction'],
        description='how the finger touches: which models are loaded, and what phases that are '
        'found in the tension say; empty: as in params_file, or not known, and all models are '
        'loaded',
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

        # -- the models say what features and classifier do ----------------------------------
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

        # -- what the tension comes from -------------------------------------------------------
        port, topic = arguments['sensor_port'], arguments['sensor_topic']
        is_stated = {'port', 'sensor'} & stated['tendon_sensor'].keys()
        if simulated and not (port or topic or is_stated):
            links.append(arguments.scratch / f'rig_{finger or "finger"}')
            port = Ports.in_folder(links[-1]).sensor
        sensor = sensor_parameters(stated, port=port, topic=topic, simulated=simulated)

        # -- the nodes -------------------------------------------------------------------------
        if sensor is not None:
            # tension from the load cell: strain
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
        # windows to feature vectors
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
            # feature vectors to labels
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
            # one bag a finger
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
                    # a bag is not written on by another process
                    **{**process, 'respawn': False},
                )
            )
    refuse_shared_ports(node.description for node in nodes)
    processes = arguments['processes']
    together = in_processes(nodes, processes, arguments)
    rig = SimulatedRig(links) if links else None
    return start(arguments, rig, [*together, *in_processes(recorders, processes, arguments)])


def generate_launch_description():
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=launch_setup)])
