# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plan, order and journal of an experiment."""

from collections import Counter
from contextlib import suppress
import dataclasses
from itertools import pairwise
import json
import resource

from hypothesis import example, given, settings
from hypothesis import strategies as st
import pytest

from tactile_bags.errors import BagError
from tactile_bags.experiment_journal import (
    Correction,
    is_experiment,
    parse_journal,
    read_corrections,
)
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.journal import (
    EXCLUDED,
    INCLUDED,
    Journal,
    Progress,
    read_journal,
    RELABELLED,
)
from tactile_lab.experiment.plan import (
    ExperimentError,
    ExperimentPlan,
    format_order,
    format_plan,
    list_order,
    parse_order,
    parse_plan,
    read_plan,
)
from tactile_ros.yaml_files import load_yaml

LABELS = st.text('abcRTF0123456789_-.+no', min_size=1, max_size=6).filter(lambda t: t[0].isalnum())
PLANS = st.builds(
    ExperimentPlan,
    name=LABELS,
    protocol=st.sampled_from(['texture', 'stiffness']),
    objects=st.lists(LABELS, min_size=1, max_size=5, unique=True).map(tuple),
    contacts=st.sampled_from([('flexion',), ('abduction',), ('flexion', 'abduction')]),
    sessions=st.integers(1, 3),
    mountings=st.integers(1, 3),
    trials=st.integers(1, 4),
    specimens=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
    hold_s=st.sampled_from([0.0, 1.5]),
)


@example(ExperimentPlan('0b_', 'texture', ('0b_', '1e3', 'no')))
@given(PLANS)
def test_plan_is_read_as_it_was_written(plan):
    assert parse_plan(load_yaml(format_plan(plan)), 'other') == plan


@given(PLANS)
def test_the_order_has_each_block_once_and_is_read_as_it_was_written(plan):
    order = [trial for name in plan.session_ids for trial in list_order(plan, name)]
    assert len(order) == plan.trial_count
    assert parse_order(format_order(order)) == order
    assert order == [trial for name in plan.session_ids for trial in list_order(plan, name)]
    per_block = len(plan.objects) * plan.trials
    for start in range(0, len(order), per_block):
        block = order[start : start + per_block]
        assert Counter(t.object_label for t in block) == dict.fromkeys(plan.objects, plan.trials)
        assert len({t.contact for t in block}) == 1
        assert len({(t.session_id, t.mounting) for t in block}) == len(plan.objects)
    for session in plan.session_ids:
        contacts = [trial.contact for trial in order if trial.session_id == session]
        turns = sum(a != b for a, b in pairwise(contacts))
        assert turns == len(plan.contacts) - 1


def test_specimens_alternate_within_and_between_sessions():
    plan = ExperimentPlan('x', 'texture', ('A', 'B'), sessions=3, mountings=3, specimens=2)
    mounted = [
        (trial.session_id, trial.object_label, trial.specimen)
        for name in plan.session_ids
        for trial in list_order(plan, name)
        if trial.trial == 1
    ]
    of_a = [specimen for _, label, specimen in mounted if label == 'A']
    assert of_a == ['A-1', 'A-2'] * 4 + ['A-1']
    assert {specimen for _, label, specimen in mounted if label == 'B'} == {'B-1', 'B-2'}
    # Mountings of an appended block continue to alternate between the two specimens.
    (block,) = {
        trial.specimen[-1]
        for trial in list_order(dataclasses.replace(plan, mountings=1), 'x-s01', 7)
    }
    assert block == '2'
    assert {t.specimen for t in list_order(dataclasses.replace(plan, specimens=1), 'x-s01')} == {
        ''
    }


def test_order_file_without_specimens_is_read():
    text = 'key,session_id,mounting,trial,contact,object_label\nk,s,1,1,flexion,A\n'
    assert [trial.specimen for trial in parse_order(text)] == ['']


