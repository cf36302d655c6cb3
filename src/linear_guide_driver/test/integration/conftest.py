# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from contextlib import ExitStack
import dataclasses

import pytest

from linear_guide_driver import TendonActuatorClient, TendonActuatorConfig


@pytest.fixture
def config(servo):
    return TendonActuatorConfig(
        port=servo.port,
        watchdog_s=0.4,
        speed_m_s=0.04,
        unguarded=True,
        flexion_current_a=0.3,
        abduction_current_a=0.3,
    )


@pytest.fixture
def connect(config):
    """Return a function that creates a connected client with other parameters."""
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
