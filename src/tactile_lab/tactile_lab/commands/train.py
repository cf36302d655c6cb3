# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile train`: choose and train models, and write model files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import functools
import math
from pathlib import Path
from typing import Annotated, Any, Optional, TYPE_CHECKING

import typer

from tactile_analysis.options import SourceOptions, TrialOptions
from tactile_lab import options
from tactile_lab.output import make_output_folder, Output, refuse_to_replace
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_analysis.datasets.automatic_features import Chosen
    from tactile_analysis.datasets.feature_options import FeatureOptions
    from tactile_analysis.datasets.feature_tables import Tables
    from tactile_analysis.trial_set import TrialSet
    from tactile_classifier.datasets.dataset import FeatureTable
    from tactile_classifier.evaluation.cross_validation import Evaluation
    from tactile_classifier.model_file.manifest import Manifest
    from tactile_classifier.training.feature_choice import FeatureChoice


FULL = 'full'
"""Value of ``--window`` for full windows, which are published after the end of their phase."""

CLASSIFIERS = ('knn', 'svm_linear', 'svm_rbf', 'tree', 'rocket')


@dataclass(frozen=True)
class TrainedModel:
    """One model file, its accuracies, and the feature table that it was trained on.

    ``window_s`` is the length of an early window [s], which is published before its phase ends;
    None for full windows.
    """

    path: Path
    model_id: str
    table: 'FeatureTable'
    evaluation: 'Evaluation'
    manifest: 'Manifest'
    window_s: Optional[float] = None

    @property
    def accuracy(self) -> float:
        """Accuracy in the model card [1]; nested if the classifier was chosen automatically."""
        return float(self.manifest.cross_validation['mean'])

    @property
    def split(self) -> str:
        """The folds with which `accuracy` was measured, as text."""
        return str(self.manifest.cross_validation['split'])

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {
            'path': str(self.path),
            'model_id': self.model_id,
            'accuracy': dict(self.manifest.cross_validation),
            'evaluation': self.evaluation.to_dict(),
            'window_s': self.window_s,
            'calibration': dict(self.manifest.calibration),
            'false_alarm_rate': self.manifest.false_alarm_rate,
        }


