# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Building blocks of the launch files: arguments, simulated rigs, nodes with their parameters.

Imports ``launch``, which is part of ROS 2 but not available on PyPI.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
import sys
import tempfile
from typing import Any

from launch import LaunchContext
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    RegisterEventHandler,
    TimerAction,
)
from launch.event_handlers import OnProcessExit, OnProcessIO, OnShutdown
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
import launch_ros.actions
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage
import yaml

from tactile_bringup.launch_config.graph import NodeDescription, require_package
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_ros.errors import TactileError

ENDS_WITHIN_S = '15'
"""Time from SIGINT to SIGTERM [s].

When a trial is ended, it first brings the rig to rest. On a busy computer, this may take longer
than launch's default of 5 s.
"""

RIG_LINGERS_S = 3.0
"""Time for which a simulated rig with moving devices continues to run after SIGINT [s].

The drivers need this time to bring the devices to rest.
"""

AFTER_END_S = 2.0
"""Time between the end of a node that ends the launch and the shutdown of the other nodes [s].

It allows the other nodes to finish their computations.
"""


def shared_arguments(**defaults: str) -> list[DeclareLaunchArgument]:
    """Return the arguments that all launch files have; ``defaults`` replaces default values."""
    described = {
        'record': (
            '',
            'folder of the bag to record into, which must not exist. Default: no recording',
        ),
        'params_file': (
            '',
            'YAML file with ROS parameters of the nodes. These parameters override the defaults; '
            'launch arguments override these parameters. `models` paths are relative to the file',
        ),
        'namespace': ('', 'namespace of all nodes. Default: the root namespace'),
        'use_sim_time': ('false', 'true: take the time from /clock instead of the computer'),
        'autostart': (
            'true',
            'true: nodes configure and activate themselves; false: a lifecycle manager does this',
        ),
        'respawn': (
            'true',
            'true: restart a process that has died. A tendon driver that starts with a taut '
            'tendon slackens it',
        ),
        'log_level': ('info', 'lowest severity that the nodes log'),
    }
    choices = {'log_level': ['debug', 'info', 'warn', 'error', 'fatal']}
    return [
        DeclareLaunchArgument(
            name,
            default_value=defaults.get(name, default),
            description=description,
            choices=choices.get(name),
        )
        for name, (default, description) in described.items()
    ]


class Arguments:
    """The values of a launch file's arguments.

    Parameters
    ----------
    context : LaunchContext
        Context of the launch.
    declared : sequence of DeclareLaunchArgument
        The arguments.

    Attributes
    ----------
    file : ParameterFile
        The parameter file of the argument ``params_file``.
    scratch : Path
        Temporary folder, which is removed at the end of the launch.

    Raises
    ------
    TactileError
        If the command line has an argument that is not declared, or the parameter file is
        invalid.
    """

    def __init__(self, context: LaunchContext, declared: Sequence[DeclareLaunchArgument]) -> None:
        self._values = {
            argument.name: str(LaunchConfiguration(argument.name).perform(context))
            for argument in declared
        }
        self._refuse_unknown()
        self.file = ParameterFile(self.path('params_file'))
        self._scratch = tempfile.TemporaryDirectory(prefix='tactile_launch_')
        self.scratch = Path(self._scratch.name)

    def __getitem__(self, name: str) -> str:
        return self._values[name]

    def is_true(self, name: str) -> bool:
        """Return the value of a boolean argument."""
        value = self._values[name].lower()
        if value not in ('true', 'false', '1', '0'):
            raise TactileError(f'{name} is "{self._values[name]}"; it must be true or false')
        return value in ('true', '1')

    def path(self, name: str) -> Path | None:
        """Return a value as a path, or None if it is empty."""
        return Path(self._values[name]).expanduser() if self._values[name] else None

    @property
    def of_every_node(self) -> dict[str, bool]:
        """The parameters ``use_sim_time`` and ``autostart`` of all nodes, without defaults."""
        time = {'use_sim_time': True} if self.is_true('use_sim_time') else {}
        return time if self.is_true('autostart') else {**time, 'autostart': False}

    @property
    def process(self) -> dict[str, Any]:
        """Arguments of the launch actions of all processes, such as output and log level."""
        return {
            'output': 'screen',
            'ros_arguments': ['--log-level', self['log_level']],
            'sigterm_timeout': ENDS_WITHIN_S,
            'respawn': self.is_true('respawn'),
            'respawn_delay': 1.0,
        }

    def clean_up(self) -> None:
        """Remove the scratch folder."""
        self._scratch.cleanup()

    def _refuse_unknown(self) -> None:
        """Refuse undeclared arguments on the command line, which launch would ignore.

        This is skipped if another package's launch file includes ours, because it may have
        further arguments.
        """
        if not any(
            after.endswith('.launch.py') and 'tactile_bringup' in (before, *Path(after).parts)
            for before, after in pairwise(sys.argv)
        ):
            return
        for word in sys.argv[1:]:
            name, given, _ = word.partition(':=')
            if not given or name in self._values:
                continue
            close = get_close_matches(name, self._values, 1)
            known = f'did you mean {close[0]}?' if close else ', '.join(self._values)
            raise TactileError(f'there is no argument {name}; {known}')


