# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options that several commands share."""

from collections.abc import Callable
import dataclasses
import functools
import inspect
from pathlib import Path
from typing import Annotated, Any, Optional

import typer


def expand(command: Callable[..., None]) -> Callable[..., None]:
    """Replace parameters whose default is a dataclass by one option per field.

    The returned command has the options in place of each such parameter, and calls ``command``
    with the dataclass.
    """
    groups: dict[str, Any] = {}
    shown = []
    for parameter in inspect.signature(command).parameters.values():
        if dataclasses.is_dataclass(parameter.default):
            groups[parameter.name] = parameter.default
            shown += [
                parameter.replace(name=field.name, default=field.default, annotation=field.type)
                for field in dataclasses.fields(parameter.default)
            ]
        else:
            shown.append(parameter)

    @functools.wraps(command)
    def run(**given: Any) -> None:
        for name, group in groups.items():
            stated = {each: given.pop(each) for each in vars(group)}
            given[name] = dataclasses.replace(group, **stated)
        command(**given)

    run.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in shown}
    return run


def split(text: Optional[str]) -> tuple[str, ...]:
    """Return the parts of an option between its commas, without empty ones."""
    return tuple(filter(None, map(str.strip, (text or '').split(','))))


def choice(*values: str) -> dict[str, Any]:
    """Return arguments of an option that accepts only these values and lists them in the help.

    Typer's own ways have disadvantages: every command would have to convert the members of an
    ``Enum``, and ``click_type`` was removed in Typer 0.22.
    """
    named = [value for value in values if value]

    def parse(value: str) -> str:
        if value not in values:
            raise typer.BadParameter(f'{value!r} is not one of {", ".join(map(repr, named))}.')
        return value

    return {'parser': parse, 'metavar': '|'.join(named)}


JsonOption = Annotated[
    bool, typer.Option('--json', help='Print the result as JSON on standard output.')
]
SeedOption = Annotated[
    int,
    typer.Option(
        min=0,
        max=2**32 - 1,
        metavar='INT',  # short, to leave room for the other columns of the help
        help='Seed of all random numbers: the same seed gives the same results.',
    ),
]
RecordingsArgument = Annotated[
    list[Path],
    typer.Argument(
        exists=True,
        help='Bags with trial events; or any other recordings: a NumPy archive (.npz), .npy, CSV '
        'or Parquet files, bags of other software, or folders of these.',
    ),
]
TaskOption = Annotated[
    Optional[str],
    typer.Option(
        **choice('texture', 'stiffness'),
        help='Kind of trial, which determines the features. Bags with trial events state it.',
    ),
]
SkipBadOption = Annotated[
    bool,
    typer.Option(
        '--skip-bad',
        help='Skip unusable trials of the archive, and list them. A trial is unusable if a value '
        'is not finite, if it is too short, or if it has no features.',
    ),
]


@dataclasses.dataclass(frozen=True)
class ArchiveOptions:
    """Options on the trials of an archive, which are fields of `Reading`."""

    channel: Annotated[
        Optional[str],
        typer.Option(
            help='Channel of the recordings: its name, its number from 0, "mean" (of all '
            'channels) or "all". Default: the first channel.'
        ),
    ] = None
    where: Annotated[
        Optional[str],
        typer.Option(
            help='Use only trials for which a column of the archive is true (--where balanced) or '
            'has a value (--where direction=1).'
        ),
    ] = None
    crop: Annotated[
        Optional[str],
        typer.Option(
            help='Part of each trial of an archive to use, in seconds, as in --crop 1:5. '
            'Default: the whole trial.',
        ),
    ] = None
    resample_hz: Annotated[
        Optional[float],
        typer.Option(
            help='Resample the archive to this rate first, with an anti-aliasing low-pass filter.'
        ),
    ] = None
    skip_bad: SkipBadOption = False
    speed_column: Annotated[
        Optional[str],
        typer.Option(
            help='Column of the archive with the sliding speeds, for --over; its name ends in '
            'the unit, _mm_s or _m_s. Bags state the speeds themselves.'
        ),
    ] = None


ARCHIVES = ArchiveOptions()
OverOption = Annotated[
    Optional[str],
    typer.Option(
        help='Texture: compute features over distance instead of time, for any sliding speed. '
        'Give the length of the window and the finest scale in mm, as in --over 45:0.5.'
    ),
]
DetrendOption = Annotated[
    Optional[str],
    typer.Option(
        **choice('none', 'mean', 'linear'),
        help='Texture: subtract nothing, the mean (as in the paper) or the least-squares line '
        'before the Fourier transform. Default: as recorded; for an archive, the default of the '
        'features node.',
    ),
]
FoldsOption = Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')]
RepetitionsOption = Annotated[
    Optional[int],
    typer.Option(
        min=1,
        help='Number of repetitions of the cross-validation. Default: 10. If the data are large '
        '(trials squared times features above 2e9): 1, without feature selection.',
    ),
]


def _of_others(*names: str, **more: Any) -> Any:
    """Return an option in the help panel on recordings of other software."""
    return typer.Option(*names, rich_help_panel='Recordings of other software', **more)


