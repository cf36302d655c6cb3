# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import json

import joblib
import numpy as np
import pytest
from tactile_command import tactile

from tactile_analysis.datasets.feature_tables import compute_tables, open_trials, read_tables
from tactile_bags import TactileBag
from tactile_bags.errors import BagError
from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_features.config import FeatureConfig
from tactile_features.conversions import event_from_msg, strain_block_from_msg
from tactile_lab.simulation import simulated_bags, simulated_trials
from tactile_lab.simulation.simulated_bags import write_simulated_bag
from tactile_lab.simulation.simulated_trials import plan_trial, SimulationPlan
from tactile_ros.topics import EVENT, STRAIN
from tactile_sim.physics.trials import SimulatedTrials

CONFIG = TrialConfig()
RATE_HZ = 60


def write(folder, plan, **options):
    return write_simulated_bag(folder, plan, CONFIG, FeatureConfig(), **options)


def digest(bag_path):
    with TactileBag(bag_path) as bag:
        return bag.sha256()


def read_events(bag_path):
    """Return the events of each trial, in the order of the bag."""
    trials = {}
    with TactileBag(bag_path) as bag:
        for message in bag.messages(EVENT):
            event = event_from_msg(message.decode())
            trials.setdefault(event.trial_id, []).append(event)
    return trials


def read_blocks(bag_path):
    with TactileBag(bag_path) as bag:
        return [strain_block_from_msg(message.decode()) for message in bag.messages(STRAIN)]


class FakeSimulator:
    """Replaces the physics by an increasing tension, and by failures that a test sets."""

    def __init__(self):
        self.failures = {}  # label and number of a trial: time at which the simulation fails [s]
        self.finished = 0

    def simulate(self, protocol, label, contact, timeline, count, seed, *, first, **more):
        times_s = np.arange(round(timeline.duration_s * RATE_HZ) + 1) / RATE_HZ
        failed_at_s = [self.failures.get((label, first + i), np.nan) for i in range(count)]
        self.finished += count
        return SimulatedTrials(
            tension_n=np.tile(times_s, (count, 1)),
            sample_times_s=times_s,
            truth={},
            failed_at_s=np.array(failed_at_s),
        )


@pytest.fixture
def simulator(monkeypatch):
    simulator = FakeSimulator()
    monkeypatch.setattr(simulated_trials, 'simulate_trials', simulator.simulate)
    return simulator


def run_simulate(folder, *options, task='stiffness'):
    """Run `tactile simulate` for two trials of each label in one session."""
    usual = {'--contact': 'flexion', '--trials': 2, '--sessions': 1, '--seed': 7, '--jobs': 1}
    stated = {k: v for k, v in usual.items() if k not in options}
    return tactile('simulate', task, '-o', folder, *sum(stated.items(), ()), *options)


def test_samples_have_no_gaps_and_events_are_ordered_and_marked_as_simulated(stiffness_bag):
    blocks = read_blocks(stiffness_bag)
    expected = 0
    for block in blocks:
        assert block.sequence == expected
        expected += len(block.tension_n)
        assert abs(block.stamp_ns - blocks[0].stamp_ns - block.sequence * 1e9 / RATE_HZ) < 2
    with TactileBag(stiffness_bag) as bag:
        assert bag.metadata['simulated'] is True
    trials = read_events(stiffness_bag)
    assert len(trials) == 15
    for events in trials.values():
        assert all(event.simulated for event in events)
        assert [e.phase for e in events] == ['approach', 'contact', 'hold', 'release', 'done']
        hold, release = events[2], events[3]
        assert release.stamp_ns - hold.stamp_ns == 4_000_000_000


def test_bytes_depend_on_the_seed_and_not_on_the_number_of_processes(stiffness_bag, tmp_path):
    plan = SimulationPlan('stiffness', 'flexion', 3, 7)
    again, parallel = (write(tmp_path / str(jobs), plan, jobs=jobs).path for jobs in (1, 2))
    other = write(tmp_path, dataclasses.replace(plan, seed=8)).path
    assert digest(stiffness_bag) == digest(again) == digest(parallel) != digest(other)
    metadata = (stiffness_bag / 'metadata.yaml').read_bytes()
    assert (parallel / 'metadata.yaml').read_bytes() == metadata


