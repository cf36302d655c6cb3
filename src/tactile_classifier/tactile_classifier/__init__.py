# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Datasets, training, evaluation, the model file and the classifier node."""

from __future__ import annotations

import importlib
from typing import Any

# Imported on first use: importing scikit-learn takes a second, and the node does not need it.
_HOMES = {
    'FeatureTable': 'datasets.dataset',
    'table_from_trials': 'datasets.dataset',
    'ClassifierError': 'errors',
    'DatasetError': 'errors',
    'EvaluationError': 'errors',
    'NoFeaturesError': 'errors',
    'ModelFileError': 'errors',
    'CLASSIFIERS': 'types',
    'DEFAULT_SCALING': 'estimators.classifiers',
    'SCALINGS': 'types',
    'build_estimator': 'estimators.classifiers',
    'Evaluation': 'evaluation.cross_validation',
    'Score': 'evaluation.cross_validation',
    'evaluate': 'evaluation.cross_validation',
    'ModelSet': 'model_set',
    'RandomConvolutionClassifier': 'estimators.random_convolutions',
    'TactileClassifier': 'training.sklearn_classifier',
    'TactileModel': 'model_file.model',
    'load_model': 'model_file.model',
    'Manifest': 'model_file.manifest',
    'write_model': 'training.model_writer',
    'evaluate_open_set': 'evaluation.open_set',
    'WindowPrediction': 'types',
    'ClassifierConfig': 'config',
    'ModelInfo': 'types',
    'ModelInfos': 'types',
    'PredictionOutcome': 'types',
    'RankSum': 'evaluation.significance',
    'rank_features': 'evaluation.significance',
    'rank_sum_p_values': 'evaluation.significance',
    'train': 'training.trainer',
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__} has no attribute {name}')
    return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
