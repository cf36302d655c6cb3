# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A fixture that spins nodes until the end of a test."""

import threading

import pytest

from tactile_ros.node_group import NodeGroup
from tactile_testing.waiting import wait_until


@pytest.fixture
def spun(context):
    """Return a function that spins the passed nodes in a `NodeGroup`."""
    groups = []

    def start(*nodes, **options):
        groups.append(NodeGroup(nodes, context=context, **options).__enter__())
        return groups[-1]

    yield start
    for group in reversed(groups):
        group.close()
    wait_until(lambda: not [t for t in threading.enumerate() if t.name.startswith('topics of')])
