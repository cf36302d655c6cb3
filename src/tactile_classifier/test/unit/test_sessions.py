# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recalibration by the known trials of a session: statistics, files, and the live model."""

import dataclasses
import json

from classifier_tables import make_table
import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_classifier.answering import LiveRecalibration
from tactile_classifier.confidence.calibration import make_group_folds
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.confidence.recalibration import (
    fit_session_statistics,
    SessionStatistics,
    TRIALS,
)
from tactile_classifier.errors import ModelFileError, TooFewTrialsError
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model, write_recalibrated
from tactile_classifier.training.trainer import train
from tactile_features.records import Outcome as FeatureOutcome

LABELS = ('foam', 'pla', 'steel', 'wood')


def draw_sessions(count, seed):
    """Return trials of four labels whose session moves the first feature of all of them."""
    rng = np.random.default_rng(seed)
    label = np.tile(np.repeat(np.arange(4), 10), count)
    session = np.repeat(np.arange(count), 40)
    values = rng.normal(size=(len(label), 3))
    values[:, 2] += 12.0 * label
    values[:, 0] += 3.0 * rng.normal(size=count)[session]
    names = [f'seed {seed} {i}' for i in session]
    return make_table(np.array(LABELS)[label], values, session_id=names)


def fit(table):
    folds = make_group_folds(table)
    statistics = fit_session_statistics(table, folds, 'whitened', 0.1)
    return statistics, NoveltyMeasure.fit(table.values, table.labels, folds.fold, 'whitened')


def codes(table):
    return np.searchsorted(LABELS, table.labels)


def test_offset_is_the_session_s_and_only_where_sessions_differ():
    table = draw_sessions(8, 1)
    statistics, measure = fit(table)
    assert statistics.share[0] > 0.9
    assert statistics.share[1:].max() < 0.5
    # One-way analysis of variance of what is left of each label's mean: 40 trials a session.
    residuals = table.values - statistics.means[codes(table)]
    by_session = residuals.reshape(8, 40, 3)
    within = by_session.var(axis=1).sum(axis=0) * 40 / (320 - 8)
    between = np.maximum(by_session.mean(axis=1).var(axis=0, ddof=1) - within / 40, 0.0)
    assert statistics.share == pytest.approx(between / (between + within / TRIALS))
    new, move = draw_sessions(1, 2), np.array([5.0, 0.0, 0.0])
    before, *_ = statistics.recalibrate(new.values, codes(new), measure.compute)
    after, *_ = statistics.recalibrate(new.values + move, codes(new), measure.compute)
    assert after - before == pytest.approx(move * statistics.share)


def test_false_alarms_of_recalibrated_sessions_are_as_asked_for():
    rates, old = [], []
    for seed in range(12):
        statistics, measure = fit(draw_sessions(6, 100 + seed))
        for i in range(10):
            new = draw_sessions(1, 1000 + 10 * seed + i)
            known = np.random.default_rng(i).permutation(len(new))[:TRIALS]
            rest = np.delete(new.values, known, axis=0)
            offset, threshold, _ = statistics.recalibrate(
                new.values[known], codes(new)[known], measure.compute
            )
            rates.append(np.mean(measure.compute(rest - offset) > threshold))
            old.append(np.mean(measure.compute(rest) > threshold))
    assert np.mean(rates) == pytest.approx(0.1, abs=0.03)
    assert np.mean(old) > 0.14  # else the offset had nothing to mend


def test_statistics_survive_json_to_the_last_bit():
    statistics, _ = fit(draw_sessions(3, 3))
    stated = json.loads(json.dumps(statistics.to_dict()))
    assert SessionStatistics.from_dict(stated, 4, 3).to_dict() == statistics.to_dict()
    with pytest.raises(ModelFileError, match='do not fit'):
        SessionStatistics.from_dict({**stated, 'share': [1.0, float('nan'), 0.0]}, 4, 3)
    with pytest.raises(ModelFileError, match='damaged'):
        SessionStatistics.from_dict({'means': []}, 4, 3)


def test_constant_features_and_large_offsets_give_finite_numbers():
    table = draw_sessions(4, 4)
    values = table.values * [1.0, 0.0, 1.0] + [1e9, 7.25, 0.0]
    statistics, measure = fit(dataclasses.replace(table, values=values))
    offset, threshold, _ = statistics.recalibrate(values[:5], codes(table)[:5], measure.compute)
    assert offset[1] == 0.0
    assert np.isfinite([*offset, threshold]).all()


