# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Small tables of features with known answers, and models trained on them."""

from pathlib import Path
import sys

import numpy as np
import pytest

# Modules that several test files import are in this folder, not in the package.
sys.path.insert(0, str(Path(__file__).parent))

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.spec import spec_for
from tactile_features.types import FeatureWindow, WindowOutcome


def make_texture_table(classes=8, each=60, noise_n=0.1):
    """Return spectra of noisy sums of sines; each class has its own frequencies."""
    rng = np.random.default_rng(7)
    time_s = np.arange(180) / 60.0
    rows, labels = [], []
    for k in range(classes):
        frequencies_hz = rng.uniform(1.0, 25.0, 4)
        amplitudes_n = rng.uniform(0.01, 0.1, 4)
        for _ in range(each):
            phases = rng.uniform(0.0, 2 * np.pi, 4)
            waves = np.sin(2 * np.pi * np.outer(time_s, frequencies_hz) + phases)
            rows.append(3.0 + waves @ amplitudes_n + rng.normal(0.0, noise_n, 180))
            labels.append(f'plate {k}')
    trials = len(rows)
    return FeatureTable(
        compute_spectrum(np.array(rows)),
        np.array(labels),
        spec_for('texture', FeatureConfig()),
        {
            'contact': np.full(trials, 'flexion'),
            'simulated': np.ones(trials, dtype=bool),
            'session_id': np.array([f's{i % 3}' for i in range(trials)]),
        },
    )


def make_stiffness_table(each=12):
    rng = np.random.default_rng(3)
    centres = np.array([[-0.9, 12.6, -0.99], [-0.3, 10.0, -0.9], [-0.1, 6.0, -0.7]])
    values = np.repeat(centres, each, axis=0) * rng.normal(1.0, 0.05, (3 * each, 3))
    return FeatureTable(
        np.clip(values, [-9, 0, -1], [9, 99, 1]),
        np.repeat(['pla', 'rubber', 'sponge'], each),
        spec_for('stiffness', FeatureConfig()),
    )


@pytest.fixture(scope='session')
def texture_table():
    return make_texture_table()


@pytest.fixture(scope='session')
def small_table():
    return make_texture_table(classes=3, each=12)


@pytest.fixture(scope='session')
def stiffness_table():
    return make_stiffness_table()


@pytest.fixture(scope='session')
def four_labels(texture_table):
    """Return the trials of four labels."""
    return texture_table.take(texture_table.labels < 'plate 4')


@pytest.fixture(scope='session')
def early_table(four_labels):
    """Return a table of four labels, like one of windows of one second that end early."""
    config = FeatureConfig(texture_samples=60, early_windows=True)
    spec = spec_for('texture', config)
    noise = 0.005 * np.random.default_rng(11).normal(size=(len(four_labels), len(spec.names)))
    values = np.abs(four_labels.values[:, : len(spec.names)] + noise)
    return FeatureTable(values, four_labels.labels, spec, four_labels.columns)


@pytest.fixture(scope='session')
def model_path(small_table, tmp_path_factory):
    path = tmp_path_factory.mktemp('models') / 'texture.npz'
    write_model(path, train(small_table, 'svm_linear'))
    return path


@pytest.fixture(scope='session')
def early_path(early_table, tmp_path_factory):
    """Return the path of a nearest-neighbour model for early windows of one second."""
    path = tmp_path_factory.mktemp('models') / 'early.npz'
    write_model(path, train(early_table, 'knn'))
    return path


@pytest.fixture
def make_window(small_table):
    """Return a function that makes a window with the features of a trial of `small_table`."""

    def make(trial=0, **changes):
        fields = {
            'feature_set': 'texture_spectrum',
            'feature_set_version': small_table.spec.version,
            'trial_id': f'trial-{trial}',
            'contact': 'flexion',
            'simulated': False,
            'outcome': WindowOutcome.OK,
            'reason': '',
            'values': small_table.values[trial],
            'window_start_ns': 10**18 + 1,
            'window_end_ns': 10**18 + 2_983_333_334,
            'first_sequence': 60,
            'rate_hz': 60.0,
            'sample_count': 180,
            'interpolated_count': 0,
            'status': 0,
            'frame_id': 'tendon_sensor_link',
            'specification_digest': small_table.spec.digest,
        }
        return FeatureWindow(**{**fields, **changes})

    return make
