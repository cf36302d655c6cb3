# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is asked of `tactile simulate`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None``: so ``Optional[X]``.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.options import choice, SeedOption


@dataclass(frozen=True, kw_only=True)
class SimulateRequest:
    """The arguments of `tactile simulate`; see its ``--help``."""

    protocol: Annotated[
        str,
        typer.Argument(**choice('texture', 'stiffness', 'slip'), help='Which kind of trial.'),
    ]
    folder: Annotated[Path, typer.Option('--output', '-o', help='Folder to write the bags into.')]
    contact: Annotated[
        Optional[list[str]],
        typer.Option(
            **choice('flexion', 'abduction'),
            help='How the finger touches; give it twice for both. Default: both.',
        ),
    ] = None
    trials_per_label: Annotated[
        int,
        typer.Option(
            '--trials', min=1, max=100_000, help='Trials on each plate or object in each session.'
        ),
    ] = 60
    sessions: Annotated[
        int,
        typer.Option(
            min=1,
            max=1000,
            help='How often the rig is set up anew: trials of one session share its finger and '
            'temperature.',
        ),
    ] = 1
    design: Annotated[
        str,
        typer.Option(
            **choice('crossed', 'as-published'),
            help='crossed: the plate or object is fixed anew before each trial. as-published: '
            'once, for all its trials, in one session: label and mounting coincide.',
        ),
    ] = 'crossed'
    speed: Annotated[
        Optional[list[float]],
        typer.Option(
            min=1,
            max=200,
            help='Sliding speed over the plate in mm/s; give it several times for a bag of each. '
            'Default: 15.',
        ),
    ] = None
    seed: SeedOption = 1
    description: Annotated[
        Optional[Path],
        typer.Option(
            help='Folder with your own finger, rig, plates or objects: YAML files laid over '
            'those of the package.'
        ),
    ] = None
    jobs: Annotated[
        int, typer.Option(help='How many processes simulate; -1: one for each core.')
    ] = -1
    plot: Annotated[
        Optional[Path],
        typer.Option(help='Draw one of the trials into this PNG file.'),
    ] = None

    @property
    def contacts(self) -> tuple[str, ...]:
        """Each kind of contact once."""
        return tuple(dict.fromkeys(self.contact or ('flexion', 'abduction')))

    @property
    def speeds_m_s(self) -> tuple[float, ...]:
        """Each sliding speed once [m/s]."""
        return tuple(mm_s / 1e3 for mm_s in dict.fromkeys(self.speed or ()))
