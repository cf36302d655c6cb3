# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile evaluate`: accuracy by cross-validation or of model files, and a report."""

import inspect
from pathlib import Path
from typing import Annotated, Optional, TYPE_CHECKING

import typer

from tactile_analysis.options import SourceOptions, TrialOptions
from tactile_lab import options
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_analysis.report.analysis import SetResult

STATED = (
    'task', 'channel', 'where', 'train_where', 'test_where', 'crop', 'resample_hz', 'over',
    'speed_column', 'detrend', 'features',
)  # fmt: skip
"""Options whose values the report contains, if they are given."""

OF_CROSS_VALIDATION = (
    'train_where', 'test_where', 'over', 'detrend', 'folds', 'repetitions', 'features', 'report',
    'answers', 'seed',
)  # fmt: skip
"""Options that ``--model`` does not allow, because the model file determines the features and no
model is trained."""


def evaluate(
    recordings: options.RecordingsArgument,
    task: options.TaskOption = None,
    train_where: Annotated[
        Optional[str],
        typer.Option(
            help='Select the training trials: a boolean column, or COLUMN=VALUE, as for --where, '
            'also for bags. The trials of --test-where are tested. Random folds are evaluated in '
            'addition.'
        ),
    ] = None,
    test_where: Annotated[
        Optional[str], typer.Option(help='Select the test trials; see --train-where.')
    ] = None,
    model: Annotated[
        Optional[list[Path]],
        typer.Option(
            exists=True,
            dir_okay=False,
            help='Evaluate this model file (.npz), instead of cross-validation, on trials that it '
            'was not trained on. Give it twice to compare two models on the same trials.',
        ),
    ] = None,
    over: options.OverOption = None,
    detrend: options.DetrendOption = None,
    group: Annotated[
        Optional[list[str]],
        typer.Option(
            help='Hold out whole groups of trials, in addition to random folds. Trials with equal '
            'values in this column form a group; several columns are separated by commas. May be '
            'repeated. Default: each column of sessions (session_id, session, day), mountings '
            '(mounting_id, mounting) and specimens (specimen) that is present. If bags have only '
            'one session: trial_block, six blocks of trials in order of time.'
        ),
    ] = None,
    folds: options.FoldsOption = 6,
    repetitions: options.RepetitionsOption = None,
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Only these features, separated by commas (--features slope,correlation), a '
            'feature set (--features glide_waveform), or auto for an automatic choice. Default: '
            'the automatic choice among all sets, followed by tables for the recorded set.'
        ),
    ] = None,
    report: Annotated[
        Optional[Path],
        typer.Option(
            help='Write a report with figures to a folder, or to a self-contained HTML file.'
        ),
    ] = None,
    answers: Annotated[
        bool,
        typer.Option(
            '--answers',
            help='Also evaluate the detection of unknown objects, with each label left out of '
            'the training once, and the calibration of probabilities. Takes a few seconds more '
            'for texture trials of one contact.',
        ),
    ] = False,
    seed: options.SeedOption = 0,
    archives: TrialOptions = options.TRIALS,
    statements: SourceOptions = options.SOURCES,
    as_json: options.JsonOption = False,
) -> None:
    """Print the accuracy of the model that *train* would write, or of model files.

    Accepts real and simulated trials, and computes the same features as the live node. The first
    number is the accuracy on held-out groups; features and classifier are chosen again from the
    training trials of each fold. Tables of the paper's four classifiers follow, with and without
    scaling, for random folds and for held-out sessions, mountings or other groups. A learning
    curve shows whether more sessions would increase the accuracy. ``--report`` and ``--json`` add
    feature selection and calibration, and take longer. The report also has figures of your trials.

    ``--model`` evaluates a model file, for example: tactile evaluate bags/new --model
    old/texture.npz --model new/texture.npz. The features of the model are computed from the
    recordings. Trials that the model was trained on are recognized by the digests in the file, and
    are excluded. A prediction of *unknown* counts as wrong. The interval is computed over
    sessions, or over the groups of ``--group``. If two models are given, trials of either training
    are excluded, and the difference is tested with McNemar's exact test. Options of archives can
    be combined with ``--model``, options of cross-validation cannot.
    """
    given = {**locals(), **vars(archives)}
    if model:
        defaults = inspect.signature(evaluate).parameters
        for name in OF_CROSS_VALIDATION:
            if given[name] != defaults[name].default:
                raise TactileError(
                    f'--{name.replace("_", "-")} is for cross-validation; omit it, or omit --model'
                )
        _evaluate_models(
            recordings, task, model, group or [], archives, statements, Output(as_json)
        )
        return
    from tactile_analysis.datasets.automatic_features import AUTO
    from tactile_analysis.datasets.feature_options import FeatureOptions
    from tactile_analysis.datasets.feature_tables import open_trials
    from tactile_analysis.report.analysis import analyse
    from tactile_analysis.report.recordings import make_sets
    from tactile_lab.commands.train import choose_with_progress

    output = Output(as_json)
    is_auto = features == AUTO
    feature_options = FeatureOptions(
        task=task,
        over=over,
        detrend=detrend,
        features=None if is_auto else features,
        train_where=train_where,
        test_where=test_where,
        **vars(archives),
    )
    hold_out = [options.split(names) for names in group or ()]
    file = None
    if report is not None:
        from tactile_analysis.report.build import build_page, report_path  # imports matplotlib
        from tactile_analysis.report.summary import describe_sources

        file = report_path(report)
    with open_trials(recordings, feature_options, statements) as source:
        chosen = choose_with_progress(
            source,
            feature_options,
            output,
            folds,
            seed,
            columns=next(iter(hold_out), ()),
            any_set=is_auto or not (features or over or detrend),
            repetitions=repetitions,
        )
        with output.progress('reading'):
            sets = make_sets(
                source,
                feature_options,
                chosen,
                hold_out,
                of_choice=is_auto,
                report=file is not None,
                unknown_objects=answers,
            )
            sources = describe_sources(recordings, source) if file else []
    with output.progress('evaluating') as show:
        results = analyse(
            sets,
            progress=show,
            folds=folds,
            repetitions=repetitions,
            random_state=seed,
            details=as_json or file is not None,  # the terminal shows no details
        )
    for result in results:
        _print(result, output)
    if file is not None:
        repeated = '' if repetitions is None else f', repeated {repetitions} times'
        stated = {
            'folds': f'{folds}{repeated}',
            'seed of the folds': seed,
            **{name.replace('_', '-'): given[name] for name in STATED},
        }
        settings = {name: str(value) for name, value in stated.items() if value is not None}
        file.write_text(build_page(results, sources, settings), encoding='utf-8')
        output.say(f'{file}: report with these numbers and figures')
    output.result({'sets': [result.to_dict() for result in results]})


