# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers while the finger glides, of several models: from their files alone, replayed equal."""

from collections import Counter
import dataclasses

from domain_coordinator import domain_id
import numpy as np
import pytest

pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')

from tactile_bags import TactileBag
from tactile_bags.recorded_setup import recorded_features, recorded_models
from tactile_bags.replay import recorded_results
from tactile_bringup.launch_config.graph import Ports
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_lab.commands.replay import replay_and_compare
from tactile_lab.datasets.feature_tables import open_features, read_tables
from tactile_lab.experiment.live_rig import LiveSetup, run_live_trials
from tactile_lab.output import Output
from tactile_ros.errors import TactileError
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.simulated_rigs import home_fast

QUICK = {'trial_runner': {'approach_speed_m_s': 0.1}}
"""Shortens what no test here looks at."""


@pytest.fixture(scope='module')
def bag(simulate_bag):
    return simulate_bag('texture', 'flexion', 3, seed=5)


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=3) as rig:
        home_fast(rig)
        yield rig


@pytest.fixture
def model(bag, tmp_path):
    """Return a file of any name: it says itself what it is for, and what it wants.

    It is for any contact.
    """
    path = tmp_path / 'partial.onnx'
    with open_features([bag]) as features:
        (table,) = features.tables().tables.values()
        partial = features.partial_tables(table, [0.5, 1.5])
    contacts = np.where(np.arange(len(table)) % 2, 'flexion', 'abduction')
    mixed = dataclasses.replace(table, columns={**table.columns, 'contact': contacts})
    write_model(path, train(mixed, 'knn', partial=partial))
    return path


def glide(rig, bag, models):
    """Record a live trial; return it."""
    with domain_id() as domain:
        setup = LiveSetup(
            Ports(*rig.ports),
            models=models,
            parameters=QUICK,
            simulated_rig=rig,
            domain_id=int(domain),
        )
        request = TrialRequest('texture', 'flexion', 'R1', 'glide')
        (trial,) = run_live_trials(setup, bag, [request], Output(as_json=True))
    return trial


def test_partial_answers_are_recorded_and_replayed_equal(rig, model, tmp_path):
    bag = tmp_path / 'bag'
    trial = glide(rig, bag, model)
    assert trial.answer.scores  # whatever it is: one window in twenty may be unknown
    with TactileBag(bag) as recording:
        (wanted,) = (f for f in recorded_features(recording).wanted if f.task == 'texture')
        assert wanted.partial_samples == (30, 90)
        (info,) = recorded_models(recording)
        assert info.specification_digest == wanted.spec.digest
        results = recorded_results(recording)
    last = results.windows[-1].trial_id  # on a busy computer there may be an attempt before it
    for found in (results.windows, results.classifications):
        counts = Counter(item.partial for item in found if item.trial_id == last)
        assert counts == {True: 2, False: 1}
    (report,) = replay_and_compare(bag, None, through_nodes=True)
    assert report.is_equal, report.comparisons
    compared = report.comparisons['recorded and plain core']
    assert compared.classification_count == len(results.classifications)
    model.rename(model.with_name('elsewhere.onnx'))
    with pytest.raises(TactileError, match=r'is not at .*partial\.onnx; name it: --models'):
        replay_and_compare(bag, None, through_nodes=False)


def test_models_with_different_features_share_a_finger(rig, bag, model, tmp_path):
    (spatial,) = read_tables([bag], {'texture_features': 'texture_spatial'}).tables.values()
    folder = tmp_path / 'models'
    folder.mkdir()
    model.rename(folder / model.name)
    write_model(folder / 'spatial.onnx', train(spatial, 'tree'))
    (folder / 'no model.onnx').write_text('no')
    recorded = tmp_path / 'bag'
    trial = glide(rig, recorded, folder)
    assert len({answer.model_id for answer in trial.answers}) == 2
    assert all(answer.scores for answer in trial.answers)
    with TactileBag(recorded) as recording:
        specs = {f.spec.digest: f.spec for f in recorded_features(recording).wanted}
        infos = recorded_models(recording)
        results = recorded_results(recording)
    sets = {specs[info.specification_digest].feature_set for info in infos}
    assert sets == {'texture_spectrum', 'texture_spatial'}
    last = results.windows[-1].trial_id
    full = [w for w in results.windows if not w.partial and w.trial_id == last]
    assert len({window.specification_digest for window in full}) == len(full) == 2
    (report,) = replay_and_compare(recorded, None, through_nodes=True)
    assert report.is_equal, report.comparisons
    counts = {c.classification_count for c in report.comparisons.values()}
    assert counts == {len(results.classifications)}
    # Two of partial windows.
    assert sum(answer.trial_id == last for answer in results.classifications) == 4
    tables = read_tables([recorded]).tables
    assert {table.spec.feature_set for table in tables.values()} == sets
    assert [key[:2] for key in tables] == [('texture', 'flexion')] * 2
