# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from contextlib import ExitStack
import dataclasses

import pytest

from linear_guide_driver import TendonActuatorClient, TendonActuatorConfig


@pytest.fixture
def config(servo):
    # A loaded machine may pause a test for longer than the watchdog of a real rig.
    return TendonActuatorConfig(port=servo.port, watchdog_s=1.0, speed_m_s=0.04, unguarded=True)


@pytest.fixture
def connect(config):
    """Return what makes a connected client with other parameters."""
    with ExitStack() as stack:

        def make(*arguments, **changes):
            client = TendonActuatorClient(dataclasses.replace(config, **changes), *arguments)
            stack.callback(client.close)
            client.connect()
            return client

        yield make


@pytest.fixture
def tendon(connect):
    return connect()