def test_no_sessions_no_statistics_and_too_few_trials_are_told():
    table = draw_sessions(1, 5)
    assert fit_session_statistics(table, make_group_folds(table), 'whitened', 0.1) is None
    statistics, measure = fit(draw_sessions(3, 6))
    with pytest.raises(TooFewTrialsError, match='4 known trials cannot recalibrate'):
        statistics.recalibrate(table.values[:4], np.zeros(4, dtype=int), measure.compute)


def test_recalibrated_file_corrects_features_and_states_where_it_came_from(tmp_path):
    source, target = tmp_path / 'model.onnx', tmp_path / 'today.onnx'
    model = write_model(source, train(draw_sessions(6, 7), 'knn', false_alarm_rate=0.1))
    new = draw_sessions(1, 8)
    values = new.values + np.array([6.0, 0.0, 0.0])
    known = dataclasses.replace(new, values=values).take(np.arange(0, len(new), 7))
    found = write_recalibrated(target, source, {0: known})
    stated = found.manifest.calibration['recalibrated']
    assert (stated['model_id'], stated['trials']) == (model.model_id, len(known))
    assert (stated['sessions'], stated['sha256']) == (['seed 8 0'], known.compute_sha256())
    loaded = load_model(target)
    moved = model.compute(values - np.array(stated['offsets'][0]))
    for one, other in zip(loaded.compute(values), moved, strict=True):
        np.testing.assert_array_equal(one, other)
    thresholds = [each.manifest.stages[0].novelty_threshold for each in (loaded, model)]
    assert thresholds[0] != thresholds[1]
    assert loaded.compute(values).novelty.mean() < model.compute(values).novelty.mean()
    assert Manifest.from_dict(found.manifest.to_dict()) == found.manifest
    origin = f'take the model that it came from, {model.model_id}'
    with pytest.raises(ModelFileError, match=origin):
        write_recalibrated(target, target, {0: known})
    strange = dataclasses.replace(known, labels=np.full(len(known), 'glass'))
    with pytest.raises(ModelFileError, match='does not know the label "glass"'):
        write_recalibrated(target, source, {0: strange})


# -- known trials as they come, against the file made of them ------------------------

KNOWN = (0, 4, 61, 122, 183)
"""Trials of four plates, all of one session of `texture_table`."""

LATER = (66, 127, 188, 9)


@pytest.fixture
def make(partial_tables, make_window):
    """Return a maker of known windows of a session: moved, so that there is an offset."""
    tables = {0: partial_tables[0], **partial_tables[1]}

    def make(trial, count=0, **changes):
        table = tables[count]
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


def test_answers_are_those_of_the_file_for_the_same_trials(
    partial_path, partial_tables, make, tmp_path
):
    tables = {0: partial_tables[0], **partial_tables[1]}
    data = partial_path.read_bytes()
    known = {
        count: dataclasses.replace(table.take(list(KNOWN)), values=table.values[[*KNOWN]] + 0.02)
        for count, table in tables.items()
    }
    today = write_recalibrated(tmp_path / 'today.onnx', partial_path, known)
    live = LiveRecalibration(load_model(partial_path), TRIALS)
    for count in tables:
        for trial in KNOWN:
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
    assert partial_path.read_bytes() == data


def test_the_correction_stays_until_a_new_session_begins_with_the_model_as_trained(
    partial_path, make
):
    live = LiveRecalibration(load_model(partial_path), TRIALS)
    for trial in KNOWN:
        live.classify(make(trial))
    before = live.classify(make(66))
    for trial in LATER:
        live.classify(make(trial, values=np.ones(91)))
    assert live.classify(make(66)) == before
    assert before.recalibration_trials == TRIALS
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
def test_what_is_not_known_does_not_count(partial_path, make, changes):
    live = LiveRecalibration(load_model(partial_path), TRIALS)
    for window in [*map(make, KNOWN[:-1]), *(make(trial, **changes) for trial in KNOWN)]:
        live.classify(window)
    assert live.classify(make(KNOWN[-1])).recalibration_trials == 0
    assert live.classify(make(66)).recalibration_trials == TRIALS


def test_what_cannot_be_recalibrated_is_told(partial_path, small_table, tmp_path):
    with pytest.raises(ModelFileError, match='recalibration_trials is 4; it must be 0 or at'):
        LiveRecalibration(load_model(partial_path), 4)
    columns = {**small_table.columns, 'session_id': np.full(len(small_table), 'one')}
    single = dataclasses.replace(small_table, columns=columns)
    alone = write_model(tmp_path / 'one.onnx', train(single, 'knn'))
    with pytest.raises(ModelFileError, match='states nothing of sessions'):
        LiveRecalibration(alone, TRIALS)
