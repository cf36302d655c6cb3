# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reliability of probabilities whose calibration is known."""

import json

import numpy as np
import pytest

from tactile_classifier.confidence.fit_calibration import compute_calibration_error
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import EvaluationError
from tactile_classifier.evaluation.plans import Attempt, run_plans
from tactile_classifier.evaluation.reliability import (
    cross_validate_reliability,
    measure_reliability,
)
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for


def test_perfectly_calibrated_probabilities_lie_on_the_diagonal():
    generator = np.random.default_rng(2)
    stated = generator.uniform(0.3, 1.0, 20_000)
    found = measure_reliability(stated, generator.random(len(stated)) < stated)
    assert sum(each.trials for each in found.bins) == found.trials == 20_000
    assert len(found.bins) == 7
    for each in found.bins:
        assert each.right == pytest.approx(each.stated, abs=0.03)
        assert each.interval.low < each.stated < each.interval.high
    assert found.error < 0.02
    assert found.error == pytest.approx(found.chance_error, abs=0.006)
    json.dumps(found.to_dict(), allow_nan=False)


def test_few_calibrated_trials_have_the_error_of_chance():
    generator = np.random.default_rng(3)
    errors, by_chance = [], []
    for _ in range(40):
        stated = generator.uniform(0.3, 1.0, 40)
        found = measure_reliability(stated, generator.random(40) < stated)
        errors.append(found.error)
        by_chance.append(found.chance_error)
    assert np.mean(by_chance) > 0.05
    assert np.mean(errors) == pytest.approx(np.mean(by_chance), rel=0.1)


def test_probabilities_that_are_too_large_are_seen():
    generator = np.random.default_rng(4)
    stated = np.full(2000, 0.95)
    found = measure_reliability(stated, generator.random(2000) < 0.6)
    assert found.error == pytest.approx(0.35, abs=0.03)
    assert found.error > 10 * found.chance_error
    (only,) = found.bins
    assert only.interval.high < only.stated
    probabilities = np.column_stack([stated, 1.0 - stated])
    true = (generator.random(2000) > 0.6).astype(np.intp)
    again = measure_reliability(stated, true == 0)
    assert again.error == compute_calibration_error(probabilities, true)


def test_reliability_holds_groups_out_and_says_why_it_cannot():
    generator = np.random.default_rng(5)
    code = np.tile(np.arange(3), 24)
    values = 2.0 * np.eye(3)[code] + generator.normal(size=(72, 3))
    spec = spec_for('stiffness', FeatureConfig())
    labels = np.array(['pla', 'rubber', 'sponge'])[code]
    table = FeatureTable(values, labels, spec, {'session_id': np.arange(72) // 18})
    found = cross_validate_reliability(table, ['session_id'], 'svm_linear', 'standard')
    assert (found.split, found.trials) == ('one session held out', 72)
    assert found.error < 0.2
    few = table.take(np.r_[0:9, 10])  # one trial of one label is not enough
    few = FeatureTable(few.values, np.r_[['a'] * 9, ['b']], spec)
    (why,) = run_plans([Attempt(cross_validate_reliability, few, [], 'knn', 'none')])
    assert isinstance(why, EvaluationError)
    assert 'has only one trial' in str(why)
