# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands of the hand tutorial run as written: SIMULATED tension in real time, over DDS.

Commands that read or write files run in the process of the test, which saves their start.
"""

from contextlib import ExitStack
import glob
import shlex

from page_commands import check_shown, read_page, ROOT, Terminal, UNTIL_CTRL_C
import pytest
from tactile_command import tactile

PAGE = ROOT / 'docs' / 'tutorials' / 'hand_with_two_fingers.md'
if not PAGE.is_file():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)


HAND = 'python my_hand.py'
"""Command of the program that moves the hand. When it has ended, Ctrl-C ends the nodes."""


def test_commands_of_the_hand_tutorial_run_as_written(tmp_path, monkeypatch):
    """Takes more than 10 s, because the hand starts and moves twice."""
    terminal = Terminal(tmp_path)
    monkeypatch.chdir(terminal.folder)
    commands, files = read_page(PAGE)
    for name, text in files.items():
        (terminal.folder / name).write_text(text)
    with ExitStack() as nodes:
        for command in commands:
            if not command.is_run:
                continue
            if UNTIL_CTRL_C.match(command.text):
                nodes.enter_context(terminal.running(command))
            elif command.text == HAND:
                run_hand(terminal, command)
                nodes.close()
            else:
                run_here(command)


def run_here(command):
    program, *words = shlex.split(command.text)
    assert program == 'tactile', command.text
    done = tactile(*(path for word in words for path in sorted(glob.glob(word)) or [word]))
    said = done.stdout + done.stderr
    assert done.returncode == 0, f'$ {command.text}\n{said}'
    check_shown(command, said)


def run_hand(terminal, command):
    """Run the program of the hand; repeat it once if a busy computer has delayed samples."""
    try:
        terminal.run(command)
    except AssertionError:
        terminal.run(command)
