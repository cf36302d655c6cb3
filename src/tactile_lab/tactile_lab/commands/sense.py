# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile sense`: the nodes of a finger that another program moves."""

from contextlib import ExitStack
from pathlib import Path
from typing import Any, Optional

from tactile_lab.options import (
    DetectedContactOption,
    ModelOption,
    NamespaceOption,
    ParamsOption,
    PhasesOption,
    QuietOption,
    RecalibrateOption,
    RecordOption,
    SensorOption,
    SensorTopicOption,
    SimulatedOption,
    SlipOption,
    WatchOption,
)


def sense(
    sensor: SensorOption = '',
    sensor_topic: SensorTopicOption = '',
    models: ModelOption = None,
    recalibrate: RecalibrateOption = 0,
    phases: PhasesOption = '',
    contact: DetectedContactOption = '',
    slip: SlipOption = False,
    simulated: SimulatedOption = False,
    params: ParamsOption = None,
    namespace: NamespaceOption = '',
    record: RecordOption = None,
    watch: WatchOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run the nodes of one finger that another program moves, in this process until Ctrl-C.

    Starts sensor, features and classifier, as ``ros2 launch tactile_bringup sense.launch.py``
    does. Prints a line for each classification. The program that moves the finger publishes
    trial events on ``trial_runner/events``. With ``--phases`` they are found in the tension
    instead.
    """
    run_fingers(
        None,
        params,
        simulated=simulated,
        watch=watch,
        quiet=quiet,
        sensor_port=sensor,
        sensor_topic=sensor_topic,
        models=str(models or ''),
        recalibrate=recalibrate,
        phases=phases,
        contact=contact,
        slip=slip,
        record=record,
        namespace=namespace,
    )


def run_fingers(
    fingers: Optional[str],
    params: Optional[Path],
    *,
    simulated: bool,
    watch: bool,
    quiet: bool,
    namespace: str,
    **options: Any,
) -> None:
    """Run the nodes of fingers in this process until a signal comes.

    Parameters
    ----------
    fingers : str or None
        Names with commas between them; None: a single finger, without a name.
    params : Path or None
        ROS parameter file.
    simulated : bool
        Start a simulated sensor for each finger without a port.
    watch, quiet : bool
        See `run_nodes`.
    namespace, options
        See `hand_graph`.

    Raises
    ------
    TactileError
        When the arguments do not fit, a node cannot be started, or one fails later.
    """
    import tempfile

    from tactile_bringup.launch_config.hand import find_fingers, hand_graph
    from tactile_bringup.launch_config.parameter_files import ParameterFile
    from tactile_lab.running import run_nodes
    from tactile_ros.process import hold_signals
    from tactile_sim.rig_process import SimulatedRig

    if hold_signals().received:
        return
    file = ParameterFile(params)
    names = ('',) if fingers is None else find_fingers(fingers, file, namespace)
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='tactile_')))

        def simulate(number: int, finger: str) -> str:
            links = scratch / f'rig_{finger or "finger"}'
            return str(stack.enter_context(SimulatedRig(number + 1, links)).ports.sensor)

        nodes = hand_graph(
            names,
            file,
            simulate=simulate if simulated else None,
            namespace=namespace,
            **options,
        )
        run_nodes(nodes, '', 'sensor nodes', watch=watch, quiet=quiet, simulated=simulated)
