# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `tactile train` makes of a small simulated recording of texture."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_bags import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replaying.replay import replay_windows
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.inference import TactileModel
from tactile_features.spec import array_spec, spec_for
from tactile_lab.commands.analysis.requests import TrainRequest
from tactile_lab.commands.analysis.train import (
    describe_answers,
    run_recalibrate,
    run_train,
    train_models,
)
from tactile_lab.commands.output import Output
from tactile_lab.datasets.bag_tables import BagTables, read_tables
from tactile_lab.datasets.reread import read_partial_tables
from tactile_ros.errors import TactileError


@pytest.fixture(scope='module')
def bag(simulate_bag):
    return simulate_bag('texture', 'flexion', 3, seed=5)


@pytest.fixture(scope='module')
def table(bag):
    (table,) = read_tables([bag]).tables.values()
    return table


@pytest.mark.parametrize('seconds', [[0.1], [1.0, 0.5], [3.0]])
def test_seconds_that_do_not_fit_are_refused(table, seconds):
    with pytest.raises(BagError, match='no early predictions after'):
        read_partial_tables(table, seconds)


def test_model_answers_partial_windows_and_no_file_is_replaced_unasked(bag, tmp_path):
    found = read_tables([bag])
    request = TrainRequest(
        folder=tmp_path / 'models',
        folds=3,
        repetitions=1,
        false_alarm_rate=0.1,
        partial='0.5,1.5',
        stop_error_rate=0.2,
    )
    (trained,) = train_models(found, request, Output(as_json=True))
    model = TactileModel.load(trained.path)
    assert model.partial_samples == (30, 90)
    assert model.manifest.false_alarm_rate == 0.1
    assert model.manifest.stop_error_rate == 0.2
    sentences = describe_answers(model.manifest)
    assert 'at 10 % false rejection' in sentences[0]
    assert sentences[-1].startswith('early predictions, accuracy held out: 0.5 s')
    assert trained.to_dict()['parts'][2]['sample_count'] == 90
    before = trained.path.read_bytes()
    with pytest.raises(TactileError, match='would be replaced'):
        train_models(found, request, Output(as_json=True))
    assert trained.path.read_bytes() == before


@pytest.mark.parametrize('detrend', ['none', 'mean', 'linear'])
def test_a_model_states_how_its_spectra_were_detrended(bag, tmp_path, capsys, detrend):
    request = TrainRequest(folder=tmp_path, folds=3, repetitions=1, partial='1', detrend=detrend)
    run_train([bag], request, as_json=False)
    assert f'spectrum_detrend {detrend}' in ' '.join(capsys.readouterr().out.split())
    model = TactileModel.load(tmp_path / 'texture_flexion.onnx')
    with TactileBag(bag) as opened:
        config = dataclasses.replace(
            recorded_features(opened).config, spectrum_detrend=detrend, partial_samples=(30, 60)
        )
        windows = replay_windows(opened, RecordedFeatures(config))
    assert model.spec == spec_for('texture', config)
    assert model.spec.parameters['spectrum_detrend'] == detrend
    others = {'none', 'mean', 'linear'} - {detrend}
    for other in others:
        changed = dataclasses.replace(config, spectrum_detrend=other)
        with pytest.raises(ModelFileError, match='spectrum_detrend'):
            model.check_fits(spec_for('texture', changed))
    # Tables of whole and partial windows are what the live extractor gives.
    (table,) = read_tables([bag], {'spectrum_detrend': detrend}).tables.values()
    tables = {**read_partial_tables(table, [0.5, 1.0]), table.spec.sample_count: table}
    assert list(tables) == [30, 60, 180]
    assert len(windows) == 3 * len(table)
    for window in windows:
        (row,) = (table.column('window_start_ns') == window.window_start_ns).nonzero()[0]
        assert window.sample_count == 30 or not model.format_mismatch(window)
        assert tables[window.sample_count].values[row].tobytes() == window.values.tobytes()


def test_detrending_is_for_the_spectrum_over_time(tmp_path):
    with pytest.raises(TactileError, match='--detrend is for the spectrum over time'):
        run_train([], TrainRequest(folder=tmp_path, over='45:0.5', detrend='linear'), as_json=True)


def test_text_that_is_no_seconds_is_refused(tmp_path):
    with pytest.raises(TactileError, match='--partial is "1;2"'):
        TrainRequest(folder=tmp_path, partial='1;2').partial_seconds()


def test_recalibration_reads_bags_of_the_session_and_replaces_nothing_unasked(
    bag, simulate_bag, tmp_path
):
    path = simulate_bag('texture', 'flexion', 3, seed=6, sessions=2)
    request = TrainRequest(folder=tmp_path / 'models', folds=3, repetitions=1, partial='1')
    (trained,) = train_models(read_tables([path]), request, Output(as_json=True))
    today = tmp_path / 'today'
    run_recalibrate(trained.path, [bag], today, force=False, as_json=True)
    (written,) = today.iterdir()
    model = TactileModel.load(written)
    stated = model.manifest.calibration['recalibrated']
    assert stated['model_id'] == trained.model_id
    assert len(stated['offsets']) == 2  # of whole and partial windows
    assert 'session_statistics' not in trained.to_dict()['calibration']
    with pytest.raises(TactileError, match='would be replaced'):
        run_recalibrate(trained.path, [bag], today, force=False, as_json=True)


def test_raw_scores_that_are_kept_are_printed_and_in_json(tmp_path, capsys):
    rng = np.random.default_rng(3)
    label, session = np.tile(np.repeat(np.arange(3), 20), 2), np.repeat([0, 1], 60)
    noise = np.where(session == 0, 0.2, 4.0)[:, np.newaxis]
    table = FeatureTable(
        3.0 * np.eye(3)[label] + noise * rng.normal(size=(120, 3)),
        np.array(['foam', 'pla', 'steel'])[label],
        array_spec('stiffness', 50, 60.0),
        {'session_id': session.astype(str)},
    )
    request = TrainRequest(folder=tmp_path, classifier='svm_linear', folds=3, repetitions=1)
    found = BagTables({('stiffness', ''): table}, ())
    (trained,) = train_models(found, request, Output(as_json=False))
    printed = ' '.join(capsys.readouterr().out.split())
    assert (
        'scores: raw (margin) are kept, because calibration was worse in both held-out sessions'
        in printed
    )
    assert trained.to_dict()['calibration']['scores']['kept'] == 'raw'
