# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import os

import pytest
from typer.testing import CliRunner

from tactile_lab.cli import main as cli
from tactile_ros.programs.transports import PROFILES, TRANSPORTS


@pytest.mark.parametrize(('before', 'after'), [(None, 'LOCALHOST'), ('SUBNET', 'SUBNET')])
def test_commands_stay_on_this_computer_unless_told_otherwise(monkeypatch, before, after):
    name = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
    for variable in ('RMW_IMPLEMENTATION', name, TRANSPORTS, *PROFILES):
        monkeypatch.setenv(variable, '')  # so that it is restored
        monkeypatch.delenv(variable)
    if before is not None:
        monkeypatch.setenv(name, before)
    monkeypatch.setattr('sys.argv', ['tactile', '--help'])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0
    assert os.environ[name] == after


@pytest.mark.parametrize('arguments', [['evalute'], ['evaluate', 'x', '--tak', 'texture']])
def test_what_is_mistyped_is_named_once(arguments):
    done = CliRunner().invoke(cli.app, arguments)
    assert done.exit_code == 2
    assert done.output.count('Did you mean') == 1


def test_help_describes_arguments():
    # Click 8.5 keeps a help of its own for arguments, and Typer's was lost.
    for command, text in (('import', 'CSV'), ('show', '(.onnx)'), ('repair', 'never closed')):
        found = CliRunner().invoke(cli.app, [command, '--help'])
        assert text in ' '.join(found.output.split('Options')[0].split())
