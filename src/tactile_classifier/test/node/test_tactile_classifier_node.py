# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of the classifier node over real DDS, with and without a feature node."""

import shutil

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from rclpy.parameter import Parameter

from tactile_classifier.conversions import model_infos_from_msg
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_classifier.types import PredictionOutcome
from tactile_features import FeatureConfig, read_contracts, spec_for, TrialFeatureExtractor
from tactile_features.conversions import event_from_msg, strain_block_from_msg
from tactile_features.types import WindowOutcome
from tactile_msgs.msg import ModelInfos
from tactile_ros.qos import LATEST


def test_windows_are_classified_over_the_wire(make_finger, model_path, make_window):
    depth = 'qos_overrides./tactile_classifier/classification.publisher.depth'
    # With use_sim_time, diagnostics are published even if there is no clock.
    finger = make_finger(contact='flexion', use_sim_time=True, **{depth: 7})
    finger.bring_up()
    windows = [
        make_window(0),
        make_window(20, contact='abduction'),
        make_window(0, feature_set='stiffness_regression'),
        make_window(3, rate_hz=100.0),
        make_window(4, outcome=WindowOutcome.GAP, reason='12 samples are missing'),
        make_window(30),
    ]
    finger.send(*windows)
    finger.spin_until(lambda: finger.models.counts['windows'] == 6 and len(finger.heard) == 4)
    answers = finger.answers
    model = load_model(model_path)
    assert answers == [model.classify_window(windows[i]) for i in (0, 3, 4, 5)]
    assert [a.label for a in answers] == ['plate 0', '', '', 'plate 2']
    assert 'rate in Hz is 100;' in answers[1].reason
    assert (finger.models.counts['windows for others'], finger.models.counts['answers']) == (
        2,
        4,
    )
    assert finger.wait_for_count('answers', '4').hardware_id == model.model_id
    assert finger.classifier.get_parameter(depth).value == 7


def test_only_an_active_node_answers_and_it_can_be_configured_again(make_finger, make_window):
    finger = make_finger()
    classifier = finger.classifier
    classifier.trigger_configure()
    classifier.add_window(make_window(0))
    classifier.trigger_activate()
    finger.connect()
    finger.send(make_window(30))
    finger.spin_until(lambda: finger.heard)
    assert [a.trial_id for a in finger.answers] == ['trial-30']
    assert finger.models.counts['windows'] == 1
    classifier.trigger_deactivate()
    classifier.trigger_cleanup()
    finger.bring_up()
    finger.send(make_window(0))
    finger.spin_until(lambda: len(finger.heard) == 2)


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'models': ''}, 'the parameter models '),
        ({'models': '/nowhere/m.npz'}, 'cannot read model /nowhere/m.npz'),
        ({'contact': 'abduction'}, 'the parameter contact is abduction'),
    ],
    ids=str,
)
def test_what_it_cannot_do_is_said_and_it_is_not_configured(
    make_finger, model_path, changes, sentence, capfd
):
    node = make_finger(**changes).classifier
    assert not node.bring_up()
    assert sentence in capfd.readouterr().err
    mended = {'models': str(model_path), 'contact': 'flexion'}
    node.set_parameters([Parameter(name, value=value) for name, value in mended.items()])
    assert node.bring_up()


# -- behind a feature node ----------------------------------------------------------


@pytest.mark.parametrize('has_models', [False, True])
def test_equal_parameters_or_the_same_models_are_answered(
    make_finger, make_trials, model_path, has_models
):
    models = {'models': str(model_path), 'texture_crop_start_s': 0.9}
    finger = make_finger(models if has_models else {})
    finger.bring_up()
    finger.play(*make_trials())
    finger.spin_until(lambda: finger.heard)
    assert finger.answers[0].outcome in (PredictionOutcome.LABEL, PredictionOutcome.UNKNOWN)
    assert finger.models.counts['windows of another specification'] == 0


