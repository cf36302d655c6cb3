# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tutorial of a hand runs as it is written: SIMULATED tension, in real time, over real DDS."""

from contextlib import ExitStack

from page_commands import read_page, ROOT, Terminal, UNTIL_CTRL_C
import pytest

PAGE = ROOT / 'docs' / 'tutorials' / 'hand_with_two_fingers.md'
if not PAGE.is_file():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)


HAND = 'python my_hand.py'
"""The program that moves; the reader then ends the nodes with Ctrl-C."""


def test_commands_of_the_hand_run_as_written(tmp_path):
    terminal = Terminal(tmp_path)
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
                terminal.run(command)


def run_hand(terminal, command):
    """Run the hand; once more if labels are missing because a busy computer delayed samples."""
    try:
        terminal.run(command)
    except AssertionError:
        terminal.run(command)