def test_order_differs_between_blocks_and_between_seeds():
    plan = ExperimentPlan('x', 'texture', tuple('ABCDEF'), mountings=4, sessions=2)

    def orders(plan):
        order = [t for name in plan.session_ids for t in list_order(plan, name) if t.trial == 1]
        labels = [trial.object_label for trial in order]
        return [tuple(labels[i : i + 6]) for i in range(0, len(labels), 6)]

    assert len(set(orders(plan))) == 8
    other = ExperimentPlan('x', 'texture', tuple('ABCDEF'), mountings=4, sessions=2, seed=2)
    assert not set(orders(plan)) & set(orders(other))


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('- 1', 'not a mapping'),
        ('protocol: texture', 'objects missing'),
        ('{protocol: smell, objects: [R1]}', 'texture or stiffness'),
        ('{protocol: texture, objects: R1}', 'not a list'),
        ('{protocol: texture, objects: []}', 'objects is empty'),
        ('{protocol: texture, objects: [no]}', 'quotes'),
        ('{protocol: texture, objects: [a/b]}', 'is not a valid name'),
        ('{protocol: texture, objects: [R1, R1]}', 'twice'),
        ('{protocol: texture, objects: [R1], contacts: [side]}', 'flexion or abduction'),
        ('{protocol: texture, objects: [R1], trials: 0}', 'from 1'),
        ('{protocol: texture, objects: [R1], trials: 2.5}', 'whole number'),
        ('{protocol: texture, objects: [R1], trials: true}', 'whole number'),
        ('{protocol: texture, objects: [R1], trials: 9999, sessions: 9}', 'the limit is 10000'),
        ('{protocol: texture, objects: [R1], hold_s: .nan}', 'hold_s'),
        ('{protocol: texture, objects: [R1], colour: red}', "unknown entry 'colour'"),
    ],
)
def test_invalid_plan_is_refused(tmp_path, text, sentence):
    path = tmp_path / 'plan.yaml'
    path.write_text(text)
    with pytest.raises(ExperimentError, match=sentence) as refusal:
        read_plan(path)
    assert 'plan.yaml' in str(refusal.value)


@given(
    st.sampled_from(['name', 'protocol', 'objects', 'contacts', 'trials', 'seed', 'hold_s']),
    st.recursive(st.none() | st.booleans() | st.integers() | st.text(), st.lists, max_leaves=4),
)
def test_any_value_in_a_plan_is_accepted_or_refused_with_a_sentence(key, value):
    document = {'protocol': 'texture', 'objects': ['R1'], key: value}
    with suppress(ExperimentError):
        assert parse_plan(document, 'x').trial_count


ENTRIES = st.lists(
    st.dictionaries(st.text(max_size=5), st.integers() | st.text(max_size=9), max_size=3).map(
        lambda values: {**values, 'kind': 'note'}
    ),
    max_size=5,
)


@given(ENTRIES, st.integers(0, 400), st.sampled_from([b'', b'\0' * 20, b'\0\n\0\n', b'{"ki']))
def test_truncated_journal_keeps_its_complete_lines(entries, cut, tail):
    data = b''.join(json.dumps(entry).encode() + b'\n' for entry in entries)[:cut]
    found, length = parse_journal(data + tail)
    assert found == entries[: data.count(b'\n')]
    assert length == data.rfind(b'\n') + 1


@given(st.binary(max_size=200))
def test_any_bytes_are_a_journal_or_refused(data):
    try:
        entries, length = parse_journal(data)
    except BagError:
        return
    assert parse_journal(data[:length]) == (entries, length)


def test_damaged_line_within_the_journal_is_refused():
    with pytest.raises(BagError, match='line 2 is damaged'):
        parse_journal(b'{"kind": "a"}\nrubbish\n{"kind": "b"}\n')


def test_journal_continues_after_an_incomplete_line_and_has_a_single_writer(tmp_path):
    path = tmp_path / 'journal.jsonl'
    with Journal(path) as journal:
        journal.append('a', n=1)
        with pytest.raises(ExperimentError, match='another program'):
            Journal(path)
    with path.open('ab') as file:
        file.write(b'{"kind": "b", "n"')
    with Journal(path) as journal:
        journal.append('c')
    assert read_journal(path) == [{'kind': 'a', 'n': 1}, {'kind': 'c'}]


def test_journal_on_a_full_disk_reports_it_and_loses_only_the_incomplete_line(tmp_path):
    path = tmp_path / 'journal.jsonl'
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Journal(path) as journal:
        journal.append('a')
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 5, limits[1]))
        try:
            with pytest.raises(ExperimentError, match=r'cannot write the journal .*too large'):
                journal.append('b')
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        with pytest.raises(ExperimentError, match='is closed'):
            journal.append('c')
    with Journal(path) as journal:
        assert journal.append('d') == {'kind': 'd'}
    assert [entry['kind'] for entry in read_journal(path)] == ['a', 'd']


@settings(max_examples=30)
@given(
    st.dictionaries(
        st.sampled_from(['key', 'trial_id', 'mounting_id', 'verdict', 'statistics', 'seconds']),
        st.none() | st.text(max_size=3) | st.integers() | st.lists(st.integers(), max_size=2),
    ),
    st.sampled_from(
        ['began', 'ended', 'kept', 'mounted', 'run', 'setup', 'relabelled', 'excluded', 'other']
    ),
)
def test_invalid_entries_are_refused_with_their_number(values, kind):
    entry = {**values, 'kind': kind}
    if kind in ('ended', 'kept', 'relabelled', 'excluded'):  # these need a trial
        with pytest.raises(ExperimentError, match='entry 1'):
            Progress([], [entry])
        return
    with suppress(ExperimentError):
        Progress([], [entry])


RESULT = {'verdict': 'good', 'sentence': '', 'statistics': {'mean_n': 5.0}, 'seconds': 1}
PLAN = ExperimentPlan('grooves', 'texture', ('R1', 'C1', 'F'), sessions=2, mountings=1, trials=2)


