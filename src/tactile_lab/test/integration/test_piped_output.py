# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""In a pipe, no value is broken at any width. On a terminal, only sentences and lists are folded.

The commands run one after the other, in one process for each folder and kind of output.
"""

import functools
import json
import os
import pty
import re
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest

from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.plan import ExperimentPlan

WIDTHS = (None, 40, 80, 200)
FOLDERS = {'short': 's', 'long': f'{"a-long-name/" * 14}and [some] words'}
LABELS = ('a plate of 2.5 mm ridges, left half', 'a plate of 2.5 mm ridges, right half')
PORT = '/dev/serial/by-id/usb-maker_of_load_cells_with_a_long_name_0123456789-if00-port0'
UNSEEN = f'{PORT}-which-does-not-exist'

# Name, arguments, exit code, and texts that must each be on one line; {...} are paths.
CASES = [
    ('show-archive', 'show {archive}', 0, ['archive {archive}']),
    ('show-row', 'show {archive}', 0, [LABELS[0], PORT]),
    ('show-bag', 'show {bag}', 0, ['bag {bag}']),
    ('show-objects', 'show {bag}', 0, ['none, pla, rubber_shell, solid_rubber, sponge']),
    ('show-model', 'show {model}', 0, ['{model}: stiffness']),
    ('show-models', 'show {models}', 2, ['tactile: {models} is', 'such as {model}']),
    ('status', 'experiment status {experiment}', 0, ['tactile experiment ', '{experiment}']),
    ('new', 'experiment new {new}.yaml --objects R1,C1', 0, ['tactile experiment ', '{new}.yaml']),
    ('devices', 'devices --port {port}', 0, ['{port}', 'no such port; check the cable']),
    ('check', 'check --sensor {port}', 1, ['sensor on {port}']),
    ('check-problem', 'check --sensor {port}', 1, ['WRONG', '{port}:', 'there is no such device']),
    ('export', 'export {archive} -o {new}.csv', 0, ['{new}.csv: 12 trials', 'columns: ']),
    ('import', 'import {table} -o {new}.npz --label-column label', 0, ['{new}.npz: 12 trials']),
    ('repair', 'repair {bag} -o {new}', 0, ['{new}: ', 'messages']),
    ('features', 'features {bag} -o {new}.csv', 0, ['{new}.csv: stiffness']),
    (
        'evaluate',
        'evaluate {bag} --folds 3 --features stiffness_regression',
        0,
        ['3 nearest neighbours', '80.0 ± 0.0'],
    ),
    ('train', 'train {bag} -o {new} --folds 3 --classifier knn', 0, ['{new}/stiffness_']),
    ('classify', 'classify {bag} --model {model}', 0, ['predictions match the label']),
    ('simulate', 'simulate stiffness -o {new} --trials 1 --sessions 1', 0, ['{new}/', 'trials']),
    ('replay', 'replay {bag} --no-nodes', 2, ['{bag} contains no features', 'can use it anyway']),
    ('no-such-path', 'show {new}', 2, ["Path '{new}' does not exist."]),
    ('wrong-option', 'show {archive} --plto x', 2, ['No such option', '--plto']),
    ('refusal', 'show {archive} --plot {new}.doc', 2, ['--plot is {new}.doc; it must end in']),
]
ALL_WIDTHS = {
    'show-archive', 'show-row', 'show-objects', 'show-models', 'devices', 'check', 'check-problem',
    'no-such-path', 'refusal',
}  # fmt: skip
"""Fast commands that together use every kind of output; they run with each width of the terminal.
The other commands run at 40 columns only."""

PROGRAM = """
import json, os, sys
import tactile_lab.__main__
from tactile_lab import program
for width, arguments in json.load(open(sys.argv.pop())):
    os.environ.pop('COLUMNS', None)
    if width:
        os.environ['COLUMNS'] = str(width)
    sys.argv = ['tactile', *arguments]
    try:
        code = program.main()
    except SystemExit as end:
        code = end.code
    sys.stderr.flush()
    print(f'@end {code}', flush=True)
