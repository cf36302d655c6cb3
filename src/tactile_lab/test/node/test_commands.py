# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tactile command as a user meets it: a process with arguments, output and an exit code."""

import json
import re
import signal

import numpy as np
import pytest
from tactile_command import program, QUICK, tactile

from tactile_bags import EVENT, STRAIN, TactileBag
from tactile_bags.errors import BagError
from tactile_bags.message_records import read_records
from tactile_testing.waiting import wait_until


@pytest.fixture
def quick(tmp_path):
    """Return the option that shortens the trials of a test."""
    path = tmp_path / 'quick.yaml'
    path.write_text(QUICK)
    return '--params', str(path)


@pytest.fixture
def archive(tmp_path):
    """Return an archive whose two labels differ in frequency."""
    generator = np.random.default_rng(0)
    time_s = np.arange(60) / 60
    label = np.repeat(['fine', 'coarse'], 12)
    frequency_hz = np.where(label == 'fine', 20.0, 5.0)
    x = np.sin(2 * np.pi * frequency_hz[:, None] * time_s + generator.uniform(0, 6, (24, 1)))
    path = tmp_path / 'trials.npz'
    np.savez(path, x=x[:, None], label=label, rate_hz=60.0, session=np.arange(24) % 4)
    return path


def test_evaluate_states_split_and_scaling_and_speaks_json(archive):
    quick = ('evaluate', archive, '--task', 'texture', '--repetitions', '2')
    done = tactile(*quick)
    assert done.returncode == 0, done.stderr
    for text in ('stratified 6-fold, 2 times', 'not scaled', '100.0'):
        assert text in done.stdout
    done = tactile(*quick, '--group', 'session', '--json')
    (found,) = json.loads(done.stdout)['sets']
    plain, grouped = found['evaluations']
    assert plain['split'] == 'stratified 6-fold, 2 times'
    assert grouped['split'] == 'one session held out'
    assert {score['scaling'] for score in grouped['scores']} == {'standard', 'none'}


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ([], '--task'),
        (['--task', 'texture', '--group', 'colour'], 'no column "colour"'),
        (['--task', 'texture', '--channel', '1'], 'no channel 1'),
        (['--task', 'texture', '--channel', 'one'], '--channel'),
        (['--task', 'texture', '--static-phase', '4'], 'START:STOP'),
        (['--task', 'texture', '--features', 'loudness'], 'loudness'),
        (['--task', 'texture', '--where', 'session=north'], 'north'),
        (['--task', 'texture', '--report', '/proc/nowhere/r.html'], 'cannot write the report'),
    ],
)
def test_evaluate_refuses_with_one_sentence(archive, arguments, sentence):
    done = tactile('evaluate', archive, *arguments)
    assert done.returncode == 2
    assert sentence in done.stderr
    assert 'Traceback' not in done.stderr


def test_too_many_folds_are_told_beside_the_sessions(archive):
    quick = ('--folds', '13', '--repetitions', '1')
    done = tactile('evaluate', archive, '--task', 'texture', *quick)
    assert done.returncode == 0
    assert 'fewer than the 13 folds' in ' '.join(done.stdout.split())
    assert 'one session held out' in ' '.join(done.stdout.split())


def test_simulated_bags_become_models(tmp_path):
    options = ('--contact', 'flexion', '--trials', 1, '--json')
    done = tactile('simulate', 'stiffness', '-o', tmp_path / 'bags', *options)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document['simulated'] is True
    (bag,) = document['bags']
    assert bag['trials'] == 30
    done = tactile('simulate', 'stiffness', '-o', tmp_path / 'bags', *options)
    assert done.returncode == 2
    assert 'exists already' in done.stderr
    pytest.importorskip('skl2onnx', reason='skl2onnx is not installed')
    options = ('--classifier', 'tree', '--repetitions', 1)
    done = tactile('train', bag['path'], '-o', tmp_path / 'models', *options)
    assert done.returncode == 0, done.stderr
    assert 'SIMULATED' in done.stdout
    assert 'stiffness-flexion-tree-' in done.stdout
    assert (tmp_path / 'models' / 'stiffness_flexion.onnx').is_file()


def test_too_few_trials_to_train_on_are_refused(stiffness_bag, tmp_path):
    done = tactile('train', stiffness_bag, '-o', tmp_path / 'models', '--classifier', 'knn')
    assert done.returncode == 2
    assert 'fewer than the 6 folds' in done.stderr


