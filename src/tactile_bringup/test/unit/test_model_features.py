# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A model says which features it wants; the feature node, classifiers and recorder are told."""

import json

import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_bringup.launch_config.graph import sensing_graph
from tactile_bringup.launch_config.launch_plans import plan_launch
from tactile_bringup.launch_config.model_folder import find_models, wanted_features
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError
from tactile_classifier.records import ClassifierConfig
from tactile_classifier.tactile_classifier_node import load_fitting_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.spec import spec_for
from tactile_ros.errors import TactileError

SPATIAL = FeatureConfig(
    rate_hz=100.0,
    texture_features='texture_spatial',
    spatial_crop_m=0.003,
    spatial_length_m=0.03,
    spatial_finest_m=0.001,
)


@pytest.fixture
def write(tmp_path):
    """Return a writer of models for windows cut by a config; the features mean nothing."""

    def write(name, config, partial=()):
        task, _, contact = name.partition('_')
        labels = np.repeat(['a', 'b'], 24)
        spec = spec_for(task, config)
        values = np.random.default_rng(5).normal(size=(48, len(spec.names)))
        values[:24] += 5.0
        columns = {'contact': np.full(48, contact)} if contact else {}
        table = FeatureTable(values, labels, spec, columns)
        path = tmp_path / 'models' / f'{name}.onnx'
        path.parent.mkdir(exist_ok=True)
        write_model(path, train(table, 'tree', partial=dict.fromkeys(partial, table)))
        return path

    return write


def by_name(nodes):
    return {node.name: node.parameters for node in nodes}


def test_the_model_alone_is_enough(write, tmp_path):
    """Spatial features at another rate: node, classifier and recording are told of it."""
    path = write('texture_flexion', SPATIAL)
    values = {'model': str(path), 'record': str(tmp_path / 'bag'), 'namespace': 'index'}
    for name in ('sense', 'texture'):
        nodes = by_name(plan_launch(name, values, tmp_path).nodes)
        metadata = json.loads(nodes['bag_recorder']['metadata'])
        for config in (
            FeatureConfig(**nodes['tactile_features']),
            FeatureConfig(**metadata['feature_config']),
        ):
            assert config == SPATIAL
        load_fitting_model(ClassifierConfig(**nodes['texture_flexion_classifier']))


def test_partial_windows_are_those_of_any_model(write, tmp_path):
    usual = FeatureConfig()
    write('texture_flexion', usual, (30, 90))
    write('texture_abduction', usual, (60, 90))
    write('stiffness_flexion', FeatureConfig(stiffness_settle_s=0.75))
    nodes = by_name(sensing_graph('', find_models(tmp_path / 'models'), {}))
    features = nodes['tactile_features']
    assert features['partial_samples'] == (30, 60, 90)
    assert features['stiffness_settle_s'] == 0.75
    FeatureConfig(**features)
    del nodes['tactile_features'], nodes['tendon_sensor']
    assert len(nodes) == 3
    for parameters in nodes.values():
        load_fitting_model(ClassifierConfig(**parameters))


def test_what_the_user_states_wins_and_the_classifier_refuses(write):
    models = find_models(write('texture_flexion', FeatureConfig(), (30, 120)))
    stated = {'texture_samples': 90}
    assert wanted_features(models, stated) == {}, 'partial windows would be longer than whole ones'
    nodes = by_name(sensing_graph('', models, {'tactile_features': stated}))
    with pytest.raises(ModelFileError, match='window in samples differs'):
        load_fitting_model(ClassifierConfig(**nodes['texture_flexion_classifier']))
    assert 'partial_samples' not in wanted_features(models, {'partial_samples': ()})
    assert wanted_features(models, {'rate_hz': 60})['partial_samples'] == (30, 120)


@pytest.mark.parametrize(
    ('other', 'name'), [(SPATIAL, 'rate_hz'), (FeatureConfig(texture_samples=90), 'texture_samp')]
)
def test_models_that_cannot_share_a_node_are_refused_by_name(write, tmp_path, other, name):
    one, two = write('texture_flexion', FeatureConfig()), write('texture_abduction', other)
    with pytest.raises(TactileError, match=f'cannot share a feature node: {name}') as refusal:
        plan_launch('sense', {'model': str(one.parent)}, tmp_path)
    assert str(one) in str(refusal.value)
    assert str(two) in str(refusal.value)
    plan_launch('texture', {'model': str(one.parent)}, tmp_path)  # takes the one for flexion


def test_a_finger_may_want_other_features_than_its_neighbour(write, tmp_path):
    write('texture_flexion', SPATIAL)
    write('texture_abduction', FeatureConfig(), (60,))
    hand = tmp_path / 'hand.yaml'
    hand.write_text(
        'fingers:\n  index: {model: models/texture_flexion.onnx}\n'
        '  thumb: {model: models/texture_abduction.onnx}\n'
    )
    nodes = {n.path: n for n in plan_launch('hand', {'hand_file': str(hand)}, tmp_path).nodes}
    index, thumb = (nodes[f'{name}/tactile_features'].parameters for name in ('index', 'thumb'))
    assert index['texture_features'] == 'texture_spatial'
    assert thumb['texture_features'] == 'texture_spectrum'
    assert thumb['partial_samples'] == (60,)
    assert 'partial_samples' not in index


def test_a_file_that_is_no_model_is_refused_before_anything_starts(write, tmp_path):
    write('texture_flexion', FeatureConfig())
    (tmp_path / 'models' / 'stiffness_flexion.onnx').write_bytes(b'no')
    with pytest.raises(ModelFileError, match=r'stiffness_flexion\.onnx is refused'):
        plan_launch('sense', {'model': str(tmp_path / 'models')}, tmp_path)
