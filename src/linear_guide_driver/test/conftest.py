# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import sys

import pytest

# The scripted devices are in the folder of the tests and are not part of the package.
sys.path.insert(0, str(Path(__file__).parent / 'peers'))

from scripted_grbl import ScriptedGrbl
from scripted_servo import ScriptedServo


@pytest.fixture
def grbl():
    peer = ScriptedGrbl()
    yield peer
    peer.close()


@pytest.fixture
def servo():
    peer = ScriptedServo()
    yield peer
    peer.close()
