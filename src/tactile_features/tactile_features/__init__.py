# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Windows of the tension stream, and texture and stiffness features of these windows."""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'Feature': '.feature_sets.feature_set',
    'FeatureConfig': '.config',
    'FeatureError': '.errors',
    'FeatureSet': '.feature_sets.feature_set',
    'FeatureSpec': '.spec',
    'FeatureSpecifications': '.spec',
    'FeatureTransformer': '.estimators',
    'FeatureWindow': '.types',
    'GlideWaveform': '.estimators',
    'HoldWaveform': '.estimators',
    'ModelContract': '.model_contract',
    'WindowOutcome': '.types',
    'SpatialWaveform': '.estimators',
    'SpatialWindow': '.feature_sets.texture_spatial',
    'StiffnessRegression': '.estimators',
    'StiffnessRelaxation': '.estimators',
    'StrainBlock': 'tactile_ros.strain',
    'TextureSpatial': '.estimators',
    'TextureSpectrum': '.estimators',
    'TrialEvent': '.types',
    'TrialFeatureExtractor': '.extraction.extractor',
    'UndefinedFeatureError': '.errors',
    'WindowSamples': '.feature_sets.feature_set',
    'WindowSpec': '.feature_sets.feature_set',
    'check_feature_set': '.checks',
    'compute_regression': '.feature_sets.stiffness',
    'compute_spatial': '.feature_sets.texture_spatial',
    'compute_spectrum': '.feature_sets.texture_spectrum',
    'features_from_trials': '.extraction.extractor',
    'find_phases': '.phases',
    'list_feature_sets': '.feature_sets.registry',
    'read_contracts': '.model_contract',
    'spec_for': '.spec',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # Imported on first use, so that a program pays only for the parts that it needs.
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name], __name__), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
