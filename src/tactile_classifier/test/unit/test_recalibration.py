# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import json

import numpy as np
import pytest

from tactile_classifier.confidence.calibration import make_group_folds
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.confidence.recalibration import fit_session_statistics
from tactile_classifier.confidence.session_statistics import SessionStatistics, TRIALS
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError, TooFewTrialsError
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.trainer import train
from tactile_features.spec import array_spec

LABELS = ('foam', 'pla', 'steel', 'wood')


def draw_sessions(count, seed, each=10, shift=3.0):
    """Return trials of four labels whose session moves the first feature of all of them."""
    rng = np.random.default_rng(seed)
    labels = np.tile(np.repeat(LABELS, each), count)
    session = np.repeat(np.arange(count), each * len(LABELS))
    values = rng.normal(size=(len(labels), 3))
    values[:, 2] += 12.0 * np.searchsorted(LABELS, labels)
    values[:, 0] += shift * rng.normal(size=count)[session]
    columns = {'session_id': np.array([f'seed {seed} {i}' for i in session])}
    return FeatureTable(values, labels, array_spec('stiffness', 50, 60.0), columns)


def fit(table, rate=0.1):
    folds = make_group_folds(table)
    return fit_session_statistics(table, folds, 'whitened', rate), NoveltyMeasure.fit(
        table.values, table.labels, folds.fold, 'whitened'
    )


def test_offset_is_the_session_s_and_only_where_sessions_differ():
    statistics, measure = fit(draw_sessions(8, 1))
    assert statistics.share[0] > 0.9
    assert statistics.share[1:].max() < 0.5
    new = draw_sessions(1, 2)
    moved = new.values + np.array([5.0, 0.0, 0.0])
    label = np.searchsorted(LABELS, new.labels)
    before, _ = statistics.recalibrate(new.values, label, measure.compute)
    after, _ = statistics.recalibrate(moved, label, measure.compute)
    assert after - before == pytest.approx(np.array([5.0, 0.0, 0.0]) * statistics.share)


def test_false_alarms_of_recalibrated_sessions_are_as_asked_for():
    rates, old = [], []
    for seed in range(12):
        statistics, measure = fit(draw_sessions(6, 100 + seed))
        for i in range(10):
            new = draw_sessions(1, 1000 + 10 * seed + i)
            known = np.random.default_rng(i).permutation(len(new))[:TRIALS]
            rest = np.setdiff1d(np.arange(len(new)), known)
            label = np.searchsorted(LABELS, new.labels)
            offset, threshold = statistics.recalibrate(
                new.values[known], label[known], measure.compute
            )
            rates.append(np.mean(measure.compute(new.values[rest] - offset) > threshold))
            old.append(np.mean(measure.compute(new.values[rest]) > threshold))
    assert np.mean(rates) == pytest.approx(0.1, abs=0.03)
    assert np.mean(old) > 0.14  # else the offset had nothing to mend


def test_statistics_survive_json_to_the_last_bit():
    statistics, _ = fit(draw_sessions(3, 3))
    found = SessionStatistics.from_dict(json.loads(json.dumps(statistics.to_dict())), 4, 3)
    assert found.to_dict() == statistics.to_dict()
    broken = {**statistics.to_dict(), 'share': [1.0, float('nan'), 0.0]}
    with pytest.raises(ModelFileError, match='do not fit'):
        SessionStatistics.from_dict(broken, 4, 3)
    with pytest.raises(ModelFileError, match='damaged'):
        SessionStatistics.from_dict({'means': []}, 4, 3)


def test_constant_features_and_large_offsets_give_finite_numbers():
    table = draw_sessions(4, 4)
    values = table.values.copy()
    values[:, 1] = 7.25
    values[:, 0] += 1e9
    statistics, measure = fit(FeatureTable(values, table.labels, table.spec, table.columns))
    offset, threshold = statistics.recalibrate(
        values[:5], np.searchsorted(LABELS, table.labels[:5]), measure.compute
    )
    assert offset[1] == 0.0
    assert np.isfinite([*offset, threshold]).all()


def test_no_sessions_no_statistics_and_too_few_trials_are_told():
    table = draw_sessions(1, 5)
    assert fit_session_statistics(table, make_group_folds(table), 'whitened', 0.1) is None
    statistics, measure = fit(draw_sessions(3, 6))
    with pytest.raises(TooFewTrialsError, match='4 known trials cannot recalibrate'):
        statistics.recalibrate(table.values[:4], np.zeros(4, dtype=int), measure.compute)


def test_recalibrated_file_corrects_features_and_states_where_it_came_from(tmp_path):
    pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')
    from tactile_classifier.training.model_writer import write_model, write_recalibrated

    source, target = tmp_path / 'model.onnx', tmp_path / 'today.onnx'
    model = write_model(source, train(draw_sessions(6, 7), 'knn', false_alarm_rate=0.1))
    new = draw_sessions(1, 8)
    values = new.values + np.array([6.0, 0.0, 0.0])
    known = FeatureTable(values[::7], new.labels[::7], new.spec, {
        name: column[::7] for name, column in new.columns.items()
    })  # fmt: skip
    found = write_recalibrated(target, source, {0: known})
    stated = found.manifest.calibration['recalibrated']
    assert (stated['model_id'], stated['trials']) == (model.model_id, len(known))
    assert stated['sessions'] == ['seed 8 0']
    assert stated['sha256'] == known.compute_sha256()
    offset = np.array(stated['offsets'][0])
    loaded = load_model(target)
    for one, other in zip(loaded.compute(values), model.compute(values - offset), strict=True):
        np.testing.assert_array_equal(one, other)
    assert (
        loaded.manifest.stages[0].novelty_threshold != model.manifest.stages[0].novelty_threshold
    )
    assert loaded.compute(values).novelty.mean() < model.compute(values).novelty.mean()
    assert Manifest.from_dict(found.manifest.to_dict()) == found.manifest
    with pytest.raises(
        ModelFileError, match=f'take the model that it came from, {model.model_id}'
    ):
        write_recalibrated(target, target, {0: known})
    strange = FeatureTable(known.values, np.full(len(known), 'glass'), known.spec, known.columns)
    with pytest.raises(ModelFileError, match='does not know the label "glass"'):
        write_recalibrated(target, source, {0: strange})
