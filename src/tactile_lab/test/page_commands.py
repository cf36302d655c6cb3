# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands and files of a documentation page, and a terminal that runs them.

In a ``console`` block, a line that begins with ``$`` is a command, and the other lines are its
output. If the first line of a code block is a comment with a file name (``# hand.yaml``), the
block is the content of this file."""

from contextlib import contextmanager
from dataclasses import dataclass, field
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

ROOT = Path(__file__).resolve().parents[3]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]

FENCE = re.compile(r'^( *)```(\w*)\n(.*?)^\1```$', re.MULTILINE | re.DOTALL)
FILE_NAME = re.compile(r'# ([\w./-]+\.(?:py|yaml))\b')

UNTIL_CTRL_C = re.compile(r'tactile (hand|sense|rig|watch)\b')
"""Pattern of commands that run until Ctrl-C, while other commands run in a second terminal."""

NOT_RUN = {
    r'tactile demo|\./tactile demo': 'minutes of real time: test_demo.py',
    r'tactile experiment \S+ --simulated --yes|tactile replay plates': (
        'minutes of real time, or needs the recording: test_experiment.py'
    ),
    r'tactile (trials|rig) .*--simulated|tactile watch$': (
        'minutes of real time: test_commands.py, test_live_rig.py, test_watch_page.py'
    ),
    r'\./tactile (test|run|shell)|python -m venv|venv/bin/': (
        'minutes, downloads, or an interactive shell: tools/wheel.py'
    ),
    r'ros2 |rosdep |colcon |cd src/tactile/src |layouts=|sed |plotjuggler |rviz2 ': (
        'ROS 2 from apt: the launch tests start the launch files'
    ),
    r'sudo |journalctl ': 'changes the computer',
    r'.*/dev/tty|tactile (devices|check|calibrate) ': 'needs devices or a sensor of the reader',
    r'tactile event ': 'needs the running nodes of a finger: test_topic_chain.py',
    r'tactile sense --sensor-topic|tactile hand .*--record grasps': (
        'needs the sensors of a hand: the tutorial of the hand, test_topic_chain.py'
    ),
    r'tactile train bags/\* -o models --(window|false-alarms)': (
        'half a minute each for a model of every length: test_early_answers.py'
    ),
    r'tactile simulate texture (-o bags --(trials 5|desc)|--contact flexion --trials 1[02])|'
    r'tactile simulate texture -o bags --contact flexion --speed 10': (
        'minutes of computation: the small recordings of page_files.py are used instead'
    ),
}
"""Patterns of commands that are not run, with the reason and the tests that cover them."""

FAILS = {'tactile import trial.csv --label pla': 2}
"""Exit codes of commands that fail on purpose, because their page explains the failure."""


TIMEOUT_S = 300.0
"""Much longer than a command needs [s], because the computer may be busy with other tests."""


@dataclass
class Command:
    """A command of a page, and the lines of its output that the page shows."""

    text: str
    shown: list[str] = field(default_factory=list)

    @property
    def is_run(self):
        return not any(re.match(pattern, self.text) for pattern in NOT_RUN)

    @property
    def exit_code(self):
        return next((FAILS[text] for text in FAILS if self.text.startswith(text)), 0)


def read_page(page):
    """Return the commands of a page, and the content of its files by name."""
    commands, files = [], {}
    for indent, language, body in FENCE.findall(page.read_text('utf-8')):
        lines = [line.removeprefix(indent) for line in body.splitlines()]
        if language == 'console':
            commands += read_commands(lines)
        elif lines and (name := FILE_NAME.match(lines[0])):
            files[name[1]] = '\n'.join(lines) + '\n'
    return commands, files


def read_commands(lines):
    commands, continues = [], False
    for line in lines:
        if continues:
            commands[-1].text += f'\n{line}'
        elif line.startswith('$ '):
            commands.append(Command(line[2:]))
        else:
            commands[-1].shown.append(line)
        continues = line.endswith('\\') and (continues or line.startswith('$ '))
    return commands


class Terminal:
    """Runs commands in a folder, with the ``tactile`` and ``python`` of the test."""

    def __init__(self, folder):
        self.folder = folder / 'page'
        self.folder.mkdir()
        programs = folder / 'bin'
        programs.mkdir()
        for name, arguments in (('tactile', '-m tactile_lab '), ('python', '')):
            (programs / name).write_text(f'#!/bin/sh\nexec {sys.executable} {arguments}"$@"\n')
            (programs / name).chmod(0o755)
        self._environment = {**os.environ, 'PATH': f'{programs}:{os.environ["PATH"]}'}

    def _start(self, text, output):
        return subprocess.Popen(
            ['bash', '-ec', text],
            cwd=self.folder,
            env=self._environment,
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def run(self, command):
        """Run a command to its end, check exit code and shown lines, and return its output."""
        with self._start(command.text, subprocess.PIPE) as process:
            try:
                output, _ = process.communicate(timeout=TIMEOUT_S)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        assert process.returncode == 0, f'$ {command.text}\n{output}'
        check_shown(command, output)
        return output

    @contextmanager
    def running(self, command):
        """Run a command during a ``with`` block, and end it with Ctrl-C after the block."""
        log = self.folder.with_name(f'{time.monotonic_ns()}.log')
        with log.open('w') as output:
            process = self._start(f'exec {command.text}', output)
        try:
            yield
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=60) == 0, log.read_text()
        finally:
            process.kill()
        check_shown(command, log.read_text())


def check_shown(command, output):
    """Check that a command has printed the lines that its page shows.

    On the page, ``...`` matches any text, and a number matches any number. A number after a
    letter, as in R1, matches only itself."""
    squeezed = ' '.join(output.split())
    for line in command.shown:
        pattern = re.escape(' '.join(line.split())).replace(r'\.\.\.', '.*')
        pattern = re.sub(r'(?<![A-Za-z\d])[\d:]+(\\\.\d+)?', r'[\\d.:]+', pattern)
        assert re.search(pattern, squeezed), f'$ {command.text}\n{line}\nis not in:\n{output}'
