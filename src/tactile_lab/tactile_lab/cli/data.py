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

"""Arguments and help of the commands on recordings; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from pathlib import Path
from typing import Annotated, Optional

import typer

from tactile_lab.cli.options import (
    check_paths,
    Classifier,
    ClusterOption,
    Contact,
    Design,
    DetrendOption,
    JsonOption,
    refusals,
    Scaling,
    SeedOption,
    SimulatedProtocol,
)
from tactile_lab.cli.recording_options import (
    ChannelOption,
    ColumnOption,
    CropOption,
    FieldOption,
    LabelFromOption,
    LabelOption,
    LabelsOption,
    OverOption,
    RateOption,
    RecordingsArgument,
    RepetitionsOption,
    ResampleOption,
    SkipBadOption,
    SpeedColumnOption,
    TaskOption,
    TopicOption,
    WhereOption,
)


def simulate(
    protocol: Annotated[SimulatedProtocol, typer.Argument(help='Which kind of trial.')],
    output: Annotated[Path, typer.Option('--output', '-o', help='Folder to write the bags into.')],
    contact: Annotated[
        Optional[list[Contact]],
        typer.Option(help='How the finger touches; give it twice for both. Default: both.'),
    ] = None,
    trials: Annotated[
        int,
        typer.Option(min=1, max=100_000, help='Trials on each plate or object in each session.'),
    ] = 60,
    sessions: Annotated[
        int,
        typer.Option(
            min=1,
            max=1000,
            help='How often the rig is set up anew: trials of one session share its finger and '
            'temperature.',
        ),
    ] = 1,
    design: Annotated[
        Design,
        typer.Option(
            help='crossed: the plate or object is fixed anew before each trial. as-published: '
            'once, for all its trials, in one session: label and mounting coincide.'
        ),
    ] = Design.crossed,
    speed: Annotated[
        Optional[list[float]],
        typer.Option(
            min=1,
            max=200,
            help='Sliding speed over the plate in mm/s; give it several times for a bag of each. '
            'Default: 15.',
        ),
    ] = None,
    seed: SeedOption = 1,
    description: Annotated[
        Optional[Path],
        typer.Option(
            help='Folder with your own finger, rig, plates or objects: YAML files laid over '
            'those of the package.'
        ),
    ] = None,
    jobs: Annotated[
        int, typer.Option(help='How many processes simulate; -1: one for each core.')
    ] = -1,
    plot: Annotated[
        Optional[Path],
        typer.Option(help='Draw one of the trials into this PNG file.'),
    ] = None,
    cluster: ClusterOption = '',
    json_output: JsonOption = False,
) -> None:
    """Make bags of **simulated** trials, without waiting in real time.

    One bag for each kind of contact, with plates or objects times sessions times trials in
    it. The bags hold the same messages as live recordings, marked as simulated. The same
    seed gives the same bytes, whatever the number of processes.

    Exits with 3 when the simulator found no equilibrium in some trial: such trials are in
    the bag up to that time, end as aborted, and give no features. **slip** trials, in which
    the object is pulled sideways, are only simulated: no rig can run them, and there are no
    slip features yet. Their bag says when each object truly began to slip.
    """
    with refusals():
        check_paths(description)
        from tactile_lab.commands.cluster import on_cluster
        from tactile_lab.commands.simulate import run_simulate, SimulateRequest

        with on_cluster(cluster):
            complete = run_simulate(
                SimulateRequest(
                    protocol=protocol.value,
                    contacts=tuple(dict.fromkeys(c.value for c in contact or list(Contact))),
                    trials_per_label=trials,
                    sessions=sessions,
                    design=design.value,
                    seed=seed,
                    folder=output,
                    description=description,
                    jobs=jobs,
                    plot=plot,
                    speeds_m_s=tuple(mm_s / 1e3 for mm_s in dict.fromkeys(speed or ())),
                ),
                as_json=json_output,
            )
    raise typer.Exit(0 if complete else 3)


def train(
    recordings: RecordingsArgument,
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Folder to write the model files into.')
    ],
    task: TaskOption = None,
    classifier: Annotated[
        Classifier, typer.Option(help='Which one goes into the model file.')
    ] = Classifier.knn,
    scaling: Annotated[
        Optional[Scaling],
        typer.Option(
            help='Scaling in the model file. Default: none for texture, whose features share '
            'one unit; standard for stiffness, whose features do not.'
        ),
    ] = None,
    false_alarms: Annotated[
        float,
        typer.Option(
            min=0.001,
            max=0.5,
            help='Share of trials on known things that the model may call unknown; it finds its '
            'threshold on trials held out.',
        ),
    ] = 0.05,
    running: Annotated[
        Optional[str],
        typer.Option(
            help='Texture: answer also after so many seconds of the window, as in '
            '--running 0.5,1,1.5,2,2.5.'
        ),
    ] = None,
    stop_error: Annotated[
        float,
        typer.Option(
            min=0.001,
            max=0.5,
            help='Share of wrong answers among those that are decided before the window is full.',
        ),
    ] = 0.05,
    over: OverOption = None,
    detrend: DetrendOption = None,
    recalibrate: Annotated[
        Optional[Path],
        typer.Option(
            metavar='MODEL',
            help='Train nothing: write this model for the session of the bags, which hold five '
            'or more of its trials with known labels. Threshold and features are corrected.',
        ),
    ] = None,
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Sets of features instead of the recorded ones, as in --features '
            'glide_waveform,hold_waveform; the classifier rocket needs these. With auto, set and '
            'classifier are chosen inside the folds.'
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option('--force', help='Replace model files of an earlier training.')
    ] = False,
    folds: Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')] = 6,
    repetitions: RepetitionsOption = None,
    seed: SeedOption = 0,
    channel: ChannelOption = None,
    where: WhereOption = None,
    crop: CropOption = None,
    resample_hz: ResampleOption = None,
    skip_bad: SkipBadOption = False,
    speed_column: SpeedColumnOption = None,
    column: ColumnOption = None,
    rate_hz: RateOption = None,
    label: LabelOption = '',
    label_from: LabelFromOption = '',
    labels: LabelsOption = None,
    topic: TopicOption = '',
    field: FieldOption = '',
    cluster: ClusterOption = '',
    json_output: JsonOption = False,
) -> None:
    """Fit the four classifiers, cross-validate them, write a model file.

    Prints the accuracy of six-fold cross-validation, repeated ten times, for all four
    classifiers with and without scaling. One ONNX file is written for each task and
    kind of contact that the recordings hold. Its scores are calibrated probabilities, or raw
    where calibration was worse in both of two sessions. It says *unknown* to what is unlike all
    training trials. Nothing is written over files of an earlier training without --force.
    """
    with refusals():
        check_paths(*recordings)
        from tactile_lab.commands.analysis.train import run_recalibrate, run_train, TrainRequest
        from tactile_lab.commands.cluster import on_cluster
        from tactile_lab.datasets.sources.options import SourceOptions

        if recalibrate is not None:
            run_recalibrate(recalibrate, recordings, output, force=force, as_json=json_output)
            return
        with on_cluster(cluster):
            run_train(
                recordings,
                TrainRequest(
                    folder=output,
                    classifier=classifier.value,
                    scaling=scaling.value if scaling else None,
                    cross_validation={
                        'folds': folds,
                        'repetitions': repetitions,
                        'random_state': seed,
                    },
                    false_alarm_rate=false_alarms,
                    running=running,
                    stop_error_rate=stop_error,
                    force=force,
                    over=over,
                    detrend=detrend.value if detrend else None,
                    features=features,
                    task=task.value if task else None,
                    channel=channel,
                    where=where,
                    crop=crop,
                    resample_hz=resample_hz,
                    skip_bad=skip_bad,
                    speed_column=speed_column,
                    sources=SourceOptions(
                        columns=tuple(column or ()),
                        rate_hz=rate_hz,
                        label=label,
                        label_from=label_from,
                        labels=labels,
                        topic=topic,
                        field=field,
                    ),
                ),
                as_json=json_output,
            )


def robustness(
    report: Annotated[
        Path,
        typer.Option('--report', '-o', help='Report to write: a folder, or an HTML file.'),
    ],
    contact: Annotated[Contact, typer.Option(help='How the finger touches.')] = Contact.flexion,
    description: Annotated[
        Optional[Path],
        typer.Option(
            help='Folder with your own finger, rig, plates or objects: YAML files laid over '
            'those of the package.'
        ),
    ] = None,
    seed: SeedOption = 1,
    jobs: Annotated[
        int, typer.Option(help='How many processes simulate; -1: one for each core.')
    ] = -1,
    cluster: ClusterOption = '',
    json_output: JsonOption = False,
) -> None:
    """Find out on **simulated** trials how good sensor and rig must be.

    Noise, drift, lost samples, jitter, glide speed, contact depth and sample rate are made
    worse one at a time: accuracy of a model that was trained under good conditions, and of
    one that was trained under the bad ones. Takes about a minute at most.
    """
    with refusals():
        from tactile_lab.commands.analysis.robustness import run_robustness
        from tactile_lab.commands.cluster import on_cluster

        with on_cluster(cluster):
            run_robustness(
                report,
                contact=contact.value,
                description=description,
                seed=seed,
                jobs=jobs,
                as_json=json_output,
            )
