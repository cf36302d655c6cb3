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
    ClusterOption,
    DetrendOption,
    JsonOption,
    refusals,
    SeedOption,
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


def import_recordings(
    sources: RecordingsArgument,
    output: Annotated[
        Path, typer.Option('--output', '-o', help='Archive to write, ending in .npz.')
    ],
    yes: Annotated[
        bool,
        typer.Option('--yes', '-y', help='Accept what is likely, instead of asking for it.'),
    ] = False,
    skip_bad: SkipBadOption = False,
    force: Annotated[bool, typer.Option('--force', help='Replace the archive.')] = False,
    column: ColumnOption = None,
    rate_hz: RateOption = None,
    label: LabelOption = '',
    label_from: LabelFromOption = '',
    labels: LabelsOption = None,
    topic: TopicOption = '',
    field: FieldOption = '',
    json_output: JsonOption = False,
) -> None:
    """Make one archive of recordings that other programs made.

    Says what it took each column, array or message for. What it cannot know it asks for on a
    terminal; elsewhere it refuses and names the option that says it. `train`, `evaluate` and
    `features` take the archive, and take the same recordings directly, with the same options.
    """
    with refusals():
        check_paths(*sources)
        from tactile_lab.commands.analysis.import_recordings import run_import
        from tactile_lab.datasets.sources.options import SourceOptions

        run_import(
            sources,
            output,
            SourceOptions(
                columns=tuple(column or ()),
                rate_hz=rate_hz,
                label=label,
                label_from=label_from,
                labels=labels,
                topic=topic,
                field=field,
            ),
            accepts_guesses=yes,
            skip_bad=skip_bad,
            force=force,
            as_json=json_output,
        )


