# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The `tactile` command in a separate process: arguments, output and exit code."""

import json
import re
import signal

import numpy as np
import pytest
from tactile_command import ask_tactile, hear_tactile, program, QUICK

from tactile_bags import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.message_records import read_records
from tactile_ros.topics import EVENT, STRAIN
from tactile_testing.waiting import wait_until


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / 'trials.npz'
    label = np.repeat(['fine', 'coarse'], 12)
    x = np.random.default_rng(0).normal(size=(24, 1, 60))
    np.savez(path, x=x, label=label, rate_hz=60.0, session=np.arange(24) % 4)
    return path


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        ([], '--task'),
        (['--task', 'texture', '--group', 'colour'], 'no column "colour"'),
        (['--task', 'texture', '--channel', '1'], 'no channel 1'),
        (['--task', 'texture', '--channel', 'one'], 'no channel one'),
        (['--task', 'texture', '--crop', '4'], 'START:STOP'),
        (['--task', 'texture', '--features', 'loudness'], 'loudness'),
    ],
)
def test_evaluate_refuses_with_one_sentence(archive, arguments, sentence):
    said = hear_tactile('evaluate', archive, *arguments, code=2)
    assert sentence in said
    assert 'Traceback' not in said


def test_simulated_bags_become_models(tmp_path):
    document = ask_tactile(
        'simulate', 'stiffness', '-o', tmp_path / 'bags', '--contact', 'flexion', '--trials', 1
    )
    assert document['simulated'] is True
    (bag,) = document['bags']
    assert bag['trials'] == 30
    options = ('--classifier', 'tree', '--repetitions', 1)
    said = hear_tactile('train', bag['path'], '-o', tmp_path / 'models', *options)
    assert 'SIMULATED' in said
    assert 'stiffness-flexion-tree-' in said
    assert (tmp_path / 'models' / 'stiffness_flexion.npz').is_file()


def test_a_bag_without_features_is_refused(stiffness_bag, trained):
    said = hear_tactile('replay', stiffness_bag, '--models', trained, code=2)
    assert 'nothing to compare' in said


def test_interrupted_trials_report_their_recording_which_replays_equal(
    rewrite, trained, parameter_file, tmp_path
):
    """Takes more than 10 s: one and a half live trials, and a replay of the bag."""
    bag = tmp_path / 'bag'
    command = ['trials', 'stiffness', '--object', 'none', '--count', '2', '--simulated']
    command += [
        '--params',
        parameter_file(QUICK),
        '--models',
        trained,
        '-o',
        bag,
        '--session',
        's',
        '--mounting',
        'm',
        '--json',
    ]
    with program(*command) as process:
        wait_until(lambda: has_begun(bag, '-0002', 'hold'), timeout_s=60.0, poll_s=0.05)
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert '1 of 2 trials on none, flexion; SIMULATED; ended early' in errors
    document = json.loads(out)
    assert (document['simulated'], document['ended_early']) == (True, 'interrupted')
    (trial,) = document['trials']
    # On a busy computer a trial may be repeated; its id then ends in -again1.
    assert re.fullmatch(r's-stiffness-flexion-none-\d{6}-0001(-again1)?', trial['trial_id'])
    assert trial['answer'] == 'none'
    events = events_of(bag)
    assert {event.mounting_id for event in events} == {'m'}
    assert (events[-1].phase, '-0002' in events[-1].trial_id) == ('aborted', True)
    said = hear_tactile('replay', bag)
    assert len(re.findall(r'equal, bit for bit \([2-4] feature windows', said)) == 2

    def disturb(type_name, message):
        if type_name == STRAIN:
            message.tension_n = message.tension_n + 1e-6
        return message

    disturbed = rewrite(bag, tmp_path / 'disturbed', disturb)
    assert 'values is' in hear_tactile('replay', disturbed, '--no-nodes', code=1)


def events_of(bag):
    with TactileBag(bag) as recorded:
        return [event for _, event in read_records(recorded.messages(EVENT))]


def has_begun(bag, trial, phase):
    """Return True if a bag that is being recorded contains a phase of a trial."""
    try:
        events = events_of(bag)
    except BagError:  # the bag does not exist yet
        return False
    return any(trial in event.trial_id and event.phase == phase for event in events)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['rig'], 'give the ports'),
        (['simulate', 'texture', '-o', '/proc/nowhere'], 'cannot make the folder'),
        (['simulate', 'texture', '-o', 'out', '--seed', '-1'], '--seed'),
        (['rig', '--simulated', '--guide', '/dev/ttyACM0'], 'uses its own ports'),
        (['demo', '-o', '.'], 'exists already'),
        (['hand'], 'name the fingers'),
        (['hand', '--fingers', '2nd'], 'not a valid name of a finger'),
    ],
)
def test_invalid_arguments_are_refused_with_a_sentence(arguments, sentence):
    said = hear_tactile(*arguments, code=2)
    assert sentence in said.replace("'", '')
    assert 'Traceback' not in said


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('tendon_senser: {ros__parameters: {rate_hz: 60.0}}', 'tendon_senser'),
        (
            'tendon_sensor: {ros__parameters: {ratehz: 60.0}}',
            'ratehz, which tendon_sensor does not have; did you mean rate_hz?',
        ),
        ('tendon_sensor: {ros__parameters: {rate_hz: -1.0}}', 'rate_hz'),
    ],
)
def test_parameters_reach_the_nodes_and_unknown_ones_are_refused(parameter_file, text, sentence):
    said = hear_tactile('rig', '--simulated', '--params', parameter_file(text), code=2)
    assert sentence in said
    assert 'Traceback' not in said


@pytest.mark.parametrize(
    ('command', 'bags'),
    [
        (['rig'], ['']),
        (['hand', '--fingers', 'index,middle', '--namespace', 'left'], ['index', 'middle']),
    ],
    ids=['rig', 'hand'],
)
def test_nodes_run_and_record_until_interrupted(command, bags, tmp_path):
    recording = tmp_path / 'recording'
    with program(*command, '--simulated', '--record', recording) as process:
        line = process.stdout.readline()
        assert 'SIMULATED' in line
        assert 'running: ' in line
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    for bag in bags:
        assert (recording / bag / 'metadata.yaml').exists()
