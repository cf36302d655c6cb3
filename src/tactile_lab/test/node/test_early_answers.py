# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Early predictions by models of short windows: their delay, and an equal replay."""

from collections import Counter
import dataclasses

from domain_coordinator import domain_id
import numpy as np
import pytest

from tactile_analysis.datasets.feature_options import FeatureOptions
from tactile_analysis.datasets.feature_tables import read_tables
from tactile_bags import TactileBag
from tactile_bags.message_records import read_records
from tactile_bags.recorded_setup import recorded_features, recorded_models
from tactile_bags.replay import recorded_results
from tactile_bringup.launch_config.graph import Ports
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_classifier.types import PredictionOutcome
from tactile_lab.commands.replay import replay_and_compare
from tactile_lab.experiment.live_rig import LiveSetup, run_live_trials
from tactile_lab.output import Output
from tactile_ros.errors import TactileError
from tactile_ros.topics import CLASSIFICATION, STRAIN
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.simulated_rigs import GUARD, home_fast, PATIENT

QUICK = {
    'trial_runner': {'approach_speed_m_s': 0.1, **PATIENT},
    'tendon_actuator': GUARD,
}
"""Parameters that shorten the phases that do not matter in this test."""


HALF_SECOND = 30  # samples
LATEST_S = 0.03
"""Longest time from the last sample of an early window to its prediction [s]."""


@pytest.fixture
def models(simulate_bag, tmp_path):
    """Return a folder of models with different window lengths; the shortest is 0.5 s.

    The model of 0.5 s is for any contact.
    """
    bag = simulate_bag('texture', 'flexion', 3, seed=5)
    folder = tmp_path / 'models'
    folder.mkdir()
    (early,) = read_tables([bag], options=FeatureOptions(window_s=0.5)).values()
    (spatial,) = read_tables([bag], {'texture_features': 'texture_spatial'}).values()
    (full,) = read_tables([bag]).values()
    contacts = np.where(np.arange(len(early)) % 2, 'flexion', 'abduction')
    mixed = dataclasses.replace(early, columns={**early.columns, 'contact': contacts})
    write_model(folder / 'early.npz', train(mixed, 'knn'))
    write_model(folder / 'full.npz', train(full, 'knn'))
    write_model(folder / 'spatial.npz', train(spatial, 'tree'))
    (folder / 'no model.npz').write_text('no')
    return folder


def glide(bag, models, trials):
    """Run and record live trials, and return them."""
    with SimulatedRig(seed=3) as rig, domain_id() as domain:
        home_fast(rig)
        setup = LiveSetup(
            Ports(*rig.ports),
            models=models,
            parameters=QUICK,
            simulated_rig=rig,
            domain_id=int(domain),
        )
        requests = [TrialRequest('texture', 'flexion', 'R1', f'glide {n}') for n in range(trials)]
        return run_live_trials(setup, bag, requests, Output(as_json=True))


def find_delays_s(recording, digests):
    """Return the delays of early predictions [s].

    A delay is the time from the last sample of the window to the recording of the prediction.
    """
    samples = {}
    for message, block in read_records(recording.messages(STRAIN)):
        for n in range(len(block.tension_n)):
            samples[block.stamp_ns + n * block.period_ns] = message.received_at_ns
    early = {
        info.model_id
        for info in recorded_models(recording)
        if info.specification_digest in digests
    }
    return [
        (message.received_at_ns - samples[answer.window_end_ns]) / 1e9
        for message, answer in read_records(recording.messages(CLASSIFICATION))
        if answer.model_id in early and answer.outcome != PredictionOutcome.NO_FEATURES
    ]


def test_model_of_half_a_second_classifies_during_the_glide(models, tmp_path):
    """Takes almost 30 s: three complete glides, of which the delays are measured."""
    bag = tmp_path / 'bag'
    trials = glide(bag, models, 3)
    for trial in trials:
        assert len({answer.model_id for answer in trial.answers}) == 3
        # The labels are not checked: 5 % may be unknown.
        assert all(answer.scores for answer in trial.answers)
    with TactileBag(bag) as recording:
        wanted = {spec.digest: spec for spec in recorded_features(recording).wanted}
        results = recorded_results(recording)
        early = {digest for digest, spec in wanted.items() if spec.is_early}
        delays_s = find_delays_s(recording, early)
    assert {(s.feature_set, s.sample_count, s.is_early) for s in wanted.values() if s.task} >= {
        ('texture_spectrum', HALF_SECOND, True),
        ('texture_spectrum', 180, False),
        ('texture_spatial', 0, False),
    }
    # Only the shortest delay is tested, because a busy computer may delay any process.
    assert len(delays_s) >= 3
    assert min(delays_s) <= LATEST_S, delays_s
    last = results.windows[-1].trial_id
    counts = Counter(w.specification_digest for w in results.windows if w.trial_id == last)
    assert {counts[digest] for digest in early} == {1}
    assert sum(counts.values()) == 3
    (report,) = replay_and_compare(bag, None, through_nodes=True)
    assert report.is_equal, report.comparisons
    counts = {c.classification_count for c in report.comparisons.values()}
    assert counts == {len(results.classifications)}
    # By default, training uses the full windows.
    tables = read_tables([bag])
    assert {t.spec.feature_set for t in tables.values()} == {'texture_spectrum', 'texture_spatial'}
    assert not any(table.spec.is_early for table in tables.values())
    (models / 'early.npz').rename(models / 'elsewhere.npz')
    with pytest.raises(TactileError, match=r'is not at .*early\.npz; state --models'):
        replay_and_compare(bag, None, through_nodes=False)
