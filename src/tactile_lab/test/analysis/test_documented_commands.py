# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every command of README.md and docs/ runs as it is written, in order, in a folder per page.

The commands of `tactile` run in the process of the test, which is faster than one process per
command. Few random convolutions are fitted, unless the predictions on a page need all of them.
The commands of how-to pages read small recordings of `page_files`, on which their output depends.
Pages with commands that run until Ctrl-C are tested in test/node.
"""

import glob
from importlib.util import find_spec
import re
import shlex

from page_commands import (
    check_shown,
    Command,
    NOT_RUN,
    PAGES,
    read_page,
    ROOT,
    Terminal,
    UNTIL_CTRL_C,
)
from page_files import FILES, keep, make_files, Recordings
import pytest
from tactile_command import ask_tactile, tactile

from tactile_analysis import read_tables
from tactile_classifier import train, write_model
from tactile_lab import program
from tactile_lab.experiment.folder import ExperimentFolder
from tactile_lab.experiment.journal import BEGAN, ENDED, GOOD, Journal, note
from tactile_lab.experiment.plan import read_plan
from tactile_ros.topics import EVENT

if not (ROOT / 'docs').is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)

OF_THE_WORKSPACE = {'build', 'clean', 'docs', 'run', 'shell', 'test'}

COMMANDS = {page: read_page(page)[0] for page in PAGES}

EVALUATED_ELSEWHERE = 'tactile evaluate bags/* --report report.html'
"""Command that is not run: evaluation.md repeats it with a comment, and the repetition is run."""

HOW_TO = {'experiments.md', *(page for page, _ in FILES)}


NEEDS_ALL_CONVOLUTIONS = 'tactile train lab.npz --task texture --crop 1.5:5'
"""Command that fits all random convolutions, because the page shows predictions of its model."""


def is_run_here(page):
    run = [command for command in COMMANDS[page] if command.is_run]
    return (
        run
        and page.name not in HOW_TO
        and not any(UNTIL_CTRL_C.match(command.text) for command in run)
    )


@pytest.mark.parametrize(
    'page', filter(is_run_here, PAGES), ids=lambda page: str(page.relative_to(ROOT))
)
def test_commands_run_as_written(page, tmp_path, rewrite, monkeypatch, few_convolutions):
    terminal = Terminal(tmp_path)
    monkeypatch.chdir(terminal.folder)
    for name, text in read_page(page)[1].items():
        (terminal.folder / name).parent.mkdir(exist_ok=True)
        (terminal.folder / name).write_text(text)
    for command in COMMANDS[page]:
        if command.text.startswith(NEEDS_ALL_CONVOLUTIONS):
            few_convolutions.undo()
        if command.is_run:
            check_shown(command, run_here(command, terminal))
        elif plan := re.match(r'tactile experiment (\w+)\.yaml --simulated --yes', command.text):
            record_experiment(terminal.folder / plan[1], rewrite)


@pytest.fixture(scope='module')
def recordings(texture_bag, stiffness_bag, rewrite, tmp_path_factory):
    folder = tmp_path_factory.mktemp('recordings')

    def bag(name, source, *change):
        return rewrite(source, folder / name, keep(*change))

    old = bag('old', texture_bag, '-0000$')
    (table,) = read_tables([old]).values()
    write_model(folder / 'old.npz', train(table, 'knn'))
    return Recordings(
        texture=bag('texture', texture_bag, '-(R1|F)-', (0.015, 0.02)),
        old=old,
        new=bag('new', texture_bag, '-0001$'),
        holds={label: bag(label, stiffness_bag, f'-{label}-') for label in ('sponge', 'pla')},
        grooves=texture_bag,
        model=folder / 'old.npz',
    )


@pytest.mark.usefixtures('few_convolutions')
@pytest.mark.parametrize('name', sorted(HOW_TO))
def test_commands_of_how_to_pages_run_as_written(name, recordings, rewrite, tmp_path, monkeypatch):
    (page,) = (page for page in PAGES if page.name == name)
    terminal = Terminal(tmp_path)
    folder, done = terminal.folder, set()
    monkeypatch.chdir(folder)
    for command in COMMANDS[page]:
        if not command.is_run:
            continue
        if command.text == 'tactile evaluate grooves':
            record_experiment(folder / 'grooves', rewrite, recordings.grooves)
        make_files(page, command, folder, recordings, done)
        if command.text != EVALUATED_ELSEWHERE:
            said = run_here(command, terminal)
            if SHOWS_ITS_FILES.match(command.text):
                check_shown(command, said)
    assert done == {key for key in FILES if key[0] == name}


def run_here(command, terminal):
    """Run one command, in this process if it is `tactile`; patterns are expanded as in a shell.

    Returns the output.
    """
    program, *words = shlex.split(command.text.replace('\\\n', ' '), comments=True)
    if program != 'tactile':
        if 'import pandas' in command.text and find_spec('pandas') is None:
            return ''  # only an environment that is older than requirements/packages.txt
        return terminal.run(Command(command.text))
    expanded = [
        path for word in words for path in (sorted(glob.glob(word)) if '*' in word else [word])
    ]
    result = tactile(*expanded)
    said = result.stdout + result.stderr
    assert result.returncode == command.exit_code, f'$ {command.text}\n{said}'
    return said


SHOWS_ITS_FILES = re.compile(r'tactile (import|classify|train lab)')
"""Commands whose output must equal the page. The output of others depends on the recordings."""


def record_experiment(path, rewrite, bag=None):
    """Fill the folder of an experiment with simulated trials, without running it in real time.

    If ``bag`` is None, all planned trials are simulated. Otherwise, the trials are taken from this
    bag; the journal has all planned trials, but the bag may contain fewer.
    """
    if path.exists():
        return
    plan = read_plan(path.with_suffix('.yaml'))
    folder = ExperimentFolder(path)
    folder.set_up(plan)
    order = folder.read_order()
    if bag is None:
        options = ('--trials', plan.mountings * plan.trials, '--sessions', plan.sessions)
        scratch = path.with_name('simulated')
        contact = ('--contact', plan.contacts[0])
        ask_tactile('simulate', plan.protocol, *contact, *options, '-o', scratch)
        (bag,) = scratch.iterdir()
    left, planned = list(order), {}

    def plan_trial(type_name, message):
        """Change a simulated trial to the next planned trial of its object, if there is one."""
        if type_name != EVENT:
            return message
        if message.trial_id not in planned:
            fitting = [trial for trial in left if trial.object_label == message.object_label]
            planned[message.trial_id] = next(iter(fitting), None)
            left[:] = [trial for trial in left if trial not in fitting[:1]]
        trial = planned[message.trial_id]
        if trial is None:
            return None
        message.trial_id, message.session_id = trial.key, trial.session_id
        message.mounting_id = name_mounting(trial)
        return message

    rewrite(bag, folder.bags / f'{plan.session_ids[0]}-01', plan_trial)
    with Journal(folder.journal) as journal:
        for trial in order:
            mounting_id = name_mounting(trial)
            note(journal, BEGAN, key=trial.key, trial_id=trial.key, mounting_id=mounting_id)
            ended = {'verdict': GOOD, 'sentence': '', 'statistics': {}, 'seconds': 1.0}
            note(journal, ENDED, trial_id=trial.key, **ended)


def name_mounting(trial):
    return f'{trial.session_id}-m{trial.mounting:02d}'


def test_patterns_of_commands_that_are_not_run_still_occur():
    texts = [command.text for commands in COMMANDS.values() for command in commands]
    gone = [row for row in NOT_RUN if not any(re.match(row, text) for text in texts)]
    assert not gone, 'take them out of NOT_RUN'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_are_in_console_blocks_and_their_options_exist(page):
    text = page.read_text('utf-8')
    assert not re.search(r'^ *```(sh|bash|shell)\b', text, re.MULTILINE), 'write ```console'
    outside = re.sub(r'```.*?```', '', text, flags=re.DOTALL)
    inline = re.findall(r'`(?:\./)?(tactile [a-z][^`]*)`', outside)
    for words in [*inline, *(c.text for c in COMMANDS[page] if c.text.startswith('tactile '))]:
        check_options(shlex.split(words.replace('\n', ' '), comments=True)[1:])


def check_options(words):
    """Check that a command and each of its options exist."""
    if words[0] in OF_THE_WORKSPACE or words[0].startswith('-'):
        return
    assert words[0] in program.COMMANDS, words
    command = program.load_command(words[0])
    if subcommands := getattr(command, 'commands', None):
        command = subcommands[words[1] if words[1:] and words[1] in subcommands else 'run']
    known = {name for item in command.params for name in (*item.opts, *item.secondary_opts)}
    given = {word for word in words if word.startswith('--')}
    assert given <= {*known, '--help'}, f'{words}: no {given - known}'


def test_launch_arguments_exist():
    # Another test compares the tables of this page with the code.
    page = (ROOT / 'docs' / 'parameters.md').read_text('utf-8')
    page = page.split('## Arguments of the launch files')[1]
    known = {}
    for files, table in re.findall(r'^(\*\*`[^\n]*)\n\n(.*?)\n\n', page, re.MULTILINE | re.DOTALL):
        for name in re.findall(r'`(\w+)\.launch\.py`', files):
            known[name] = set(re.findall(r'^\| `(\w+)` \|', table, re.MULTILINE))
    checked = 0
    for page in PAGES:
        text = page.read_text('utf-8').replace('\\\n', ' ')
        for name, arguments in re.findall(
            r'ros2 launch tactile_bringup (\w+)\.launch\.py(.*)', text
        ):
            given = set(re.findall(r'(\w+):=', arguments.partition('`')[0]))
            assert given <= known[name], f'{page.name}: {name} has no {given - known[name]}'
            checked += 1
    assert checked > 10
