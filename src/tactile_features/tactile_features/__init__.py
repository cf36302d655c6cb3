# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Cuts the tension stream into windows and computes texture and stiffness features."""

from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.extractor import TrialFeatureExtractor, features_from_trials
from tactile_features.records import (
    FeatureConfig,
    FeatureWindow,
    Outcome,
    StrainBlock,
    TrialEvent,
)
from tactile_features.regression import compute_regression
from tactile_features.signal_phases import find_phases
from tactile_features.sliding import SlidingSpectrum, sliding_spectrum
from tactile_features.spatial import SpatialWindow, compute_spatial, compute_spatial_trials
from tactile_features.spec import FeatureSpec, spec_for
from tactile_features.spectrum import compile_spectrum, compute_spectrum

__all__ = [
    'FeatureConfig',
    'FeatureError',
    'FeatureSpec',
    'FeatureWindow',
    'Outcome',
    'SlidingSpectrum',
    'SpatialWindow',
    'StrainBlock',
    'TrialEvent',
    'TrialFeatureExtractor',
    'UndefinedFeatureError',
    'compile_spectrum',
    'compute_regression',
    'compute_spatial',
    'compute_spatial_trials',
    'compute_spectrum',
    'features_from_trials',
    'find_phases',
    'sliding_spectrum',
    'spec_for',
]
