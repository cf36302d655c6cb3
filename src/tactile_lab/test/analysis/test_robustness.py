# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the accuracy on simulated trials if the sensor or the rig is not perfect."""

from dataclasses import replace
import importlib
from pathlib import Path

import numpy as np
import pytest

from tactile_analysis.datasets.feature_tables import read_tables
from tactile_bringup.trial_protocols import TrialConfig
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.trials import simulate_trials

REPOSITORY = Path(__file__).resolve().parents[4]
if not (REPOSITORY / 'benchmarks').is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)


@pytest.fixture(scope='module')
def study():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(REPOSITORY)
        yield importlib.import_module('benchmarks.simulator.robustness')


@pytest.fixture(scope='module')
def catalogue():
    return Catalogue(None)


def make_trials(study, catalogue, label):
    config = TrialConfig()
    return study.CleanTrials('stiffness', label, study.Study(seed=7), config, catalogue, 0, 3)


@pytest.fixture(scope='module')
def trials(study, catalogue):
    return make_trials(study, catalogue, 'pla')


def test_default_conditions_equal_the_simulator_bit_for_bit(study, trials, catalogue):
    expected = simulate_trials(
        'stiffness', 'pla', 'flexion', trials.planned.timeline, 3, 7, catalogue=catalogue
    )
    np.testing.assert_array_equal(trials.sense(), expected.tension_n)
    noise_n = trials.sense(noise_n=0.1) - trials.sense()
    assert np.std(noise_n) == pytest.approx(0.1, rel=0.1)


def test_features_are_those_of_a_bag(study, trials, stiffness_bag):
    (table,) = read_tables([stiffness_bag]).values()
    of_pla = table.values[table.labels == 'pla']
    rows = trials.extract(study.USUAL)
    # The values differ slightly, because stamps in the bag are rounded to nanoseconds.
    np.testing.assert_allclose(np.array(rows), of_pla, rtol=1e-7)


def test_lost_samples_differ_between_labels(study, catalogue, trials):
    other = make_trials(study, catalogue, 'sponge')
    assert len({t.draw_losses(i, 1)[0] for t in (trials, other) for i in range(3)}) == 6


def test_lost_samples_refuse_windows_unless_gaps_are_interpolated(study, trials):
    lossy = study.Setting('lost', 0.05, lost=0.05)
    assert trials.extract(lossy) == [None] * 3
    bridged = trials.extract(replace(lossy, max_gap_samples=5))
    whole = trials.extract(study.USUAL)
    np.testing.assert_allclose(np.array(bridged), np.array(whole), rtol=0.05)
    assert not np.array_equal(np.array(bridged), np.array(whole))


def test_sessions_differ_and_another_depth_is_simulated(study, catalogue):
    small = study.Study(train_sessions=1, test_sessions=1, train_trials=2, test_trials=1)
    ((usual, test),) = study.make_features(
        small, catalogue, 'stiffness', [study.Setting('a', 1.0)]
    )
    assert (len(usual.labels), len(test.labels), test.trials) == (10, 5, 5)
    assert not set(map(tuple, usual.values)) & set(map(tuple, test.values))
    assert 0.0 <= study.score('stiffness', usual, test) <= 1.0
    settings = study.list_settings(0.004, 0.015)
    assert len({setting.axis for setting in settings}) == 5
    bridged = {s.max_gap_samples for s in settings if 'bridged' in s.axis}
    assert bridged == {3}
    deep = [study.Setting('contact depth', 1.2, depth=1.2)]
    ((deeper, _),) = study.make_features(small, catalogue, 'stiffness', deep)
    assert (deeper.values[:, 1] > usual.values[:, 1]).all()