def features(
    recordings: RecordingsArgument,
    output: Annotated[
        Path, typer.Option('--output', '-o', help='File to write: .parquet or .csv.')
    ],
    task: TaskOption = None,
    features: Annotated[
        Optional[str],
        typer.Option(
            help='A set of features instead of the recorded one, as in --features glide_waveform; '
            'or only these features, with commas.'
        ),
    ] = None,
    group: Annotated[
        Optional[str],
        typer.Option(
            help='Columns that make the column "group", with commas. Default for bags with trial '
            'events: mounting_id.'
        ),
    ] = None,
    channel: ChannelOption = None,
    where: WhereOption = None,
    crop: CropOption = None,
    resample_hz: ResampleOption = None,
    skip_bad: SkipBadOption = False,
    over: OverOption = None,
    detrend: DetrendOption = None,
    speed_column: SpeedColumnOption = None,
    force: Annotated[bool, typer.Option('--force', help='Replace the file.')] = False,
    column: ColumnOption = None,
    rate_hz: RateOption = None,
    label: LabelOption = '',
    label_from: LabelFromOption = '',
    labels: LabelsOption = None,
    topic: TopicOption = '',
    field: FieldOption = '',
    json_output: JsonOption = False,
) -> None:
    """Write the features of recordings as a table, for notebooks and other programs.

    One row a trial: source, trial, label, session, group, simulated, then one column a feature.
    The units stand in the metadata of each Parquet column, and in the names of CSV columns. With
    several tasks or contacts, each has its own file, with its name at the end.
    """
    with refusals():
        check_paths(*recordings)
        from tactile_lab.commands.analysis.feature_file import FeaturesRequest, run_features
        from tactile_lab.datasets.sources.options import SourceOptions

        run_features(
            FeaturesRequest(
                recordings=tuple(recordings),
                file=output,
                task=task.value if task else None,
                features=features,
                group=group,
                channel=channel,
                where=where,
                crop=crop,
                resample_hz=resample_hz,
                skip_bad=skip_bad,
                over=over,
                detrend=detrend.value if detrend else None,
                speed_column=speed_column,
                force=force,
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


def evaluate(
    recordings: RecordingsArgument,
    task: TaskOption = None,
    channel: ChannelOption = None,
    where: WhereOption = None,
    train_where: Annotated[
        Optional[str],
        typer.Option(
            help='Train on these trials and test on those of --test-where, beside random folds '
            'over both. A column that is true, or COLUMN=VALUE, as for --where; bags too.'
        ),
    ] = None,
    test_where: Annotated[
        Optional[str], typer.Option(help='Trials to test on; see --train-where.')
    ] = None,
    crop: CropOption = None,
    resample_hz: ResampleOption = None,
    skip_bad: SkipBadOption = False,
    over: OverOption = None,
    detrend: DetrendOption = None,
    speed_column: SpeedColumnOption = None,
    group: Annotated[
        Optional[list[str]],
        typer.Option(
            help='Beside random folds, hold out each group of trials that agree in this column, '
            'in turn; several columns with commas between them: that agree in all. May be given '
            'several times. Default for bags: session_id, or trial_block (a sixth of a session) '
            'where there is one session only.'
        ),
    ] = None,
    folds: Annotated[int, typer.Option(min=2, help='Folds of the cross-validation.')] = 6,
    repetitions: RepetitionsOption = None,
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Only these features, separated by commas, as in --features slope,correlation; '
            'a set of features, as in --features glide_waveform; or auto: folds choose the set.'
        ),
    ] = None,
    report: Annotated[
        Optional[Path],
        typer.Option(
            help='Write a report with figures: a folder, or an HTML file, which needs no other.'
        ),
    ] = None,
    answers: Annotated[
        bool,
        typer.Option(
            '--answers',
            help='Also rejection of unknown objects, with each label left out in turn, and '
            'calibration of probabilities; from bags also early predictions and physical '
            'measures. Takes about half a minute more for each set of '
            'texture trials.',
        ),
    ] = False,
    seed: SeedOption = 0,
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
    """Cross-validate the four classifiers on recordings, and write a report.

    On your own trials, real or simulated: the same features as the live node, every
    classifier with and without scaling, and the split stated beside each number. Random
    folds, and beside them whole groups held out, such as sessions. ``--report`` and ``--json``
    add learning curves and what choosing features brings, and take twice as long. The report
    has the paper's figures, made of your trials.
    """
    with refusals():
        check_paths(*recordings)
        from tactile_lab.commands.analysis.evaluate import EvaluateRequest, run_evaluate
        from tactile_lab.commands.cluster import on_cluster
        from tactile_lab.datasets.sources.options import SourceOptions

        with on_cluster(cluster):
            run_evaluate(
                EvaluateRequest(
                    recordings=tuple(recordings),
                    task=task.value if task else None,
                    channel=channel,
                    where=where,
                    train_where=train_where,
                    test_where=test_where,
                    crop=crop,
                    resample_hz=resample_hz,
                    skip_bad=skip_bad,
                    groups=tuple(group or ()),
                    folds=folds,
                    repetitions=repetitions,
                    features=features,
                    seed=seed,
                    report=report,
                    over=over,
                    detrend=detrend.value if detrend else None,
                    speed_column=speed_column,
                    answers=answers,
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


def compare(
    model_a: Annotated[
        Path, typer.Argument(help='Model file, or a folder of them as `tactile train` writes.')
    ],
    model_b: Annotated[Path, typer.Argument(help='The other one.')],
    recordings: RecordingsArgument,
    group: Annotated[
        Optional[str],
        typer.Option(
            help='Columns that make a group of trials, with commas, for the interval. '
            'Default: session_id, or session.'
        ),
    ] = None,
    unseen: Annotated[
        bool,
        typer.Option('--unseen', help='Leave out trials that one of the models was trained on.'),
    ] = False,
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
    json_output: JsonOption = False,
) -> None:
    """Say which of two models is better, and whether the difference is more than chance.

    As in: tactile compare old/texture_flexion.onnx new/texture_flexion.onnx bags/new_session

    Each model names every trial by its own features. It may answer "unknown", which counts as
    not right. The difference of the accuracies has a paired 95 % interval: Student's t over the
    sessions, or with one session that of McNemar's exact test over the trials. The table also
    shows rejected trials and file sizes. Below it are the confusions in which the models differ
    most, and the time of one answer of B against that of A.

    Take trials that neither model was trained on. The command warns of others: most model files
    tell which trials they were trained on. Two folders of models are compared file by file, for
    each task and contact.
    """
    with refusals():
        check_paths(model_a, model_b, *recordings)
        from tactile_lab.commands.analysis.compare import CompareRequest, run_compare
        from tactile_lab.datasets.sources.options import SourceOptions

        run_compare(
            CompareRequest(
                models=(model_a, model_b),
                recordings=tuple(recordings),
                group=group,
                unseen=unseen,
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
