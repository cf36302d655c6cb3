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
