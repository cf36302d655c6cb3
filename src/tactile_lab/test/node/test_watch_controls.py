# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The buttons of the live page against services that answer late."""

import asyncio
import threading

import pytest
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_lab.watch import controls
from tactile_lab.watch.controls import WatchControls
from tactile_lab.watch.node import WatchNode
from tactile_lab.watch.state import WatchState
from tactile_ros.errors import TactileError
from tactile_ros.programs.node_group import NodeGroup
from tactile_testing.waiting import wait_until

STOP = '/late/linear_guide/stop'


def test_stop_reaches_the_rig_after_an_answer_that_came_too_late(context, monkeypatch):
    monkeypatch.setattr(controls, 'ANSWER_TIMEOUT_S', 0.2)
    calls, may_answer = [], threading.Event()

    def stop(_, response):
        calls.append('stop')
        may_answer.wait(10.0)
        response.success = True
        return response

    guide = Node('guide', context=context)
    guide.create_service(Trigger, STOP, stop)
    state = WatchState()
    state.finger('late')
    watch = WatchNode(state, context)
    with NodeGroup([guide], context), NodeGroup([watch], context) as group:
        wait_until(lambda: STOP in watch.control_clients)
        client = watch.control_clients[STOP]
        wait_until(client.service_is_ready)
        buttons = WatchControls(watch, context)
        with pytest.raises(TactileError, match='no confirmation from late/linear_guide/stop'):
            asyncio.run(buttons.stop())
        may_answer.set()
        wait_until(lambda: not client._pending_requests, 'the late answer never came')
        monkeypatch.setattr(controls, 'ANSWER_TIMEOUT_S', 10.0)
        assert asyncio.run(buttons.stop()) == 'stopped'
        assert calls == ['stop', 'stop']
        assert not group.ended.is_set()
