# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options for reading recordings and for choosing trials and features.

Each field of an option class is an option of the commands, with its description and limits in the
annotation. This module imports nothing slow, because the commands import it for their help.
"""

# Typer 0.9 cannot read ``X | None`` or annotations that are strings, so this module uses
# ``Optional`` and does not import ``annotations`` from ``__future__``.
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Annotated, ClassVar, Optional

from tactile_ros.errors import TactileError


class SourceError(TactileError):
    """Raised if a recording cannot be read as labelled trials; the message has the remedy."""


@dataclass(frozen=True)
class SourceOptions:
    """Properties of recordings of other software; each is empty or None if it is not stated."""

    TITLE: ClassVar[str] = 'Recordings of other software'

    force_column: Annotated[
        str,
        'Column of the force in a table; several columns, separated by commas, for several '
        'channels. Default: the column force or tension, with or without a unit, as in force_mN.',
    ] = ''
    time_column: Annotated[str, 'Column of the times. Default: t, time, timestamp or stamp.'] = ''
    trial_column: Annotated[
        str,
        'Column that contains the trial of each row. Default: trial or trial_id. If there is '
        'no such column, each file is one trial.',
    ] = ''
    label_column: Annotated[
        str, 'Column of the labels. Default: label, object or object_label.'
    ] = ''
    time_unit: Annotated[
        str,
        'Unit of the times if the name of their column does not contain it: s, ms, us, ns or '
        'min; iso for texts such as 2026-11-28 12:00:00.5, day-first for 28.11.2026 '
        '12:00:00.5.',
    ] = ''
    rate_hz: Annotated[
        Optional[float],
        'Sample rate in Hz of recordings without times. If there are times, it must match them.',
        {'min': 0.001, 'max': 1e7},
    ] = None
    unit: Annotated[
        str,
        'Unit of the force if the name of its column does not contain it, as in --unit mN. '
        'Forces are converted to N.',
    ] = ''
    label: Annotated[str, 'Label of all trials of these recordings.'] = ''
    label_from: Annotated[
        str,
        'Where the label of a file or bag comes from: "folder" is the name of its folder; '
        '"file" is its name without the number at the end; a regular expression matches its '
        'path and has the label in parentheses. Named groups become columns. Default: the folder, '
        'if there are several; its parent, if the folders are named like groups (day1, day2).',
    ] = ''
    labels: Annotated[
        Optional[Path],
        'File with one label per trial, for a .npy file: .npy, .txt or .csv. Default: a file '
        'beside it with the name NAME_labels, NAME_y, labels, label or y.',
    ] = None
    topic: Annotated[
        str,
        'Topic of a bag that contains the force. Its messages are WrenchStamped, Float64, '
        'Float32, JointState, or our StrainBlock. Each bag is one trial. Default: the only topic '
        'with such messages.',
    ] = ''
    field: Annotated[
        str,
        'Field of the messages, as in --field force.z, force.norm or effort.JOINT; several, '
        'separated by commas, for several channels.',
    ] = ''
    separator: Annotated[
        str,
        'Separator of the columns of a text table: comma, semicolon, tab, space, or the '
        'character. Default: comma; in .tsv a tab.',
    ] = ''
    decimal: Annotated[
        str, 'Decimal mark of a text table, . or , as in --decimal , . Default: a point.'
    ] = ''
    header_rows: Annotated[
        Optional[int],
        'Number of header lines of a text table. The last one names the columns. Default: 1.',
        {'min': 0, 'max': 1000},
    ] = None

    def compile_label_pattern(self) -> Optional[re.Pattern[str]]:
        """Return ``label_from`` as a pattern with a group; None for '', 'folder' and 'file'."""
        if self.label_from in ('', 'folder', 'file'):
            return None
        try:
            pattern = re.compile(self.label_from)
        except re.error as error:
            raise SourceError(
                f'--label-from: "{self.label_from}" is not a regular expression: {error}'
            ) from error
        if not pattern.groups:
            raise SourceError(
                f'--label-from: "{self.label_from}" must be folder, file, or a regular '
                r'expression with the label in parentheses, as in "(\w+)_\d+"'
            )
        return pattern


SKIP_BAD = (
    'Skip unusable trials of the archive, and list them. A trial is unusable if a value is not '
    'finite, if the trial is too short, or if it has no features.'
)


@dataclass(frozen=True)
class TrialOptions:
    """Selection and cutting of the trials of recordings without trial events."""

    channel: Annotated[
        Optional[str],
        'Channel of the recordings: its name, its number from 0, "mean" (of all channels) or '
        '"all". Default: the first channel.',
    ] = None
    where: Annotated[
        Optional[str],
        'Use only trials for which a column of the archive is true (--where balanced), or has '
        'this value (--where direction=1).',
    ] = None
    crop: Annotated[
        Optional[str],
        'Part of each trial of an archive to use, in seconds, as in --crop 1:5. Default: the '
        'whole trial.',
    ] = None
    resample_hz: Annotated[
        Optional[float],
        'Resample the archive to this rate first, with an anti-aliasing low-pass filter.',
    ] = None
    skip_bad: Annotated[bool, SKIP_BAD] = False
    speed_column: Annotated[
        Optional[str],
        'Column of the archive with the sliding speeds, for --over; its name ends in the unit, '
        '_mm_s or _m_s. Bags state the speeds themselves.',
    ] = None
