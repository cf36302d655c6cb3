# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import pytest

import tactile_classifier
from tactile_classifier.records import ClassifierConfig
from tactile_features.config import FeatureConfig


def test_feature_parameters_are_those_of_the_feature_node():
    fields = {
        'rate_hz': 100.0,
        'texture_samples': 300,
        'texture_crop_start_s': 1.0,
        'texture_features': 'texture_spatial',
        'spatial_crop_m': 0.0,
        'spatial_length_m': 0.048,
        'spatial_finest_m': 0.003,
    }
    config, expected = ClassifierConfig(**fields), FeatureConfig(**fields)
    assert dataclasses.replace(config.feature_config(), buffer_s=120.0) == expected
    shared = {f.name: f for f in dataclasses.fields(FeatureConfig)}
    for field in dataclasses.fields(ClassifierConfig):
        if field.name in shared:
            assert field.default == shared[field.name].default


def test_public_names_exist():
    for name in tactile_classifier.__all__:
        assert getattr(tactile_classifier, name) is not None
    with pytest.raises(AttributeError, match='has no attribute nonsense'):
        tactile_classifier.nonsense  # noqa: B018
