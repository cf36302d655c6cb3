# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Model files determine the features: launch files only pass their path."""

import functools

import numpy as np
import pytest

from tactile_bringup.launch_config.hand import find_fingers, hand_graph
from tactile_bringup.launch_config.parameter_files import ParameterFile
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.errors import ModelFileError
from tactile_features.spec import spec_for

SPATIAL = FeatureConfig(
    rate_hz=100.0,
    texture_features='texture_spatial',
    spatial_crop_m=0.003,
    spatial_length_m=0.03,
    spatial_finest_m=0.001,
)


@functools.cache
def train_model(name, config):
    """Return a model that is trained on random features."""
    task, _, contact = name.partition('_')
    labels = np.repeat(['a', 'b'], 24)
    spec = spec_for(task, config)
    values = np.random.default_rng(5).normal(size=(48, len(spec.names)))
    values[:24] += 5.0
    columns = {'contact': np.full(48, contact)} if contact else {}
    return train(FeatureTable(values, labels, spec, columns), 'tree')


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a model file for a `FeatureConfig`."""

    def write(name, config):
        path = tmp_path / 'models' / f'{name}.npz'
        path.parent.mkdir(exist_ok=True)
        write_model(path, train_model(name, config))
        return path

    return write


def planned(fingers=None, params=None, **options):
    file = ParameterFile(params)
    names = [''] if fingers is None else find_fingers(fingers, file)
    return {node.path: node.parameters for node in hand_graph(names, file, **options)}


def test_models_with_different_features_share_a_finger(write, tmp_path):
    folder = write('texture_flexion', SPATIAL).parent
    write('texture_abduction', FeatureConfig(texture_samples=30, early_windows=True))
    write('stiffness_flexion', FeatureConfig(stiffness_settle_s=0.75))
    for contact in ({}, {'contact': 'flexion'}):
        nodes = planned(models=str(folder), **contact)
        told = {'models': str(folder), **contact}
        assert nodes['tactile_features'] == nodes['tactile_classifier'] == told


def test_the_rate_of_a_sensor_on_a_topic_is_measured_whatever_models_need(write):
    folder = write('texture_flexion', SPATIAL).parent
    nodes = planned(models=str(folder), sensor_topic='/f')
    assert nodes['tendon_sensor']['rate_hz'] == 0.0


def test_a_finger_may_have_other_models_than_its_neighbour(write, tmp_path):
    paths = {
        'index': write('texture_flexion', SPATIAL),
        'thumb': write('texture_abduction', FeatureConfig(texture_samples=60, early_windows=True)),
    }
    hand = tmp_path / 'hand.yaml'
    hand.write_text(
        'index: {tactile_features: {ros__parameters: {models: models/texture_flexion.npz}}}\n'
        'thumb: {tactile_classifier: {ros__parameters: {models: models/texture_abduction.npz}}}\n'
    )
    nodes = planned('', hand)
    for name, path in paths.items():
        for node in ('tactile_features', 'tactile_classifier'):
            assert nodes[f'{name}/{node}'] == {'models': str(path)}


def test_a_file_that_is_no_model_does_not_keep_the_others_from_starting(write, tmp_path):
    folder = write('texture_flexion', FeatureConfig()).parent
    (folder / 'stiffness_flexion.npz').write_bytes(b'no')
    assert 'tactile_classifier' in planned(models=str(folder))
    (folder / 'texture_flexion.npz').unlink()
    with pytest.raises(ModelFileError, match=r'stiffness_flexion\.npz'):
        planned(models=str(folder))
