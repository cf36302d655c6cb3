# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated rig that each test may break."""

import pytest

from tactile_sim import SimulatedRig


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=3) as rig:
        yield rig


@pytest.fixture(autouse=True)
def _sound_again(rig):
    yield
    for device in ('sensor', 'guide', 'tendon'):
        rig.fault(device, 'none')
