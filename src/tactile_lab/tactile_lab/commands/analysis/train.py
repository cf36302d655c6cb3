# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile train`: recordings in, table of accuracies and model files out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import choose_repetitions
from tactile_classifier.estimators.classifiers import default_scaling
from tactile_classifier.evaluation.cross_validation import evaluate, Evaluation
from tactile_classifier.model_file.card import tell_scores
from tactile_classifier.model_file.live_recalibration import RECALIBRATED, STATISTICS
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.names import CLASSIFIER_TITLES, describe_features, SCALING_TITLES
from tactile_classifier.records import PROBABILITY
from tactile_classifier.training.model_writer import TactileModel, write_model
from tactile_classifier.training.recalibrated_model import write_recalibrated
from tactile_classifier.training.trainer import train
from tactile_features.feature_sets.registry import list_feature_sets
from tactile_features.records import PHASE_GLIDE, PHASE_HOLD, PROTOCOL_TEXTURE
from tactile_lab.commands.analysis.features import AUTO, choose_automatically, keep_task, Reader
from tactile_lab.commands.analysis.requests import TrainRequest
from tactile_lab.commands.output import make_output_folder, Output, refuse_to_replace
from tactile_lab.datasets.bag_tables import BagTables, name_table, read_tables
from tactile_lab.datasets.feature_options import choose_features, list_sets
from tactile_lab.datasets.prepared import prepare_trials
from tactile_lab.datasets.reread import read_partial_tables
from tactile_lab.datasets.sources.leaves import Leaf
from tactile_lab.datasets.sources.load import split_sources
from tactile_lab.datasets.tables import accuracy_caption, accuracy_table, tell_warnings
from tactile_lab.experiment.folder import list_recordings
from tactile_ros.errors import TactileError

PartialReader = Callable[[FeatureTable, Sequence[float]], dict[int, FeatureTable]]
"""As `read_partial_tables`."""


@dataclass(frozen=True)
class TrainedModel:
    """One model file, the accuracies beside it, and the table that it came from."""

    path: Path
    model_id: str
    table: FeatureTable
    evaluation: Evaluation
    manifest: Manifest

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return {
            'path': str(self.path),
            'model_id': self.model_id,
            'evaluation': self.evaluation.to_dict(),
            'parts': [asdict(part) for part in self.manifest.stages],
            'calibration': describe_calibration(self.manifest),
            'false_alarm_rate': self.manifest.false_alarm_rate,
            'stop_error_rate': self.manifest.stop_error_rate,
        }


def run_train(recordings: Sequence[Path], request: TrainRequest, *, as_json: bool) -> None:
    """Train on recordings and print what came out."""
    recordings = list_recordings(recordings)
    output = Output(as_json)
    automatic = request.features == AUTO
    named = None if automatic else request.features
    chosen = choose_features(request.over, request.detrend, named)
    if named and not list_sets(named):
        raise TactileError(
            f'--features is "{named}"; it must be {AUTO} or name sets of features: '
            f'{", ".join((*list_feature_sets(PHASE_GLIDE), *list_feature_sets(PHASE_HOLD)))}'
        )
    if request.partial_seconds() and (request.over or automatic):  # wrong texts fail first
        raise TactileError(
            'features over distance have no early predictions, and so --features auto has none: '
            'leave --partial out'
        )
    own, leaves = split_sources(recordings, request.sources)
    if leaves:
        trained = _train_on_trials(leaves, replace(request, features=named), automatic, output)
    else:
        request.check_for_bags()
        if automatic:
            trained = _train_automatically(
                lambda fields: _of_task(read_tables(own, fields), request), request, chosen, output
            )
        else:
            found = _of_task(read_with_progress(own, output, chosen), request)
            trained = train_models(found, request, output)
    output.result({'models': [model.to_dict() for model in trained]})


def _of_task(found: BagTables, request: TrainRequest) -> BagTables:
    return replace(found, tables=keep_task(found.tables, request.task))


