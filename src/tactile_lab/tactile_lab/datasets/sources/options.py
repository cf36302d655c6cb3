# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command-line options for recordings that do not state their rate, labels or columns."""

from dataclasses import dataclass
from pathlib import Path
import re
from typing import Annotated, Optional

import typer

from tactile_lab.datasets.sources.questions import SourceError

ROLES = ('time', 'trial', 'label', 'value')
"""Possible roles of a column of a table."""

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
class SourceOptions:
    """Statements about recordings; each is empty or None where nothing is stated."""

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

    @property
    def roles(self) -> dict[str, tuple[str, ...]]:
        """Names of columns by role.

        Raises
        ------
        SourceError
            When a text is not ``ROLE=NAME``.
        """
        roles: dict[str, tuple[str, ...]] = {}
        for text in self.columns or ():
            role, _, names = text.partition('=')
            if role not in ROLES or not names:
                raise SourceError(
                    f'--column is "{text}"; it must be ROLE=NAME with a role of '
                    f'{", ".join(ROLES)}, as in --column value=force_n'
                )
            roles[role] = tuple(name.strip() for name in names.split(','))
        return roles

    def compile_label_pattern(self) -> re.Pattern[str] | None:
        """Return ``label_from`` as a pattern; None where it is none.

        Raises
        ------
        SourceError
            When it is no regular expression with a group.
        """
        if self.label_from in ('', 'folder', 'file'):
            return None
        try:
            pattern = re.compile(self.label_from)
        except re.error as error:
            raise SourceError(
                f'--label-from: "{self.label_from}" is no pattern: {error}'
            ) from error
        if not pattern.groups:
            raise SourceError(
                f'--label-from: "{self.label_from}" must be folder, file, or a regular '
                r'expression with the label in brackets, as in "(\w+)_\d+"'
            )
        return pattern
