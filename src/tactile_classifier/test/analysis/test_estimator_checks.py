# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classifiers pass the checks of scikit-learn for estimators; no failure is expected."""

import numpy as np
import pytest
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier
from sklearn.utils.estimator_checks import (
    check_classifiers_classes,
    check_classifiers_train,
    check_methods_sample_order_invariance,
    check_methods_subset_invariance,
    parametrize_with_checks,
)

from tactile_classifier import load_model, RandomConvolutionClassifier, TactileClassifier
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import make_predictor
from tactile_classifier.training.trainer import train
from tactile_features.estimators import GlideWaveform


class PaddedConvolutions(RandomConvolutionClassifier):
    """Pads short waveforms: the checks use fewer than nine samples, the minimum length."""

    def _divide(self, rows):
        return super()._divide(np.pad(rows, [(0, 0), (0, max(0, 9 - rows.shape[1]))]))


@parametrize_with_checks(
    [
        PaddedConvolutions(),
        TactileClassifier(make_pipeline(GlideWaveform(), StandardScaler(), SVC(kernel='linear'))),
    ]
)
@pytest.mark.filterwarnings('ignore:no calibrated probabilities')
def test_classifiers_pass_the_checks_of_scikit_learn(estimator, check):
    check(estimator)


@pytest.mark.parametrize('classifier', [KNeighborsClassifier(3), DecisionTreeClassifier()])
@pytest.mark.parametrize(
    'check',
    [
        check_classifiers_classes,
        check_classifiers_train,
        check_methods_sample_order_invariance,
        check_methods_subset_invariance,
    ],
)
@pytest.mark.filterwarnings('ignore:no calibrated probabilities')
def test_predictions_of_other_pipelines_pass_their_checks(classifier, check):
    """Of the checks of scikit-learn, only these depend on the classifier in the pipeline."""
    check('TactileClassifier', TactileClassifier(make_pipeline(GlideWaveform(), classifier)))


def test_random_convolutions_are_written_as_by_the_trainer(tmp_path):
    rng = np.random.default_rng(2)
    labels, sessions = np.repeat(['coarse', 'fine'], 12), np.arange(24) % 3
    pitch_hz = np.where(labels == 'coarse', 4.0, 9.0)[:, np.newaxis]
    phase = 2 * np.pi * (pitch_hz * np.arange(40) / 60 + rng.random((24, 1)))
    windows = 3.0 + 0.05 * np.sin(phase) + rng.normal(0.0, 0.01, (24, 40))
    model = TactileClassifier(make_pipeline(GlideWaveform(), RandomConvolutionClassifier()))
    model.fit(windows, labels, groups=sessions).save(tmp_path / 'm.npz')
    waveform = GlideWaveform().fit(windows)
    columns = {'session_id': sessions}
    table = FeatureTable(windows, labels, waveform.specification_, columns)
    expected = make_predictor(train(table, 'rocket')).classifier
    found = load_model(tmp_path / 'm.npz').predictor.classifier
    for name in found.SHAPES:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
