# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags with trial events as a `TrialSet`, corrected by the journal of their experiment."""

import json
import shutil

import numpy as np
import pytest
from tactile_command import ask_tactile

from tactile_analysis import TrialSet
from tactile_analysis.datasets.feature_tables import compute_tables, open_trials
from tactile_analysis.options import SourceError
from tactile_analysis.report.recordings import usual_splits
from tactile_analysis.report.summary import describe_sources
from tactile_bags import TactileBag
from tactile_bags.message_records import read_records
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import replay_phases
from tactile_classifier.datasets.splits import grouped_split
from tactile_ros.strain import StrainStatus
from tactile_ros.topics import EVENT, STRAIN
from tactile_testing.recordings import check_source


def test_bag_keeps_the_rules_of_a_source(stiffness_bag):
    check_source(lambda: TrialSet.load(stiffness_bag))


def test_trials_have_labels_events_and_signals(stiffness_bag):
    with TrialSet.load(stiffness_bag) as recording, TactileBag(stiffness_bag) as bag:
        assert recording.is_own
        assert len(recording.trials) == 15
        blocks = [block for _, block in read_records(bag.messages(STRAIN))]
        stamps_ns = np.concatenate(
            [b.stamp_ns + np.arange(len(b.tension_n)) * b.period_ns for b in blocks]
        )
        tension_n = np.concatenate([block.tension_n for block in blocks])
        for trial in recording.trials:
            assert trial.why_not is None
            assert trial.simulated
            assert trial.phases[-1][2] == pytest.approx(
                (trial.events[-1].stamp_ns - trial.begin_ns) * 1e-9
            )
            inside = (stamps_ns >= trial.begin_ns) & (stamps_ns <= trial.events[-1].stamp_ns)
            np.testing.assert_array_equal(trial.signal.values[0], tension_n[inside])
            assert trial.signal.unit == 'N'
            assert trial.signal.rate_hz == 60.0
        assert len({trial.label for trial in recording.trials}) == 5
        assert bag.topics['/trial_runner/events'] == (
            EVENT,
            sum(len(trial.events) for trial in recording.trials),
        )


def test_bag_is_opened_once_and_replayed_with_equal_results(stiffness_bag, opened):
    with TactileBag(stiffness_bag) as bag:
        expected = replay_phases(bag, recorded_features(bag), finish=True).windows
    del opened[:]
    with TrialSet.load(stiffness_bag) as recording:
        (bag,) = recording.bags
        for _ in range(2):
            assert replay_phases(bag, recorded_features(bag), finish=True).windows == expected
        recording.windows()
        assert [trial.signal.values.shape for trial in recording.trials]
    assert len(opened) == 1


@pytest.mark.parametrize('where', ['metadata', 'events', 'samples', 'nowhere'])
def test_trial_is_simulated_if_metadata_events_or_samples_state_it(
    stiffness_bag, rewrite, tmp_path, where
):
    """One mark is enough, because recorders and publishers of other projects do not set it."""

    def change(type_name, message):
        if type_name == EVENT:
            message.simulated = where == 'events'
        elif type_name == STRAIN:
            message.status = int(StrainStatus.SIMULATED) if where == 'samples' else 0
        return message

    bag = rewrite(stiffness_bag, tmp_path / 'bag', change, simulated=where == 'metadata')
    with TrialSet.load(bag) as recording:
        assert {trial.simulated for trial in recording.trials} == {where != 'nowhere'}


def make_experiment(folder, bag, entries):
    """Create the folder of an experiment with a copy of ``bag`` and a journal of ``entries``."""
    (folder / 'bags').mkdir(parents=True)
    shutil.copytree(bag, folder / 'bags' / 's1-01')
    (folder / 'plan.yaml').touch()
    (folder / 'order.csv').touch()
    lines = [json.dumps(entry) for entry in entries]
    (folder / 'journal.jsonl').write_text('\n'.join([*lines, '{"kind": "cut of']))
    return folder


def test_bag_of_an_experiment_without_trials_is_omitted(stiffness_bag, rewrite, tmp_path):
    """If `tactile experiment` ends before its first trial, it writes a bag without trials."""
    folder = make_experiment(tmp_path / 'one', stiffness_bag, [])
    rewrite(
        stiffness_bag,
        folder / 'bags' / 's1-02',
        lambda kind, message: None if kind == EVENT else message,
    )
    with TrialSet.load(folder) as recording:
        assert len(recording.trials) == 15
    shutil.rmtree(folder / 'bags' / 's1-01')
    with pytest.raises(SourceError, match='no trial was recorded'):
        TrialSet.load(folder)


def test_experiment_keeps_the_rules_of_a_source(stiffness_bag, tmp_path):
    with TrialSet.load(stiffness_bag) as recording:
        ids = [trial.name for trial in recording.trials]
    began = [{'kind': 'began', 'key': each, 'trial_id': each} for each in ids]
    ended = [{'kind': 'ended', 'trial_id': each, 'verdict': 'good'} for each in ids[1:]]
    corrected = [
        {'kind': 'excluded', 'trial_id': ids[1], 'why': 'the plate was loose'},
        {'kind': 'relabelled', 'trial_id': ids[2], 'label': 'cork'},
    ]
    folder = make_experiment(tmp_path / 'one', stiffness_bag, [*began, *ended, *corrected])
    check_source(lambda: TrialSet.load(folder))


