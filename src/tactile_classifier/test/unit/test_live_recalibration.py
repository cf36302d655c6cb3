# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Known trials of a session, as they come one by one, against the file made of them."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.answering import LiveRecalibration
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model, write_recalibrated
from tactile_classifier.training.trainer import train
from tactile_features.records import Outcome as FeatureOutcome

TRIALS = 5
KNOWN = (0, 61, 122, 183, 4)
"""Trials of four plates, all of one session of `texture_table`."""

LATER = (66, 127, 188, 9)


@pytest.fixture(scope='module')
def trained(partial_tables, tmp_path_factory):
    """Return the path of a model with partial parts, and its tables by samples."""
    whole, partial = partial_tables
    path = tmp_path_factory.mktemp('models') / 'texture.onnx'
    write_model(path, train(whole, 'knn', partial=partial))
    return path, {0: whole, **partial}


@pytest.fixture
def make(trained, make_window):
    """Return a maker of known windows of a session: moved, so that there is an offset."""

    def make(trial, count=0, **changes):
        table = trained[1][count]
        fields = {
            'trial_id': f'trial-{trial}',
            'values': table.values[trial] + 0.02,
            'specification_digest': table.spec.digest,
            'session_id': 'today',
            'object_label': str(table.labels[trial]),
            **({'partial': True, 'sample_count': count} if count else {}),
        }
        return make_window(0, **{**fields, **changes})

    return make


def test_answers_are_those_of_the_file_for_the_same_trials(trained, make, tmp_path):
    path, tables = trained
    data = path.read_bytes()
    known = {
        count: dataclasses.replace(
            table.take(np.isin(np.arange(len(table)), KNOWN)),
            values=table.values[sorted(KNOWN)] + 0.02,
        )
        for count, table in tables.items()
    }
    today = write_recalibrated(tmp_path / 'today.onnx', path, known)
    live = LiveRecalibration(load_model(path), TRIALS)
    for count in tables:
        for trial in sorted(KNOWN):
            window = make(trial, count)
            assert live.classify(window) == live.model.classify_window(window)  # before it counts
        for trial in LATER:
            found = live.classify(make(trial, count))
            wanted = today.classify_window(make(trial, count))
            names = {'model_id': live.model.model_id, 'recalibration_trials': TRIALS}
            assert found == dataclasses.replace(wanted, **names)
            plain = live.model.classify_window(make(trial, count))
            assert found.novelty != plain.novelty
            assert found.novelty_threshold != plain.novelty_threshold
    assert path.read_bytes() == data


def learn(path, make, known=KNOWN):
    live = LiveRecalibration(load_model(path), TRIALS)
    for trial in known:
        live.classify(make(trial))
    return live


def test_a_new_session_begins_with_the_model_as_trained(trained, make):
    live = learn(trained[0], make)
    assert live.classify(make(66)).recalibration_trials == TRIALS
    tomorrow = make(66, session_id='tomorrow')
    assert live.classify(tomorrow) == live.model.classify_window(tomorrow)


@pytest.mark.parametrize(
    'changes',
    [
        {'object_label': ''},
        {'object_label': 'glass'},
        {'outcome': FeatureOutcome.GAP, 'reason': 'lost', 'values': np.empty(0)},
        {'rate_hz': 100.0},
        {'values': np.full(91, np.nan)},
    ],
)
def test_what_is_not_known_does_not_count(trained, make, changes):
    live = learn(trained[0], make, KNOWN[:-1])
    for trial in KNOWN:
        live.classify(make(trial, **changes))
    assert live.classify(make(KNOWN[-1])).recalibration_trials == 0
    assert live.classify(make(66)).recalibration_trials == TRIALS


def test_the_correction_stays_after_the_last_known_trial(trained, make):
    live = learn(trained[0], make)
    before = live.classify(make(66))
    for trial in LATER:
        live.classify(make(trial, values=np.ones(91)))
    assert live.classify(make(66)) == before


def test_what_cannot_be_recalibrated_is_told(trained, model_path, small_table, tmp_path):
    model = load_model(trained[0])
    with pytest.raises(ModelFileError, match='recalibration_trials is 4; it must be 0 or at'):
        LiveRecalibration(model, 4)
    columns = {**small_table.columns, 'session_id': np.full(len(small_table), 'one')}
    single = dataclasses.replace(small_table, columns=columns)
    alone = write_model(tmp_path / 'one.onnx', train(single, 'knn'))
    with pytest.raises(ModelFileError, match='states nothing of sessions'):
        LiveRecalibration(alone, TRIALS)
