# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A launch plan as launch actions: names and parameters for the nodes of the launch files.

Imports ``launch``, which comes with an ordinary ROS 2 and not from PyPI.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
import shutil
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
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage

from tactile_bringup.launch_config.graph import (
    LaunchPlan,
    NodeDescription,
    PLAYER,
    RigDescription,
)
from tactile_bringup.launch_config.launch_arguments import LAUNCH_FILES, LaunchValues, RENAMED
from tactile_bringup.launch_config.launch_plans import plan_launch

RIG_LINGERS_S = 3.0
"""A simulated rig outlives the drivers that bring it to rest, as a real one does; one that
nothing moves need not."""

ENDS_WITHIN_S = '15'
"""A trial that is ended brings the rig to rest first; with launch's own 5 s a busy computer
could be too slow for that."""

RESPAWN_DELAY_S = 1.0
"""Between the death of a node and its next start; one that cannot start is tried for ever."""

TENDON_RESPAWN_DELAY_S = 0.2
"""The tendon driver may have left the tendon taut."""

NOT_RESPAWNED = ('bag_recorder', PLAYER)
"""A recording ends with its recorder: a bag is not written on by another process."""

AFTER_END_S = 2.0
"""For what is still being computed when the node has ended that ends all."""


def declare_arguments(name: str) -> list[DeclareLaunchArgument]:
    """Return the arguments of a launch file, from `launch_arguments`.

    Parameters
    ----------
    name : str
        Name of the launch file, without ``.launch.py``.
    """
    return [
        DeclareLaunchArgument(
            argument.name,
            default_value=argument.default,
            description=argument.description,
            choices=list(argument.choices) or None,
        )
        for argument in LAUNCH_FILES[name]
    ]


class Planned:
    """Plan of a launch file with the values of its arguments, as launch actions.

    Parameters
    ----------
    name : str
        Name of the launch file, without ``.launch.py``.

    Raises
    ------
    TactileError
        When an argument is not valid, or a file that it names does not exist.
    """

    def __init__(self, name: str, context: LaunchContext) -> None:
        self._values = {
            argument.name: str(LaunchConfiguration(argument.name).perform(context))
            for argument in LAUNCH_FILES[name]
        }
        # launch passes over arguments that nobody declares.
        old = {key: context.launch_configurations.get(key) for key in RENAMED}
        LaunchValues(name, {key: value for key, value in old.items() if value})
        self._scratch = Path(tempfile.mkdtemp(prefix='tactile_launch_'))
        try:
            self._plan = plan_launch(name, self._values, self._scratch)
        except Exception:
            self._scratch.rmdir()
            raise

    def options(self, executable: str) -> list[dict[str, Any]]:
        """Return the arguments of ``Node`` for each node of an executable that is wanted."""
        return [
            _options(node, self._values)
            for node in self._plan.nodes
            if node.executable == executable
        ]

    def start(self, nodes: Sequence[Node]) -> list[Any]:
        """Return the launch actions: simulated rigs first, then the nodes, then the end of all."""
        return [
            RegisterEventHandler(
                OnShutdown(on_shutdown=lambda *_: shutil.rmtree(self._scratch, ignore_errors=True))
            ),
            *self._endings(nodes),
            *_after_rigs(self._plan, list(nodes)),
        ]

    def _endings(self, nodes: Sequence[Node]) -> list[Any]:
        if not self._plan.ends_with:
            return []
        ends = TimerAction(
            period=AFTER_END_S, actions=[EmitEvent(event=Shutdown(reason='the end was reached'))]
        )
        described = [node for node in self._plan.nodes if node.path == self._plan.ends_with]
        return [
            RegisterEventHandler(OnProcessExit(target_action=node, on_exit=ends))
            for node in nodes
            if node.node_executable == described[0].executable
        ]


def _after_rigs(plan: LaunchPlan, nodes: list[Node]) -> list[Any]:
    """Start simulated rigs, and the nodes once all ports are there."""
    if not plan.rigs:
        return nodes
    waiting = {rig.links for rig in plan.rigs}

    def on_output(rig: RigDescription) -> Callable[[Any], list[Node] | None]:
        def start_when_last(event: Any) -> list[Node] | None:
            if rig.links not in waiting:
                return None
            waiting.discard(rig.links)  # its first line says that its ports are there
            return None if waiting else nodes

        return start_when_last

    actions: list[Any] = []
    for rig in plan.rigs:
        process = _rig(rig)
        handler = OnProcessIO(target_action=process, on_stdout=on_output(rig))
        actions += [RegisterEventHandler(handler), process]
    return actions


def _rig(rig: RigDescription) -> ExecuteProcess:
    mount = ['--mount', *rig.mount] if rig.mount else []
    return ExecuteProcess(
        cmd=[
            ExecutableInPackage(package='tactile_sim', executable='tactile_sim_rig'),
            *('--links', str(rig.links), '--seed', str(rig.seed)),
            *('--linger', str(RIG_LINGERS_S if mount else 0.0), *mount),
        ],
        name=rig.links.name,
        output='screen',
        sigterm_timeout=ENDS_WITHIN_S,
    )


def _options(description: NodeDescription, values: Mapping[str, str]) -> dict[str, Any]:
    return {
        'name': description.name,
        'namespace': description.namespace,
        'parameters': [
            # With its type: launch would read {...} or on in a text as YAML.
            {
                key: ParameterValue(value, value_type=_type_of(value))
                for key, value in description.parameters.items()
                if not isinstance(value, (tuple, list)) or len(value)
            }
        ],
        'arguments': ['--ros-args', '--log-level', values['log_level']],
        'output': 'screen',
        'sigterm_timeout': ENDS_WITHIN_S,
        'respawn': values['respawn'] == 'true' and description.name not in NOT_RESPAWNED,
        'respawn_delay': (
            TENDON_RESPAWN_DELAY_S if description.name == 'tendon_actuator' else RESPAWN_DELAY_S
        ),
    }


def _type_of(value: Any) -> Any:
    return list[type(value[0])] if isinstance(value, (tuple, list)) else type(value)