def train(
    recordings: options.RecordingsArgument,
    folder: Annotated[
        Path, typer.Option('--output', '-o', help='Folder to write the model files into.')
    ],
    task: options.TaskOption = None,
    classifier: Annotated[
        Optional[str],
        typer.Option(
            **{
                **options.choice(*CLASSIFIERS),
                'metavar': 'NAME',
            },  # short, to leave room for the help
            help=f'Classifier: {", ".join(CLASSIFIERS)}; the recorded features are used. Default: '
            'features, classifier and scaling are chosen by cross-validation.',
        ),
    ] = None,
    scaling: Annotated[
        Optional[str],
        typer.Option(
            **options.choice('standard', 'none'),
            help='Scaling of the features. Default: chosen by cross-validation. If --classifier '
            'is given: none for texture (the features have the same unit), standard for '
            'stiffness.',
        ),
    ] = None,
    false_alarm_rate: Annotated[
        float,
        typer.Option(
            '--false-alarms',
            metavar='SHARE',
            min=0.001,
            max=0.5,
            help='Rate of false rejection: fraction of the trials with known labels that the '
            'model may classify as unknown, on average over sessions. The threshold is computed '
            'from held-out trials.',
        ),
    ] = 0.05,
    strict: Annotated[
        bool,
        typer.Option(
            '--strict',
            help='Use the largest threshold of all sessions, so that the rate --false-alarms '
            'holds in most new sessions, and not only on average. Fewer unknown objects are '
            'detected.',
        ),
    ] = False,
    window: Annotated[
        str,
        typer.Option(
            metavar='SECONDS',
            help='Lengths of the windows, such as 0.5,1,full; a model file is written for each. '
            'A model for the first 0.5 s of a glide or hold gives its prediction as soon as they '
            'have passed.',
        ),
    ] = FULL,
    over: options.OverOption = None,
    detrend: options.DetrendOption = None,
    features: Annotated[
        Optional[str],
        typer.Option(
            help='Feature sets, separated by commas; or auto, to choose one by cross-validation. '
            'The classifier rocket needs glide_waveform or hold_waveform. Default: auto; if '
            '--classifier, --over or --detrend is given, the recorded feature set.'
        ),
    ] = None,
    group: Annotated[
        Optional[str],
        typer.Option(
            help='Hold out whole groups for choice, test and calibration. Trials with equal '
            'values in these columns form a group. Default: sessions if there are several, '
            'otherwise blocks of trials of a bag, otherwise random folds.'
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option('--force', help='Replace model files of an earlier training.')
    ] = False,
    folds: options.FoldsOption = 6,
    repetitions: options.RepetitionsOption = None,
    seed: options.SeedOption = 0,
    archives: TrialOptions = options.TRIALS,
    statements: SourceOptions = options.SOURCES,
    as_json: options.JsonOption = False,
) -> None:
    """Choose features and classifier by cross-validation, and write model files.

    Prints the accuracy of every candidate on held-out groups, and the accuracy of the selection
    procedure. With --classifier, prints the accuracy of the paper's four classifiers with and
    without scaling instead. Writes one model file (.npz) for each task, contact and window length.
    A model predicts calibrated probabilities, and classifies windows that differ from all training
    trials as *unknown*. Existing model files are only replaced with --force.
    """
    from tactile_analysis.datasets.automatic_features import AUTO
    from tactile_analysis.datasets.feature_options import FeatureOptions
    from tactile_analysis.datasets.feature_tables import open_trials

    output = Output(as_json)
    if features == AUTO and classifier:
        raise TactileError('--features auto also chooses the classifier; omit --classifier')
    lengths = parse_lengths(window)
    if over and lengths != [None]:
        raise TactileError('features over distance (--over) have no early windows; omit --window')
    stated = bool(classifier or over or detrend)
    automatic = features == AUTO or not (features or stated)
    if features and not automatic:
        _check_sets(features)
    trained: list[TrainedModel] = []
    for window_s in lengths:
        feature_options = FeatureOptions(
            task=task,
            over=over,
            detrend=detrend,
            features=None if automatic else features,
            window_s=window_s,
            **vars(archives),
        )
        feature_options.choose_fields()  # refuses contradictory options before the computation
        with open_trials(recordings, feature_options, statements) as source:
            if not trained:
                _refuse_existing(source, task, folder, lengths, force=force)
            write = functools.partial(
                train_models,
                source,
                feature_options,
                folder=folder,
                output=output,
                false_alarm_rate=false_alarm_rate,
                strict=strict,
                force=force,
            )
            if classifier:
                tables = read_with_progress(source, feature_options, output)
                trained += write(
                    tables,
                    classifier=classifier,
                    scaling=scaling,
                    hold_out=options.split(group),
                    folds=folds,
                    repetitions=repetitions,
                    seed=seed,
                )
                continue
            if automatic:
                _say_steps(source, output)
            else:
                read_with_progress(source, feature_options, output)
            chosen = choose_with_progress(
                source,
                feature_options,
                output,
                folds,
                seed,
                columns=options.split(group),
                any_set=automatic,
                must_hold_out=bool(group),
                scaling=scaling or '',
                repetitions=repetitions,
            )
            tables = {key: each.table for key, each in chosen.items()}
            trained += write(tables, chosen=chosen, hold_out=options.split(group))
    if len(lengths) > 1:
        say_lengths(trained, folder / 'accuracy_by_length.png', output)
    output.result({'models': [model.to_dict() for model in trained]})


def _refuse_existing(
    source: 'TrialSet',
    wanted: Optional[str],
    folder: Path,
    lengths: Sequence[Optional[float]],
    *,
    force: bool,
) -> None:
    """Refuse to replace existing model files, before the long computation."""
    keys = [(wanted or '', '')]
    if source.is_own:
        found = dict.fromkeys((each.task, each.contact) for each in source.included)
        keys = [key for key in found if wanted in (None, key[0])]
    paths = [model_path(folder, key, window_s) for window_s in lengths for key in keys]
    refuse_to_replace(paths, force=force)


def _check_sets(features: str) -> None:
    from tactile_analysis.datasets.automatic_features import AUTO
    from tactile_analysis.datasets.feature_options import list_sets
    from tactile_features.feature_sets.registry import list_feature_sets
    from tactile_features.types import PHASE_GLIDE, PHASE_HOLD

    if not list_sets(features):
        raise TactileError(
            f'--features is "{features}"; it must be {AUTO} or feature sets: '
            f'{", ".join((*list_feature_sets(PHASE_GLIDE), *list_feature_sets(PHASE_HOLD)))}'
        )


def parse_lengths(text: str) -> list[Optional[float]]:
    """Return the window lengths in the option ``--window`` [s]; None is a full window."""
    try:
        lengths = [None if each == FULL else float(each) for each in options.split(text)]
    except ValueError:
        lengths = []
    is_positive = all(each is None or 0.0 < each < math.inf for each in lengths)
    if not lengths or not is_positive or len(set(lengths)) < len(lengths):
        raise TactileError(
            f'--window is "{text}"; it must be different lengths in seconds or {FULL}, separated '
            f'by commas, such as 0.5,1,{FULL}'
        )
    return lengths


def say_lengths(trained: Sequence[TrainedModel], picture: Path, output: Output) -> None:
    """Print and draw the accuracy for each window length."""
    from tactile_analysis.plots import plot_accuracy_by_length
    from tactile_lab.console import Table

    columns = ('model', 'window [s]', 'accuracy [%]', 'trials', 'tested by')
    table = Table(
        *columns, title='accuracy by window length', right_from=1, spare=['tested by', 'trials']
    )
    curves: dict[str, list[tuple[float, float]]] = {}
    for model in trained:
        spec = model.table.spec
        name = ', '.join(filter(None, (model.manifest.task, model.manifest.contact)))
        seconds = spec.sample_count / spec.rate_hz
        length = f'{seconds:g}' if spec.sample_count else FULL
        accuracy = f'{100 * model.accuracy:.1f}'
        table.add_row(name, length, accuracy, str(len(model.table)), model.split)
        if spec.sample_count:
            curves.setdefault(f'{name} ({model.split})', []).append((seconds, model.accuracy))
    output.say(table)
    simulated = any(model.manifest.simulated for model in trained)
    plot_accuracy_by_length(picture, curves, simulated=simulated)
    output.say(f'{picture}: figure of these accuracies')


def _say_steps(trials: 'TrialSet', output: Output) -> None:
    output.say(*(() if trials.is_own else trials.notes))


def read_with_progress(
    trials: 'TrialSet', feature_options: 'FeatureOptions', output: Output
) -> 'Tables':
    """Return the feature tables of a recording, and print the excluded trials."""
    from tactile_analysis.datasets.feature_tables import compute_tables

    with output.progress('extracting features'):
        tables, found = compute_tables(trials, feature_options)
    left_out = [*found[:5]]
    if len(found) > 5:
        left_out.append(f'{len(found) - 5} more')
    _say_steps(trials, output)
    output.say(*(f'excluded: {each}' for each in left_out))
    return tables


def choose_with_progress(
    trials: 'TrialSet',
    feature_options: 'FeatureOptions',
    output: Output,
    folds: int,
    seed: int,
    **choice: Any,
) -> 'dict[tuple[str, ...], Chosen]':
    """Choose features and classifier for each table, and print the reasons.

    ``choice`` are further arguments of `choose_automatically`.
    """
    from tactile_analysis.datasets.automatic_features import choose_automatically

    said: list[str] = []
    with output.progress('choosing features and classifier') as show:
        chosen = choose_automatically(
            trials, feature_options, folds, seed, said.append, progress=show, **choice
        )
    output.say(*said)
    return chosen


def model_path(folder: Path, key: tuple[str, ...], window_s: Optional[float] = None) -> Path:
    """Return the path of a new model file.

    The name contains task, contact and window length for people; programs read the manifest.
    """
    length = '' if window_s is None else f'{window_s:g}s'
    return folder / f'{"_".join(filter(None, (*key, length)))}.npz'


def train_models(
    trials: 'TrialSet',
    feature_options: 'FeatureOptions',
    tables: Mapping[tuple[str, ...], 'FeatureTable'],
    *,
    folder: Path,
    output: Output,
    classifier: str = 'knn',
    scaling: Optional[str] = None,
    chosen: 'Optional[Mapping[tuple[str, ...], Chosen]]' = None,
    hold_out: Sequence[str] = (),
    false_alarm_rate: float = 0.05,
    strict: bool = False,
    folds: int = 6,
    repetitions: Optional[int] = None,
    seed: int = 0,
    force: bool = False,
) -> list[TrainedModel]:
    """Train and write a model for each table, and print accuracies on held-out groups.

    ``tables`` are the feature tables of ``trials``; the keys are task and contact. ``chosen`` is
    the automatic choice of features and classifier for each table. If it is None, ``classifier``
    is trained, and the paper's four classifiers are cross-validated. For the other parameters, see
    ``tactile train --help``.
    """
    import numpy as np

    from tactile_analysis.datasets.feature_tables import title as title_of
    from tactile_analysis.wording import (
        accuracy_caption,
        describe_answers,
        format_warnings,
    )
    from tactile_classifier.estimators.classifiers import default_scaling
    from tactile_classifier.model_file.manifest import format_features
    from tactile_classifier.training.model_writer import write_model
    from tactile_classifier.training.trainer import check_size
    from tactile_classifier.training.trainer import train as train_model
    from tactile_classifier.types import CLASSIFIER_TITLES, SCALING_TITLES
    from tactile_lab.result_tables import accuracy_table, choice_table

    for table in tables.values():
        check_size(table)
    window_s = feature_options.window_s
    paths = {key: model_path(folder, key, window_s) for key in tables}
    refuse_to_replace(paths.values(), force=force)
    make_output_folder(folder)
    models = []
    for key, table in tables.items():
        choice: Optional[FeatureChoice] = None
        if chosen is not None:
            choice = chosen[key].choice
            _, classifier, scaling = choice.chosen
            evaluation = choice.evaluation
        else:
            evaluation = _evaluate(table, hold_out, folds, repetitions, seed, output)
        simulated = ', SIMULATED trials' if np.any(table.columns.get('simulated', False)) else ''
        title = f'{title_of(trials, feature_options, key, table)}{simulated}'
        output.say(
            accuracy_table(evaluation, title) if choice is None else choice_table(choice, title),
            accuracy_caption(evaluation),
            format_features(table.spec),
            *format_warnings([evaluation]),
        )
        scaled = scaling or default_scaling(key[0], classifier)
        trained = train_model(
            table,
            classifier,
            scaled,
            false_alarm_rate=false_alarm_rate,
            strict=strict,
            score=evaluation.score(classifier, scaled),
            choice=choice,
            hold_out=hold_out or ('session_id',),
        )
        model = write_model(paths[key], trained)
        output.say(
            *describe_answers(trained.manifest),
            f'{paths[key]}: {CLASSIFIER_TITLES[classifier]}, {SCALING_TITLES[scaled]}; '
            f'{model.model_id}\n',
        )
        models.append(
            TrainedModel(paths[key], model.model_id, table, evaluation, trained.manifest, window_s)
        )
    return models


def _evaluate(
    table: 'FeatureTable',
    hold_out: Sequence[str],
    folds: int,
    repetitions: Optional[int],
    seed: int,
    output: Output,
) -> 'Evaluation':
    """Cross-validate the classifiers on held-out groups; if there are none, in random folds."""
    from tactile_analysis.datasets.automatic_features import find_sessions
    from tactile_classifier.datasets.splits import choose_repetitions
    from tactile_classifier.evaluation.cross_validation import evaluate

    columns = tuple(hold_out) or find_sessions(table)
    repeats, saving = choose_repetitions(table, repetitions)
    if saving and not columns:
        output.say(saving)
    with output.progress('cross-validating') as show:
        return evaluate(
            table,
            folds=folds,
            repetitions=repeats,
            hold_out=columns,
            random_state=seed,
            jobs=-1,
            progress=show,
        )