"""


def choose_widths(name):
    return WIDTHS if name in ALL_WIDTHS else (40,)


@pytest.fixture(scope='module')
def run_all(stiffness_bag, trained, tmp_path_factory):
    """Return a function that runs the commands in a folder and returns their outputs."""

    @functools.cache
    def run_all(folder_name, is_terminal):
        folder = tmp_path_factory.mktemp('w') / FOLDERS[folder_name]
        paths = make_files(folder, stiffness_bag, trained)
        asked = {
            (name, width): [
                part.format(**paths, new=folder / f'{name}-{width}') for part in arguments.split()
            ]
            for name, arguments, *_ in CASES
            if name in ALL_WIDTHS or not is_terminal
            for width in choose_widths(name)
        }
        calls = folder / 'calls.json'
        calls.write_text(json.dumps([(width, asked[name, width]) for name, width in asked]))
        run = run_on_terminal if is_terminal else run_in_pipe
        said = run([sys.executable, '-c', PROGRAM, str(calls)])
        *outputs, rest = re.split(r'@end (.*)\r?\n', said)
        assert not rest
        ended = zip(outputs[::2], map(int, outputs[1::2]), strict=True)
        return paths, folder, dict(zip(asked, ended, strict=True))

    return run_all


def make_files(folder, bag, models):
    """Make the files that the commands read; return their paths by the names in `CASES`."""
    folder.mkdir(parents=True)
    x = np.random.default_rng(0).normal(size=(12, 1, 60))
    columns = {'label': LABELS * 6, 'port': [PORT] * 6 + [PORT[:-1]] * 6}
    np.savez(folder / 'archive.npz', x=x, rate_hz=60.0, **columns)
    rows = [f'{i},{k / 60},{x[i, 0, k]},R{i % 2}' for i in range(12) for k in range(60)]
    (folder / 'table.csv').write_text('\n'.join(['trial,time_s,force_n,label', *rows]))
    shutil.copytree(bag, folder / 'bag')
    shutil.copytree(models, folder / 'models')
    plan = ExperimentPlan('plan', 'texture', objects=('R1', 'C1'), contacts=('flexion',))
    ExperimentFolder(folder / 'experiment').set_up(plan)
    (model,) = (folder / 'models').glob('*.npz')
    names = {'archive': 'archive.npz', 'table': 'table.csv', 'bag': 'bag', 'models': 'models'}
    paths = {name: folder / file for name, file in names.items()}
    return {**paths, 'experiment': folder / 'experiment', 'model': model, 'port': UNSEEN}


def run_in_pipe(command):
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300
    )
    return done.stdout


def run_on_terminal(command):
    parent, child = pty.openpty()
    environment = {**os.environ, 'TERM': 'xterm'}
    process = subprocess.Popen(command, stdin=child, stdout=child, stderr=child, env=environment)
    os.close(child)
    said = []

    def read():
        try:
            while data := os.read(parent, 65_536):
                said.append(data)
        except OSError:  # the program has closed its end
            pass

    reader = threading.Thread(target=read)
    reader.start()
    process.wait(300)
    reader.join()
    os.close(parent)
    return re.sub(r'\x1b\[[0-9;?]*[A-Za-z]', '', b''.join(said).decode())


RUNS = [
    (name, folder, width, expected, code)
    for name, _, code, expected in CASES
    for folder in FOLDERS
    for width in choose_widths(name)
]
NAMES = [f'{name}-{folder}-{width}' for name, folder, width, *_ in RUNS]


@pytest.mark.parametrize(('name', 'folder', 'width', 'expected', 'code'), RUNS, ids=NAMES)
def test_in_a_pipe_each_row_is_one_line(run_all, name, folder, width, expected, code):
    paths, home, outputs = run_all(folder, is_terminal=False)
    said, ended = outputs[name, width]
    assert ended == code, said
    wanted = [text.format(**paths, new=home / f'{name}-{width}') for text in expected]
    assert any(all(text in line for text in wanted) for line in said.splitlines()), said


@pytest.mark.parametrize('name', sorted(ALL_WIDTHS))
def test_in_a_pipe_the_output_does_not_depend_on_the_width(run_all, name):
    *_, outputs = run_all('long', is_terminal=False)
    said = {outputs[name, width][0].replace(f'{name}-{width}', '') for width in WIDTHS}
    assert len(said) == 1


@pytest.mark.parametrize('name', sorted(ALL_WIDTHS))
@pytest.mark.parametrize('folder', FOLDERS)
@pytest.mark.parametrize('width', WIDTHS[1:])
def test_on_a_terminal_names_and_paths_are_not_broken(run_all, name, folder, width):
    paths, home, outputs = run_all(folder, is_terminal=True)
    said, _ = outputs[name, width]
    (expected,) = (expected for each, _, _, expected in CASES if each == name)
    if name == 'show-row':  # a column of the archive, which a narrow terminal hides
        expected = [text for text in expected if text != PORT or width > 80]
        assert (PORT in said) == (width > 80)
        assert ('with `| cat`: port' in said) == (width <= 80)
    for text in expected:
        wanted = text.format(**paths, new=home / f'{name}-{width}')
        is_name = ('/' in wanted and ', ' not in wanted) or wanted in LABELS
        lines = said.splitlines() if is_name else [' '.join(re.sub('[│┃]', ' ', said).split())]
        assert any(wanted in line for line in lines), said
    assert '…' not in said


def test_on_a_terminal_lists_are_folded_between_values(run_all):
    *_, outputs = run_all('short', is_terminal=True)
    for width, lines in ((40, 2), (80, 1)):
        said, _ = outputs['show-objects', width]
        facts = said.split('trial_id')[0]  # omit the table of trials
        rows = [row for row in facts.splitlines() if 'none,' in row or 'sponge' in row]
        assert len(rows) == lines
