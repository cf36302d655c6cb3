# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording and models of version 0.1 give the same features, and labels bit for bit."""

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from tactile_classifier import load_model
from tactile_lab.datasets.feature_tables import read_tables

FOLDER = Path(__file__).parents[1] / 'data' / 'recorded_by_0_1'
RECORDING = FOLDER / 'recording'
ANSWERS = json.loads((FOLDER / 'answers.json').read_text('utf-8'))


def hexes(values):
    return [value.hex() for value in values.tolist()]


def read_recorded():
    """Return what the recording says, by a reader that is not ours."""
    windows, answers = [], []
    with AnyReader([RECORDING]) as reader:
        for connection, _, data in reader.messages():
            kind = connection.msgtype.rpartition('/')[2]
            if kind not in ('TactileFeatures', 'Classification'):
                continue
            message = reader.deserialize(data, connection.msgtype)
            name = message.trial_id
            if kind == 'TactileFeatures':
                values = hexes(message.values)
                windows.append({'trial': name, 'set': message.feature_set, 'values': values})
            else:
                said = {'trial': name, 'model': message.model_id, 'label': message.label}
                said['scores'] = hexes(message.scores)
                answers.append({**said, 'novelty': message.novelty.hex()})
    return {'windows': windows, 'classifications': answers}


def test_the_recording_is_as_it_was():
    assert read_recorded() == ANSWERS


@pytest.mark.parametrize('answer', ANSWERS['classifications'], ids=lambda a: a['trial'])
def test_a_model_of_format_6_answers_as_it_did(answer):
    models = map(load_model, (FOLDER / 'models').iterdir())
    (model,) = (model for model in models if model.model_id == answer['model'])
    (values,) = (w['values'] for w in ANSWERS['windows'] if w['trial'] == answer['trial'])
    computed = model.compute([[float.fromhex(value) for value in values]])
    assert hexes(computed.scores[0]) == answer['scores']
    assert computed.novelty[0].item().hex() == answer['novelty']


def test_its_features_are_computed_from_the_samples_as_they_were():
    tables = read_tables([RECORDING]).tables.values()
    found = [row for table in tables for row in table.values]
    recorded = [[float.fromhex(x) for x in window['values']] for window in ANSWERS['windows']]
    # Versions of NumPy differ in the last bits of a transform.
    for mine, theirs in zip(sorted(found, key=tuple), sorted(recorded), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-14)
