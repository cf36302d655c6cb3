# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import pytest

import tactile_classifier
from tactile_classifier import records
from tactile_classifier.conversions import classification_from_msg, classification_to_msg
from tactile_classifier.inference import TactileModel
from tactile_classifier.records import ClassifierConfig, Outcome
from tactile_features.records import FeatureConfig


def test_constants_are_those_of_the_message():
    from tactile_msgs.msg import Classification

    for outcome in Outcome:
        assert outcome == getattr(Classification, f'OUTCOME_{outcome.name}')
    for kind in ('VOTES', 'MARGIN', 'PROBABILITY'):
        assert getattr(records, kind) == getattr(Classification, f'SCORE_{kind}')


def test_record_has_the_fields_of_the_message(model_path, make_window):
    from tactile_msgs.msg import Classification

    fields = {f.name for f in dataclasses.fields(records.ClassificationResult)}
    mirrored = {name.removesuffix('_ns') for name in fields} - {'frame_id'}
    assert mirrored | {'header'} == set(Classification.get_fields_and_field_types())


@pytest.mark.parametrize('changes', [{}, {'rate_hz': 1.0}])
def test_message_round_trip(model_path, make_window, changes):
    result = TactileModel.load(model_path).classify(make_window(**changes))
    message = classification_to_msg(result)
    assert classification_from_msg(message) == result
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (10**9 + 2, 983_333_334)


def test_feature_parameters_are_those_of_the_feature_node():
    config = ClassifierConfig(rate_hz=100.0, texture_samples=300, texture_crop_start_s=1.0)
    expected = FeatureConfig(rate_hz=100.0, texture_samples=300, texture_crop_start_s=1.0)
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
