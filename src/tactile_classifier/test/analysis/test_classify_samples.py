# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classification of samples: results equal those of a stream; wrong inputs are refused."""

import dataclasses
import functools
from pathlib import Path

import numpy as np
import pytest

from tactile_classifier import load_model, write_model
from tactile_classifier.datasets.dataset import FeatureTable, table_from_trials
from tactile_classifier.errors import DatasetError, ModelFileError
from tactile_classifier.model_file.manifest import list_facts
from tactile_classifier.model_file.model import TactileModel
from tactile_classifier.training.trainer import train
from tactile_classifier.types import NO_ANSWER, UNKNOWN
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import features_from_trials, TrialFeatureExtractor
from tactile_features.model_container import open_container, pack_container
from tactile_features.spec import spec_for
from tactile_features.types import TrialEvent
from tactile_ros.strain import StrainBlock

START_NS = 10**18
SPEED_M_S = 0.02


def make_rows(label, seed, count, rate_hz, samples):
    """Return trials with a falling level and a wave whose frequency depends on the label."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) / rate_hz
    phase = rng.uniform(0.0, 2 * np.pi, (count, 1))
    wave = 0.1 * np.sin(2 * np.pi * (4.0 + 5.0 * label) * time_s + phase)
    fall = (0.3 + 0.2 * label + rng.normal(0.0, 0.02, (count, 1))) * time_s
    return 6.0 - label - fall + wave + rng.normal(0.0, 0.02, (count, samples))


def table_of_rows(task, config, samples, sessions=3, each=10, **options):
    """Return features of windows that are already cut, with a feature node's specification."""
    rows = np.concatenate(
        [make_rows(i, i, sessions * each, config.rate_hz, samples) for i in range(3)]
    )
    speeds = np.full(len(rows), SPEED_M_S)
    values, _ = features_from_trials(
        task, rows, config.rate_hz, config=config, speeds_m_s=speeds, **options
    )
    labels = np.repeat(['plate 0', 'plate 1', 'plate 2'], sessions * each)
    session = np.tile(np.repeat([f's{i}' for i in range(sessions)], each), 3)
    return FeatureTable(values, labels, spec_for(task, config), {'session_id': session})


def stream(task, config, tension_n, phase, end_s):
    """Return the windows that an extractor cuts from a phase that begins at the first sample."""
    wanted = [spec_for(task, config)]
    extractor = TrialFeatureExtractor(config, wanted)
    events = [
        TrialEvent(
            START_NS + round(time_s * 1e9), 't', 's', task, 'flexion', '', name,
            glide_speed_m_s=SPEED_M_S,
        )
        for time_s, name in ((0.0, phase), (end_s, 'return'))
    ]  # fmt: skip
    extractor.add_event(events[0])
    period_ns = round(1e9 / config.rate_hz)
    windows = extractor.add_block(StrainBlock(START_NS, 0, period_ns, tension_n))
    windows += extractor.add_event(events[1])
    return windows + extractor.finish()


CASES = {
    'spectrum': ('texture', FeatureConfig(), 'knn', 180),
    'waveform': ('texture', FeatureConfig(texture_features='glide_waveform'), 'svm_rbf', 180),
    'over distance': (
        'texture', FeatureConfig(rate_hz=100.0, texture_features='texture_spatial'), 'tree', 300
    ),
    'stiffness': ('stiffness', FeatureConfig(rate_hz=100.0), 'svm_linear', 300),
}  # fmt: skip


@pytest.fixture(scope='module')
def model_of(tmp_path_factory):
    """Return a function that returns the loaded model of a case; each is trained once."""
    folder = tmp_path_factory.mktemp('samples')

    @functools.cache
    def model_of(case):
        task, config, classifier, samples = CASES[case]
        path = folder / f'{case}.npz'
        write_model(path, train(table_of_rows(task, config, samples), classifier))
        return load_model(path)

    return model_of


@pytest.fixture
def model(model_of):
    return model_of('spectrum')


