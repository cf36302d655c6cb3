# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers while the finger glides, of several models: from their files alone, replayed equal."""

from collections import Counter
import dataclasses

from domain_coordinator import domain_id
import numpy as np
import pytest

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
from tactile_testing.simulated_rigs import GUARD, home_fast, PATIENT

QUICK = {
    'trial_runner': {'approach_speed_m_s': 0.1, **PATIENT},
    'tendon_actuator': GUARD,
}
"""Shortens what no test here looks at."""


@pytest.fixture
def models(simulate_bag, tmp_path):
    """Return a folder of models with different features, of which one answers early.

    A file says itself what it is for, and what it wants; this one is for any contact.
    """
    bag = simulate_bag('texture', 'flexion', 3, seed=5)
    folder = tmp_path / 'models'
    folder.mkdir()
    with open_features([bag]) as features:
        (table,) = features.tables().tables.values()
        partial = features.partial_tables(table, [0.5, 1.5])
        (spatial,) = features.tables({'texture_features': 'texture_spatial'}).tables.values()
    contacts = np.where(np.arange(len(table)) % 2, 'flexion', 'abduction')
    mixed = dataclasses.replace(table, columns={**table.columns, 'contact': contacts})
    write_model(folder / 'partial.npz', train(mixed, 'knn', partial=partial))
    write_model(folder / 'spatial.npz', train(spatial, 'tree'))
    (folder / 'no model.npz').write_text('no')
    return folder


def glide(bag, models):
    """Record a live trial; return it."""
    with SimulatedRig(seed=3) as rig, domain_id() as domain:
        home_fast(rig)
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


def test_models_that_want_different_features_answer_while_it_glides(models, tmp_path):
    bag = tmp_path / 'bag'
    trial = glide(bag, models)
    assert len({answer.model_id for answer in trial.answers}) == 2
    assert all(answer.scores for answer in trial.answers)  # one in twenty may be unknown
    with TactileBag(bag) as recording:
        wanted = {f.spec.digest: f for f in recorded_features(recording).wanted}
        infos = recorded_models(recording)
        results = recorded_results(recording)
    asked = [wanted[info.specification_digest] for info in infos]
    parts = {each.spec.feature_set: each.partial_samples for each in asked}
    assert parts == {'texture_spectrum': (30, 90), 'texture_spatial': ()}
    last = results.windows[-1].trial_id  # on a busy computer there may be an attempt before it
    for found in (results.windows, results.classifications):
        counts = Counter(item.partial for item in found if item.trial_id == last)
        assert counts == {True: 2, False: 2}
    full = [w for w in results.windows if not w.partial and w.trial_id == last]
    assert len({window.specification_digest for window in full}) == 2
    (report,) = replay_and_compare(bag, None, through_nodes=True)
    assert report.is_equal, report.comparisons
    counts = {c.classification_count for c in report.comparisons.values()}
    assert counts == {len(results.classifications)}
    tables = read_tables([bag]).tables
    assert {table.spec.feature_set for table in tables.values()} == set(parts)
    assert [key[:2] for key in tables] == [('texture', 'flexion')] * 2
    (models / 'partial.npz').rename(models / 'elsewhere.npz')
    with pytest.raises(TactileError, match=r'is not at .*partial\.npz; name it: --models'):
        replay_and_compare(bag, None, through_nodes=False)