@dataclasses.dataclass(frozen=True)
class Statements:
    """Options on recordings of other software, which are the fields of `SourceOptions`."""

    force_column: Annotated[
        str,
        _of_others(
            help='Column of the force in a table; several columns, separated by commas, for '
            'several channels. Default: the column force or tension, with or without a unit, as '
            'in force_mN.'
        ),
    ] = ''
    time_column: Annotated[
        str, _of_others(help='Column of the times. Default: t, time, timestamp or stamp.')
    ] = ''
    trial_column: Annotated[
        str,
        _of_others(
            help='Column with the trial of each row. Default: trial or trial_id. If there is no '
            'such column, a file is one trial.'
        ),
    ] = ''
    label_column: Annotated[
        str, _of_others(help='Column of the labels. Default: label, object or object_label.')
    ] = ''
    time_unit: Annotated[
        str,
        _of_others(
            help='Unit of the times if their heading does not state it: s, ms, us, ns or min; '
            'iso for texts such as 2026-11-28 12:00:00.5, day-first for 28.11.2026 12:00:00.5.'
        ),
    ] = ''
    rate_hz: Annotated[
        Optional[float],
        _of_others(
            min=0.001,
            max=1e7,
            help='Sample rate in Hz of recordings without times. If there are times, it must '
            'match them.',
        ),
    ] = None
    unit: Annotated[
        str,
        _of_others(
            help='Unit of the force if no heading states it, as in --unit mN. Forces are '
            'converted to N.'
        ),
    ] = ''
    label: Annotated[str, _of_others(help='The label of all these trials.')] = ''
    label_from: Annotated[
        str,
        _of_others(
            help='Source of the label of a file or bag: "folder", the name of its folder; "file", '
            'its name without the number at the end; or a regular expression for its path with '
            'the label in parentheses. Named groups become columns.'
        ),
    ] = ''
    labels: Annotated[
        Optional[Path],
        _of_others(
            help='File with one label per trial, for a .npy file: .npy, .txt or .csv. Default: '
            'NAME_labels or labels beside it.'
        ),
    ] = None
    topic: Annotated[
        str,
        _of_others(
            help='Topic in a bag that contains the force: WrenchStamped, Float64, Float32, '
            'JointState, or our strain. Each bag is one trial.'
        ),
    ] = ''
    field: Annotated[
        str,
        _of_others(
            help='Field of the messages, as in --field force.z, force.norm or effort.JOINT; '
            'several, separated by commas, for several channels.'
        ),
    ] = ''
    separator: Annotated[
        str,
        _of_others(
            help='Separator of the columns of a text table: comma, semicolon, tab, space, '
            'or the character. Default: comma; in .tsv a tab.'
        ),
    ] = ''
    decimal: Annotated[
        str,
        _of_others(
            help='Decimal mark of a text table, . or , as in --decimal , . Default: a point.'
        ),
    ] = ''
    header_rows: Annotated[
        Optional[int],
        _of_others(
            min=0,
            max=1000,
            help='Number of header lines of a text table. The last one names the columns. '
            'Default: 1.',
        ),
    ] = None


STATEMENTS = Statements()
ClusterOption = Annotated[
    str,
    typer.Option(
        metavar='ADDRESS',
        help='Compute on the workers of this Dask scheduler, such as tcp://HOST:8786. '
        'These packages must be installed there, too. The results are the same, bit for bit.',
    ),
]
SensorOption = Annotated[str, typer.Option(help='Serial port of the load cell.')]
SensorTopicOption = Annotated[
    str,
    typer.Option(
        metavar='TOPIC[:AXIS|:JOINT]',
        help='Topic of a force that another node publishes, instead of a port: WrenchStamped, '
        'Wrench, Float64, Float32 or JointState, such as /ft/wrench:fx.',
    ),
]
SimulatedOption = Annotated[
    bool, typer.Option('--simulated', help='Start simulated devices and use their ports.')
]
ModelOption = Annotated[
    Optional[Path],
    typer.Option(
        exists=True,
        help='Folder of model files from `tactile train`, or one file. Features are '
        'computed as the models require.',
    ),
]
ParamsOption = Annotated[
    Optional[Path],
    typer.Option(exists=True, help='YAML file with ROS parameters for the nodes.'),
]


@dataclasses.dataclass(frozen=True)
class RigOptions:
    """Options on a rig: its ports, and the parameters of its nodes."""

    guide: Annotated[str, typer.Option(help='Serial port of the linear guide (Grbl).')] = ''
    tendon: Annotated[str, typer.Option(help='Serial port of the Dynamixel.')] = ''
    sensor: SensorOption = ''
    sensor_topic: SensorTopicOption = ''
    simulated: SimulatedOption = False
    params: ParamsOption = None


RIG = RigOptions()
NamespaceOption = Annotated[str, typer.Option(help='Namespace of all nodes.')]
RecordOption = Annotated[Optional[Path], typer.Option(help='Record to this bag; must not exist.')]
WatchOption = Annotated[
    bool,
    typer.Option(
        '--watch', help='Serve a live page; its address is printed. See `tactile watch`.'
    ),
]
QuietOption = Annotated[
    bool, typer.Option('--quiet', help='Do not print a line for each classification.')
]
ProtocolArgument = Annotated[
    str, typer.Argument(**choice('texture', 'stiffness'), help='Kind of trial.')
]
ContactOption = Annotated[
    str, typer.Option(**choice('flexion', 'abduction'), help='Contact of the finger.')
]
DescriptionOption = Annotated[
    Optional[Path],
    typer.Option(
        exists=True,
        help='Folder with your own finger, rig, plates or objects: YAML files that override '
        'the files of the package.',
    ),
]
JobsOption = Annotated[
    int, typer.Option(help='Number of processes for the simulation; -1 for all cores.')
]