def _evaluate_models(
    recordings: list[Path],
    task: Optional[str],
    models: list[Path],
    group: list[str],
    archives: TrialOptions,
    statements: SourceOptions,
    output: Output,
) -> None:
    from tactile_analysis.datasets.feature_options import FeatureOptions
    from tactile_analysis.datasets.model_accuracy import evaluate_models
    from tactile_analysis.trial_set import TrialSet
    from tactile_lab.result_tables import format_evaluation

    for name, values, most in (('--model', models, 2), ('--group', group, 1)):
        if len(values) > most:
            raise TactileError(
                f'{name} is given {len(values)} times; with --model give it '
                f'{"once" if most == 1 else "at most twice"}'
            )
    feature_options = FeatureOptions(task=task, **vars(archives))
    with (
        output.progress('evaluating'),
        TrialSet.load(recordings, statements) as recording,
    ):
        columns = options.split(group[0]) if group else ()
        found = evaluate_models(recording, feature_options, models, columns)
    output.say(*format_evaluation(found))
    output.result(found.to_dict())


def _print(result: 'SetResult', output: Output) -> None:
    from tactile_analysis.report.summary import (
        format_accuracy,
        format_first_sentence,
        format_learning_curve,
        format_model,
        format_reliability,
        unknown_rows,
    )
    from tactile_analysis.wording import accuracy_caption, format_warnings
    from tactile_classifier.model_file.manifest import format_features
    from tactile_lab.result_tables import accuracy_table, learning_table, recall_table

    output.say(
        f'{result.recordings.title}: {format_first_sentence(result)}',
        f'  {format_model(result)}',
        f'  {format_accuracy(result)}',
        recall_table(result.headline),
    )
    if result.curve is not None:
        output.say(learning_table(result.curve), f'  {format_learning_curve(result)}')
    if result.reliability is not None:
        output.say(f'  {format_reliability(result)}')
    for evaluation in result.evaluations:
        output.say(accuracy_table(evaluation, result.recordings.title, intervals=True))
        output.say(accuracy_caption(evaluation, intervals=True))
    output.say(f'  {format_features(result.recordings.table.spec)}')
    lines = [
        *result.recordings.format_preparation(most=10),
        *(': '.join(row) for row in (unknown_rows(result.open_set) if result.open_set else ())),
        *result.not_done,
        *format_warnings(result.evaluations),
    ]
    output.say(*(f'  {line}' for line in lines), '')
