# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Answers on many trials are those on each, and a model knows what it was trained on."""

import numpy as np
import pytest

from tactile_classifier.model_file.model import find_training_trials
from tactile_classifier.records import NO_ANSWER, Outcome, UNKNOWN
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train


@pytest.mark.parametrize('classifier', ['knn', 'svm_rbf', 'tree'])
def test_answers_are_those_of_the_node(small_table, make_window, tmp_path, classifier):
    model = write_model(tmp_path / 'm.onnx', train(small_table, classifier))
    generator = np.random.default_rng(2)
    values = small_table.values * generator.uniform(0.2, 5.0, (len(small_table), 1))
    outcomes = {Outcome.UNKNOWN: UNKNOWN, Outcome.NO_FEATURES: NO_ANSWER}
    expected = []
    for row in values:
        result = model.classify_window(make_window(0, values=row))
        expected.append(outcomes.get(result.outcome, result.label))
    assert model.predict(values).tolist() == expected
    assert model.predict(values[:0]).shape == (0,)
    assert {UNKNOWN, *small_table.labels} >= set(expected) > {UNKNOWN}


def test_a_model_tells_its_training_trials_from_others_like_them(texture_table, tmp_path):
    keep = np.arange(len(texture_table)) % 4 == 0
    model = write_model(tmp_path / 'm.onnx', train(texture_table.take(keep), 'knn'))
    np.testing.assert_array_equal(find_training_trials(model, texture_table.values), keep)


def test_a_model_without_novelty_does_not_tell(stiffness_table, tmp_path):
    few = stiffness_table.take(np.arange(len(stiffness_table)) % 4 == 0)
    model = write_model(tmp_path / 'm.onnx', train(few, 'knn'))
    assert 'reason' in model.manifest.calibration
    assert find_training_trials(model, few.values) is None
    assert set(model.predict(few.values)) <= set(few.labels)
