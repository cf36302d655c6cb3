# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials of the demo, and its explanations of wrong predictions."""

import numpy as np
import pytest

from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features import FeatureConfig, FeatureWindow, spec_for, WindowOutcome
from tactile_lab.commands.demo import choose_trials, explain_misses, KINDS
from tactile_lab.commands.train import TrainedModel
from tactile_lab.experiment.live_rig import LiveTrial


@pytest.fixture(scope='module')
def trained(tmp_path_factory):
    """Return a model of three labels. The features of PLA and rubber have equal distributions."""
    rng = np.random.default_rng(0)
    labels = np.tile(['pla', 'rubber', 'sponge'], 40)
    sessions = np.repeat(['a', 'b', 'c', 'd'], 30)
    slope = {'pla': 1.0, 'rubber': 1.0, 'sponge': 9.0}
    values = np.array([slope[label] for label in labels])[:, None] + rng.normal(size=(120, 3)) / 9
    columns = {'session_id': sessions, 'contact': np.full(120, 'flexion')}
    table = FeatureTable(values, labels, spec_for('stiffness', FeatureConfig()), columns)
    path = tmp_path_factory.mktemp('models') / 'stiffness_flexion.npz'
    model = write_model(path, train(table, 'knn'))
    return TrainedModel(path, model.model_id, table, None, model.manifest)


def live(trained, label, values):
    spec = trained.table.spec
    window = FeatureWindow(
        spec.feature_set, spec.version, 't', 'flexion', True, WindowOutcome.OK, '',
        np.asarray(values), 0, 3_000_000_000, 0, 60.0, 180, 0, 0, '',
        specification_digest=spec.digest,
    )  # fmt: skip
    answer = load_model(trained.path).classify_window(window)
    return LiveTrial(TrialRequest('stiffness', 'flexion', label), (answer,))


def test_correct_prediction_has_no_explanation(trained):
    assert explain_misses([live(trained, 'sponge', [9.0, 9.0, 9.0])], [trained]) == []


def test_wrong_prediction_is_explained_by_held_out_sessions(trained):
    (row,) = np.flatnonzero(trained.table.labels == 'rubber')[:1]
    trial = live(trained, 'pla', trained.table.values[row])
    said = trial.answer.label
    if said == 'pla':
        trial = live(trained, 'rubber', trained.table.values[row])
    (sentence,) = explain_misses([trial], [trained])
    wanted = trial.request.object_label
    assert sentence.startswith(f'stiffness, flexion, {wanted}, classified as {said}: ')
    share, whole = (int(word) for word in sentence.split() if word.isdigit())
    assert whole == 40
    assert 5 <= share <= 35  # the model cannot distinguish PLA and rubber


def test_unknown_prediction_has_its_reason(trained):
    trial = live(trained, 'pla', [99.0, 99.0, 99.0])
    (sentence,) = explain_misses([trial], [trained])
    reason = trial.answers[0].reason
    assert reason
    assert reason in sentence


def test_trials_of_the_demo_have_all_kinds_and_unique_names():
    drawn = choose_trials(3, 10)
    kinds = [(trial.contact, trial.protocol) for trial in drawn]
    assert [kinds.count(kind) for kind in KINDS] == [3, 3, 2, 2]
    assert len({trial.trial_id for trial in drawn}) == 10
    assert drawn == choose_trials(3, 10)
