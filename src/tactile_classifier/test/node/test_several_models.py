# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Models with different features share a feature node and a classifier node."""

import dataclasses
import shutil

from diagnostic_msgs.msg import DiagnosticStatus
from finger_nodes import make_header, PERIOD_NS
import numpy as np
import pytest

from tactile_classifier.conversions import model_infos_from_msg
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features import (
    FeatureConfig,
    read_contracts,
    spec_for,
    TrialFeatureExtractor,
)
from tactile_features.conversions import event_from_msg, strain_block_from_msg
from tactile_msgs.msg import ModelInfos, StrainBlock, TrialEvent
from tactile_ros.qos import LATEST

TENSION_N = np.random.default_rng(0).normal(3.0, 0.1, 900)
SPECS = {
    'full': spec_for('texture', FeatureConfig()),
    'short': spec_for('texture', FeatureConfig(texture_samples=90, max_gap_samples=3)),
    'over_distance': spec_for('texture', FeatureConfig(texture_features='texture_spatial')),
    'hold': spec_for('stiffness', FeatureConfig()),
}


def make_table(spec, seed):
    rng = np.random.default_rng(seed)
    labels = np.repeat(['pla', 'wood', 'felt'], 8)
    scale = np.repeat([1.0, 1.5, 2.0], 8)[:, None]
    return FeatureTable(
        scale * np.abs(rng.normal(0.05, 0.02, (24, len(spec.names)))),
        labels,
        spec,
        {
            'contact': np.full(24, 'flexion'),
            'session_id': np.array([f's{i % 3}' for i in range(24)]),
        },
    )


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')
    folder = tmp_path_factory.mktemp('models')
    for seed, (name, spec) in enumerate(SPECS.items()):
        table = make_table(spec, seed)
        parts = {}
        if name == 'full':
            parts = {60: dataclasses.replace(table, values=1.1 * table.values)}
        write_model(folder / f'{name}.onnx', train(table, 'knn', partial=parts))
    return folder


def blocks():
    """The stream in blocks of one sample, of which one is lost in the first glide."""
    return [
        StrainBlock(
            header=make_header(n * PERIOD_NS / 1e9),
            sequence=n,
            period_ns=PERIOD_NS,
            tension_n=TENSION_N[n : n + 1].tolist(),
        )
        for n in range(len(TENSION_N))
        if n != 150
    ]


def events():
    return [
        TrialEvent(
            header=make_header(time_s),
            trial_id=trial_id,
            protocol='texture',
            contact='flexion',
            phase=phase,
            glide_speed_m_s=0.02,
        )
        for trial_id, time_s, phase in (
            ('t1', 1.0, 'glide'),
            ('t1', 6.0, 'done'),
            ('t2', 6.5, 'glide'),
            ('t2', 11.0, 'hold'),
            ('t2', 14.0, 'done'),
        )
    ]


def answer_alone(path):
    """The answers of one model behind an extractor that computes its features alone."""
    (contract,), _ = read_contracts(path)
    extractor = TrialFeatureExtractor(FeatureConfig(), [contract.wanted])
    windows = [w for event in events() for w in extractor.add_event(event_from_msg(event))]
    windows += [w for block in blocks() for w in extractor.add_block(strain_block_from_msg(block))]
    model = load_model(path)
    digest = contract.wanted.spec.digest
    return [model.classify_window(w) for w in windows if w.specification_digest == digest]


def test_each_answers_with_the_bits_that_it_gives_alone(make_finger, folder):
    finger = make_finger({'models': str(folder)}, models=str(folder))
    finger.bring_up()
    assert [spec.digest for spec in finger.features.extractor.specifications] == [
        SPECS[name].digest for name in ('full', 'hold', 'over_distance', 'short')
    ]
    for event in events():
        finger.events.publish(event)
    for block in blocks():
        finger.strain.publish(block)
    alone = {name: answer_alone(folder / f'{name}.onnx') for name in SPECS}
    full = [answer for answers in alone.values() for answer in answers if not answer.partial]
    part = [answer for answer in alone['full'] if answer.partial]
    assert len(full) == 7
    assert len(part) == 2
    finger.spin_until(lambda: len(finger.heard) == 7 and len(finger.heard_partial) == 2)
    answers = finger.answers
    for name in SPECS:
        model_id = alone[name][0].model_id
        assert [a for a in answers if a.model_id == model_id] == [
            a for a in alone[name] if not a.partial
        ]
    assert finger.partial_answers == part
    # The lost sample is refused by the one and filled by the other.
    (lost,) = [a for a in alone['full'] if a.trial_id == 't1' and not a.partial]
    assert 'max_gap_samples allows 0' in lost.reason
    assert 'missing' not in alone['short'][0].reason


def test_its_models_are_announced_and_a_broken_file_is_named(make_finger, folder, tmp_path, capfd):
    shutil.copy(folder / 'full.onnx', tmp_path / 'any name.onnx')
    (tmp_path / 'broken.onnx').write_bytes(b'hello')
    finger = make_finger({'models': str(tmp_path)}, models=str(tmp_path))
    finger.bring_up()
    infos = []
    finger.peer.create_subscription(ModelInfos, 'tactile_classifier/models', infos.append, LATEST)
    finger.spin_until(lambda: infos and finger.diagnostics)
    found = model_infos_from_msg(infos[-1])
    assert found.models == finger.answering.models.infos
    assert found.models[0].path == str(tmp_path / 'any name.onnx')
    (refused,) = found.refused
    assert f'model {tmp_path / "broken.onnx"} is refused' in refused
    assert refused in capfd.readouterr().err
    status = finger.diagnostics[-1]
    assert status.level == DiagnosticStatus.WARN
    assert refused in status.message
    assert status.hardware_id == found.models[0].model_id
