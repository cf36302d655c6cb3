# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Options of the commands that read recordings: which trials, and what a recording leaves unsaid.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.cli.options import Protocol

RecordingsArgument = Annotated[
    list[Path],
    typer.Argument(
        help='Bags with trial events; or any other recordings: a NumPy archive (.npz), .npy, CSV '
        'or Parquet files, bags of others, or folders of these.'
    ),
]
RepetitionsOption = Annotated[
    Optional[int],
    typer.Option(
        min=1,
        help='How often it is repeated. Default: 10; once where trials squared times features '
        'are more than 2e9, and what else takes long is left out then.',
    ),
]
TaskOption = Annotated[
    Optional[Protocol],
    typer.Option(help='Which features to compute. Bags with trial events say it themselves.'),
]
ChannelOption = Annotated[
    Optional[str],
    typer.Option(help='Channel of the recordings, "mean" of all, or "all"; default: 0.'),
]
WhereOption = Annotated[
    Optional[str],
    typer.Option(
        help='Only trials of which a column of the archive is true, as in --where balanced, '
        'or has a value, as in --where direction=1.'
    ),
]
CropOption = Annotated[
    Optional[str],
    typer.Option(
        '--crop',
        '--static-phase',
        help='Part of each trial of an archive that counts, in seconds, as in --crop 1:5. '
        'Default: all of it.',
    ),
]
ResampleOption = Annotated[
    Optional[float],
    typer.Option(
        help='Resample the archive to this rate first, with a low-pass against aliasing.'
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
OverOption = Annotated[
    Optional[str],
    typer.Option(
        help='Texture: features over this stretch of surface instead of over time, for any '
        'sliding speed: length of the window and finest scale in mm, as in --over 45:0.5.'
    ),
]
SpeedColumnOption = Annotated[
    Optional[str],
    typer.Option(
        help='Column of the archive with the sliding speeds, for --over; its name ends in '
        'the unit, _mm_s or _m_s. A bag states them itself.'
    ),
]
_OTHERS = 'Recordings of others'
ColumnOption = Annotated[
    Optional[list[str]],
    typer.Option(
        metavar='ROLE=NAME',
        rich_help_panel=_OTHERS,
        help='What a column of a table is: time, trial, label or value, as in --column '
        'value=force_n or --column time=t:ms. May be given several times; several names with '
        'commas.',
    ),
]
RateOption = Annotated[
    Optional[float],
    typer.Option(
        min=0.001,
        max=1e7,
        rich_help_panel=_OTHERS,
        help='Sample rate in Hz of recordings without times. With times it must fit them.',
    ),
]
LabelOption = Annotated[
    str, typer.Option(rich_help_panel=_OTHERS, help='The label of all these trials.')
]
LabelFromOption = Annotated[
    str,
    typer.Option(
        rich_help_panel=_OTHERS,
        help='Where the label of a file or bag is: "folder", the one that it lies in; "file", its '
        'name without the number at the end; or a regular expression for its path with the label '
        'in brackets. Named groups become columns.',
    ),
]
LabelsOption = Annotated[
    Optional[Path],
    typer.Option(
        rich_help_panel=_OTHERS,
        help='File with one label a trial, for a .npy file: .npy, .txt or .csv. Default: '
        'NAME_labels or labels beside it.',
    ),
]
TopicOption = Annotated[
    str,
    typer.Option(
        rich_help_panel=_OTHERS,
        help='Topic of a bag with the force: WrenchStamped, Float64, Float32, JointState, or our '
        'strain. A bag is a trial.',
    ),
]
FieldOption = Annotated[
    str,
    typer.Option(
        rich_help_panel=_OTHERS,
        help='Field of its messages, as in --field force.z, force.norm or effort.JOINT; several '
        'with commas are several channels.',
    ),
]
