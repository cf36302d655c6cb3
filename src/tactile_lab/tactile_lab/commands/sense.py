# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile sense` and `tactile hand`: run the nodes of fingers that another program moves."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from tactile_lab import options

PHASES = ('stated', 'texture', 'stiffness')


@dataclass(frozen=True)
class FingerOptions:
    """Options of `tactile sense` and `tactile hand`."""

    sensor_topic: options.SensorTopicOption = ''
    models: options.ModelOption = None
    phases: Annotated[
        str,
        typer.Option(
            **options.choice('', *PHASES),
            help='Source of the phases. stated: trial events; texture or stiffness: detection in '
            'the tension of trials of this kind. Default: as in the parameter file, or stated.',
            show_default=False,
        ),
    ] = ''
    contact: Annotated[
        str,
        typer.Option(
            '--contact',
            **options.choice('', 'flexion', 'abduction'),
            help='Contact of the finger, if the phases are detected in the tension. Default: not '
            'known.',
            show_default=False,
        ),
    ] = ''
    simulated: options.SimulatedOption = False
    params: options.ParamsOption = None
    namespace: options.NamespaceOption = ''
    record: options.RecordOption = None
    watch: options.WatchOption = False
    quiet: options.QuietOption = False


OF_BOTH = FingerOptions()


def sense(sensor: options.SensorOption = '', stated: FingerOptions = OF_BOTH) -> None:
    """Run the nodes of one finger that another program moves, in this process until Ctrl-C.

    Starts the nodes of sensor, features and classifier, like
    ``ros2 launch tactile_bringup sense.launch.py``. Prints a line for each classification. The
    program that moves the finger must publish trial events on ``trial_runner/events``. With
    ``--phases``, the phases are detected in the tension instead.
    """
    run_fingers(None, sensor=sensor, **vars(stated))


def hand(
    fingers: Annotated[
        str,
        typer.Option(
            help='Namespaces of the fingers, such as index,middle. Default: all fingers that '
            '--params describes.'
        ),
    ] = '',
    stated: FingerOptions = OF_BOTH,
) -> None:
    """Run the nodes of any number of fingers, in this process until Ctrl-C.

    Runs the nodes of `tactile sense` for each finger, like
    ``ros2 launch tactile_bringup hand.launch.py``. The namespace of the nodes is the name of the
    finger. Parameters that differ between fingers (port or topic, models, phases) are in the ROS
    parameter file ``--params``, which has a block for each node of each finger. ``--record`` makes
    one bag per finger.
    """
    run_fingers(fingers, **vars(stated))


def run_fingers(
    fingers: Optional[str],
    *,
    params: Optional[Path],
    simulated: bool,
    watch: bool,
    quiet: bool,
    models: Optional[Path],
    sensor: str = '',
    **choices: Any,
) -> None:
    """Run the nodes of fingers in this process until a signal arrives.

    Parameters
    ----------
    fingers : str or None
        Names of the fingers, separated by commas; None for a single finger without a namespace.
    simulated : bool
        Start a simulated sensor for each finger without a port.
    choices : dict
        Further arguments of `hand_graph`.
    """
    import tempfile

    from tactile_bringup.launch_config.graph import Ports
    from tactile_bringup.launch_config.hand import find_fingers, hand_graph
    from tactile_bringup.launch_config.parameter_files import ParameterFile
    from tactile_lab.running import run_nodes
    from tactile_ros.process import hold_signals
    from tactile_sim.rig_process import SimulatedRig

    if hold_signals().received:
        return
    file = ParameterFile(params)
    names = ('',) if fingers is None else find_fingers(fingers, file, choices['namespace'])
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='tactile_')))

        links: list[Path] = []

        def simulate(finger: str) -> str:
            links.append(scratch / f'rig_{finger or "finger"}')
            return Ports.in_folder(links[-1]).sensor

        nodes = hand_graph(
            names,
            file,
            sensor_port=sensor,
            simulate=simulate if simulated else None,
            models=str(models or ''),
            **choices,
        )
        if links:
            stack.enter_context(SimulatedRig(1, links))
        run_nodes(nodes, 'sensor nodes', watch=watch, quiet=quiet, simulated=simulated)
