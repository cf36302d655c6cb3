# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""In experiments with random interruptions, no trial is lost and none is counted twice."""

from contextlib import contextmanager, suppress
from itertools import pairwise
import os

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from tactile_lab.experiment import journal as journal_module
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.journal import Progress, read_journal
from tactile_lab.experiment.loop import format_seconds, list_changes, run_experiment, TrialResult
from tactile_lab.experiment.plan import ExperimentError, ExperimentPlan, list_order
from tactile_ros.errors import TactileError

PLAN = ExperimentPlan('x', 'stiffness', ('pla', 'sponge'), sessions=2, mountings=2, trials=2)


@pytest.fixture(autouse=True, scope='module')
def no_wait_for_the_disk():
    """Let `os.fsync` return immediately; power cuts are only simulated."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, 'fsync', lambda handle: None)
        yield


class PowerCut(BaseException):
    """Simulates a power cut. Code that catches `Exception` does not catch it."""


class World:
    """The simulated laboratory, whose recordings and mounted object survive interruptions.

    ``cuts`` states for each possible moment if a power cut happens, and ``outcomes`` has the
    result of each trial.
    """

    def __init__(self, cuts=(), outcomes=()):
        self.cuts, self.outcomes = iter(cuts), iter(outcomes)
        self.recorded = []
        self.following = []
        self.mounted = None
        self.setup = {'tendon_sensor.scale': '1.0'}

    def may_cut(self):
        if next(self.cuts, False):
            raise PowerCut


@pytest.fixture
def folder(tmp_path):
    return ExperimentFolder(tmp_path / 'experiment')


class Bench:
    def __init__(self, world):
        self.world = world

    @contextmanager
    def session(self, bag):
        bag.mkdir(parents=True)
        self.world.may_cut()
        yield self.run

    def read_setup(self):
        return self.world.setup

    def run(self, order):
        assert self.world.mounted == order.planned.object_label
        self.world.following.append(order.following)
        self.world.may_cut()
        outcome = next(self.world.outcomes, 'good')
        if outcome == 'failed':
            raise TactileError('the cable came off')
        self.world.recorded.append(order.trial_id)
        self.world.may_cut()
        if outcome == 'unusable':
            return TrialResult('3 samples lost')
        value = 100.0 if outcome == 'outlier' else 5.0 + 0.01 * len(self.world.recorded)
        return TrialResult(None, '240 samples', {'mean_n': value})


class Person:
    def __init__(self, world, choices=()):
        self.world = world
        self.choices = iter(choices)
        self.said, self.asked, self.changes = [], [], []

    def begin_session(self, session_id, trials):
        return True

    def accept_setup(self, changes):
        self.changes += changes
        return next(self.choices, True)

    def mount(self, trial, turns_finger):
        self.world.may_cut()
        self.world.mounted = trial.object_label

    def choose(self, order, verdict, sentence):
        self.world.may_cut()
        self.asked.append(verdict)
        return next(self.choices, 'again')

    def say(self, text):
        self.said.append(text)


def run_to_end(folder, world, person=None, plan=PLAN, added=()):
    """Start or continue the experiment; return its progress and the reason of its end."""
    folder.set_up(plan)
    with folder.open_journal() as journal:
        return run_experiment(folder, Bench(world), person or Person(world), journal, added)


def run(*arguments, **options):
    return run_to_end(*arguments, **options)[0]


def check_complete(folder, world):
    progress = folder.read_progress()
    assert not progress.left()
    kept = [progress.kept(trial.key).trial_id for trial in progress.order]
    assert len(set(kept)) == len(kept) == PLAN.trial_count
    # Each kept trial was recorded completely. Each recording has a unique name.
    assert set(kept) <= set(world.recorded)
    assert len(set(world.recorded)) == len(world.recorded)


@settings(max_examples=40)
@given(
    cuts=st.lists(st.sampled_from([False] * 6 + [True]), max_size=100),
    torn=st.lists(st.integers(0, 300), max_size=6),
    outcomes=st.lists(
        st.sampled_from(['good', 'good', 'failed', 'unusable', 'outlier']), max_size=30
    ),
    choices=st.lists(st.sampled_from(['again', 'keep']), max_size=20),
)
def test_no_trial_is_lost_or_counted_twice_after_any_interruption(
    tmp_path_factory, cuts, torn, outcomes, choices
):
    folder = ExperimentFolder(tmp_path_factory.mktemp('x') / 'experiment')
    world = World(cuts, outcomes)
    torn = iter(torn)
    for _ in range(len(cuts) + 1):
        try:
            run(folder, world, Person(world, choices))
            break
        except PowerCut:
            # The last line of the journal can be incomplete after a power cut.
            with folder.journal.open('ab') as file:
                file.write(b'{"kind": "ended", "trial_id": "x-s01-m01-t01"}'[: next(torn, 0) % 47])
    check_complete(folder, world)


@settings(max_examples=15)
@given(st.lists(st.sampled_from([False, False, False, True]), max_size=60))
def test_repeated_call_continues_the_appended_block(tmp_path_factory, cuts):
    folder = ExperimentFolder(tmp_path_factory.mktemp('x') / 'experiment')
    run(folder, World([], []))
    planned = len(folder.read_order())
    world = World(cuts, [])
    session_id = PLAN.session_ids[0]
    block = folder.draw_block(session_id)
    for _ in range(len(cuts) + 1):
        try:
            added = [] if folder.appended_left(session_id) else folder.draw_block(session_id)
            run(folder, world, added=added)
            break
        except PowerCut:
            assert len(folder.read_order()) in (planned, planned + len(block))
    assert folder.read_order()[planned:] == block
    assert not folder.read_progress().left()


@settings(max_examples=20)
@given(st.lists(st.integers(1, 25), max_size=12), st.booleans())
def test_experiment_continues_after_a_kill_between_any_two_writes(tmp_path_factory, kills, after):
    """The program is killed before or after an entry of the journal is written to disk."""
    folder = ExperimentFolder(tmp_path_factory.mktemp('x') / 'experiment')
    world = World()
    confirm = os.fsync
    countdown = None

    def cut(handle):
        nonlocal countdown
        if after:
            confirm(handle)
        if countdown is not None:
            countdown -= 1
            if countdown <= 0:
                raise PowerCut
        confirm(handle)

    journal_module.os.fsync = cut
    try:
        for countdown in [*kills, None]:  # noqa: B007 - read by cut
            with suppress(PowerCut):
                run(folder, world)
    finally:
        journal_module.os.fsync = confirm
    check_complete(folder, world)


def test_failed_trials_and_outliers_can_be_repeated_immediately(folder):
    plan = ExperimentPlan('x', 'stiffness', ('pla',), sessions=1, mountings=1, trials=5)
    world = World(outcomes=['good', 'failed', 'unusable', 'good', 'good', 'outlier', 'outlier'])
    person = Person(world, ['again', 'again', 'again', 'keep'])
    progress = run(folder, world, person, plan)
    assert person.asked == ['failed', 'failed', 'outlier', 'outlier']
    assert list(progress.attempts) == [
        *('x-s01-m01-t01', 'x-s01-m01-t02', 'x-s01-m01-t02-again1', 'x-s01-m01-t02-again2'),
        *('x-s01-m01-t03', 'x-s01-m01-t04', 'x-s01-m01-t04-again1', 'x-s01-m01-t05'),
    ]
    assert progress.outlier_count == 1
    assert progress.kept('x-s01-m01-t04').trial_id == 'x-s01-m01-t04-again1'
    assert 'mean tension 100 N, usually 5' in progress.attempts['x-s01-m01-t04'].sentence
    assert person.said[0].startswith(
        'trial 1 of 5, x-s01-m01-t01: pla, flexion: good: 240 samples; '
    )
    assert person.said[1].startswith(
        'trial 2 of 5, x-s01-m01-t02: pla, flexion: failed: the cable came off'
    )
    assert person.said[-1].startswith('trial 5 of 5, x-s01-m01-t05: ')
    assert person.said[-1].endswith('; 0 s left')
    found = progress.to_dict()
    assert (found['done'], found['failed'], found['attempts']) == (5, 2, 8)


def test_each_trial_describes_the_following_one(folder):
    plan = ExperimentPlan('x', 'stiffness', ('pla', 'sponge'), sessions=1, mountings=1, trials=2)
    world = World()
    run(folder, world, plan=plan)
    order = folder.read_order()
    expected = [
        f'{after.object_label}, flexion{", to be mounted" * (after.mounting != before.mounting)}'
        for before, after in pairwise(order)
    ]
    assert world.following == [*expected, 'end of the session']
    assert sum('to be mounted' in each for each in expected) == 1


def test_operator_can_stop_and_the_object_gets_a_new_mounting_when_continued(folder):
    world = World(outcomes=['good', 'failed'])
    assert run_to_end(folder, world, Person(world, ['stop']))[1] == (
        'stopped after trial x-s01-m01-t02'
    )
    progress, ended = run_to_end(folder, world)
    assert ended is None
    check_complete(folder, world)
    first, *_, second = (progress.kept(f'x-s01-m01-t{i:02d}').mounting_id for i in (1, 2))
    assert (first, second) == ('x-s01-m01', 'x-s01-m01-2')
    mountings = [attempt.mounting_id for attempt in progress.attempts.values()]
    assert len(set(mountings)) == len(progress.mounting_ids) == 9


def test_failed_recording_ends_the_experiment(folder, monkeypatch):
    def fail(self, order):
        raise ExperimentError('the disk is full')

    world = World()
    with monkeypatch.context() as patch:
        patch.setattr(Bench, 'run', fail)
        with pytest.raises(ExperimentError, match='disk is full'):
            run(folder, world)
    assert folder.read_progress().to_dict()['interrupted'] == 1
    run(folder, world)
    check_complete(folder, world)


def test_remaining_time_is_estimated_from_the_trials_so_far():
    order = [each for name in PLAN.session_ids for each in list_order(PLAN, name)]
    progress = Progress(order, [])
    progress.take({'kind': 'mounted', 'mounting_id': 'm', 'seconds': 50.0})
    first = order[0].key
    progress.take({'kind': 'began', 'key': first, 'trial_id': 'a', 'mounting_id': 'm'})
    ended = {'verdict': 'good', 'sentence': '', 'statistics': {}, 'seconds': 12.0}
    progress.take({'kind': 'ended', 'trial_id': 'a', **ended})
    assert progress.estimate_left_s() == 15 * 12.0 + 8 * 50.0


@pytest.mark.parametrize(
    ('seconds', 'text'), [(0, '0 s'), (89, '89 s'), (90, '2 min'), (5399, '1 h 30 min')]
)
def test_durations_are_formatted_in_s_min_or_h(seconds, text):
    assert format_seconds(seconds) == text


def test_experiment_continues_with_a_changed_setup_only_if_it_is_accepted(folder):
    world = World(outcomes=['good', 'failed'])
    run(folder, world, Person(world, ['stop']))
    assert folder.read_progress().setup == world.setup
    world.setup = {'tendon_sensor.scale': '1.1', 'tendon_sensor device': 'A5'}
    person = Person(world, [False])
    progress, ended = run_to_end(folder, world, person)
    assert person.changes == [
        'tendon_sensor device: unknown -> A5',
        'tendon_sensor.scale: 1.0 -> 1.1',
    ]
    assert ended == 'the set-up was not accepted'
    assert progress.done_count == 1
    assert folder.read_progress().setup['tendon_sensor.scale'] == '1.0'
    run(folder, world, Person(world, [True]))
    check_complete(folder, world)
    entries = [e for e in read_journal(folder.journal) if e['kind'] == 'setup']
    assert [bool(entry['accepted_changes']) for entry in entries] == [False, True, False]
    assert list_changes(world.setup, world.setup) == []
