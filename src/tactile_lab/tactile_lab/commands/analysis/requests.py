# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests of the commands on recordings of many trials."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.datasets.trial_options import TrialOptions
from tactile_lab.options import (
    choice,
    RecordingsArgument,
    SeedOption,
)
from tactile_ros.errors import TactileError

RepetitionsOption = Annotated[
    Optional[int],
    typer.Option(
        min=1,
        help='How often it is repeated. Default: 10; for large data (trials squared times '
        'features above 2e9) once, without feature selection.',
    ),
]
TaskOption = Annotated[
    Optional[str],
    typer.Option(
        **choice('texture', 'stiffness'),
        help='Which features to compute. Bags with trial events say it themselves.',
    ),
]
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


@dataclass(frozen=True, kw_only=True)
class FeaturesRequest(TrialOptions):
    """The arguments of `tactile features`; see its ``--help``."""

    recordings: RecordingsArgument
    file: Annotated[Path, typer.Option('--output', '-o', help='File to write: .parquet or .csv.')]
    task: TaskOption = None
    features: Annotated[
        Optional[str],
        typer.Option(
            help='A set of features instead of the recorded one, as in --features glide_waveform; '
            'or only these features, with commas.'
        ),
    ] = None
    group: Annotated[
        Optional[str],
        typer.Option(
            help='Columns that make the column "group", with commas. Default for bags with trial '
            'events: mounting_id.'
        ),
    ] = None
    over: OverOption = None
    detrend: DetrendOption = None
    force: Annotated[bool, typer.Option('--force', help='Replace the file.')] = False


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest(TrialOptions):
    """The arguments of `tactile evaluate`; see its ``--help``."""

    recordings: RecordingsArgument
    task: TaskOption = None
    train_where: Annotated[
        Optional[str],
        typer.Option(
            help='Train on these trials and test on those of --test-where, beside random folds '
            'over both. A column that is true, or COLUMN=VALUE, as for --where; bags too.'
        ),
    ] = None
    test_where: Annotated[
        Optional[str], typer.Option(help='Trials to test on; see --train-where.')
    ] = None
    over: OverOption = None
    detrend: DetrendOption = None
    groups: Annotated[
        Optional[list[str]],
        typer.Option(
            '--group',
            help='Beside random folds, hold out each group of trials that agree in this column, '
            'in turn; several columns with commas between them: that agree in all. May be given '
            'several times. Default for bags: session_id, or trial_block (a sixth of a session) '
            'where there is one session only.',
        ),
    ] = None
    folds: Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')] = 6
    repetitions: RepetitionsOption = None
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Only these features, separated by commas, as in --features slope,correlation; '
            'a set of features, as in --features glide_waveform; or auto: folds choose the set.'
        ),
    ] = None
    report: Annotated[
        Optional[Path],
        typer.Option(
            help='Write a report with figures: a folder, or an HTML file, which needs no other.'
        ),
    ] = None
    answers: Annotated[
        bool,
        typer.Option(
            '--answers',
            help='Also rejection of unknown objects, with each label left out in turn, and '
            'calibration of probabilities; from bags also early predictions and physical '
            'measures. Takes about half a minute more for each set of '
            'texture trials.',
        ),
    ] = False
    seed: SeedOption = 0
    is_experiment: bool = False

    @property
    def hold_out(self) -> tuple[tuple[str, ...], ...]:
        """The columns of each grouped split."""
        return tuple(
            tuple(part.strip() for part in group.split(',') if part.strip())
            for group in self.groups or ()
        )


@dataclass(frozen=True, kw_only=True)
class CompareRequest(TrialOptions):
    """The arguments of `tactile compare`; see its ``--help``."""

    model_a: Annotated[
        Path, typer.Argument(help='Model file, or a folder of them as `tactile train` writes.')
    ]
    model_b: Annotated[Path, typer.Argument(help='The other one.')]
    recordings: RecordingsArgument
    group: Annotated[
        Optional[str],
        typer.Option(
            help='Columns that make a group of trials, with commas, for the interval. '
            'Default: session_id.'
        ),
    ] = None
    unseen: Annotated[
        bool,
        typer.Option('--unseen', help='Leave out trials that one of the models was trained on.'),
    ] = False


@dataclass(frozen=True, kw_only=True)
class TrainRequest(TrialOptions):
    """The arguments of `tactile train`; see its ``--help``."""

    folder: Annotated[
        Path, typer.Option('--output', '-o', help='Folder to write the model files into.')
    ]
    task: TaskOption = None
    classifier: Annotated[
        str,
        typer.Option(
            **choice('knn', 'svm_linear', 'svm_rbf', 'tree', 'rocket'),
            help='Which one goes into the model file.',
        ),
    ] = 'knn'
    scaling: Annotated[
        Optional[str],
        typer.Option(
            **choice('standard', 'none'),
            help='Scaling in the model file. Default: none for texture, whose features share '
            'one unit; standard for stiffness, whose features do not.',
        ),
    ] = None
    false_alarm_rate: Annotated[
        float,
        typer.Option(
            '--false-alarms',
            min=0.001,
            max=0.5,
            help='False rejection rate: share of trials with known labels that the model may '
            'classify as unknown. The threshold comes from held-out trials.',
        ),
    ] = 0.05
    partial: Annotated[
        Optional[str],
        typer.Option(
            help='Texture: early predictions after these seconds of the window, as in '
            '--partial 0.5,1,1.5,2,2.5.'
        ),
    ] = None
    stop_error_rate: Annotated[
        float,
        typer.Option(
            '--stop-error',
            min=0.001,
            max=0.5,
            help='Share of wrong labels among trials that are decided before the window is full.',
        ),
    ] = 0.05
    over: OverOption = None
    detrend: DetrendOption = None
    recalibrate: Annotated[
        Optional[Path],
        typer.Option(
            metavar='MODEL',
            help='Do not train. Correct threshold and features of this model for the session of '
            'the bags, by five or more of its trials with known labels.',
        ),
    ] = None
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Sets of features instead of the recorded ones, as in --features '
            'glide_waveform,hold_waveform; the classifier rocket needs these. With auto, set and '
            'classifier are chosen inside the folds.'
        ),
    ] = None
    force: Annotated[
        bool, typer.Option('--force', help='Replace model files of an earlier training.')
    ] = False
    folds: Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')] = 6
    repetitions: RepetitionsOption = None
    seed: SeedOption = 0

    def partial_seconds(self) -> list[float]:
        """Return ``partial`` as numbers.

        Raises
        ------
        TactileError
            When it is none.
        """
        try:
            return [float(part) for part in (self.partial or '').split(',') if part.strip()]
        except ValueError:
            raise TactileError(
                f'--partial is "{self.partial}"; it must be seconds with commas between them, '
                'such as 0.5,1,1.5'
            ) from None