@pytest.mark.parametrize('case', CASES)
def test_the_answer_is_that_on_the_window_of_the_stream_bit_for_bit(case, model_of):
    task, config, _, samples = CASES[case]
    model = model_of(case)
    phase, crop_s = ('glide', config.texture_crop_start_s)
    if task == 'stiffness':
        phase, crop_s = ('hold', config.stiffness_settle_s)
    lead = np.full(round(crop_s * config.rate_hz), 6.0)
    end_s = crop_s + samples / config.rate_hz + config.stiffness_crop_end_s
    seen = set()
    for label in range(4):  # the model does not know label 3
        row = make_rows(label, 90 + label, 1, config.rate_hz, samples + 200)[0]
        tension_n = np.concatenate([lead, row])
        (window,) = stream(task, config, tension_n, phase, end_s)
        first = window.first_sequence
        part = tension_n[first : first + window.sample_count]
        live = model.classify_window(window)
        answer = model.classify(part, config.rate_hz, speed_m_s=SPEED_M_S)
        assert answer.scores == dict(zip(live.labels, live.scores, strict=True))
        assert answer.novelty == live.novelty
        assert answer.novelty_threshold == live.novelty_threshold
        assert answer.label == (live.label or UNKNOWN)
        assert (answer.reason or '') == live.reason
        seen.add(answer.label)
    # Phases are random, so each waveform may be unlike all training trials.
    assert seen > {UNKNOWN} or case in ('waveform', 'over distance')


def test_an_early_window_is_answered_as_on_the_stream(tmp_path):
    config = FeatureConfig(texture_samples=60, early_windows=True)
    early = write_model(tmp_path / 'm.npz', train(table_of_rows('texture', config, 60), 'knn'))
    tension_n = make_rows(1, 91, 1, 60.0, 300)[0]
    (window,) = stream('texture', config, tension_n, 'glide', 4.5)
    part = tension_n[window.first_sequence :][: window.sample_count]
    live, answer = early.classify_window(window), early.classify(part, 60)
    assert (tuple(answer.scores.values()), answer.label) == (live.scores, live.label)
    with pytest.raises(DatasetError, match=r'90 samples.* 60 '):
        early.classify(tension_n[:90], 60)


def test_the_remedy_for_too_many_samples_is_the_window_of_the_live_node(model):
    tension_n = make_rows(1, 91, 1, 60.0, 300)[0]
    (window,) = stream('texture', FeatureConfig(), tension_n, 'glide', 4.5)
    first = window.first_sequence
    with pytest.raises(DatasetError, match=rf'uses samples\[{first}:{first + 180}\] of a glide'):
        model.classify(tension_n, 60)


@pytest.mark.parametrize(
    ('samples', 'rate_hz', 'sentence'),
    [
        (np.ones(179), 60, r'model texture.*: 179 samples; a window has 180 \(3 s at 60 Hz\): g'),
        (
            np.ones(180),
            100,
            r'the rate is 100 Hz, but the model was trained at 60 Hz: resample the samples',
        ),
        (np.ones((2, 180)), 60, r'shape \(2, 180\); one window has shape \(n,\): call'),
        (3.0, 60, r'shape \(\);'),
    ],
)
def test_samples_that_are_no_window_are_refused_with_the_remedy(model, samples, rate_hz, sentence):
    with pytest.raises(DatasetError, match=sentence):
        model.classify(samples, rate_hz)


def test_a_window_without_features_gives_the_reason(model, model_of):
    answer = model.classify(np.full(180, np.nan), 60)
    assert (answer.label, answer.reason) == (NO_ANSWER, 'not all samples are finite')
    assert (answer.scores, answer.novelty, answer.p_value) == ({}, None, None)
    with pytest.raises(DatasetError, match='needs a sliding speed above 0: give speed_m_s'):
        model_of('over distance').classify(np.ones(300), 100)


def test_a_model_of_several_channels_takes_all_of_them(tmp_path):
    rows = np.concatenate([make_rows(i, i, 20, 60.0, 180) for i in range(3)])
    x = np.stack([rows, rows[::-1]], axis=1)
    table = table_from_trials('texture', x, np.repeat(['a', 'b', 'c'], 20), 60.0, 'all')
    model = write_model(tmp_path / 'm.npz', train(table, 'knn'))
    for row, values in zip(x[::7], table.values[::7], strict=True):
        expected = model.compute(values[np.newaxis]).scores[0].tolist()
        assert list(model.classify(row, 60).scores.values()) == expected
    with pytest.raises(DatasetError, match=r'\(2, n\)'):
        model.classify(x[0, 0], 60)


