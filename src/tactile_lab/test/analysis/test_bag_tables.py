# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from tactile_analysis.datasets.bag_features import number_blocks
from tactile_analysis.datasets.feature_tables import compute_tables, open_trials, read_tables
from tactile_bags import BagWriter, TactileBag
from tactile_bags.errors import BagError
from tactile_lab.simulation.simulated_trials import SAMPLES_PER_BLOCK
from tactile_ros.topics import EVENT, EVENT_TOPIC, RecordedTopic, STRAIN, STRAIN_TOPIC


def compute(bags):
    with open_trials(bags) as trials:
        return compute_tables(trials)


@pytest.fixture
def rewritten(rewrite, stiffness_bag, tmp_path):
    """Return a function that changes the events of a bag and computes its feature tables."""

    def read(change):
        def change_event(type_name, message):
            if type_name == EVENT:
                change(message)
            return message

        return compute([rewrite(stiffness_bag, tmp_path / 'changed', change_event)])

    return read


@pytest.fixture(scope='module')
def usual(stiffness_bag):
    return compute([stiffness_bag])


def test_table_has_one_row_a_trial_with_its_label_and_place(usual, stiffness_bag):
    assert usual[1] == ()
    (table,) = usual[0].values()
    assert list(usual[0]) == [('stiffness', 'flexion')]
    assert table.values.shape == (15, 3)
    labels, counts = np.unique(table.labels, return_counts=True)
    assert labels.tolist() == ['none', 'pla', 'rubber_shell', 'solid_rubber', 'sponge']
    assert set(counts) == {3}
    assert table.column('simulated').all()
    assert len(set(table.column('trial_id'))) == 15
    assert set(table.column('bag')) == {str(stiffness_bag)}
    assert (table.column('window_end_ns') - table.column('window_start_ns') > 3e9).all()
    assert (np.diff(np.sort(table.column('window_start_ns'))) > 4e9).all()


def test_trials_with_missing_samples_or_without_a_label_are_excluded_and_reported(
    rewrite, stiffness_bag, tmp_path
):
    def lose(type_name, message):
        # The lost block is in the hold phase of the first trial.
        if type_name == STRAIN and message.sequence == 2 * SAMPLES_PER_BLOCK:
            return None
        if type_name == EVENT and message.object_label == 'sponge':
            message.object_label = ''
        return message

    found = compute([rewrite(stiffness_bag, tmp_path / 'lossy', lose)])
    (table,) = found[0].values()
    assert len(table) == 15 - 1 - 3
    lost = [each for each in found[1] if f'{SAMPLES_PER_BLOCK} samples are missing' in each]
    assert len(lost) == 1
    assert sum('no label' in each for each in found[1]) == 3
    # Only the refused trial that has a label is counted.
    assert found[0]['stiffness', 'flexion'].refused == 1


def rename_protocols(event):
    event.protocol = {'pla': 'texture', 'sponge': ''}.get(event.object_label, event.protocol)


def forget_names(event):
    event.trial_id = 'trial'


@pytest.mark.parametrize('change', [rename_protocols, forget_names])
def test_windows_go_by_their_features_and_their_moment_whatever_they_are_called(
    rewritten, usual, change
):
    found = rewritten(change)[0]
    assert list(found) == [('stiffness', 'flexion')]
    expected = usual[0]['stiffness', 'flexion']
    assert found['stiffness', 'flexion'].compute_sha256() == expected.compute_sha256()


def test_bag_without_labelled_trials_is_refused_with_the_reason(rewritten):
    def forget_label(event):
        event.object_label = ''

    with pytest.raises(BagError, match='no labelled trial'):
        rewritten(forget_label)


def test_bags_with_different_feature_parameters_are_not_mixed(stiffness_bag, tmp_path):
    with TactileBag(stiffness_bag) as bag:
        facts = {**bag.metadata, 'feature_config': {'stiffness_settle_s': 1.0}}
        with BagWriter(tmp_path / 'other', facts) as writer:
            for name, (type_name, _) in bag.topics.items():
                writer.add_topic(RecordedTopic(name.strip('/'), type_name))
            for message in (next(bag.messages(EVENT)), next(bag.messages(STRAIN))):
                writer.write_raw(message.topic, message.received_at_ns, message.data)
    with pytest.raises(BagError, match='other feature parameters'):
        read_tables([stiffness_bag, tmp_path / 'other'])


def test_trial_blocks_divide_the_trials_of_each_label_in_order_of_time():
    labels = np.array(['a', 'b'] * 12)
    sessions = np.repeat(['s', 't'], 12)
    starts_ns = np.arange(24)[::-1]  # the table need not be ordered by time
    blocks = number_blocks(starts_ns, sessions, labels)
    of_a = blocks[(labels == 'a') & (sessions == 's')]
    assert of_a.tolist() == [5, 4, 3, 2, 1, 0]
    assert number_blocks(starts_ns[:8], sessions[:8], labels[:8]).max() == 4


def test_detected_trials_are_detected_again_instead_of_read(stiffness_bag, tmp_path):
    """Phases are detected again in the samples, because the recorder can miss detected events."""
    config = {'phases': 'stiffness', 'detected_object_label': 'pla', 'detected_session_id': 's1'}
    path = tmp_path / 'detected'
    with TactileBag(stiffness_bag) as bag:
        facts = {**bag.metadata, 'feature_config': {**bag.metadata['feature_config'], **config}}
        with BagWriter(path, facts) as writer:
            writer.add_topic(STRAIN_TOPIC)
            writer.add_topic(EVENT_TOPIC)
            for message in (next(bag.messages(EVENT)), *bag.messages(STRAIN)):
                writer.write_raw(message.topic, message.received_at_ns, message.data)
    found = compute([path])
    (table,) = found[0].values()
    assert found[1] == ()
    assert len(set(table.column('trial_id'))) == len(table) == 15
    assert set(table.labels) == {'pla'}
    assert set(table.column('session_id')) == {'s1'}
