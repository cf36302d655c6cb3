# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests of the commands on devices and the rig."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.options import (
    ContactOption,
    GuideOption,
    ModelOption,
    ParamsOption,
    ProtocolArgument,
    SeedOption,
    SensorOption,
    SensorTopicOption,
    SimulatedOption,
    TendonOption,
    WatchOption,
)
from tactile_ros.errors import TactileError


@dataclass(frozen=True, kw_only=True)
class PortArguments:
    """Where the three devices are: ports, a topic instead of the sensor's, or simulated ones.

    Raises
    ------
    TactileError
        When the sensor is given twice.
    """

    guide: GuideOption = ''
    tendon: TendonOption = ''
    sensor: SensorOption = ''
    sensor_topic: SensorTopicOption = ''
    simulated: SimulatedOption = False

    def __post_init__(self) -> None:
        if self.sensor and self.sensor_topic:
            raise TactileError('there are a --sensor and a --sensor-topic; give one')


@dataclass(frozen=True, kw_only=True)
class TrialsRequest:
    """The arguments of `tactile trials`; see its ``--help``."""

    protocol: ProtocolArgument
    label: Annotated[
        str, typer.Option('--object', help='The plate or object that lies under the finger.')
    ]
    bag: Annotated[
        Path, typer.Option('--output', '-o', help='Bag to record into; must not exist yet.')
    ]
    contact: ContactOption = 'flexion'
    count: Annotated[int, typer.Option(min=1, max=10_000, help='How many trials.')] = 1
    session: Annotated[
        str,
        typer.Option(
            help='Name of the session, also of an earlier one to continue; part of the names of '
            'the trials. Default: the time.'
        ),
    ] = ''
    mounting: Annotated[
        str,
        typer.Option(
            help='Name of the mounting; name another each time you fix the plate or object anew. '
            'Default: none.'
        ),
    ] = ''
    models: ModelOption = None
    ports: PortArguments = field(default_factory=PortArguments)
    params: ParamsOption = None
    watch: WatchOption = False
    seed: SeedOption = 1


@dataclass(frozen=True, kw_only=True)
class ExperimentRequest:
    """The arguments of `tactile experiment run`; see its ``--help``."""

    plan: Annotated[
        Path, typer.Argument(help='Plan, as `tactile experiment new` writes it, or the folder.')
    ]
    folder: Annotated[
        Optional[Path],
        typer.Option('--output', '-o', help="Folder. Default: the plan's name without .yaml."),
    ] = None
    append: Annotated[
        str,
        typer.Option(
            help='Append a block to this session: each object once more, in each contact. '
            'While an appended block of it has trials left, that one goes on instead.'
        ),
    ] = ''
    models: ModelOption = None
    ports: PortArguments = field(default_factory=PortArguments)
    params: ParamsOption = None
    yes: Annotated[
        bool,
        typer.Option(
            '--yes',
            help='Ask nothing, on the simulated rig: what fails is tried again, up to three '
            'times; outliers are kept and marked.',
        ),
    ] = False
    watch: WatchOption = False
    seed: SeedOption = 1


@dataclass(frozen=True, kw_only=True)
class DemoRequest:
    """The arguments of `tactile demo`; see its ``--help``."""

    folder: Annotated[
        Optional[Path],
        typer.Option(
            '--output', '-o', help='Folder for the results; must not exist. Default: a new one.'
        ),
    ] = None
    seed: SeedOption = 1
    short: Annotated[
        bool,
        typer.Option(
            help='Few training trials: a quick check that all parts work, no useful accuracy.'
        ),
    ] = False
    trials: Annotated[
        int,
        typer.Option(
            min=1,
            max=100,
            help='Live trials, five to seven seconds each, spread evenly over the kinds of trial.',
        ),
    ] = 5
    watch: Annotated[
        bool, typer.Option('--watch/--no-watch', help='Serve the live trials as a page.')
    ] = True
