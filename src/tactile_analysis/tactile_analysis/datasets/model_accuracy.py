# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy of model files on trials that were not used in training."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tactile_analysis.datasets.feature_options import FeatureOptions
from tactile_analysis.datasets.feature_tables import compute_tables, join_tables, prepare
from tactile_analysis.trial_set import TrialSet
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.evaluation.intervals import Result
from tactile_classifier.evaluation.model_accuracy import (
    AccuracyDifference,
    compare_predictions,
    ModelAccuracy,
    Names,
    score_predictions,
)
from tactile_classifier.model_file.model import load_model, TactileModel
from tactile_classifier.types import NO_ANSWER, UNKNOWN
from tactile_features.spec import is_same_rate
from tactile_features.types import contacts_agree
from tactile_ros.errors import TactileError

SESSION = 'session_id'


@dataclass(frozen=True)
class NewLabels(Result):
    """Trials whose label a model does not know; not included in the accuracy.

    ``unknown_rates`` contains, for each model, the fraction of these trials for which it predicts
    "unknown" [1].
    """

    trials: int
    labels: tuple[str, ...]
    unknown_rates: tuple[float, ...]


@dataclass(frozen=True)
class ModelEvaluation(Result):
    """Accuracy of one or two models on the same trials.

    Attributes
    ----------
    title : str
        Task and contact; ``SIMULATED`` if a trial is simulated.
    models : tuple of dict
        One dictionary per model: ``path``, ``model_id``, ``feature_set``, ``labels``, and
        ``training_trials``. The last is the number of trials that are excluded because the model
        was trained on them.
    scores : tuple of ModelAccuracy
        One per model.
    difference : AccuracyDifference or None
        Difference of the two models' accuracies; None if there is one model.
    trials, sessions : int
        Number of evaluated trials and number of their sessions. The number of sessions is 0 if
        sessions are not recorded.
    beside_training : int
        Number of evaluated trials from sessions with other trials that were used in training.
    new_labels : NewLabels or None
    left_out : tuple of str
        One sentence per trial without features.
    """

    title: str
    models: tuple[dict[str, Any], ...]
    scores: tuple[ModelAccuracy, ...]
    difference: AccuracyDifference | None
    trials: int
    sessions: int
    beside_training: int
    new_labels: NewLabels | None
    left_out: tuple[str, ...] = field(default=())

    @property
    def warnings(self) -> list[str]:
        """Sentences that restrict the validity of the results."""
        found = []
        if self.beside_training:
            found.append(
                f'{self.beside_training} of these trials are from sessions used in training; '
                'accuracy in a new session may be lower'
            )
        if self.sessions < 2:
            found.append(
                'the trials are of one session, or sessions are not recorded: the interval does '
                'not apply to other sessions'
            )
        known = [set(model['labels']) for model in self.models]
        for side, mine, other in zip('AB', known, known[::-1], strict=False):
            if mine - other:
                found.append(f'labels of {side} only: {", ".join(sorted(mine - other))}')
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        return {**super().to_dict(), 'warnings': self.warnings}


class _Row(NamedTuple):
    """Features of one labelled trial for one model."""

    label: str
    session: str
    is_simulated: bool
    prediction: str
    is_training: bool


def evaluate_models(
    recording: TrialSet,
    options: FeatureOptions,
    paths: Sequence[Path],
    columns: Sequence[str] = (),
) -> ModelEvaluation:
    """Evaluate one or two model files on the labelled trials of a recording.

    The features of each model are computed from the recording. Trials are excluded if one of the
    models was trained on them or does not know their label. A trial without features for one of
    two models counts as a wrong prediction of this model.

    Parameters
    ----------
    recording : TrialSet
    options : FeatureOptions
        Selection of trials, and cropping of archives. Features and task are those of the models.
    paths : sequence of Path
        One or two model files.
    columns : sequence of str
        Columns that together identify the session of a trial; default: ``session_id``.

    Raises
    ------
    TactileError
        If models and recording do not fit, or no trial remains.
    ModelFileError
        If a file cannot be used, or its features cannot be computed from the recording.
    """
    models = [load_model(path) for path in paths]
    _check_question(models, paths, options.task)
    tables = [_read_table(recording, options, *pair) for pair in zip(models, paths, strict=True)]
    has_sessions = bool(columns) or any(SESSION in table.columns for table, _ in tables)
    rows = [
        _list_rows(model, _of_contact(table, models), columns)
        for model, (table, _) in zip(models, tables, strict=True)
    ]
    names = list(dict.fromkeys(chain(*rows)))
    trials = [next(each[name] for each in rows if name in each) for name in names]
    labels = np.array([trial.label for trial in trials])
    sessions = np.array([trial.session for trial in trials])
    predicted = np.array([[_predict(each.get(name)) for name in names] for each in rows])
    seen = np.array([[name in each and each[name].is_training for name in names] for each in rows])
    is_known = np.all([np.isin(labels, model.labels) for model in models], axis=0)
    keep = is_known & ~seen.any(axis=0)
    if not keep.any():
        raise TactileError(_explain_nothing_left(recording, models, paths, labels, seen, is_known))
    counted = [each[keep] for each in predicted]
    groups = sessions[keep] if has_sessions else None
    simulated = any(
        trial.is_simulated for trial, is_kept in zip(trials, keep, strict=True) if is_kept
    )
    contacts = {model.contact for model in models} - {''}
    return ModelEvaluation(
        title=', '.join(
            [models[0].task, *sorted(contacts), *(['SIMULATED'] if simulated else [])]
        ),
        models=tuple(
            {
                'path': str(path),
                'model_id': model.model_id,
                'feature_set': model.spec.feature_set,
                'labels': list(model.labels),
                'training_trials': int(is_training.sum()),
            }
            for path, model, is_training in zip(paths, models, seen, strict=True)
        ),
        scores=tuple(score_predictions(labels[keep], each, groups) for each in counted),
        difference=(
            compare_predictions(labels[keep], counted[0], counted[1], groups)
            if len(models) == 2
            else None
        ),
        trials=int(keep.sum()),
        sessions=0 if groups is None else len(np.unique(groups)),
        beside_training=(
            int(np.isin(groups, sessions[seen.any(axis=0)]).sum()) if groups is not None else 0
        ),
        new_labels=_describe_new(labels[~is_known], predicted[:, ~is_known]),
        left_out=tuple(dict.fromkeys(chain(*(left_out for _, left_out in tables)))),
    )


