# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is asked of `tactile rig`, `trials`, `experiment run` and `check`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None``: so ``Optional[X]``.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.options import (
    choice,
    GuideOption,
    ModelsOption,
    NamespaceOption,
    ParamsOption,
    QuietOption,
    RecalibrateOption,
    RecordOption,
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
class RigRequest:
    """The arguments of `tactile rig`; see its ``--help``."""

    models: ModelsOption = None
    recalibrate: RecalibrateOption = 0
    ports: PortArguments = field(default_factory=PortArguments)
    params: ParamsOption = None
    namespace: NamespaceOption = ''
    record: RecordOption = None
    watch: WatchOption = False
    quiet: QuietOption = False
    seed: SeedOption = 1


@dataclass(frozen=True, kw_only=True)
class TrialsRequest:
    """The arguments of `tactile trials`; see its ``--help``."""

    protocol: Annotated[
        str,
        typer.Argument(**choice('texture', 'stiffness'), help='Which kind of trial.'),
    ]
    label: Annotated[
        str, typer.Option('--object', help='The plate or object that lies under the finger.')
    ]
    bag: Annotated[
        Path, typer.Option('--output', '-o', help='Bag to record into; must not exist yet.')
    ]
    contact: Annotated[
        str,
        typer.Option(**choice('flexion', 'abduction'), help='How the finger touches.'),
    ] = 'flexion'
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
    models: ModelsOption = None
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
            help='Append a block to this session: each object once more, in each contact.'
        ),
    ] = ''
    models: ModelsOption = None
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
class CheckRequest:
    """The arguments of `tactile check`; see its ``--help``."""

    ports: PortArguments = field(default_factory=PortArguments)
    params: ParamsOption = None
    namespace: Annotated[str, typer.Option(help='Namespace of the nodes in --params.')] = ''
    seconds: Annotated[
        float, typer.Option(min=1.0, max=3600.0, help='How long to listen to the sensor.')
    ] = 5.0
    may_move: Annotated[
        bool,
        typer.Option(
            '--move',
            help='Also home the guide and move it 5 mm, and wind the tendon 2 mm in and out.',
        ),
    ] = False
    seed: SeedOption = 1
