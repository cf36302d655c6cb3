# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The unit file starts an existing launch file, and ends it without leaving nodes."""

from configparser import ConfigParser
from pathlib import Path
import re
import shlex

import pytest

PACKAGE = Path(__file__).resolve().parents[2]
LAUNCHING = PACKAGE / 'tactile_bringup' / 'launch_config' / 'launching.py'
KILL_AFTER_S = 5
"""Default time between SIGTERM and SIGKILL in launch [s]."""


@pytest.fixture(scope='module')
def service():
    parser = ConfigParser(interpolation=None)
    parser.optionxform = str
    parser.read_string((PACKAGE / 'systemd' / 'tactile-hand.service').read_text())
    return parser['Service']


def test_it_starts_an_existing_launch_file(service):
    shell, option, commands = shlex.split(service['ExecStart'])
    assert (shell, option) == ('/bin/bash', '-c')
    *sources, launch = commands.split(' && ')
    assert sources
    assert all(source.startswith('source /') for source in sources)
    # Without exec, the main process would be the shell, which does not forward signals.
    words = launch.split()
    assert words[:4] == ['exec', 'ros2', 'launch', 'tactile_bringup']
    assert (PACKAGE / 'launch' / words[4]).is_file()


def test_it_is_ended_by_sigint_to_launch_alone_and_launch_has_time_to_end_its_nodes(service):
    assert service['KillSignal'] == 'SIGINT'
    assert service['KillMode'] == 'mixed'
    (ends_within_s,) = re.findall(r"^ENDS_WITHIN_S = '(\d+)'$", LAUNCHING.read_text(), re.M)
    assert int(service['TimeoutStopSec']) > int(ends_within_s) + KILL_AFTER_S


def test_a_launch_that_fails_is_started_again(service):
    assert service['Restart'] == 'on-failure'