def test_one_channel_of_several_is_stated_and_found_again(tmp_path):
    rows = np.concatenate([make_rows(i, i, 20, 60.0, 180) for i in range(3)])
    x = np.stack([rows, 0.5 * rows[::-1]], axis=1)
    label = np.repeat(['a', 'b', 'c'], 20)
    named = {'channels': ('fx', 'fy')}
    specs, facts = {}, {}
    for channel in (0, 'fy', 'mean'):
        table = table_from_trials('texture', x, label, 60.0, channel, **named)
        model = write_model(tmp_path / 'm.npz', train(table, 'knn'))
        specs[channel], facts[channel] = model.spec, list_facts(model.manifest)['channel']
        used = {0: x[:, 0], 'fy': x[:, 1], 'mean': x.mean(axis=1)}[channel]
        for row, one in zip(x[::7], used[::7], strict=True):
            assert model.classify(row, 60).scores == model.classify(one, 60).scores
        if channel != 'mean':
            with pytest.raises(ModelFileError, match='the channel differs'):
                model.check_fits(
                    table_from_trials('texture', x, label, 60.0, 'mean', **named).spec
                )
    assert len({spec.digest for spec in specs.values()}) == 3
    assert facts == {
        0: 'fx; not used: fy', 'fy': 'fy; not used: fx', 'mean': 'mean of 2 (fx, fy)',
    }  # fmt: skip
    assert table_from_trials('texture', x, label, 60.0, **named).spec == specs[0]
    alone = ('texture', x[:, :1], label, 60.0)
    digests = {table_from_trials(*alone, c).spec.digest for c in (0, 'mean', 'all')}
    assert len(digests) == 1


def test_a_hold_without_any_change_has_an_answer(model_of):
    assert model_of('stiffness').classify(np.full(300, 5.0), 100).label != NO_ANSWER


def test_a_rate_that_differs_by_less_than_a_thousandth_is_the_same(model):
    samples = make_rows(1, 5, 1, 60.0, 180)[0]
    answer = model.classify(samples, 60.0)
    for rate_hz in (60.03, 59.95, float(np.float32(60.001)), 1.0 / np.diff([0.0, 1.0 / 60.0])[0]):
        assert model.classify(samples, rate_hz).label == answer.label
    with pytest.raises(DatasetError, match=r'60\.07 Hz.* 60 Hz'):
        model.classify(samples, 60.07)
    other = features_from_trials('texture', samples[np.newaxis], 59.95)[1]
    assert other.names != model.spec.names
    model.check_fits(other)
    with pytest.raises(ModelFileError, match=r'the rate in Hz differs: required 60, found 60\.07'):
        model.check_fits(features_from_trials('texture', samples[np.newaxis], 60.07)[1])


@pytest.mark.parametrize('sessions', [1, 3])
def test_the_p_value_is_at_most_the_rate_where_the_window_is_unknown(sessions, tmp_path):
    table = table_of_rows('texture', FeatureConfig(), 180, sessions=sessions, each=60 // sessions)
    model = write_model(tmp_path / 'm.npz', train(table, 'knn'))
    p_values = []
    for share in np.linspace(0.0, 0.5, 40):
        known, strange = (make_rows(label, 95, 1, 60.0, 180)[0] for label in (1, 5))
        answer = model.classify((1 - share) * known + share * strange, 60)
        assert (answer.label == UNKNOWN) == (answer.p_value <= 0.05)
        p_values.append(answer.p_value)
    assert min(p_values) < 0.05 < max(p_values) <= 1.0


def test_a_file_with_damaged_held_out_novelties_is_refused(model):
    calibration = {k: v for k, v in model.manifest.calibration.items() if k != 'held_out_novelty'}

    def change(new):
        changed = dataclasses.replace(model.manifest, calibration={**calibration, **new})
        arrays = open_container(Path(model.path).read_bytes()).arrays
        return TactileModel(pack_container(changed.to_dict(), arrays))

    with pytest.raises(ModelFileError, match='novelties of held-out trials are damaged'):
        change({})
    damaged = (
        {'names': [], 'sessions': [[1.0], [2.0]]},
        {'names': ['a'], 'sessions': [[]]},
        {'names': ['a'], 'sessions': ['x']},
        {'names': [1], 'sessions': [[1.0]]},
        {'names': ['a'], 'sessions': [[np.inf]]},
        {'names': [], 'sessions': []},
        {},
        [],
        3,
    )
    for entry in damaged:
        with pytest.raises(ModelFileError, match='novelties of held-out trials are damaged'):
            change({'held_out_novelty': entry})


def test_an_uncalibrated_model_has_raw_scores_alone_and_says_why(tmp_path):
    table = table_of_rows('texture', FeatureConfig(), 180, sessions=1, each=4)
    model = write_model(tmp_path / 'm.npz', train(table, 'knn'))
    rows = make_rows(1, 91, 1, 60.0, 180)
    answer = model.classify(rows[0], 60)
    assert answer.label == 'plate 1'
    assert (answer.probabilities, answer.novelty, answer.p_value) == ({}, None, None)
    assert max(answer.scores, key=answer.scores.get) == 'plate 1'
    for ask in (model.predict_proba, model.novelty, model.p_value):
        with pytest.raises(DatasetError, match=' 19 trials'):
            ask(rows)
