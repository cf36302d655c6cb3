# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The actions of the buttons on the live page."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
import time
from typing import Any

from rclpy.context import Context

from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.watch.node import CANCEL, place_of, RELEASES, RESETS, TARE, WatchNode
from tactile_ros.errors import TactileError
from tactile_ros.goal_client import call_until_answered
from tactile_ros.node_group import NodeGroup

ANSWER_TIMEOUT_S = 5.0
FIND_TIMEOUT_S = 0.5
POLL_S = 0.02
REMEDY = 'bring the rig to rest with its switch'


class WatchControls:
    """The actions of the buttons on the live page. They call services and actions of the nodes.

    ``before_trial`` is called with the request before a trial starts. With a simulated rig, it
    mounts the object under the finger.
    """

    def __init__(
        self,
        node: WatchNode,
        context: Context,
        before_trial: Callable[[TrialRequest], object] = lambda request: None,
    ) -> None:
        self._node = node
        self._context = context
        self._before_trial = before_trial
        self._operators: dict[str, tuple[OperatorNode, NodeGroup]] = {}

    def close(self) -> None:
        """Destroy all clients and nodes."""
        for _, group in self._operators.values():
            group.close()
        self._operators = {}

    async def stop(self) -> str:
        """End sessions, cancel trials, stop guides and tendons, all in parallel.

        The rigs remain stopped until `reset`. Returns a sentence with the names of the nodes that
        have confirmed. Raises `TactileError` when no node can be stopped, or one has not
        confirmed.
        """
        self._node.state.was_stopped = True
        for operator, _ in self._operators.values():
            with suppress(RuntimeError):  # the executor of the operator node has been shut down
                operator.stop()
        clients = self._node.stop_clients()
        # Sessions are ended first, so that they do not repeat a cancelled trial.
        order = sorted(clients, key=lambda path: not path.endswith(CANCEL))
        answers = await asyncio.gather(
            *(self._stop_one(clients[path], path) for path in order), return_exceptions=True
        )
        # Dictionaries omit duplicates: a trial runner has two services, so its name occurs twice.
        confirmed: dict[str, None] = {}
        silent: dict[str, None] = {}
        for path, answer in zip(order, answers, strict=True):
            if answer is None:
                continue
            is_bad = isinstance(answer, BaseException) or getattr(answer, 'success', True) is False
            (silent if is_bad else confirmed)[_node_name(path)] = None
        if not silent and not confirmed:
            raise TactileError(f'stop: no node was found that can be stopped; {REMEDY}')
        if silent:
            raise TactileError(f'stop: not confirmed by {", ".join(silent)}; {REMEDY}')
        return f'stop: confirmed by {", ".join(confirmed)}'

    async def release(self) -> str:
        """Slacken all tendons."""
        return await self._ask_all('release', RELEASES)

    async def reset(self) -> str:
        """End the stopped state of all rigs. Nothing moves, and no session continues."""
        return await self._ask_all('reset', RESETS)

    async def _ask_all(self, action: str, names: tuple[str, ...]) -> str:
        """Call services of all fingers in parallel; raise `TactileError` when one refuses."""
        clients = self._node.clients_of(names)
        answers = await asyncio.gather(
            *(self._stop_one(client, path) for path, client in clients.items()),
            return_exceptions=True,
        )
        done: list[str] = []
        for path, answer in zip(clients, answers, strict=True):
            if isinstance(answer, BaseException):
                raise TactileError(f'{action}: {answer}')
            if answer is not None and not answer.success:
                raise TactileError(f'{action}: {_node_name(path)}: {answer.message}')
            if answer is not None:
                done.append(_node_name(path))
        if not done:
            raise TactileError(f'{action}: no node was found that has this service')
        return f'{action}: done by {", ".join(done)}'

    async def tare(self, finger: str) -> str:
        """Tare the sensor of a finger."""
        path = place_of(finger, TARE)
        client = self._node.client_of(path)
        if client is None:
            raise TactileError(f'tare: there is no service {path}')
        answer = await self._call(client, path)
        if not answer.success:
            raise TactileError(f'tare: {answer.message}')
        return f'tare: {answer.message}'

    async def home(self, finger: str) -> str:
        """Home the guide of a finger."""
        return await asyncio.to_thread(self._operator(finger).home_guide)

    async def trial(self, finger: str, request: TrialRequest) -> str:
        """Run a trial with a finger."""
        operator = self._operator(finger)
        await asyncio.to_thread(self._before_trial, request)
        return f'{await asyncio.to_thread(operator.run_trial, request)}: done'

    def _operator(self, finger: str) -> OperatorNode:
        if finger not in {f.name for f in self._node.state.fingers}:
            raise TactileError(f'there is no finger "{finger}"')
        if finger not in self._operators:
            operator = OperatorNode(self._context, finger, name='watch_operator')
            group = NodeGroup([operator], self._context)
            group.__enter__()
            self._operators[finger] = (operator, group)
        operator = self._operators[finger][0]
        operator.resume()
        return operator

    async def _stop_one(self, client: Any, path: str) -> Any:
        """Call a service, and return its response.

        Return None if the service has no server, and its confirmation is not required.
        """
        if not self._node.must_confirm(path) and not await _is_there(client, FIND_TIMEOUT_S):
            return None
        return await self._call(client, path)

    async def _call(self, client: Any, path: str) -> Any:
        """Call a service repeatedly until it responds; return the response.

        The request may be executed twice, which does no harm for these services.
        """

        async def call() -> Any:
            await _is_there(client, ANSWER_TIMEOUT_S)
            request = client.srv_type.Request()
            answer = call_until_answered(self._node, client, request, ANSWER_TIMEOUT_S)
            return await asyncio.wrap_future(answer)

        try:
            return await asyncio.wait_for(call(), ANSWER_TIMEOUT_S)
        except asyncio.TimeoutError:
            raise TactileError(f'{path} has not responded within {ANSWER_TIMEOUT_S:g} s') from None


async def _is_there(client: Any, timeout_s: float) -> bool:
    """Wait until the client has found its server; return False after ``timeout_s``."""
    deadline_s = time.monotonic() + timeout_s
    while not client.service_is_ready():
        if time.monotonic() > deadline_s:
            return False
        await asyncio.sleep(POLL_S)
    return True


def _node_name(path: str) -> str:
    """Return the full name of a node from the full name of one of its services."""
    path = path.strip('/').removesuffix('/run_trial/_action/cancel_goal')
    for service in ('/stop', '/release', '/reset'):
        path = path.removesuffix(service)
    return path
