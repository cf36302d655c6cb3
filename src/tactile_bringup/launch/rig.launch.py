# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes of a rig that runs the trials of one protocol, each in a separate process.

Start it by ``ros2 launch tactile_bringup texture.launch.py`` or ``stiffness.launch.py``.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction

from tactile_bringup.launch_config.graph import (
    ModelChoice,
    NO_PORT,
    Ports,
    recorder_parameters,
    sensor_parameters,
    simulated_tendon_parameters,
)
from tactile_bringup.launch_config.hand import refuse_shared_ports
from tactile_bringup.launch_config.launching import (
    Arguments,
    Node,
    shared_arguments,
    SimulatedRigProcess,
    start,
)
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_ros.errors import TactileError

CONFIG = ParameterFile(Path(__file__).parents[1] / 'config' / 'rig.yaml')

ARGUMENTS = [
    DeclareLaunchArgument(
        'protocol', choices=['texture', 'stiffness'], description='the protocol of the trials'
    ),
    DeclareLaunchArgument(
        'rig',
        default_value='hardware',
        choices=['hardware', 'simulated'],
        description='devices behind the ports: hardware, or a simulated rig, which is started '
        'unless ports are given. All data from a simulated rig are marked',
    ),
    DeclareLaunchArgument(
        'guide_port',
        default_value='',
        description='serial port of the linear guide (Grbl). Default: the port in params_file, or '
        '/dev/tactile/guide',
    ),
    DeclareLaunchArgument(
        'tendon_port',
        default_value='',
        description='serial port of the tendon actuator (Dynamixel). Default: the port in '
        'params_file, or /dev/tactile/tendon',
    ),
    DeclareLaunchArgument(
        'sensor_port',
        default_value='',
        description='serial port of the load cell. none: there is no load cell; the sensor is the '
        'Net F/T or the topic in params_file or, if there is neither, another node publishes '
        'tendon_sensor/strain. Default: the port in params_file, or /dev/tactile/sensor',
    ),
    DeclareLaunchArgument(
        'sensor_topic',
        default_value='',
        description='topic of a force that another node publishes, instead of a port: '
        'WrenchStamped, Wrench, Float64, Float32 or JointState. An axis (fx to tz, norm) or the '
        'name of a joint may follow after a colon, such as /ft/wrench:fx. The rate is measured, '
        'unless params_file has one',
    ),
    DeclareLaunchArgument(
        'contact',
        default_value='flexion',
        choices=['flexion', 'abduction'],
        description='contact of the finger; selects the models',
    ),
    DeclareLaunchArgument(
        'models',
        default_value='',
        description='folder of model files as written by "tactile train", or one file. The models '
        'determine which features are computed. Without models, no classifier is started',
    ),
    DeclareLaunchArgument(
        'object',
        default_value='',
        description='plate or object under the finger of the simulated rig. Default: R1 for '
        'texture, rubber_shell for stiffness',
    ),
    *shared_arguments(),
]


def launch_setup(context):
    arguments = Arguments(context, ARGUMENTS)
    protocol, contact = arguments['protocol'], arguments['contact']
    namespace, file = arguments['namespace'], arguments.file
    file.refuse_others([namespace])
    common = arguments.of_every_node
    process = {'namespace': namespace, **arguments.process}

    # -- ports of the devices ------------------------------------------------------------------
    ports = {name: arguments[f'{name}_port'] for name in ('guide', 'tendon', 'sensor')}
    for name in ('guide', 'tendon'):
        if ports[name] == NO_PORT:
            raise TactileError(
                f'{name}_port is none, but a trial moves the {name}; if another node moves the '
                'finger, use sense.launch.py'
            )
    simulated = arguments['rig'] == 'simulated'
    has_sensor = bool(ports['sensor'] or arguments['sensor_topic'])
    given = [name for name, port in ports.items() if port and port != NO_PORT]
    missing = [f'{name}_port' for name in ('guide', 'tendon') if not ports[name]]
    missing += [] if has_sensor else ['sensor_port']
    rig = None
    if simulated and not given:
        touched = arguments['object'] or {'texture': 'R1', 'stiffness': 'rubber_shell'}[protocol]
        links = arguments.scratch / 'rig'
        rig = SimulatedRigProcess([links], (protocol, touched, contact))
        of_rig = Ports.in_folder(links)
        ports['guide'], ports['tendon'] = of_rig.guide, of_rig.tendon
        if not has_sensor:
            ports['sensor'] = of_rig.sensor
    elif simulated and missing:
        raise TactileError(
            f'give all ports of the simulated rig that is running, also {", ".join(missing)}; '
            'or give none, to start a simulated rig'
        )

    # -- the models determine the features and the classifier ---------------------------------
    stated = {
        name: file.of(name, namespace)
        for name in ('tendon_sensor', 'tactile_features', 'tactile_classifier', 'tendon_actuator')
    }
    models = ModelChoice.of_finger(arguments['models'], stated, protocol, contact)
    of_models = models.parameters if models else {}

    # -- the nodes -----------------------------------------------------------------------------
    nodes = []
    sensor = sensor_parameters(
        stated,
        port=ports['sensor'],
        topic=arguments['sensor_topic'],
        simulated=simulated,
    )
    if sensor is not None:
        # The sensor node reads the load cell, and publishes the tension.
        nodes.append(
            Node(
                package='tendon_sensor_driver',
                executable='tendon_sensor_node',
                name='tendon_sensor',
                parameters=[CONFIG, file, sensor, common],
                **process,
            )
        )
    of_tendon = simulated_tendon_parameters(stated) if simulated else {}
    nodes += [
        # The node of the linear guide has the actions move and home.
        Node(
            package='linear_guide_driver',
            executable='linear_guide_node',
            name='linear_guide',
            parameters=[CONFIG, file, {'port': ports['guide']}, common],
            **process,
        ),
        # The node of the tendon actuator has the action pull and the service release.
        Node(
            package='linear_guide_driver',
            executable='tendon_actuator_node',
            name='tendon_actuator',
            parameters=[CONFIG, file, {'port': ports['tendon']}, of_tendon, common],
            # The delay is short, because a driver that was killed may have left the tendon taut.
            **{**process, 'respawn_delay': 0.2},
        ),
        # The trial runner executes trials (action run_trial), and publishes events.
        Node(
            package='tactile_bringup',
            executable='trial_runner_node',
            name='trial_runner',
            parameters=[CONFIG, file, common],
            **process,
        ),
        # The feature node computes a feature vector from each window of samples.
        Node(
            package='tactile_features',
            executable='tactile_features_node',
            name='tactile_features',
            parameters=[CONFIG, file, of_models, common],
            **process,
        ),
    ]
    if models:
        # The classifier node computes a label from each feature vector.
        nodes.append(
            Node(
                package='tactile_classifier',
                executable='tactile_classifier_node',
                name='tactile_classifier',
                parameters=[CONFIG, file, of_models, common],
                **process,
            )
        )
    if arguments['record']:
        recorder = recorder_parameters(
            arguments['record'], namespaces=[namespace], classifier=models is not None
        )
        nodes.append(
            Node(
                package='tactile_bags',
                executable='bag_recorder_node',
                name='bag_recorder',
                parameters=[CONFIG, file, recorder, common],
                # The recorder is not restarted, because it cannot continue a bag.
                **{**process, 'respawn': False},
            )
        )
    refuse_shared_ports(node.description for node in nodes)
    return start(arguments, rig, nodes)


def generate_launch_description():
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=launch_setup)])
