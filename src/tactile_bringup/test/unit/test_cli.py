# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import os

import pytest

from tactile_bringup import cli


@pytest.mark.parametrize(('before', 'after'), [(None, 'LOCALHOST'), ('SUBNET', 'SUBNET')])
def test_commands_stay_on_this_computer_unless_told_otherwise(monkeypatch, before, after):
    name = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
    monkeypatch.setenv(name, before or '')
    if before is None:
        monkeypatch.delenv(name)
    monkeypatch.setattr('sys.argv', ['tactile', '--help'])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0
    assert os.environ[name] == after
