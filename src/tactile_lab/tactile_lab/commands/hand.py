# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile hand`: the nodes of any number of fingers that another program moves."""

from typing import Annotated

import typer

from tactile_lab.commands.sense import run_fingers
from tactile_lab.options import (
    DetectedContactOption,
    ModelOption,
    NamespaceOption,
    ParamsOption,
    PhasesOption,
    QuietOption,
    RecalibrateOption,
    RecordOption,
    SensorTopicOption,
    SimulatedOption,
    SlipOption,
    WatchOption,
)


def hand(
    fingers: Annotated[
        str,
        typer.Option(
            help='Namespaces of the fingers, such as index,middle. Default: all that --params '
            'describes.'
        ),
    ] = '',
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
    """Run the nodes of any number of fingers, in this process until Ctrl-C.

    Runs the nodes of `tactile sense` for each finger, in a namespace with the finger's name, as
    ``ros2 launch tactile_bringup hand.launch.py`` does. What differs between fingers (port or
    topic, models, phases, slip detector) stands in the ROS parameter file ``--params``, in
    blocks for the nodes of each finger. ``--record`` makes one bag a finger.
    """
    run_fingers(
        fingers,
        params,
        simulated=simulated,
        watch=watch,
        quiet=quiet,
        sensor_topic=sensor_topic,
        models=str(models or ''),
        recalibrate=recalibrate,
        phases=phases,
        contact=contact,
        slip=slip,
        record=record,
        namespace=namespace,
    )
