# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command-line options that select trials of recordings and their features.

Typer reads the annotations; see `tactile_lab.commands.analysis.requests` for their form.
"""

from dataclasses import dataclass, field
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_lab.datasets.sources.options import SkipBadOption, SourceOptions
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_lab.datasets.selection import TrainTest


@dataclass(frozen=True, kw_only=True)
class TrialOptions:
    """Options shared by `features`, `evaluate`, `compare` and `train`; see their ``--help``.

    A field without a help text here is an option only where a command declares it anew.
    """

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
            '--crop',
            '--static-phase',
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
    sources: SourceOptions = field(default_factory=SourceOptions)
    task: Optional[str] = None
    train_where: Optional[str] = None
    test_where: Optional[str] = None
    over: Optional[str] = None
    detrend: Optional[str] = None
    features: Optional[str] = None

    @property
    def train_test(self) -> 'TrainTest':
        """The stated split into trials to train on and to test on."""
        from tactile_lab.datasets.selection import (
            TrainTest,  # NumPy, which ``--help`` does not need
        )

        return TrainTest(self.train_where, self.test_where)

    def check_for_bags(self) -> None:
        """Refuse what says how to cut or read trials, which bags with trial events say.

        Raises
        ------
        TactileError
            When such an option is given.
        """
        for name in ('channel', 'where', 'crop', 'resample_hz', 'skip_bad', 'speed_column'):
            if getattr(self, name):
                option = name.replace('_', '-')
                raise TactileError(
                    f'--{option} is for archives; a bag says itself what a trial is'
                )
        if any(vars(self.sources).values()):
            raise TactileError(
                'these are bags with trial events, which say themselves what a trial is: leave '
                '--column, --rate-hz, --label, --label-from, --labels and --field out'
            )