@pytest.fixture
def folder(tmp_path):
    folder = ExperimentFolder(tmp_path / 'grooves')
    folder.set_up(PLAN)
    return folder


def test_sessions_may_be_increased_and_other_entries_must_not_change(folder):
    assert is_experiment(folder.path)
    before = folder.read_order()
    assert len(before) == 12
    folder.set_up(PLAN)
    assert folder.read_order() == before
    folder.set_up(dataclasses.replace(PLAN, sessions=3))
    assert folder.read_order()[:12] == before
    assert len(folder.read_order()) == 18
    for changed in ({'seed': 2}, {'trials': 3}, {'sessions': 1}):
        with pytest.raises(ExperimentError, match=next(iter(changed))):
            folder.set_up(dataclasses.replace(PLAN, **{'sessions': 3, **changed}))


def test_a_block_is_appended_to_a_session_and_its_trials_are_counted(folder):
    assert folder.appended_left('grooves-s01') == 0  # planned trials are not counted
    block = folder.draw_block('grooves-s01')
    assert len(block) == 6
    assert len(folder.read_order()) == 12
    folder.append(block)
    order = folder.read_order()
    assert len(order) == 18
    assert {t.mounting for t in order if t.session_id == 'grooves-s01'} == set(range(1, 7))
    assert folder.appended_left('grooves-s01') == 6
    assert folder.appended_left('grooves-s02') == 0
    with folder.open_journal() as journal:
        for number, trial in enumerate(folder.read_order()[-6:], 1):
            journal.append('began', key=trial.key, trial_id=trial.key, mounting_id='m')
            journal.append('ended', trial_id=trial.key, **RESULT)
            assert folder.appended_left('grooves-s01') == 6 - number
    for ask in (folder.draw_block, folder.appended_left):
        with pytest.raises(ExperimentError, match='no session "other"'):
            ask('other')


def test_folder_with_other_files_is_refused(tmp_path):
    (tmp_path / 'notes.txt').write_text('mine')
    with pytest.raises(ExperimentError, match='is not an experiment'):
        ExperimentFolder(tmp_path).set_up(PLAN)
    assert [path.name for path in tmp_path.iterdir()] == ['notes.txt']


def test_bags_of_an_experiment_and_their_excluded_trials(folder):
    folder.open_journal().close()
    bag = folder.bag_path('grooves-s01', 1)
    bag.mkdir()
    assert folder.bag_path('grooves-s01', 1) != bag
    assert folder.list_bags() == [bag]
    assert read_corrections(folder.path) == {}
    with folder.open_journal() as journal:
        for name in ('one', 'two'):
            journal.append('began', key='k', trial_id=name, mounting_id='m')
        journal.append('ended', trial_id='two', **RESULT)
    assert read_corrections(folder.path) == {
        'one': Correction('repeated (interrupted)'),
        'two': Correction(),
    }


def test_corrections_are_entries_and_the_last_one_is_valid(folder):
    first, *_ = folder.read_order()
    with folder.open_journal() as journal:
        journal.append('mounted', mounting_id='m', seconds=1)
        journal.append('began', key=first.key, trial_id=first.key, mounting_id='m')
        journal.append('began', key=first.key, trial_id=f'{first.key}-again1', mounting_id='m')
        journal.append('ended', trial_id=f'{first.key}-again1', **RESULT)
    assert len(folder.read_progress().earlier(first)) == 1
    # A correction that names a planned trial applies to the attempt that was kept.
    attempt = folder.correct(first.key, EXCLUDED, why='the cable touched')
    assert attempt.trial_id == f'{first.key}-again1'
    found = read_corrections(folder.path)
    assert found[attempt.trial_id] == Correction('excluded: the cable touched')
    assert found[first.key] == Correction('repeated (interrupted)')
    assert not folder.read_progress().earlier(first)
    assert folder.read_progress().to_dict()['excluded'] == 1
    assert folder.read_progress().done_count == 1
    folder.correct(attempt.trial_id, INCLUDED, why='it did not')
    assert read_corrections(folder.path)[attempt.trial_id] == Correction()
    other = next(label for label in PLAN.objects if label != first.object_label)
    folder.correct(attempt.trial_id, RELABELLED, label=other, why='wrong plate')
    assert read_corrections(folder.path)[attempt.trial_id] == Correction(label=other)
    found = folder.read_progress()
    assert (found.find(first.key).label, found.to_dict()['relabelled']) == (other, 1)
    # A relabelled trial was recorded on another plate, so it is no reference for this one.
    assert not found.earlier(first)
    before = folder.journal.read_bytes()
    with pytest.raises(ExperimentError, match=f'no trial "x"; did you mean {first.key}'):
        folder.correct('x', EXCLUDED, why='')
    assert folder.journal.read_bytes() == before