def test_specimens_of_the_journal_are_a_column_that_can_be_held_out(stiffness_bag, tmp_path):
    with TrialSet.load(stiffness_bag) as recording:
        labels = {trial.name: trial.label for trial in recording.trials}
    entries = []
    for i, (name, label) in enumerate(labels.items()):
        specimen = f'{label}-{i % 2 + 1}'
        mounted = {'mounting_id': name, 'specimen': specimen, 'seconds': 1.0}
        entries += [
            {'kind': 'mounted', **mounted},
            {'kind': 'began', 'key': name, 'trial_id': name, 'mounting_id': name},
            {'kind': 'ended', 'trial_id': name, 'verdict': 'good'},
        ]
    (wrong, *_), (*_, other) = labels, labels.values()
    entries.append({'kind': 'relabelled', 'trial_id': wrong, 'label': other})
    folder = make_experiment(tmp_path / 'one', stiffness_bag, entries)
    with open_trials([folder]) as trials:
        (table,) = compute_tables(trials)[0].values()
        stated = {trial.name: trial.columns['specimen'] for trial in trials}
    trial_ids, specimens = (table.column(name).tolist() for name in ('trial_id', 'specimen'))
    assert dict(zip(trial_ids, specimens, strict=True)) == stated
    assert stated.pop(wrong) == other  # its specimen is unknown
    assert all(specimen.startswith(f'{labels[name]}-') for name, specimen in stated.items())
    split = grouped_split(table, ['specimen'])
    assert split.name == 'one specimen held out'
    assert ('specimen',) in usual_splits(table)[0]


def test_features_are_of_the_selected_and_relabelled_trials(stiffness_bag):
    with TrialSet.load(stiffness_bag) as trials:
        (whole,) = compute_tables(trials)[0].values()
        label = trials.trials[0].label
        some = trials.select(f'label={label}')
        first = np.arange(len(some)) == 0
        changed = some.exclude(first, 'the object was loose').relabel(~first, 'cork')
        tables, left_out = compute_tables(changed)
        (table,) = tables.values()
        assert set(table.labels) == {'cork'}
        np.testing.assert_array_equal(table.values, whole.values[whole.labels == label][1:])
        assert any('the object was loose' in sentence for sentence in left_out)
        (again,) = compute_tables(trials)[0].values()
        assert again.compute_sha256() == whole.compute_sha256()


def test_journal_of_an_experiment_excludes_and_relabels_trials(stiffness_bag, tmp_path):
    with TrialSet.load(stiffness_bag) as recording:
        ids = [trial.name for trial in recording.trials]
        sessions = {trial.session_id for trial in recording.trials}
    entries = [{'kind': 'began', 'key': each, 'trial_id': each} for each in ids]
    verdicts = ['failed', 'outlier', '', *['good'] * 12]
    entries += [
        {'kind': 'ended', 'trial_id': each, 'verdict': verdict}
        for each, verdict in zip(ids, verdicts, strict=True)
        if verdict
    ]
    entries += [
        {'kind': 'kept', 'trial_id': ids[1]},
        {'kind': 'excluded', 'trial_id': ids[3], 'why': 'the plate was loose'},
        {'kind': 'excluded', 'trial_id': ids[4], 'why': 'by mistake'},
        {'kind': 'included', 'trial_id': ids[4]},
        {'kind': 'relabelled', 'trial_id': ids[5], 'label': 'cork'},
    ]
    one = make_experiment(tmp_path / 'one', stiffness_bag, entries)
    with TrialSet.load(one) as recording:
        why_not = [trial.why_not for trial in recording.trials]
        assert why_not[:5] == [
            'repeated (failed)',
            None,
            'repeated (interrupted)',
            'excluded: the plate was loose',
            None,
        ]
        assert not any(why_not[5:])
        assert recording.trials[5].label == 'cork'
        assert {event.object_label for event in recording.trials[5].events} == {'cork'}
        assert {trial.session_id for trial in recording.trials} == sessions
        (source,) = describe_sources([one], recording)
        assert source.corrections == (
            f'{ids[0]} is excluded: repeated (failed)',
            f'{ids[2]} is excluded: repeated (interrupted)',
            f'{ids[3]} is excluded: the plate was loose',
            f'{ids[5]} was relabelled cork',
        )
    two = make_experiment(tmp_path / 'two', stiffness_bag, entries)
    with TrialSet.load([one, two]) as recording:
        assert {trial.session_id for trial in recording.trials} == {
            f'{name}/{session}' for name in ('one', 'two') for session in sessions
        }
    shown = ask_tactile('show', one, '--plot', tmp_path / 'all.svg')
    assert [each['excluded'] for each in shown['trials']] == why_not
    assert shown['facts']['excluded'] == '3'
    assert 'excluded' in (tmp_path / 'all.svg').read_text()
    (tmp_path / 'recordings.txt').write_text('one\ntwo\n')
    with TrialSet.load(tmp_path / 'recordings.txt') as recording:
        assert len(recording.trials) == 30
