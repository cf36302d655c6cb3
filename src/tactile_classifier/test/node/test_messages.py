# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import pytest

from tactile_classifier import types
from tactile_classifier.conversions import (
    classification_from_msg,
    classification_to_msg,
    model_infos_from_msg,
    model_infos_to_msg,
)
from tactile_classifier.model_file.model import load_model
from tactile_classifier.model_set import ModelSet
from tactile_classifier.types import ModelInfos, PredictionOutcome
from tactile_msgs.msg import Classification, ModelInfo
from tactile_ros.errors import MessageError


def test_records_have_the_fields_and_constants_of_the_messages():
    for outcome in PredictionOutcome:
        assert outcome == getattr(Classification, f'OUTCOME_{outcome.name}')
    for kind in ('VOTES', 'MARGIN', 'PROBABILITY'):
        assert getattr(types, kind) == getattr(Classification, f'SCORE_{kind}')
    fields = {f.name for f in dataclasses.fields(types.WindowPrediction)}
    mirrored = {name.removesuffix('_ns') for name in fields} - {'frame_id'}
    assert mirrored | {'header'} == set(Classification.get_fields_and_field_types())
    names = {field.name for field in dataclasses.fields(types.ModelInfo)}
    assert names == set(ModelInfo.get_fields_and_field_types())


@pytest.mark.parametrize('changes', [{}, {'rate_hz': 1.0}])
def test_message_round_trip(model_path, make_window, changes):
    model = load_model(model_path)
    result = model.classify_window(make_window(**changes))
    message = classification_to_msg(result)
    assert classification_from_msg(message) == result
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (10**9 + 2, 983_333_334)


def test_messages_that_cannot_be_are_refused():
    with pytest.raises(MessageError, match='outcome is 9; it must be one of 0'):
        classification_from_msg(Classification(outcome=9))
    with pytest.raises(MessageError, match='scores has 2 entries and labels 1'):
        classification_from_msg(Classification(labels=['a'], scores=[0.0, 1.0]))


def test_facts_of_models_come_back_as_they_were(model_path):
    models = ModelSet.load(model_path)
    infos = ModelInfos(models.infos, ('model /m.npz is refused: it is empty',), 10**18 + 1)
    assert model_infos_from_msg(model_infos_to_msg(infos)) == infos