def test_order_of_trials_is_session_number_label_for_any_chunk_size(
    simulator, tmp_path, monkeypatch
):
    plan = SimulationPlan('stiffness', 'flexion', 5, 7, sessions=2)
    whole = write(tmp_path / 'whole', plan)
    monkeypatch.setattr(simulated_bags, 'CHUNK_TRIALS', 2)
    monkeypatch.setattr(simulated_bags, 'ROUND_TRIALS', 1)
    cut = write(tmp_path / 'cut', plan)
    assert digest(cut.path) == digest(whole.path)
    trials = read_events(whole.path)
    labels = [events[0].object_label for events in trials.values()][:5]
    assert len(set(labels)) == 5
    assert list(trials) == [
        f'stiffness_flexion-7-{session}-{label}-{number:04d}'
        for session in range(2)
        for number in range(5)
        for label in labels
    ]
    sessions = [events[0].session_id for events in trials.values()]
    assert sessions == ['simulated-7-0'] * 25 + ['simulated-7-1'] * 25
    assert len({events[0].mounting_id for events in trials.values()}) == 50


def test_number_of_trials_that_wait_to_be_written_is_limited(simulator, tmp_path, monkeypatch):
    monkeypatch.setattr(simulated_bags, 'CHUNK_TRIALS', 2)
    monkeypatch.setattr(simulated_bags, 'ROUND_TRIALS', 20)
    written, waiting = 0, []

    def count(trials):
        nonlocal written
        waiting.append(simulator.finished - written)
        written += trials

    with joblib.parallel_config(backend='threading'):
        bag = write(
            tmp_path, SimulationPlan('stiffness', 'flexion', 40, 7), jobs=2, on_trials=count
        )
    assert bag.trials == written == 200
    assert max(waiting) <= 20


def test_trial_without_equilibrium_is_aborted_and_its_remaining_samples_are_omitted(
    simulator, tmp_path
):
    simulator.failures = {('sponge', 1): 2.0, ('pla', 0): 0.1}
    bag = write(tmp_path, SimulationPlan('stiffness', 'flexion', 2, 7))
    pla, sponge = 'stiffness_flexion-7-0-pla-0000', 'stiffness_flexion-7-0-sponge-0001'
    assert dict(bag.aborted) == {pla: 0.1, sponge: 2.0}
    trials = read_events(bag.path)
    assert [event.phase for event in trials[pla]] == ['aborted']
    assert [event.phase for event in trials[sponge]] == ['approach', 'contact', 'hold', 'aborted']
    assert trials[sponge][-1].message == 'the simulation found no equilibrium at 2.000 s'
    blocks = read_blocks(bag.path)
    last = max(i for i, b in enumerate(blocks) if b.stamp_ns < trials[sponge][-1].stamp_ns)
    # The tension of the fake simulator is the time of the sample.
    assert 1.95 < blocks[last].tension_n[-1] < 2.0
    gap = blocks[last + 1].sequence - blocks[last].sequence - len(blocks[last].tension_n)
    assert blocks[last + 1].lost_before == gap > 0
    assert sum(block.lost_before > 0 for block in blocks) == 2


def test_trial_aborted_in_or_after_its_hold_has_no_features(simulator, tmp_path):
    simulator.failures = {('sponge', 1): 2.0, ('pla', 0): 5.2}
    bag = write(tmp_path, SimulationPlan('stiffness', 'flexion', 2, 7))
    events = read_events(bag.path)
    assert events['stiffness_flexion-7-0-sponge-0001'][-2].phase == 'hold'
    assert events['stiffness_flexion-7-0-pla-0000'][-2].phase == 'release'
    with open_trials([bag.path]) as trials:
        tables, left_out = compute_tables(trials)
    assert len(tables['stiffness', 'flexion']) == 8
    for sentence, name in zip(left_out, ('pla-0000', 'sponge-0001'), strict=True):
        assert f'{name}: the trial was aborted' in sentence
        assert 'no equilibrium at' in sentence


