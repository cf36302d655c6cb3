# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands for fingers that another program moves."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.cli.request_options import spread
from tactile_lab.options import (
    check_paths,
    DetectedContactOption,
    ModelOption,
    NamespaceOption,
    ParamsOption,
    PhasesOption,
    QuietOption,
    RecalibrateOption,
    RecordOption,
    refusals,
    SensorOption,
    SensorTopicOption,
    SimulatedOption,
    SlipOption,
    WatchOption,
)


@dataclass(frozen=True)
class SensingOptions:
    """Options that `tactile sense` and `tactile hand` share."""

    sensor_topic: SensorTopicOption = ''
    model: ModelOption = None
    recalibrate: RecalibrateOption = 0
    phases: PhasesOption = 'stated'
    contact: DetectedContactOption = ''
    slip: SlipOption = False
    simulated: SimulatedOption = False
    params: ParamsOption = None
    namespace: NamespaceOption = ''
    record: RecordOption = None
    watch: WatchOption = False
    quiet: QuietOption = False

    def run(self, name: str, **values: str) -> None:
        """Run what the launch file of this name starts."""
        check_paths(self.model, self.params)
        from tactile_lab.commands.running.rig import View
        from tactile_lab.commands.running.sense import run_sensing
        from tactile_lab.watch.options import WatchOptions

        values |= {
            'sensor_topic': self.sensor_topic,
            'model': str(self.model or ''),
            'recalibrate': str(self.recalibrate),
            'phases': self.phases,
            'contact': self.contact,
            'slip': 'true' if self.slip else 'false',
            'rig': 'simulated' if self.simulated else 'hardware',
            'params_file': str(self.params or ''),
            'namespace': self.namespace,
            'record': str(self.record or ''),
        }
        run_sensing(name, values, View(WatchOptions() if self.watch else None, self.quiet))


@spread
def sense(
    sensor: SensorOption = '',
    *,
    options: SensingOptions,
) -> None:
    """Run the nodes of one finger that another program moves, in this process until Ctrl-C.

    Starts sensor, features and classifiers, as ``ros2 launch tactile_bringup sense.launch.py``
    does in processes of their own. Prints a line for each classification. The program that moves
    the finger publishes trial events on ``trial_runner/events``. With ``--phases`` they are found
    in the tension instead.
    """
    with refusals():
        options.run('sense', sensor_port=sensor)


@spread
def hand(
    fingers: Annotated[
        str, typer.Option(help='Namespaces of the fingers, such as index,middle.')
    ] = '',
    hand_file: Annotated[
        Optional[Path],
        typer.Option(
            help="YAML file with each finger's port or topic, model, phases, slip and parameters."
        ),
    ] = None,
    *,
    options: SensingOptions,
) -> None:
    """Run the nodes of any number of fingers, in this process until Ctrl-C.

    Runs the nodes of `tactile sense` for each finger, in a namespace with the finger's name, as
    ``ros2 launch tactile_bringup hand.launch.py`` does in processes of their own. ``--record``
    makes one bag a finger.
    """
    with refusals():
        check_paths(hand_file)
        options.run('hand', fingers=fingers, hand_file=str(hand_file or ''))
