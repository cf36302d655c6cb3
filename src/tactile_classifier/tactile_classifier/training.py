# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fitting a classifier to a table of features, with the manifest of its model file."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from typing import Any, NamedTuple

import numpy as np
from sklearn.pipeline import Pipeline

from tactile_classifier.dataset import FeatureTable
from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators import DEFAULT_SCALING, SCORE_KINDS, build_estimator
from tactile_classifier.evaluation import Score
from tactile_classifier.manifest import Manifest

LIBRARIES = ('numpy', 'scikit-learn', 'skl2onnx', 'onnx', 'onnxruntime')


class Trained(NamedTuple):
    """A fitted pipeline and what its model file will say of it."""

    estimator: Pipeline
    manifest: Manifest


def train(
    table: FeatureTable,
    classifier: str,
    scaling: str = '',
    *,
    score: Score | None = None,
    created: datetime.datetime | None = None,
) -> Trained:
    """Fit a classifier to all the trials of a table.

    Parameters
    ----------
    table : FeatureTable
        Its columns ``contact`` and ``simulated``, where present, go into the manifest.
    classifier, scaling : str
        See `build_estimator`; an empty scaling means the task's default.
    score : Score, optional
        What cross-validation said of the same classifier and scaling.
    created : datetime, optional
        Stated in the manifest; now when not given.

    Raises
    ------
    DatasetError
        When there are too few trials or one class only.
    ValueError
        When a name is not known, or the score is of another classifier.
    """
    scaling = scaling or DEFAULT_SCALING[table.task]
    if score is not None and (score.classifier, score.scaling) != (classifier, scaling):
        raise ValueError(
            f'the score is of {score.classifier} with scaling {score.scaling}, '
            f'not of {classifier} with scaling {scaling}'
        )
    estimator = build_estimator(classifier, scaling)
    if len(np.unique(table.labels)) < 2:
        raise DatasetError(f'there is one class only, "{table.labels[0]}": nothing to tell apart')
    if len(table) < 3:
        raise DatasetError('training needs three trials at least')
    estimator.fit(table.values, table.labels)
    manifest = Manifest(
        task=table.task,
        contact=_only_contact(table),
        spec=table.spec,
        labels=tuple(str(label) for label in estimator.classes_),
        score_kind=SCORE_KINDS[classifier],
        classifier=classifier,
        scaling=scaling,
        simulated=bool(np.any(table.columns.get('simulated', False))),
        training_sha256=table.compute_sha256(),
        trials=len(table),
        versions=_versions(),
        cross_validation=_summary(score),
        created=(created or datetime.datetime.now(datetime.timezone.utc)).isoformat(
            timespec='seconds'
        ),
    )
    return Trained(estimator, manifest)


def _only_contact(table: FeatureTable) -> str:
    contacts = np.unique(table.columns.get('contact', np.array([''])))
    return str(contacts[0]) if len(contacts) == 1 else ''


def _summary(score: Score | None) -> dict[str, Any]:
    if score is None:
        return {}
    summary = score.to_dict()
    return {key: summary[key] for key in ('mean', 'spread', 'spread_of', 'split')}


def _versions() -> dict[str, str]:
    versions = {name: _version(name) for name in LIBRARIES}
    return {'python': platform.python_version(), **{k: v for k, v in versions.items() if v}}


def _version(library: str) -> str:
    try:
        return importlib.metadata.version(library)
    except importlib.metadata.PackageNotFoundError:
        return ''
