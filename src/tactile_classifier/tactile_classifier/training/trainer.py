# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Train a classifier on a table of features, and create the manifest of its model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import contextlib
import dataclasses
import datetime
import importlib.metadata
import platform
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.fit_calibration import (
    calibrate_held_out,
    HeldOutCalibration,
    leave_labels_out,
    make_group_folds,
)
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.datasets.dataset import FeatureTable, find_column
from tactile_classifier.errors import DatasetError, TooFewTrialsError
from tactile_classifier.estimators.classifiers import (
    build_estimator,
    default_scaling,
    on_one_thread,
    SCORE_KINDS,
    warn_of_labels_never_given,
)
from tactile_classifier.evaluation.cross_validation import Score
from tactile_classifier.model_file.manifest import (
    Confidence,
    KNOWN_NOVELTY,
    Manifest,
    TrainingTrials,
)
from tactile_classifier.training.feature_choice import FeatureChoice
from tactile_classifier.types import PROBABILITY, ROCKET
from tactile_features.model_container import MAX_MANIFEST_BYTES, MAX_MODEL_BYTES

LIBRARIES = ('numpy', 'scikit-learn')


@dataclasses.dataclass(frozen=True, eq=False)
class Trained:
    """Fitted parts of a model, and its manifest.

    ``values``, shape (trials, k), contains the training features. If ``calibration`` is None, the
    model returns raw scores.
    """

    estimator: Pipeline
    values: npt.NDArray[np.float64]
    calibration: Calibration | None
    novelty: NoveltyMeasure | None
    manifest: Manifest


@on_one_thread
def train(
    table: FeatureTable,
    classifier: str,
    scaling: str = '',
    *,
    false_alarm_rate: float = 0.05,
    strict: bool = False,
    score: Score | None = None,
    choice: FeatureChoice | None = None,
    hold_out: Sequence[str] = ('session_id',),
    parameters: Mapping[str, Any] | None = None,
) -> Trained:
    """Fit a classifier to all trials of a table, and calibrate its scores.

    The threshold and the probabilities are computed from held-out trials: from whole groups of
    ``hold_out`` if each label occurs in several groups (`make_group_folds`). The classifier in the
    file is fitted to all trials. If there are too few trials, the model has no novelty and no
    probabilities, and the manifest contains the reason.

    Parameters
    ----------
    table : FeatureTable
        Training trials. The columns ``contact``, ``simulated`` and ``session_id`` are used if
        present.
    classifier, scaling : str
        See `build_estimator`; an empty scaling selects the default of the task.
    false_alarm_rate : float
        Fraction of windows of known labels that may be rejected as unknown, on average over
        sessions [1].
    strict : bool
        Use the strict threshold of `HeldOutNovelty`, which holds in most new sessions but detects
        fewer unknown objects.
    score : Score, optional
        Cross-validated score of the same classifier and scaling.
    choice : FeatureChoice, optional
        Automatic choice of features, classifier and scaling; the card then contains its nested
        score.
    hold_out : sequence of str
        Columns that define the groups. The probabilities and the threshold hold for new groups.
    parameters : mapping, optional
        Parameters of the classifier, such as ``C``, that replace our defaults. They must be
        convertible to JSON.

    Raises
    ------
    DatasetError
        If there are too few trials or only one class, if a column is missing, or if the model file
        would be too large.
    ValueError
        If a name is unknown, the rate is not between 0 and 1, or the score belongs to another
        classifier.
    """
    scaling = scaling or default_scaling(table.task, classifier)
    if choice is not None:
        score = choice.nested
    if score is not None and (score.classifier, score.scaling) != (classifier, scaling):
        raise ValueError(
            f'the score belongs to {score.classifier} with scaling {score.scaling}, '
            f'not to {classifier} with scaling {scaling}'
        )
    if not 0.0 < false_alarm_rate < 1.0:
        raise ValueError(f'false_alarm_rate is {false_alarm_rate}; it must be between 0 and 1')
    if classifier == ROCKET and not table.is_waveform:
        raise DatasetError(
            f'random convolutions need a waveform, not {table.spec.feature_set}: use '
            'glide_waveform, spatial_waveform or hold_waveform'
        )
    check_size(table)
    labels = np.unique(table.labels)
    if len(labels) < 2:
        raise DatasetError(f'there is only one class, "{table.labels[0]}": record at least two')
    if len(table) < 3:
        raise DatasetError('training needs at least three trials')
    held_out, stated = _calibrate(
        table, classifier, scaling, parameters, false_alarm_rate, strict, hold_out
    )
    estimator = build_estimator(classifier, scaling, table.channels, parameters)
    estimator.fit(table.values, table.labels)
    warn_of_labels_never_given(estimator, table.values)
    manifest = Manifest(
        task=table.task,
        contact=_only_contact(table),
        spec=table.spec,
        labels=tuple(str(label) for label in labels),
        score_kind=PROBABILITY if held_out else SCORE_KINDS[classifier],
        classifier=classifier,
        scaling=scaling,
        simulated=bool(np.any(table.columns.get('simulated', False))),
        training_sha256=table.compute_sha256(),
        trials=len(table),
        trial_digests=tuple(table.digest_trials()),
        versions=_versions(),
        cross_validation=_summarise(score, choice),
        created=datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds'),
        confidence=Confidence(
            novelty_threshold=held_out.novelty_threshold,
            slope=held_out.calibration.slope,
            offset=held_out.calibration.offset,
            calibration_error_before=held_out.error_before,
            calibration_error_after=held_out.error_after,
            accuracy=held_out.accuracy,
        )
        if held_out
        else Confidence(),
        calibration=stated,
        false_alarm_rate=false_alarm_rate if held_out else -1.0,
        training=describe_training(table),
        parameters=dict(parameters or {}),
    )
    return Trained(
        estimator,
        table.values,
        held_out.calibration if held_out else None,
        held_out.novelty if held_out else None,
        manifest,
    )


