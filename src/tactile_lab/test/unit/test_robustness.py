# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The study of what makes accuracy fall: its trials are those of the simulator."""

import numpy as np
import pytest

from tactile_bringup.records import TrialConfig
from tactile_features.config import FeatureConfig
from tactile_lab.datasets.bag_tables import read_tables
from tactile_lab.report.figures.robustness import build_robustness_page, tell_axis
from tactile_lab.simulation.robustness import (
    CleanTrials,
    describe,
    make_features,
    Point,
    score,
    Study,
)
from tactile_lab.simulation.robustness_axes import Axis, list_axes, Sensing, Setting
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.trials import simulate_trials

SMALL = Study(train_sessions=1, test_sessions=1, train_trials=2, test_trials=1)


@pytest.fixture(scope='module')
def catalogue():
    return Catalogue(None)


def make_trials(catalogue, label):
    config = TrialConfig(simulated=True)
    return CleanTrials('stiffness', label, Study(seed=7), config, catalogue, 0, 3)


@pytest.fixture(scope='module')
def trials(catalogue):
    return make_trials(catalogue, 'pla')


def test_usual_conditions_are_the_simulators_bit_for_bit(trials, catalogue):
    expected = simulate_trials(
        'stiffness', 'pla', 'flexion', trials.planned.timeline, 3, 7, catalogue=catalogue
    )
    np.testing.assert_array_equal(trials.sense(Sensing()), expected.tension_n)


def test_features_are_those_of_a_bag(trials, stiffness_bag):
    (table,) = read_tables([stiffness_bag]).tables.values()
    of_pla = table.values[table.labels == 'pla']
    rows = trials.extract(Sensing(), FeatureConfig(measures=False))
    # Stamps count from another beginning, in whole nanoseconds.
    np.testing.assert_allclose(np.array(rows), of_pla, rtol=1e-7)


def test_each_condition_changes_what_it_says(trials):
    usual = trials.sense(Sensing())
    noisy = trials.sense(Sensing(noise_n=0.1)) - usual
    assert np.std(noisy) == pytest.approx(0.1, rel=0.1)
    drifting = trials.sense(Sensing(drift_n_rt_s=0.05)) - usual
    assert np.abs(drifting[:, 0]).max() <= 1e-3
    assert np.std(drifting[:, -1]) > 0.02
    still = slice(0, 10)  # where the tension rests, the time of sampling does not matter
    shaken = trials.sense(Sensing(jitter=0.5)) - usual
    assert np.abs(shaken[:, still]).max() < np.abs(shaken).max() / 5


def test_losses_and_jitter_differ_from_label_to_label(catalogue, trials):
    other = make_trials(catalogue, 'sponge')
    for what in ('loss', 'jitter'):
        drawn = [t._generator(what, i).random() for t in (trials, other) for i in range(3)]
        assert len(set(drawn)) == 6


def test_lost_samples_cost_windows_unless_gaps_are_bridged(trials):
    config = FeatureConfig(measures=False)
    lossy = Sensing(lost=0.05)
    assert trials.extract(lossy, config) == [None] * 3
    bridged = trials.extract(lossy, FeatureConfig(measures=False, max_gap_samples=5))
    whole = trials.extract(Sensing(), config)
    np.testing.assert_allclose(np.array(bridged), np.array(whole), rtol=0.05)
    assert not np.array_equal(np.array(bridged), np.array(whole))


def test_sessions_differ_and_other_depth_and_rate_are_simulated_anew(catalogue):
    ((usual, test),) = make_features(SMALL, catalogue, 'stiffness', [Setting('a', 1.0)])
    assert (len(usual.labels), len(test.labels), test.trials) == (10, 5, 5)
    assert not set(map(tuple, usual.values)) & set(map(tuple, test.values))
    assert 0.0 <= score('stiffness', usual, test) <= 1.0
    axes = {axis.name: axis for axis in list_axes(catalogue.rig().load_cell, TrialConfig())}
    assert not axes['sample rate'].trains_elsewhere
    assert {s.max_gap_samples for s in axes['lost samples, gaps bridged'].settings} == {3}
    settings = [Setting('sample rate', 30.0, rate_hz=30.0)]
    ((train, _),) = make_features(SMALL, catalogue, 'texture', settings)
    assert train.values.shape == (16, 46)  # 90 samples
    deep = [Setting('contact depth', 1.2, depth=1.2)]
    ((deeper, _),) = make_features(SMALL, catalogue, 'stiffness', deep)
    assert (deeper.values[:, 1] > usual.values[:, 1]).all()


def test_page_says_simulated_and_has_every_number(catalogue):
    axis = Axis('noise', 'N', (Setting('noise', 0.004),), 0.004)
    points = [
        Point('texture', 'noise', 0.004, 0.875, 0.75, 0.0),
        Point('stiffness', 'noise', 0.004, None, 0.5, 0.25),
    ]
    document = describe(Study(), catalogue, points)
    page = build_robustness_page([axis], points, document)
    for text in ('88 %', '75 %', 'none', '25 %', 'trained on sessions 0 to 2'):
        assert text in page
    assert page.count('SIMULATED') >= 4
    assert tell_axis(axis, points)[0] == 'noise (N), texture: 0.004: 88 % / 75 %'
