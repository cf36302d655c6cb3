# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bag of an older version is read, and its features and predictions are computed again."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from tactile_analysis import TrialSet
from tactile_bags import TactileBag
from tactile_bags.recorded_setup import nominal_rate_hz, recorded_features, recorded_models
from tactile_bags.replay import recorded_results, replay_through_core
from tactile_classifier import ModelSet
from tactile_ros.topics import (
    CLASSIFICATION,
    EVENT,
    FEATURES,
    MODELS,
    SPECIFICATIONS,
    STRAIN,
    TARE,
)

RECORDING = Path(__file__).parents[1] / 'data' / 'recorded_at_c3a91d4a'


@pytest.fixture(scope='module')
def stored():
    """Return the messages of each type, read by rosbags with the definitions in the bag."""
    found = {}
    with AnyReader([RECORDING]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.msgtype, []).append(message)
    return found


@pytest.fixture
def bag():
    with TactileBag(RECORDING) as opened:
        yield opened


def as_dict(message):
    """Return the fields of a message, without its constants."""
    return {
        name: as_dict(value) if hasattr(value, '__msgtype__') else np.asarray(value).tolist()
        for name, value in vars(message).items()
        if name != '__msgtype__' and not name.isupper()
    }


@pytest.mark.parametrize('type_name', [STRAIN, EVENT, TARE])
def test_samples_events_and_tares_keep_every_field(bag, stored, type_name):
    read = [as_dict(message.decode()) for message in bag.messages(type_name)]
    assert read == [as_dict(message) for message in stored[type_name]]
    assert len(read) == {STRAIN: 661, EVENT: 5, TARE: 1}[type_name]


def test_other_messages_are_decoded_with_the_definitions_in_the_bag(bag, stored):
    (window,), (answer,) = stored[FEATURES], stored[CLASSIFICATION]
    (info,) = stored[MODELS][0].models
    results = recorded_results(bag)
    (read,) = results.windows
    assert (read.trial_id, read.contact) == (window.trial_id, 'flexion')
    assert read.values.tolist() == window.values.tolist()
    (said,) = results.classifications
    assert (said.label, said.model_id) == (answer.label, info.model_id) == ('pla', info.model_id)
    assert list(said.scores) == answer.scores.tolist()
    (model,) = recorded_models(bag)
    assert (model.model_id, list(model.labels)) == (info.model_id, info.labels)
    specified = {each.feature_set for each in stored[SPECIFICATIONS][0].specifications}
    assert {each.feature_set for each in recorded_features(bag).specifications} == specified
    assert nominal_rate_hz(bag) == 60.0


def test_trial_of_the_old_bag_is_loaded_with_label_and_samples():
    (trial,) = TrialSet.load([RECORDING]).trials
    assert (trial.label, trial.session_id, trial.contact) == ('pla', 's1', 'flexion')
    assert trial.columns['simulated'] is True
    assert trial.signal.values.shape == (1, 397)


def test_features_and_classifications_of_the_old_bag_are_computed_again(bag, stored, trained):
    results = replay_through_core(bag, ModelSet.load(trained), recorded_features(bag))
    (window,), (recorded,) = results.windows, stored[FEATURES]
    # Versions of NumPy differ in the last bits of a sum.
    np.testing.assert_allclose(window.values, recorded.values, rtol=1e-12, atol=1e-14)
    (answer,) = results.classifications
    assert answer.trial_id == recorded.trial_id
    assert 'pla' in answer.labels
    assert answer.label in ('', *answer.labels)
    assert len(answer.scores) == len(answer.labels)
