# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import threading

import pytest

from tactile_bringup.launch_config.graph import NodeDescription
from tactile_bringup.nodes.graph_runner import running_graph
from tactile_ros.errors import TactileError

RUNNER = NodeDescription('trial_runner')


def test_a_callback_that_fails_is_told_at_once_and_at_the_end(context):
    ended = threading.Event()

    def fail():
        raise ZeroDivisionError('a bug')

    def run():
        with running_graph([RUNNER], context, on_end=ended.set) as nodes:
            nodes['trial_runner'].create_timer(0.01, fail)
            assert ended.wait(10.0)

    with pytest.raises(TactileError, match='a node failed, so all nodes were ended: a bug'):
        run()