def check_size(table: FeatureTable) -> None:
    """Raise DatasetError if the model file of a table would be too large.

    The largest arrays are the two matrices of the novelty measure, and the training trials, which
    the measure and the nearest-neighbour classifier store.
    """
    (trials, features), labels = table.values.shape, len(np.unique(table.labels))
    size = 8 * (2 * features**2 + trials * (2 * features + labels))
    if size > MAX_MODEL_BYTES - MAX_MANIFEST_BYTES:
        raise DatasetError(
            f'{trials} trials of {features} features ({table.spec.feature_set}) need a model file '
            f'of {size / 2**20:.0f} MiB; the limit is {MAX_MODEL_BYTES >> 20} MiB: '
            'use fewer trials, one channel, or shorter windows'
        )


def _calibrate(
    table: FeatureTable,
    classifier: str,
    scaling: str,
    parameters: Mapping[str, Any] | None,
    false_alarm_rate: float,
    strict: bool,
    hold_out: Sequence[str],
) -> tuple[HeldOutCalibration | None, dict[str, Any]]:
    """Fit the calibration on held-out trials; return it with its entry in the manifest.

    If there are too few trials, returns None and an entry with the reason.
    """
    columns = [find_column(table.columns, name) for name in hold_out]
    if columns != ['session_id']:  # by default, a table without sessions is allowed
        for name in columns:
            table.column(name)
    try:
        folds = make_group_folds(table, columns)
        held_out = calibrate_held_out(
            table,
            classifier,
            scaling,
            folds,
            false_alarm_rate,
            strict=strict,
            parameters=parameters,
        )
    except TooFewTrialsError as error:
        return None, {'reason': str(error)}
    stated = {
        'split': folds.split,
        'groups': folds.groups,
        'held_out': columns,
        'trials': len(table),
        'strict': strict,
        KNOWN_NOVELTY: held_out.held_out_novelty.to_dict(),
    }
    if held_out.surplus is not None:
        stated['surplus'] = dataclasses.asdict(held_out.surplus)
    unlearned = leave_labels_out(table, folds, false_alarm_rate)
    if unlearned is not None:
        stated['unlearned'] = dataclasses.asdict(unlearned)
    return held_out, stated


def describe_training(table: FeatureTable) -> TrainingTrials:
    """Return the recording conditions of the trials, from the columns of the table."""
    speeds = _different(table, 'glide_speed_m_s')
    speeds = [speed for speed in speeds if np.isfinite(speed) and speed > 0.0]
    return TrainingTrials(
        sessions=len(_different(table, 'session_id')),
        mountings=len(_different(table, 'mounting_id')),
        speeds=len(speeds),
        slowest_m_s=float(min(speeds, default=-1.0)),
        fastest_m_s=float(max(speeds, default=-1.0)),
        simulated=int(np.count_nonzero(table.columns.get('simulated', False))),
    )


def _different(table: FeatureTable, name: str) -> list[Any]:
    """Return the distinct, non-empty values of a column; empty if there is no such column."""
    found = table.columns.get(name, np.empty(0))
    return [value for value in np.unique(found).tolist() if value != '']


def _only_contact(table: FeatureTable) -> str:
    contacts = np.unique(table.columns.get('contact', np.array([''])))
    return str(contacts[0]) if len(contacts) == 1 else ''


def _summarise(score: Score | None, choice: FeatureChoice | None) -> dict[str, Any]:
    if score is None:
        return {}
    stated = {key: getattr(score, key) for key in ('mean', 'spread', 'spread_of', 'split')}
    stated['interval'] = score.interval.to_dict()
    return stated if choice is None else {**stated, 'choice': choice.summarise()}


def _versions() -> dict[str, str]:
    versions = {'python': platform.python_version()}
    for name in LIBRARIES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return versions