def _train_on_trials(
    leaves: Sequence[Leaf], request: TrainRequest, automatic: bool, output: Output
) -> list[TrainedModel]:
    """Train on recordings that are not bags of ours."""
    with output.progress('extracting features'):
        prepared = prepare_trials(leaves, request, folds=request.folds)
    for line in (prepared.title, *prepared.trials.steps):
        output.say(line, plain=True)
    for each in prepared.trials.skipped:
        output.say(f'left out: row {each.row}: {each.reason}', plain=True)
    key = (prepared.task, '')
    if automatic:
        read: Reader = lambda fields: BagTables({key: prepared.compute_table(fields)}, ())  # noqa: E731
        return _train_automatically(read, request, {}, output)
    found = BagTables({key: prepared.table}, ())
    return train_models(found, request, output, prepared.partial_tables)


def _train_automatically(
    read: Reader, request: TrainRequest, chosen: Mapping[str, Any], output: Output
) -> list[TrainedModel]:
    folds, seed = request.folds, request.seed
    models = []
    found = choose_automatically(read, chosen, folds, seed, output)
    for key, (table, candidate, _) in found.items():
        wanted = replace(request, classifier=candidate.classifier, scaling=candidate.scaling)
        models += train_models(BagTables({key: table}, ()), wanted, output)
    return models


def read_with_progress(
    bags: Sequence[Path], output: Output, chosen: Mapping[str, Any] = MappingProxyType({})
) -> BagTables:
    """Read the bags' feature tables; say which trials are left out. See `read_tables`."""
    with output.progress('extracting features'):
        found = read_tables(bags, chosen)
    for sentence in found.left_out[:5]:
        output.say(f'left out: {sentence}')
    if len(found.left_out) > 5:
        output.say(f'left out: {len(found.left_out) - 5} more')
    return found


def model_path(folder: Path, task: str, contact: str, digest: str = '') -> Path:
    """Return the path of a new model. Its name is for people: the file says what it is for."""
    return folder / f'{"_".join(filter(None, (task, contact, digest)))}.onnx'


def train_models(
    found: BagTables,
    request: TrainRequest,
    output: Output,
    read_partial: PartialReader = read_partial_tables,
) -> list[TrainedModel]:
    """Cross-validate the four classifiers on each table and write the chosen one's model.

    Parameters
    ----------
    found : BagTables
    request : TrainRequest
    output : Output
    read_partial : callable
        Returns the features of the first parts of a table's windows.

    Raises
    ------
    TactileError
        When a model file is there already and may not be replaced.
    """
    paths = {key: model_path(request.folder, *key) for key in found.tables}
    refuse_to_replace(paths.values(), force=request.force)
    make_output_folder(request.folder)
    models = []
    for key, table in found.tables.items():
        task = key[0]
        repetitions, saving = choose_repetitions(table, request.repetitions)
        if saving:
            output.say(saving)
        with output.progress('cross-validating') as show:
            evaluation = evaluate(
                table,
                folds=request.folds,
                repetitions=repetitions,
                random_state=request.seed,
                jobs=-1,
                progress=show,
            )
        name = name_table(key, table)
        simulated = ', SIMULATED trials' if np.any(table.columns.get('simulated', False)) else ''
        output.say(accuracy_table(evaluation, f'{name}{simulated}'))
        output.say(accuracy_caption(evaluation))
        output.say(describe_features(table.spec))
        for warning in tell_warnings([evaluation]):
            output.say(warning)
        chosen = request.scaling or default_scaling(task, request.classifier)
        seconds = request.partial_seconds() if task == PROTOCOL_TEXTURE else []
        trained = train(
            table,
            request.classifier,
            chosen,
            partial=read_partial(table, seconds) if seconds else None,
            false_alarm_rate=request.false_alarm_rate,
            stop_error_rate=request.stop_error_rate,
            score=evaluation.score(request.classifier, chosen),
        )
        path = paths[key]
        model = write_model(path, trained)
        for sentence in describe_answers(trained.manifest):
            output.say(sentence)
        output.say(
            f'{path}: {CLASSIFIER_TITLES[request.classifier]}, {SCALING_TITLES[chosen]}; '
            f'{model.model_id}\n'
        )
        models.append(TrainedModel(path, model.model_id, table, evaluation, trained.manifest))
    return models