def test_replay_of_a_bag_without_features_says_so(stiffness_bag, trained):
    done = tactile('replay', stiffness_bag, '--models', trained)
    assert done.returncode == 2
    assert 'nothing to compare' in done.stderr


def test_trials_that_are_interrupted_say_what_they_recorded_and_replay_equal(
    rewrite, trained, quick, tmp_path
):
    bag = tmp_path / 'bag'
    command = ['trials', 'stiffness', '--object', 'none', '--count', '2', '--simulated', *quick]
    command += ['--models', trained, '-o', bag, '--session', 's', '--mounting', 'm', '--json']
    with program(*command) as process:
        wait_until(lambda: has_begun(bag, '-0002', 'hold'), timeout_s=60.0, poll_s=0.05)
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert '1 of 2 trials on none, flexion; SIMULATED; ended early' in errors
    document = json.loads(out)
    assert (document['simulated'], document['ended_early']) == (True, 'interrupted')
    (trial,) = document['trials']
    # On a busy computer a trial may have been run a second time, under a name that says so.
    assert re.fullmatch(r's-stiffness-flexion-none-\d{6}-0001(-again1)?', trial['trial_id'])
    assert trial['answer'] == 'none'
    events = events_of(bag)
    assert {event.mounting_id for event in events} == {'m'}
    assert (events[-1].phase, '-0002' in events[-1].trial_id) == ('aborted', True)
    done = tactile('replay', bag)
    assert done.returncode == 0, done.stdout
    assert len(re.findall(r'equal, bit for bit \([2-4] feature windows', done.stdout)) == 2

    def disturb(type_name, message):
        if type_name == STRAIN:
            message.tension_n = message.tension_n + 1e-6
        return message

    done = tactile('replay', rewrite(bag, tmp_path / 'disturbed', disturb), '--no-nodes')
    assert done.returncode == 1
    assert 'values is' in done.stdout


def events_of(bag):
    with TactileBag(bag) as recorded:
        return [event for _, event in read_records(recorded.messages(EVENT))]


def has_begun(bag, trial, phase):
    """Return whether a recording that is under way has a phase of a trial."""
    try:
        events = events_of(bag)
    except BagError:  # nothing is recorded yet
        return False
    return any(trial in event.trial_id and event.phase == phase for event in events)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['rig'], 'name the ports'),
        (['simulate', 'texture', '-o', '/proc/nowhere'], 'cannot make the folder'),
        (['simulate', 'texture', '-o', 'out', '--seed', '-1'], '--seed'),
        (['rig', '--simulated', '--guide', '/dev/ttyACM0'], 'brings its own ports'),
        (['demo', '-o', '.'], 'exists already'),
        (['hand'], 'name the fingers'),
        (['hand', '--fingers', '2nd'], 'no name for a finger'),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(arguments, sentence):
    done = tactile(*arguments)
    assert done.returncode == 2, done.stdout
    assert sentence in done.stderr.replace("'", '')
    assert 'Traceback' not in done.stderr


def test_parameters_reach_the_nodes_and_unknown_ones_are_refused(tmp_path):
    params = tmp_path / 'params.yaml'
    for text, said in (
        ('tendon_senser: {ros__parameters: {rate_hz: 60.0}}', 'tendon_senser'),
        (
            'tendon_sensor: {ros__parameters: {ratehz: 60.0}}',
            'ratehz, which tendon_sensor does not have; did you mean rate_hz?',
        ),
        ('tendon_sensor: {ros__parameters: {rate_hz: -1.0}}', 'rate_hz'),
    ):
        params.write_text(text)
        done = tactile('rig', '--simulated', '--params', params)
        assert (done.returncode, said in done.stderr) == (2, True), done.stderr
        assert 'Traceback' not in done.stderr


@pytest.mark.parametrize(
    ('command', 'bags'),
    [
        (['rig'], ['']),
        (['sense', '--phases', 'stiffness', '--slip'], ['']),
        (['hand', '--fingers', 'index,middle', '--namespace', 'left'], ['index', 'middle']),
    ],
    ids=['rig', 'sense', 'hand'],
)
def test_nodes_run_and_record_until_interrupted(command, bags, tmp_path):
    recording = tmp_path / 'recording'
    with program(*command, '--simulated', '--record', recording) as process:
        line = process.stdout.readline()
        assert 'SIMULATED' in line
        assert 'running: ' in line
        assert ('slip_detector' in line) == ('--slip' in command)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    for bag in bags:
        assert (recording / bag / 'metadata.yaml').exists()