def test_a_parameter_of_the_feature_node_alone_is_noticed(
    make_finger, make_trials, model_path, capfd
):
    difference = '(texture_crop_start_s) differs: required 0.6, found 0.9'
    finger = make_finger({'texture_crop_start_s': 0.9})
    finger.bring_up()
    finger.play(*make_trials())
    finger.spin_until(lambda: len(finger.heard) == 2)
    log = capfd.readouterr().err
    assert 'does not compute the features of model texture-flexion-svm_linear' in log
    assert f' models to {model_path}' in log
    for answer in finger.answers:
        assert (answer.outcome, answer.label) == (PredictionOutcome.NO_FEATURES, '')
        assert difference in answer.reason
    status = finger.wait_for_count('windows of another specification', '2')
    assert status.level == DiagnosticStatus.WARN
    assert difference in status.message


SPECS = {
    'early': spec_for('texture', FeatureConfig(texture_samples=30, early_windows=True)),
    'full': spec_for('texture', FeatureConfig()),
    'short': spec_for('texture', FeatureConfig(texture_samples=90, max_gap_samples=3)),
    'over_distance': spec_for('texture', FeatureConfig(texture_features='texture_spatial')),
    'hold': spec_for('stiffness', FeatureConfig()),
}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Return a folder of models with different features."""
    folder = tmp_path_factory.mktemp('models')
    labels, scale = np.repeat(['pla', 'wood', 'felt'], 8), np.repeat([1.0, 1.5, 2.0], 8)[:, None]
    columns = {'contact': np.full(24, 'flexion'), 'session_id': np.arange(24) % 3}
    for seed, (name, spec) in enumerate(SPECS.items()):
        values = np.random.default_rng(seed).normal(0.05, 0.02, (24, len(spec.names)))
        table = FeatureTable(scale * np.abs(values), labels, spec, columns)
        write_model(folder / f'{name}.npz', train(table, 'knn'))
    return folder


def answer_alone(path, events, blocks):
    """Return the results of one model if no other model is used."""
    (contract,), _ = read_contracts(path)
    extractor = TrialFeatureExtractor(FeatureConfig(), [contract.spec])
    windows = [w for event in events for w in extractor.add_event(event_from_msg(event))]
    windows += [w for block in blocks for w in extractor.add_block(strain_block_from_msg(block))]
    model = load_model(path)
    digest = contract.spec.digest
    return [model.classify_window(w) for w in windows if w.specification_digest == digest]


def test_each_model_answers_with_the_bits_that_it_gives_alone(make_finger, make_trials, folder):
    finger = make_finger({'models': str(folder)}, models=str(folder))
    finger.bring_up()
    assert [spec.digest for spec in finger.features.extractor.specifications] == [
        SPECS[name].digest for name in ('early', 'full', 'hold', 'over_distance', 'short')
    ]
    trials = make_trials(lost=150)
    finger.play(*trials)
    alone = {name: answer_alone(folder / f'{name}.npz', *trials) for name in SPECS}
    assert [len(answers) for answers in alone.values()] == [2, 2, 2, 2, 1]
    finger.spin_until(lambda: len(finger.heard) == 9)
    for answers in alone.values():
        model_id = answers[0].model_id
        assert [a for a in finger.answers if a.model_id == model_id] == answers
    # The model "full" allows no lost samples; for the model "short", they are interpolated.
    (lost,) = [a for a in alone['full'] if a.trial_id == 't1']
    assert 'max_gap_samples allows 0' in lost.reason
    assert 'missing' not in alone['short'][0].reason


def test_its_models_are_announced_and_a_broken_file_is_named(make_finger, folder, tmp_path, capfd):
    shutil.copy(folder / 'full.npz', tmp_path / 'any name.npz')
    (tmp_path / 'broken.npz').write_bytes(b'hello')
    finger = make_finger({'models': str(tmp_path)}, models=str(tmp_path))
    finger.bring_up()
    infos = []
    finger.listen(ModelInfos, 'tactile_classifier/models', infos, LATEST)
    finger.spin_until(lambda: infos and finger.diagnostics)
    found = model_infos_from_msg(infos[-1])
    assert found.models == finger.models.infos
    assert found.models[0].path == str(tmp_path / 'any name.npz')
    (refused,) = found.refused
    assert f'model {tmp_path / "broken.npz"} is refused' in refused
    assert refused in capfd.readouterr().err
    status = finger.diagnostics[-1]
    assert status.level == DiagnosticStatus.WARN
    assert refused in status.message
    assert status.hardware_id == found.models[0].model_id