class Node(launch_ros.actions.Node):
    """A `launch_ros.actions.Node` with layers of parameters.

    Parameters
    ----------
    package, executable, name, namespace : str
        See `launch_ros.actions.Node`.
    parameters : sequence of ParameterFile or mapping
        Layers of parameters; later layers override earlier ones. Values that are None or empty
        are ignored.
    **process
        Further arguments of the process.

    Attributes
    ----------
    description : NodeDescription
        The node with its merged parameters.
    process : dict
        Arguments of the process.
    """

    def __init__(
        self,
        *,
        package: str,
        executable: str,
        name: str,
        namespace: str = '',
        parameters: Sequence[ParameterFile | Mapping[str, Any]] = (),
        **process: Any,
    ) -> None:
        namespace = namespace.strip('/')
        merged: dict[str, Any] = {}
        for layer in parameters:
            of_node = layer.of(name, namespace) if isinstance(layer, ParameterFile) else layer
            merged |= {k: v for k, v in of_node.items() if v is not None and v not in ('', ())}
        self.description = NodeDescription(name, merged, namespace)
        self.process = process
        super().__init__(
            package=package,
            executable=executable,
            name=name,
            namespace=namespace,
            parameters=[_typed(merged)] if merged else [],
            **process,
        )


def in_processes(
    nodes: Sequence[Node], processes: str, arguments: Arguments
) -> list[launch_ros.actions.Node]:
    """Return the processes of the nodes of fingers.

    ``processes`` is ``node`` for one process per node, ``finger`` for one per namespace, or
    ``one`` for a single process.
    """
    if processes == 'node':
        return list(nodes)
    together: dict[str, list[Node]] = {}
    for node in nodes:
        key = node.description.namespace if processes == 'finger' else 'all'
        together.setdefault(key, []).append(node)
    return [_finger_process(members, arguments) for members in together.values()]


def _finger_process(nodes: Sequence[Node], arguments: Arguments) -> launch_ros.actions.Node:
    """Return one process with all nodes, which reads their parameters from one file."""
    with tempfile.NamedTemporaryFile(
        'w', dir=arguments.scratch, suffix='.yaml', delete=False, encoding='utf-8'
    ) as file:
        document = {
            f'/{node.description.path}': {'ros__parameters': _plain(node.description.parameters)}
            for node in nodes
            if node.description.parameters
        }
        yaml.dump(document, file, _Quoting, allow_unicode=True)
    process = dict(nodes[0].process)
    process['ros_arguments'] = [*process.get('ros_arguments', ()), '--params-file', file.name]
    return launch_ros.actions.Node(
        package='tactile_bringup',
        executable='finger_node',
        arguments=[f'/{node.description.path}' for node in nodes],
        **process,
    )


