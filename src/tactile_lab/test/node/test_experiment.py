# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""An experiment on the simulated rig that is interrupted, killed, continued and read."""

import signal
import time

from tactile_command import (
    ask_tactile,
    hear_tactile,
    let_rigs_home_fast,
    program,
    SHORT_HOLD,
)

from tactile_analysis.datasets.feature_tables import read_tables
from tactile_bags import TactileBag
from tactile_bags.message_records import read_records
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.journal import read_journal
from tactile_ros.topics import EVENT
from tactile_testing.waiting import wait_until


def run_until_done(folder, quick, count, signal_number):
    """Run until ``count`` trials are done and the next is in its hold; then send a signal.

    On a busy computer a trial may fail, and is then repeated.
    """
    plan = folder.path if folder.path.exists() else folder.path.with_suffix('.yaml')
    with program('experiment', plan, '--simulated', '--yes', *quick) as process:
        wait_beside(process, lambda: is_in_hold(folder, count))
        process.send_signal(signal_number)
        out, errors = process.communicate(timeout=60)
    return out, errors, process.returncode


def is_in_hold(folder, count):
    if not folder.journal.exists() or folder.read_progress().done_count < count:
        return False
    entries = read_journal(folder.journal)  # read last: a trial may just have become done
    if not entries:
        return False
    last = entries[-1]
    return last['kind'] == 'began' and 'hold' in phases(folder, last['trial_id'])


def wait_beside(process, condition):
    def step():
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.05)

    wait_until(condition, timeout_s=90.0, step=step)


def phases(folder, trial_id):
    """Return the phases of a trial that have been recorded to the last bag so far."""
    with TactileBag(folder.list_bags()[-1]) as bag:
        events = [event for _, event in read_records(bag.messages(EVENT))]
    return [event.phase for event in events if event.trial_id == trial_id]


def test_experiment_continues_after_ctrl_c_and_kill_and_its_trials_are_read(
    tmp_path, monkeypatch, parameter_file
):
    """Takes more than 30 s: four starts of the program, and five live trials."""
    let_rigs_home_fast(monkeypatch.setattr)
    quick = ('--params', parameter_file(SHORT_HOLD))
    plan = tmp_path / 'soft.yaml'
    options = ['--protocol', 'stiffness', '--objects', 'pla', '--sessions', 2]
    hear_tactile('experiment', 'new', plan, *options, '--mountings', 1, '--trials', 1)
    folder = ExperimentFolder(tmp_path / 'soft')
    assert '--yes requires --simulated' in hear_tactile('experiment', plan, '--yes', code=2)
    assert not folder.path.exists()

    out, errors, code = run_until_done(folder, quick, 0, signal.SIGINT)
    assert code == 130, errors
    assert '0 of 2 trials recorded; interrupted: 1' in out
    params = quick[1]
    assert f'Continue: tactile experiment {folder.path} --simulated --params {params} --yes' in out
    out, _, code = run_until_done(folder, quick, 1, signal.SIGKILL)
    assert code == -signal.SIGKILL
    assert 'trial 1 of 2, ' in out
    # Run the remaining trials, and append a block when the rig has started.
    more = ('--append', 'soft-s01', '--simulated', '--yes', *quick)
    found = ask_tactile('experiment', folder.path, *more)
    assert (found['done'], found['interrupted'], len(folder.read_order())) == (3, 2, 3)
    assert found['attempts'] == 5 + found['failed']
    assert found['sessions_left'] == []
    assert len(found['bags']) == 5
    said = hear_tactile('experiment', folder.path, '--simulated', '--yes')
    assert 'Complete. Train on it' in said

    # The bags contain each planned trial once; after each interruption the mounting is new.
    events = []
    for path in folder.list_bags():
        with TactileBag(path) as bag:
            events += [event for _, event in read_records(bag.messages(EVENT))]
    kept = [trial['trial_id'] for trial in found['trials'] if trial['is_kept']]
    ended = [event for event in events if event.phase == 'done' and event.trial_id in kept]
    assert sorted((e.session_id, e.object_label) for e in ended) == sorted(
        (trial.session_id, trial.object_label) for trial in folder.read_order()
    )
    mounted = {(event.mounting_id, event.object_label) for event in events}
    assert len(mounted) == len({mounting for mounting, _ in mounted}) == 5
    replayed = ask_tactile('replay', folder.path, '--no-nodes')
    assert {finger['bag'] for finger in replayed['fingers']} <= set(found['bags'])
    assert len(replayed['fingers']) > 1
    assert replayed['equal']

    (table,) = read_tables(folder.list_bags()).values()
    assert set(table.column('trial_id')) == set(kept)
    assert len(table) == 3
