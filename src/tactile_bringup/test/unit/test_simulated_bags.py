# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from tactile_bringup.bags import EVENT, STRAIN, TactileBag
from tactile_bringup.errors import BagError
from tactile_bringup.records import TrialConfig
from tactile_bringup.simulated_bags import (
    SimulationPlan,
    paper_plans,
    plan_trial,
    simulate_label,
    write_simulated_bag,
)
from tactile_bringup.trial_protocols import TrialRequest
from tactile_features.conversions import event_from_msg, strain_block_from_msg
from tactile_features.records import FeatureConfig


def test_samples_follow_each_other_without_gap_through_all_trials(stiffness_bag):
    with TactileBag(stiffness_bag) as bag:
        blocks = [strain_block_from_msg(m.decode()) for m in bag.messages(STRAIN)]
    expected = 0
    for block in blocks:
        assert block.sequence == expected
        expected += len(block.tension_n)
    stamps = np.array([block.stamp_ns for block in blocks])
    assert np.all(np.abs(np.diff(stamps) - 12e9 / 60) < 2)


def test_every_event_is_marked_as_simulated_and_phases_are_in_order(stiffness_bag):
    trials = {}
    with TactileBag(stiffness_bag) as bag:
        assert bag.facts['simulated'] is True
        for message in bag.messages(EVENT):
            event = event_from_msg(message.decode())
            assert event.simulated
            trials.setdefault(event.trial_id, []).append(event)
    assert len(trials) == 15
    for events in trials.values():
        assert [e.phase for e in events] == ['approach', 'contact', 'hold', 'release', 'done']
        hold, release = events[2], events[3]
        assert release.stamp_ns - hold.stamp_ns == 4_000_000_000


def test_same_seed_same_bytes_other_seed_other_bytes(stiffness_bag, tmp_path):
    config = TrialConfig(simulated=True)

    def digest(name, seed):
        plan = SimulationPlan('stiffness', 'flexion', 3, seed)
        path = write_simulated_bag(tmp_path / name, plan, config, FeatureConfig())
        with TactileBag(path) as bag:
            return bag.sha256()

    with TactileBag(stiffness_bag) as bag:
        first = bag.sha256()
    assert digest('again', 7) == first
    assert digest('other', 8) != first


def test_existing_bag_is_kept(stiffness_bag):
    plan = SimulationPlan('stiffness', 'flexion', 1, 7)
    with pytest.raises(BagError, match='exist'):
        write_simulated_bag(
            stiffness_bag.parent, plan, TrialConfig(simulated=True), FeatureConfig()
        )


def test_plan_keeps_the_glide_speed():
    config = TrialConfig(simulated=True)
    planned = plan_trial(config, TrialRequest('texture', 'flexion'))
    phases = dict(planned.phases)
    glide_s = phases['release'] - phases['glide']
    ramps_s = config.glide_speed_m_s / 0.5
    assert glide_s == pytest.approx(config.glide_length_m / config.glide_speed_m_s + ramps_s)


def test_paper_plans_are_the_four_sets():
    plans = paper_plans(60, 1)
    assert {(p.protocol, p.contact) for p in plans} == {
        (p, c) for p in ('texture', 'stiffness') for c in ('flexion', 'abduction')
    }
    assert len(plans) == 4


def test_one_seed_makes_other_trials_for_each_contact_and_label():
    config = TrialConfig(simulated=True)
    noise = [
        simulate_label(SimulationPlan('stiffness', contact, 1, 1), label, config).tension_n[0, :12]
        for contact in ('flexion', 'abduction')
        for label in ('none', 'pla')
    ]
    assert len({values.tobytes() for values in noise}) == 4