class _Quoting(yaml.SafeDumper):
    """Writes texts in quotes, because ROS would read ``1e3`` as a number and ``on`` as true."""


_Quoting.add_representer(
    str, lambda dumper, text: dumper.represent_scalar('tag:yaml.org,2002:str', text, style='"')
)


def _plain(parameters: Mapping[str, Any]) -> dict[str, Any]:
    return {k: list(v) if isinstance(v, tuple) else v for k, v in parameters.items()}


def _typed(parameters: Mapping[str, Any]) -> dict[str, ParameterValue]:
    """Return parameters with explicit types, because launch would parse texts as YAML."""
    return {
        key: ParameterValue(value, value_type=_type_of(value)) for key, value in parameters.items()
    }


def _type_of(value: Any) -> Any:
    return list[type(value[0])] if isinstance(value, (tuple, list)) else type(value)  # type: ignore[misc]


class SimulatedRigProcess(ExecuteProcess):
    """Process with the simulated devices of a rig or of several fingers.

    Parameters
    ----------
    links : sequence of Path
        One folder per rig or finger for the links to its serial ports; see `Ports.in_folder`.
    mount : tuple of str
        Protocol, object and contact of the object under the finger; empty for no object.

    Raises
    ------
    TactileError
        If the object is unknown, or the simulator is not installed.
    """

    def __init__(self, links: Sequence[Path], mount: tuple[str, ...] = ()) -> None:
        require_package('tactile_sim', 'rig:=simulated')
        if mount:
            from tactile_sim.descriptions.catalogue import list_objects

            known = list(list_objects(mount[0]))
            if mount[1] not in known:
                raise TactileError(
                    f'object is "{mount[1]}"; for {mount[0]}, the objects are {", ".join(known)}'
                )
        super().__init__(
            cmd=[
                ExecutableInPackage(package='tactile_sim', executable='tactile_sim_rig'),
                *('--seed', '1', '--links', *map(str, links)),
                *('--linger', str(RIG_LINGERS_S if mount else 0.0)),
                *(('--mount', *mount) if mount else ()),
            ],
            name='simulated_rig',
            output='screen',
            sigterm_timeout=ENDS_WITHIN_S,
        )


def start(
    arguments: Arguments,
    rig: SimulatedRigProcess | None,
    nodes: Sequence[launch_ros.actions.Node],
    ends_with: launch_ros.actions.Node | None = None,
) -> list[Any]:
    """Return the launch actions.

    Parameters
    ----------
    arguments : Arguments
        Values of the arguments; their scratch folder is removed on shutdown.
    rig : SimulatedRigProcess or None
        Simulated rig, which is started before the nodes.
    nodes : sequence of Node
        The nodes.
    ends_with : Node, optional
        Node whose end shuts the launch down.
    """
    # The handler also keeps a reference to ``arguments``, so the scratch folder exists until then.
    clean_up = OnShutdown(on_shutdown=lambda *_: arguments.clean_up())
    actions: list[Any] = [RegisterEventHandler(clean_up)]
    if ends_with is not None:
        end = TimerAction(
            period=AFTER_END_S, actions=[EmitEvent(event=Shutdown(reason='the node has ended'))]
        )
        actions.append(RegisterEventHandler(OnProcessExit(target_action=ends_with, on_exit=end)))
    if rig is None:
        return [*actions, *nodes]
    waiting = list(nodes)

    def on_output(_: Any) -> list[Any] | None:
        """Start the nodes after the rig's first line of output, because its ports exist then."""
        started = list(waiting)
        waiting.clear()
        return started or None

    return [
        *actions,
        RegisterEventHandler(OnProcessIO(target_action=rig, on_stdout=on_output)),
        rig,
    ]