def test_simulate_lists_aborted_trials_and_exits_with_3(simulator, tmp_path):
    simulator.failures = {('sponge', 1): 2.0}
    both = ('--contact', 'flexion', '--contact', 'abduction')
    told = run_simulate(tmp_path, *both, '--json')
    assert told.returncode == 3
    assert '1 of 10 trials ABORTED' in told.stderr
    bags = json.loads(told.stdout)['bags']
    assert bags[0]['aborted'] == {'stiffness_flexion-7-0-sponge-0001': 2.0}
    assert bags[1]['aborted'] == {'stiffness_abduction-7-0-sponge-0001': 2.0}


def test_as_published_has_one_mounting_per_object_and_crossed_one_per_trial(simulator, tmp_path):
    def simulate_design(design):
        folder = tmp_path / design
        assert run_simulate(folder, '--trials', 3, '--design', design).returncode == 0
        (table,) = read_tables([folder / 'stiffness_flexion']).values()
        return table

    table = simulate_design('as-published')
    mountings = table.columns['mounting_id']
    assert sorted(set(zip(table.labels, mountings, strict=True))) == [
        (label, f'simulated-7-0-flexion-{label}-0') for label in sorted(set(table.labels))
    ]
    assert len(set(simulate_design('crossed').columns['mounting_id'])) == 15
    refused = run_simulate(tmp_path / 'two', '--design', 'as-published', '--sessions', 2)
    assert (refused.returncode, '--sessions is 2' in refused.stderr) == (2, True)


@pytest.mark.parametrize(
    ('options', 'sessions', 'trials'),
    [
        ((), 6, 10),
        (('--sessions', 4), 4, 15),
        (('--sessions', 100), 100, 1),
        (('--trials', 1), 6, 1),
        (('--design', 'as-published'), 1, 60),
    ],
)
def test_by_default_sixty_trials_come_from_six_sessions(
    simulator, tmp_path, options, sessions, trials
):
    done = tactile('simulate', 'stiffness', '-o', tmp_path, '--jobs', 1, '--json', *options)
    assert done.returncode == 0
    for bag in json.loads(done.stdout)['bags']:
        assert (bag['sessions'], bag['trials_per_label_and_session']) == (sessions, trials)


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (('--jobs', 0), '--jobs is 0'),
        (('-o', 'taken'), 'exists already'),
    ],
)
def test_simulate_refuses_invalid_options_with_a_sentence(simulator, tmp_path, options, sentence):
    folder = tmp_path / ('taken' if '-o' in options else 'free')
    (tmp_path / 'taken' / 'stiffness_flexion').mkdir(parents=True)
    told = run_simulate(folder, *(() if '-o' in options else options))
    assert told.returncode == 2
    assert sentence in told.stderr
    assert simulator.finished == 0


def test_unfinished_bag_is_removed_and_an_existing_bag_is_kept(simulator, tmp_path, stiffness_bag):
    def interrupt(_):
        raise KeyboardInterrupt

    plan = SimulationPlan('stiffness', 'flexion', 1, 7)
    with pytest.raises(KeyboardInterrupt):
        write(tmp_path, plan, on_trials=interrupt)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(BagError, match='exist'):
        write(stiffness_bag.parent, plan)
    assert len(read_events(stiffness_bag)) == 15


def test_plan_keeps_the_glide_speed():
    planned = plan_trial(CONFIG, TrialRequest('texture', 'flexion'))
    phases = dict(planned.phases)
    glide_s = phases['release'] - phases['glide']
    ramps_s = CONFIG.glide_speed_m_s / 0.5
    assert glide_s == pytest.approx(CONFIG.glide_length_m / CONFIG.glide_speed_m_s + ramps_s)


def test_trials_differ_between_contacts_sessions_and_labels_for_one_seed(tmp_path):
    bags = [
        write(tmp_path, SimulationPlan('stiffness', contact, 1, 1, sessions=2)).path
        for contact in ('flexion', 'abduction')
    ]
    blocks = [read_blocks(bag) for bag in bags]
    each = len(blocks[0]) // 10
    noise = {bag_blocks[i * each].tension_n.tobytes() for bag_blocks in blocks for i in range(10)}
    assert len(noise) == 20
