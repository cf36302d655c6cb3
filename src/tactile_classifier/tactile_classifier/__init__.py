# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Datasets, training, evaluation, the ONNX model file and the classifier node."""

from __future__ import annotations

import importlib
from typing import Any

# Imported when first asked for: scikit-learn takes a second that the node does not have
# to spend.
_HOMES = {
    'LabelledTrials': 'archive',
    'load_archive': 'archive',
    'FeatureTable': 'dataset',
    'table_from_trials': 'dataset',
    'ClassifierError': 'errors',
    'DatasetError': 'errors',
    'EvaluationError': 'errors',
    'ModelFileError': 'errors',
    'CLASSIFIERS': 'estimators',
    'DEFAULT_SCALING': 'estimators',
    'SCALINGS': 'estimators',
    'build_estimator': 'estimators',
    'Evaluation': 'evaluation',
    'Score': 'evaluation',
    'evaluate': 'evaluation',
    'TactileModel': 'inference',
    'read_manifest': 'inference',
    'Manifest': 'manifest',
    'write_model': 'model_file',
    'evaluate_open_set': 'open_set_evaluation',
    'ClassificationResult': 'records',
    'ClassifierConfig': 'records',
    'Outcome': 'records',
    'RankSum': 'significance',
    'rank_features': 'significance',
    'rank_sum_p_values': 'significance',
    'evaluate_stopping': 'stopping_evaluation',
    'train': 'training',
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__} has no attribute {name}')
    return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
