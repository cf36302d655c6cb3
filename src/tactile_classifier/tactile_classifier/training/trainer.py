# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fitting a classifier to a table of features, with the manifest of its model file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import contextlib
import dataclasses
import datetime
import importlib.metadata
from itertools import zip_longest
import platform
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.pipeline import Pipeline

from tactile_classifier.confidence.calibration import Calibration
from tactile_classifier.confidence.fit_calibration import (
    calibrate_stage,
    CalibratedStage,
    leave_labels_out,
    make_group_folds,
)
from tactile_classifier.confidence.fit_novelty import rank_of_sessions
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
from tactile_classifier.evaluation.early_answers import fit_rule
from tactile_classifier.model_file.manifest import FULL_WINDOW, Manifest, Stage, TrainingTrials
from tactile_classifier.records import PROBABILITY, ROCKET
from tactile_classifier.training.feature_choice import Candidate, FeatureChoice
from tactile_features.model_container import MAX_MANIFEST_BYTES, MAX_MODEL_BYTES

LIBRARIES = ('numpy', 'scikit-learn')


@dataclasses.dataclass(frozen=True, eq=False)
class FittedStage:
    """The fitted parts that answer windows of ``sample_count`` samples; 0: the full window.

    ``values``, shape (trials, k), are the features that the estimator was fitted on. Without a
    calibration raw scores are given.
    """

    sample_count: int
    estimator: Pipeline
    values: npt.NDArray[np.float64]
    calibration: Calibration | None
    novelty: NoveltyMeasure | None


@dataclasses.dataclass(frozen=True, eq=False)
class Trained:
    """Fitted stages, the full window's first, and what their model file will say of them."""

    stages: tuple[FittedStage, ...]
    manifest: Manifest

    @property
    def estimator(self) -> Pipeline:
        """The stage that answers full windows."""
        return self.stages[0].estimator


@on_one_thread
def train(
    table: FeatureTable,
    classifier: str,
    scaling: str = '',
    *,
    partial: Mapping[int, FeatureTable] | None = None,
    false_alarm_rate: float = 0.05,
    stop_error_rate: float = 0.05,
    score: Score | None = None,
    choice: FeatureChoice | None = None,
    hold_out: Sequence[str] = ('session_id',),
) -> Trained:
    """Fit a classifier to all the trials of a table, and calibrate its answers.

    Thresholds and probabilities come from trials that are held out in turn, whole groups of
    ``hold_out`` where there are several (`make_group_folds`); the classifier in the file is then
    fitted to all trials. Too few trials: no novelty, no probabilities, and the manifest says why.

    Parameters
    ----------
    table : FeatureTable
        Its columns ``contact``, ``simulated`` and ``session_id``, where present, count.
    classifier, scaling : str
        See `build_estimator`; an empty scaling means the task's default.
    partial : mapping of int to FeatureTable, optional
        Features of the first so many samples of the same windows, trial by trial, of which
        the model is to give early predictions.
    false_alarm_rate : float
        Share of windows of known labels that may be rejected as unknown [1].
    stop_error_rate : float
        Share of wrong answers among those given before the window is full [1].
    score : Score, optional
        What cross-validation said of the same classifier and scaling.
    choice : FeatureChoice, optional
        By which features, classifier and scaling were chosen.
    hold_out : sequence of str
        Columns whose groups probabilities and thresholds are to hold for.

    Raises
    ------
    DatasetError
        When there are too few trials or one class only, when a column is missing, when the model
        file would be too large, or when the tables of partial windows hold other trials.
    ValueError
        When a name is not known, a rate is not between 0 and 1, or the score is of another
        classifier.
    """
    scaling = scaling or default_scaling(table.task, classifier)
    if score is not None and (score.classifier, score.scaling) != (classifier, scaling):
        raise ValueError(
            f'the score is of {score.classifier} with scaling {score.scaling}, '
            f'not of {classifier} with scaling {scaling}'
        )
    for rate in (false_alarm_rate, stop_error_rate):
        if not 0.0 < rate < 1.0:
            raise ValueError(f'a rate is {rate}; it must lie between 0 and 1')
    if classifier == ROCKET and not table.is_waveform:
        raise DatasetError(
            f'random convolutions need a waveform, and {table.spec.feature_set} is none: take '
            'glide_waveform, spatial_waveform or hold_waveform'
        )
    check_size(table)
    labels = np.unique(table.labels)
    if len(labels) < 2:
        raise DatasetError(f'there is one class only, "{table.labels[0]}"; record at least two')
    if len(table) < 3:
        raise DatasetError('training needs three trials at least')
    tables = {0: table, **dict(sorted((partial or {}).items()))}
    for count, other in tables.items():
        if not np.array_equal(other.labels, table.labels) or table.spec.mismatch(other.spec):
            raise DatasetError(f'the table of {count} samples is not of the same trials')

    calibrated, stated, session = _calibrate(
        list(tables.values()), classifier, scaling, false_alarm_rate, hold_out
    )
    if partial and not calibrated:
        raise DatasetError(f'early predictions need calibrated ones: {stated["reason"]}')
    stages = [
        FittedStage(
            sample_count=count,
            estimator=build_estimator(classifier, scaling, table.channels).fit(
                table.values, table.labels
            ),
            values=table.values,
            calibration=held_out.calibration if held_out else None,
            novelty=held_out.novelty if held_out else None,
        )
        for (count, table), held_out in zip_longest(tables.items(), calibrated)
    ]
    warn_of_labels_never_given(stages[0].estimator, table.values)
    stop_threshold = fit_rule(calibrated[1:], stop_error_rate, session) if partial else None
    manifest = Manifest(
        task=table.task,
        contact=_only_contact(table),
        spec=table.spec,
        labels=tuple(str(label) for label in labels),
        score_kind=PROBABILITY if calibrated else SCORE_KINDS[classifier],
        classifier=classifier,
        scaling=scaling,
        simulated=bool(np.any(table.columns.get('simulated', False))),
        training_sha256=table.compute_sha256(),
        trials=len(table),
        versions=_versions(),
        cross_validation=_summary(
            score, choice, Candidate(table.spec.feature_set, classifier, scaling)
        ),
        created=datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds'),
        stages=tuple(
            Stage(
                sample_count=count,
                metric=held_out.novelty.metric,
                novelty_threshold=held_out.novelty_threshold,
                slope=held_out.calibration.slope,
                offset=held_out.calibration.offset,
                stop_threshold=stop_threshold if count and stop_threshold else -1.0,
                calibration_error_before=held_out.error_before,
                calibration_error_after=held_out.error_after,
                accuracy=float(1.0 - held_out.wrong.mean()),
            )
            for count, held_out in zip(tables, calibrated, strict=False)
        )
        or (FULL_WINDOW,),
        calibration=stated,
        false_alarm_rate=false_alarm_rate if calibrated else -1.0,
        stop_error_rate=stop_error_rate if partial else -1.0,
        training=describe_training(table),
    )
    return Trained(tuple(stages), manifest)