def describe_calibration(manifest: Manifest) -> dict[str, Any]:
    """Return the manifest's entry without its long lists."""
    found = {k: v for k, v in manifest.calibration.items() if k != STATISTICS}
    if RECALIBRATED in found:
        found[RECALIBRATED] = {k: v for k, v in found[RECALIBRATED].items() if k != 'offsets'}
    return found


def run_recalibrate(
    source: Path, bags: Sequence[Path], folder: Path, *, force: bool, as_json: bool
) -> None:
    """Write a model for the session of the bags' trials, and print what it was.

    Raises
    ------
    TactileError
        When the bags hold no trials for the model, or a file would be replaced.
    """
    output = Output(as_json)
    model = TactileModel.load(source)
    tables = read_with_progress(bags, output, model.spec.config_values()).tables
    fitting = [
        table
        for (task, contact, *_), table in tables.items()
        if task == model.task and len({contact, model.contact} - {''}) < 2
    ]
    if len(fitting) != 1:
        raise TactileError(
            f'the bags must hold {model.task} trials of one contact that model {model.model_id} '
            'was trained for'
        )
    (table,) = fitting
    path = model_path(folder, model.task, model.contact)
    refuse_to_replace([path], force=force)
    make_output_folder(folder)
    seconds = [count / model.spec.rate_hz for count in model.partial_samples]
    partial = read_partial_tables(table, seconds) if seconds else {}
    found = write_recalibrated(path, source, {0: table, **partial})
    stated = describe_calibration(found.manifest)
    before, after = (each.manifest.stages[0].novelty_threshold for each in (model, found))
    output.say(
        f'{path}: {model.model_id} for the session of {len(table)} known trials; unknown: above '
        f'novelty {after:.2f}, before {before:.2f}; {found.model_id}'
    )
    output.result({'path': str(path), 'model_id': found.model_id, 'calibration': stated})


def describe_answers(manifest: Manifest) -> list[str]:
    """Return what held-out trials say of probabilities, threshold and early predictions."""
    if 'reason' in manifest.calibration:
        return [f'no probabilities and no "unknown": {manifest.calibration["reason"]}']
    whole, *partial = manifest.stages
    sentences = [
        f'probabilities: expected calibration error {100 * whole.calibration_error_before:.1f} % '
        f'before, {100 * whole.calibration_error_after:.1f} % after; unknown: above novelty '
        f'{whole.novelty_threshold:.2f}, at {100 * manifest.false_alarm_rate:g} % false '
        f'rejection; both by {manifest.calibration["split"]}'
    ]
    if manifest.score_kind != PROBABILITY:
        sentences.append(f'scores: {tell_scores(manifest)}')
    share = manifest.calibration.get('session_share', -1.0)
    sentences.append(
        f'thresholds hold in {100 * share:.0f} % of new sessions like these'
        if share > 0.0
        else 'thresholds hold for trials like these; without several sessions a new one may differ'
    )
    if partial:
        shares = ', '.join(
            f'{part.sample_count / manifest.spec.rate_hz:g} s {100 * part.accuracy:.1f} %'
            for part in partial
        )
        threshold = partial[0].stop_threshold
        rule = (
            f'decided early from a probability of {threshold:g}'
            if threshold >= 0.0
            else 'never decided early: these trials prove no threshold'
        )
        sentences.append(
            f'early predictions, accuracy held out: {shares}; {rule}, '
            f'at {100 * manifest.stop_error_rate:g} % wrong answers'
        )
    return sentences
