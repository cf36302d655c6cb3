# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options that several commands share."""

from collections.abc import Callable
import dataclasses
import functools
import inspect
from pathlib import Path
from typing import Annotated, Any, get_args, Optional

import typer

from tactile_analysis.options import SKIP_BAD, SourceOptions, TrialOptions


def expand(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that has an option for each field of the dataclasses among its parameters.

    A parameter of ``command`` is replaced in this way if its default is an instance of a
    dataclass. The returned command makes the instance from the options and passes it to
    ``command``.
    """
    groups: dict[str, Any] = {}
    shown = []
    for parameter in inspect.signature(command).parameters.values():
        if dataclasses.is_dataclass(parameter.default):
            groups[parameter.name] = parameter.default
            shown += [
                parameter.replace(
                    name=field.name,
                    default=field.default,
                    annotation=_to_option(type(parameter.default), field),
                )
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


def _to_option(group: type, field: dataclasses.Field[Any]) -> Any:
    """Return the annotation of a field for Typer; a description and limits become an option."""
    kind, described, *limits = get_args(field.type)
    if not isinstance(described, str):
        return field.type
    names = [f'--{field.name.replace("_", "-")}'] if kind is bool else []
    panel = getattr(group, 'TITLE', None)
    option = typer.Option(
        *names, help=described, rich_help_panel=panel, **(limits[0] if limits else {})
    )
    return Annotated[kind, option]


def split(text: Optional[str]) -> tuple[str, ...]:
    """Split the value of an option at its commas; omit empty parts."""
    return tuple(filter(None, map(str.strip, (text or '').split(','))))


def choice(*values: str) -> dict[str, Any]:
    """Return arguments of `typer.Option` that restrict the option to these values.

    The values are listed in the help. This does not use an ``Enum``, because every command would
    have to convert its members, nor ``click_type``, because Typer 0.22 has removed it.
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
SkipBadOption = Annotated[bool, typer.Option('--skip-bad', help=SKIP_BAD)]


SOURCES, TRIALS = SourceOptions(), TrialOptions()
OverOption = Annotated[
    Optional[str],
    typer.Option(
        help='Texture: compute features over distance instead of time, so that trials of '
        'different sliding speeds can be compared. Give the length of the window and the finest '
        'scale in mm, as in --over 45:0.5.'
    ),
]
DetrendOption = Annotated[
    Optional[str],
    typer.Option(
        **choice('none', 'mean', 'linear'),
        help='Texture: what is subtracted from the signal before the Fourier transform: none, '
        'the mean (as in the paper), or the least-squares line (linear). Default: as recorded; '
        'for an archive, the default of the feature node.',
    ),
]
FoldsOption = Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')]
RepetitionsOption = Annotated[
    Optional[int],
    typer.Option(
        min=1,
        help='Number of repetitions of the cross-validation. Default: 10. For large data (trials '
        'squared times features above 2e9), the default is 1, and features are not selected.',
    ),
]


SensorOption = Annotated[str, typer.Option(help='Serial port of the load cell.')]
SensorTopicOption = Annotated[
    str,
    typer.Option(
        metavar='TOPIC[:AXIS|:JOINT]',
        help='Topic on which another node publishes the force, such as /ft/wrench:fx, instead of '
        'a port. Messages: WrenchStamped, Wrench, Float64, Float32 or JointState.',
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
    """Options of commands that use a rig: its ports, and the parameters of its nodes."""

    guide: Annotated[str, typer.Option(help='Serial port of the linear guide (Grbl).')] = ''
    tendon: Annotated[str, typer.Option(help='Serial port of the Dynamixel.')] = ''
    sensor: SensorOption = ''
    sensor_topic: SensorTopicOption = ''
    simulated: SimulatedOption = False
    params: ParamsOption = None


RIG = RigOptions()
NamespaceOption = Annotated[str, typer.Option(help='Namespace of all nodes.')]
RecordOption = Annotated[
    Optional[Path], typer.Option(help='Record to this new bag; must not exist.')
]
WatchOption = Annotated[
    bool,
    typer.Option('--watch', help='Serve a live page, and print its address. See `tactile watch`.'),
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
        help='Folder with descriptions of your own finger, rig, plates or objects: YAML files '
        'that replace the files of the package.',
    ),
]
JobsOption = Annotated[
    int, typer.Option(help='Number of processes for the simulation; -1 for all cores.')
]