def _check_question(
    models: Sequence[TactileModel], paths: Sequence[Path], task: str | None
) -> None:
    """Raise `TactileError` if the tasks or contacts of the models, or ``--task``, differ."""
    for model, path in zip(models, paths, strict=True):
        if task not in (None, model.task):
            raise TactileError(f'{path} is a model for {model.task} trials, but --task is {task}')
    about = [', '.join(filter(None, (model.task, model.contact))) for model in models]
    if models[0].task != models[-1].task or not contacts_agree(
        models[0].contact, models[-1].contact
    ):
        raise TactileError(
            f'the models are for different trials, {paths[0]} for {about[0]} and {paths[-1]} for '
            f'{about[-1]}: evaluate them separately'
        )


def _read_table(
    recording: TrialSet, options: FeatureOptions, model: TactileModel, path: Path
) -> tuple[FeatureTable, tuple[str, ...]]:
    """Return the table of a model's features, and a sentence for each trial without features."""
    spec = model.spec
    rate_hz = options.resample_hz or recording.rate_hz
    if rate_hz is not None and not is_same_rate(rate_hz, spec.rate_hz):
        remedy = (
            '' if recording.is_own else f', or resample the trials: --resample-hz {spec.rate_hz:g}'
        )
        raise TactileError(
            f'{path} needs samples at {spec.rate_hz:g} Hz, not {rate_hz:g} Hz as in '
            f'{recording.name}: train a model at this rate{remedy}'
        )
    options = replace(options, task=model.task)
    if not recording.is_own:  # a bag itself states window and channel
        options = replace(
            options,
            features=spec.feature_set,
            channel=options.channel or spec.channel or None,
            window_s=spec.sample_count / spec.rate_hz if spec.is_early else None,
        )
    trials = prepare(recording, options)
    tables, left_out = compute_tables(trials, options, spec.config_values())
    for table in tables.values():
        model.check_fits(table.spec)
    return join_tables(list(tables.values())), left_out


def _of_contact(table: FeatureTable, models: Sequence[TactileModel]) -> FeatureTable:
    """Select the trials with the contact of the models."""
    contacts = _column(table, 'contact', '')
    keep = [
        all(contacts_agree(model.contact, contact) for model in models)
        for contact in contacts.astype(str).tolist()
    ]
    if not any(keep):
        (wanted,) = {model.contact for model in models} - {''}
        raise TactileError(f'there are no labelled {table.task} trials of {wanted}')
    return table.take(np.array(keep))


def _list_rows(
    model: TactileModel, table: FeatureTable, columns: Sequence[str]
) -> dict[tuple[str, ...], _Row]:
    """Return the rows by bag, namespace, name, and number of earlier trials with this name."""
    seen = np.isin(table.digest_trials(), model.manifest.trial_digests)
    parts = [table.column(name) for name in columns] or [_column(table, SESSION, '')]
    sessions = ['/'.join(map(str, each)) for each in zip(*parts, strict=True)]
    simulated = _column(table, 'simulated', False).astype(bool)
    predicted = model.predict_or_unknown(table.values).tolist()
    sources = [_column(table, name, '').astype(str) for name in ('bag', 'namespace', 'trial_id')]
    times: Counter[tuple[str, ...]] = Counter()
    rows = {}
    for i, source in enumerate(zip(*sources, strict=True)):
        rows[(*source, str(times[source]))] = _Row(
            str(table.labels[i]), sessions[i], bool(simulated[i]), predicted[i], bool(seen[i])
        )
        times[source] += 1
    return rows


def _column(table: FeatureTable, name: str, absent: Any) -> Any:
    """Return a column, filled with ``absent`` if the table lacks it."""
    return np.asarray(table.columns.get(name, np.full(len(table), absent)))


def _predict(row: _Row | None) -> str:
    return NO_ANSWER if row is None else row.prediction


def _explain_nothing_left(
    recording: TrialSet,
    models: Sequence[TactileModel],
    paths: Sequence[Path],
    labels: Names,
    seen: Any,
    is_known: Any,
) -> str:
    """Return why no trial remains."""
    if not is_known.any():
        shared = set(models[0].labels).intersection(*(model.labels for model in models))
        return (
            f'no trial of {recording.name} has a label of the model: labels of the trials: '
            f'{", ".join(np.unique(labels))}; labels of {" and ".join(map(str, paths))}: '
            f'{", ".join(sorted(shared)) or "none in common"}'
        )
    counts = (
        f'{path} on {each.sum()} of {len(labels)}' for path, each in zip(paths, seen, strict=True)
    )
    return (
        f'no trial of {recording.name} remains, because the models were trained on them '
        f'({", ".join(counts)}): give recordings that were not used in training'
    )


def _describe_new(labels: Names, predicted: Any) -> NewLabels | None:
    if not len(labels):
        return None
    rates = tuple((predicted == UNKNOWN).mean(axis=1).tolist())
    return NewLabels(len(labels), tuple(np.unique(labels).tolist()), rates)
