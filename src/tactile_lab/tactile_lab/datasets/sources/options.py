# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command-line options for recordings that do not state their rate, labels or columns."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_bags.sources import files

_OTHERS = 'Recordings of others'

SkipBadOption = Annotated[
    bool,
    typer.Option(
        '--skip-bad',
        help='Leave out trials of the archive that cannot be used, and list them: values '
        'that are not finite, too short, no features.',
    ),
]


@dataclass(frozen=True)
class SourceOptions(files.SourceOptions):
    """The statements about recordings as options of a command."""

    columns: Annotated[
        Optional[list[str]],
        typer.Option(
            '--column',
            metavar='ROLE=NAME',
            rich_help_panel=_OTHERS,
            help='What a column of a table is: time, trial, label or value, as in --column '
            'value=force_n or --column time=t:ms. May be given several times; several names with '
            'commas.',
        ),
    ] = None
    rate_hz: Annotated[
        Optional[float],
        typer.Option(
            min=0.001,
            max=1e7,
            rich_help_panel=_OTHERS,
            help='Sample rate in Hz of recordings without times. With times it must fit them.',
        ),
    ] = None
    unit: Annotated[
        str,
        typer.Option(
            rich_help_panel=_OTHERS,
            help='Unit of the signal where no heading says it, as in --unit mN.',
        ),
    ] = ''
    label: Annotated[
        str, typer.Option(rich_help_panel=_OTHERS, help='The label of all these trials.')
    ] = ''
    label_from: Annotated[
        str,
        typer.Option(
            rich_help_panel=_OTHERS,
            help='Where the label of a file or bag is: "folder", the one that it lies in; "file", '
            'its name without the number at the end; or a regular expression for its path with '
            'the label in brackets. Named groups become columns.',
        ),
    ] = ''
    labels: Annotated[
        Optional[Path],
        typer.Option(
            rich_help_panel=_OTHERS,
            help='File with one label a trial, for a .npy file: .npy, .txt or .csv. Default: '
            'NAME_labels or labels beside it.',
        ),
    ] = None
    topic: Annotated[
        str,
        typer.Option(
            rich_help_panel=_OTHERS,
            help='Topic of a bag with the force: WrenchStamped, Float64, Float32, JointState, or '
            'our strain. A bag is a trial.',
        ),
    ] = ''
    field: Annotated[
        str,
        typer.Option(
            rich_help_panel=_OTHERS,
            help='Field of its messages, as in --field force.z, force.norm or effort.JOINT; '
            'several with commas are several channels.',
        ),
    ] = ''
    separator: Annotated[
        str,
        typer.Option(
            rich_help_panel=_OTHERS,
            help='What stands between the columns of a text table: comma, semicolon, tab, space, '
            'or the character. Default: comma; in .tsv a tab. LabVIEW files (.lvm) state it.',
        ),
    ] = ''
    decimal: Annotated[
        str,
        typer.Option(
            rich_help_panel=_OTHERS,
            help='Decimal mark of a text table, . or , as in --decimal , . Default: a point.',
        ),
    ] = ''
    header_rows: Annotated[
        Optional[int],
        typer.Option(
            min=0,
            max=1000,
            rich_help_panel=_OTHERS,
            help='Lines of a text table above its numbers. The last one names the columns; one '
            'with their units may follow. Default: 1.',
        ),
    ] = None
