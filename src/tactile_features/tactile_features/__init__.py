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

"""Cuts the tension stream into windows and computes texture and stiffness features."""

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.extraction.extractor import features_from_trials, TrialFeatureExtractor
from tactile_features.feature_sets.feature_set import (
    Feature,
    FeatureSet,
    WindowSamples,
    WindowSpec,
)
from tactile_features.feature_sets.stiffness_regression import compute_regression
from tactile_features.feature_sets.texture_spatial import compute_spatial, SpatialWindow
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.phases.signal_phases import find_phases
from tactile_features.records import FeatureWindow, Outcome, StrainBlock, TrialEvent
from tactile_features.spec import FeatureSpec, spec_for

__all__ = [
    'Feature',
    'FeatureConfig',
    'FeatureError',
    'FeatureSet',
    'FeatureSpec',
    'FeatureWindow',
    'Outcome',
    'SpatialWindow',
    'StrainBlock',
    'TrialEvent',
    'TrialFeatureExtractor',
    'UndefinedFeatureError',
    'WindowSamples',
    'WindowSpec',
    'compute_regression',
    'compute_spatial',
    'compute_spectrum',
    'features_from_trials',
    'find_phases',
    'spec_for',
]