def check_size(table: FeatureTable) -> None:
    """Raise DatasetError when a model of so many trials and features would be too large a file.

    Most of a file are the two matrices of the novelty measure, and the trials of this measure and
    of the nearest neighbours.
    """
    (trials, features), labels = table.values.shape, len(np.unique(table.labels))
    size = 8 * (2 * features**2 + trials * (2 * features + labels))
    if size > MAX_MODEL_BYTES - MAX_MANIFEST_BYTES:
        raise DatasetError(
            f'{trials} trials of {features} features ({table.spec.feature_set}) would give a '
            f'model file of {size / 2**20:.0f} MiB, the limit is {MAX_MODEL_BYTES >> 20} MiB: '
            'take fewer trials, one channel, or shorter windows'
        )


def _calibrate(
    tables: list[FeatureTable],
    classifier: str,
    scaling: str,
    false_alarm_rate: float,
    hold_out: Sequence[str],
) -> tuple[list[CalibratedStage], dict[str, Any], npt.NDArray[np.intp] | None]:
    """Return calibrated stages, the manifest's entry, and groups; no stages, and why, if not."""
    columns = [find_column(tables[0].columns, name) for name in hold_out]
    if columns != ['session_id']:  # a table may have no sessions, and then trials are held out
        for name in columns:
            tables[0].column(name)
    try:
        folds = make_group_folds(tables[0], columns)
        stages = [
            calibrate_stage(table, classifier, scaling, folds, false_alarm_rate)
            for table in tables
        ]
    except TooFewTrialsError as error:
        return [], {'reason': str(error)}, None
    stated = {
        'split': folds.split,
        'groups': folds.groups,
        'held_out': columns,
        'trials': len(tables[0]),
        'session_share': folds.session_share,
        'held_out_novelty': [_state_novelty(stage, folds.session) for stage in stages],
    }
    unlearned = leave_labels_out(tables[0], folds, stages[0].novelty.metric, false_alarm_rate)
    if unlearned is not None:
        stated['unlearned'] = dataclasses.asdict(unlearned)
    return stages, stated, folds.session


def _state_novelty(stage: CalibratedStage, session: npt.NDArray[np.intp] | None) -> dict[str, Any]:
    """Return the novelties of held-out trials, for p-values."""
    group = np.zeros(len(stage.held_out_novelty), dtype=int) if session is None else session
    sessions = [np.sort(stage.held_out_novelty[group == i]) for i in np.unique(group)]
    return {
        'rank': rank_of_sessions(len(sessions)),
        'sessions': [each.tolist() for each in sessions],
    }


def describe_training(table: FeatureTable) -> TrainingTrials:
    """Return under how many conditions the trials were recorded, as their columns say."""
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
    """Return the values of a column, none where there is no such column; no empty text."""
    found = table.columns.get(name, np.empty(0))
    return [value for value in np.unique(found).tolist() if value != '']


def _only_contact(table: FeatureTable) -> str:
    contacts = np.unique(table.columns.get('contact', np.array([''])))
    return str(contacts[0]) if len(contacts) == 1 else ''


def _summary(
    score: Score | None, choice: FeatureChoice | None, chosen: Candidate
) -> dict[str, Any]:
    if score is None:
        return {}
    stated = {key: getattr(score, key) for key in ('mean', 'spread', 'spread_of', 'split')}
    return stated if choice is None else {**stated, 'choice': choice.summarise(chosen)}


def _versions() -> dict[str, str]:
    versions = {'python': platform.python_version()}
    for name in LIBRARIES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    return versions
