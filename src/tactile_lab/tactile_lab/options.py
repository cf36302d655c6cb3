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
    """Return a command that has options instead of its parameters whose default is a dataclass.

    Each field of the dataclass is one option, in its place. The command gets the dataclass.
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
    """Return the parts between the commas of an option, without blank ones."""
    return tuple(filter(None, map(str.strip, (text or '').split(','))))


def choice(*values: str) -> dict[str, Any]:
    """Return what makes an option take one of these values, and name them in the help.

    Typer's own ways: an ``Enum``, whose members each command would unwrap; and ``click_type``,
    which Typer no longer has since 0.22.
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
        metavar='INT',  # short, so that the help has room for its other columns
        help='Seed of all random numbers: the same seed gives the same results.',
    ),
]
RecordingsArgument = Annotated[
    list[Path],
    typer.Argument(
        exists=True,
        help='Bags with trial events; or any other recordings: a NumPy archive (.npz), .npy, CSV '
        'or Parquet files, bags of others, or folders of these.',
    ),
]
TaskOption = Annotated[
    Optional[str],
    typer.Option(
        **choice('texture', 'stiffness'),
        help='Which features to compute. Bags with trial events say it themselves.',
    ),
]
SkipBadOption = Annotated[
    bool,
    typer.Option(
        '--skip-bad',
        help='Leave out trials of the archive that cannot be used, and list them: values '
        'that are not finite, too short, no features.',
    ),
]


@dataclasses.dataclass(frozen=True)
class ArchiveOptions:
    """Options on the trials of an archive, which are fields of `Reading`."""

    channel: Annotated[
        Optional[str],
        typer.Option(help='Channel of the recordings, "mean" of all, or "all"; default: 0.'),
    ] = None
    where: Annotated[
        Optional[str],
        typer.Option(
            help='Only trials of which a column of the archive is true, as in --where balanced, '
            'or has a value, as in --where direction=1.'
        ),
    ] = None
    crop: Annotated[
        Optional[str],
        typer.Option(
            help='Part of each trial of an archive that counts, in seconds, as in --crop 1:5. '
            'Default: all of it.',
        ),
    ] = None
    resample_hz: Annotated[
        Optional[float],
        typer.Option(
            help='Resample the archive to this rate first, with a low-pass against aliasing.'
        ),
    ] = None
    skip_bad: SkipBadOption = False
    speed_column: Annotated[
        Optional[str],
        typer.Option(
            help='Column of the archive with the sliding speeds, for --over; its name ends in '
            'the unit, _mm_s or _m_s. A bag states them itself.'
        ),
    ] = None


ARCHIVES = ArchiveOptions()
OverOption = Annotated[
    Optional[str],
    typer.Option(
        help='Texture: features over this stretch of surface instead of over time, for any '
        'sliding speed: length of the window and finest scale in mm, as in --over 45:0.5.'
    ),
]
DetrendOption = Annotated[
    Optional[str],
    typer.Option(
        **choice('none', 'mean', 'linear'),
        help='Texture: what is subtracted before the Fourier transform: nothing, the mean, as in '
        'the paper, or the least-squares line. Default: as recorded; for an archive as the '
        'features node does.',
    ),
]
FoldsOption = Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')]
RepetitionsOption = Annotated[
    Optional[int],
    typer.Option(
        min=1,
        help='How often it is repeated. Default: 10; for large data (trials squared times '
        'features above 2e9) once, without feature selection.',
    ),
]


def _of_others(*names: str, **more: Any) -> Any:
    """Return an option of the part of the help on recordings of others."""
    return typer.Option(*names, rich_help_panel='Recordings of others', **more)


@dataclasses.dataclass(frozen=True)
class Statements:
    """Options on recordings of others, which are the fields of `SourceOptions`."""

    force_column: Annotated[
        str,
        _of_others(
            help='Column of the force in a table; several with commas are several channels. '
            'Default: the column force or tension, with or without a unit, as in force_mN.'
        ),
    ] = ''
    time_column: Annotated[
        str, _of_others(help='Column of the times. Default: t, time, timestamp or stamp.')
    ] = ''
    trial_column: Annotated[
        str,
        _of_others(
            help='Column that names the trial of each row. Default: trial or trial_id. Without '
            'one, a file is one trial.'
        ),
    ] = ''
    label_column: Annotated[
        str, _of_others(help='Column of the labels. Default: label, object or object_label.')
    ] = ''
    time_unit: Annotated[
        str,
        _of_others(
            help='Unit of the times where their heading does not say it: s, ms, us, ns or min; '
            'iso for texts such as 2026-11-28 12:00:00.5, day-first for 28.11.2026 12:00:00.5.'
        ),
    ] = ''
    rate_hz: Annotated[
        Optional[float],
        _of_others(
            min=0.001,
            max=1e7,
            help='Sample rate in Hz of recordings without times. With times it must fit them.',
        ),
    ] = None
    unit: Annotated[
        str,
        _of_others(
            help='Unit of the force where no heading says it, as in --unit mN. Forces are '
            'converted to N.'
        ),
    ] = ''
    label: Annotated[str, _of_others(help='The label of all these trials.')] = ''
    label_from: Annotated[
        str,
        _of_others(
            help='Where the label of a file or bag is: "folder", the one that it lies in; "file", '
            'its name without the number at the end; or a regular expression for its path with '
            'the label in brackets. Named groups become columns.'
        ),
    ] = ''
    labels: Annotated[
        Optional[Path],
        _of_others(
            help='File with one label a trial, for a .npy file: .npy, .txt or .csv. Default: '
            'NAME_labels or labels beside it.'
        ),
    ] = None
    topic: Annotated[
        str,
        _of_others(
            help='Topic of a bag with the force: WrenchStamped, Float64, Float32, JointState, or '
            'our strain. A bag is a trial.'
        ),
    ] = ''
    field: Annotated[
        str,
        _of_others(
            help='Field of its messages, as in --field force.z, force.norm or effort.JOINT; '
            'several with commas are several channels.'
        ),
    ] = ''
    separator: Annotated[
        str,
        _of_others(
            help='What stands between the columns of a text table: comma, semicolon, tab, space, '
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
            help='Lines of a text table above its numbers. The last one names the columns. '
            'Default: 1.',
        ),
    ] = None


STATEMENTS = Statements()
ClusterOption = Annotated[
    str,
    typer.Option(
        metavar='ADDRESS',
        help='Compute on the workers of this Dask scheduler, such as tcp://HOST:8786. '
        'These packages must be installed there, too. The results are equal, bit for bit.',
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
        help='Folder of model files, as `tactile train` writes it, or one file. Features are '
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
RecordOption = Annotated[
    Optional[Path], typer.Option(help='Record into this bag; must not exist yet.')
]
WatchOption = Annotated[
    bool,
    typer.Option(
        '--watch', help='Serve a live page; its address is printed. See `tactile watch`.'
    ),
]
QuietOption = Annotated[
    bool, typer.Option('--quiet', help='Print no line for each classification.')
]
ProtocolArgument = Annotated[
    str, typer.Argument(**choice('texture', 'stiffness'), help='Which kind of trial.')
]
ContactOption = Annotated[
    str, typer.Option(**choice('flexion', 'abduction'), help='How the finger touches.')
]
DescriptionOption = Annotated[
    Optional[Path],
    typer.Option(
        exists=True,
        help='Folder with your own finger, rig, plates or objects: YAML files laid over '
        'those of the package.',
    ),
]
JobsOption = Annotated[
    int, typer.Option(help='How many processes simulate; -1: one for each core.')
]
