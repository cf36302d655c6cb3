# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands that run nodes: of the rig, of fingers, and the live page."""

from dataclasses import dataclass
from typing import Annotated, Optional

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.commands.rig_requests import DemoRequest, RigRequest, TrialsRequest
from tactile_lab.options import (
    check_paths,
    DetectedContactOption,
    JsonOption,
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


@spread
def demo(request: DemoRequest, as_json: JsonOption = False) -> None:
    """Run everything from training to live trials on the **simulated** rig, in about a minute.

    Makes training sets from the simulator, trains and cross-validates the four
    classifiers, then runs live trials: simulated devices on serial lines, the real
    drivers, the trial runner, features, classification. Records them into a bag,
    replays the bag through nodes and through the plain core, and says whether all
    three agree bit for bit. The address of a live page is printed before the live trials.
    """
    from tactile_lab.commands.running.demo import run_demo

    ok = run_demo(request, as_json=as_json)
    raise typer.Exit(0 if ok else 1)


@spread
def trials(request: TrialsRequest, as_json: JsonOption = False) -> None:
    """Run trials on one plate or object, one after the other, and record them.

    Homes the guide, then repeats the protocol. With ``--models`` each trial is classified as
    well. `tactile train` takes the bags of several such sessions. The simulated rig puts the
    named plate or object under the finger. On a real rig, put it there before you run the
    command.

    For several objects use `tactile experiment`: with one object a session, a model may learn
    the session instead of the object.
    """
    check_paths(request.models, request.params)
    from tactile_lab.commands.running.trials import run_trials

    run_trials(request, as_json=as_json)


@spread
def rig(request: RigRequest) -> None:
    """Run all nodes of the rig in this process until Ctrl-C; print each classification.

    Starts sensor, guide, tendon, trial runner, features and, with models, a classifier. Start
    trials with the action ``trial_runner/run_trial``. To run trials without another program, use
    `tactile trials`.
    """
    check_paths(request.models, request.params)
    from tactile_lab.commands.running.rig import run_rig

    run_rig(request)


@dataclass(frozen=True)
class SensingOptions:
    """Options that `tactile sense` and `tactile hand` share."""

    sensor_topic: SensorTopicOption = ''
    models: ModelOption = None
    recalibrate: RecalibrateOption = 0
    phases: PhasesOption = ''
    contact: DetectedContactOption = ''
    slip: SlipOption = False
    simulated: SimulatedOption = False
    params: ParamsOption = None
    namespace: NamespaceOption = ''
    record: RecordOption = None
    watch: WatchOption = False
    quiet: QuietOption = False

    def run(self, fingers: Optional[str], sensor_port: str = '') -> None:
        """Run the nodes of fingers."""
        check_paths(self.models, self.params)
        from tactile_lab.commands.running.sense import run_sensing

        run_sensing(
            fingers,
            self.params,
            simulated=self.simulated,
            watch=self.watch,
            quiet=self.quiet,
            namespace=self.namespace,
            sensor_port=sensor_port,
            sensor_topic=self.sensor_topic,
            models=str(self.models or ''),
            recalibrate=self.recalibrate,
            phases=self.phases,
            contact=self.contact,
            slip=self.slip,
            record=self.record,
        )


@spread
def sense(sensor: SensorOption = '', *, options: SensingOptions) -> None:
    """Run the nodes of one finger that another program moves, in this process until Ctrl-C.

    Starts sensor, features and classifier, as ``ros2 launch tactile_bringup sense.launch.py``
    does. Prints a line for each classification. The program that moves the finger publishes
    trial events on ``trial_runner/events``. With ``--phases`` they are found in the tension
    instead.
    """
    options.run(None, sensor)


@spread
def hand(
    fingers: Annotated[
        str,
        typer.Option(
            help='Namespaces of the fingers, such as index,middle. Default: all that --params '
            'describes.'
        ),
    ] = '',
    *,
    options: SensingOptions,
) -> None:
    """Run the nodes of any number of fingers, in this process until Ctrl-C.

    Runs the nodes of `tactile sense` for each finger, in a namespace with the finger's name, as
    ``ros2 launch tactile_bringup hand.launch.py`` does. What differs between fingers (port or
    topic, models, phases, slip detector) stands in the ROS parameter file ``--params``, in
    blocks for the nodes of each finger. ``--record`` makes one bag a finger.
    """
    options.run(fingers)


def watch(
    host: Annotated[
        str,
        typer.Option(
            help='Address to listen on. With another address than the default, everybody on the '
            'network can see the page and press Stop: see docs/security.md.'
        ),
    ] = '127.0.0.1',
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help='Port of the page. Default: 8642, or a free one.'),
    ] = 0,
    terminal: Annotated[
        bool, typer.Option('--terminal', help='Draw in this terminal; serve no page.')
    ] = False,
) -> None:
    """Show every finger live in a browser, until Ctrl-C.

    Run it beside `tactile rig`, `tactile sense`, `tactile hand` or any launch file: it finds
    fingers by their topics on the same ROS domain. Those commands also take ``--watch``, which
    costs less than a process of its own.

    For each finger the page shows tension with the phases of the trial, the spectrum of the
    partial window, the label with its probabilities or *unknown*, slip, and the health of each
    device with its remedy. Its buttons tare the sensor, home the guide and run a trial. They need
    the token in the printed address. Without the token a page can only show and **stop**. Stop
    does not replace the emergency stop of your rig.
    """
    from tactile_lab.commands.running.watch import run_watch
    from tactile_lab.watch.options import WatchOptions

    run_watch(WatchOptions(host, port), terminal=terminal)
