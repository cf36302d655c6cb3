# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The buttons of the live page."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from rclpy.context import Context

from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.watch.node import CANCEL, place_of, TARE, WatchNode
from tactile_ros.errors import TactileError
from tactile_ros.node.requests import send
from tactile_ros.programs.node_group import NodeGroup

ANSWER_TIMEOUT_S = 5.0


class WatchControls:
    """What the buttons do, over services and actions of the fingers' nodes.

    Parameters
    ----------
    node : WatchNode
    context : rclpy.context.Context
    before_trial : callable
        Given the request of a trial before it starts: puts the object under a simulated finger.
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
        """Give everything back."""
        for _, group in self._operators.values():
            group.close()
        self._operators = {}

    async def stop(self) -> str:
        """Cancel the trial, and stop guide and tendon, of every finger; all at the same time.

        Raises
        ------
        TactileError
            When there is nothing to stop, or something has not confirmed it.
        """
        self._node.state.was_stopped = True
        clients = {p: c for p, c in self._node.control_clients.items() if not p.endswith(TARE)}
        if not clients:
            raise TactileError('stop: nothing is known here that moves')
        # The cancellation goes first: a trial that is cancelled is not repeated.
        order = sorted(clients, key=lambda path: not path.endswith(CANCEL))
        answers = await asyncio.gather(
            *(self._call(clients[path], path) for path in order), return_exceptions=True
        )
        silent = [
            path
            for path, answer in zip(order, answers, strict=True)
            if isinstance(answer, BaseException) or getattr(answer, 'success', True) is False
        ]
        if silent:
            names = ', '.join(path.strip('/') for path in silent)
            raise TactileError(
                f'stop: no confirmation from {names}; bring the rig to rest with its switch'
            )
        return 'stopped'

    async def tare(self, finger: str) -> str:
        """Set the tension to zero."""
        path = place_of(finger, TARE)
        client = self._node.control_clients.get(path)
        if client is None:
            raise TactileError(f'tare: there is no service {path}')
        answer = await self._call(client, path)
        if not answer.success:
            raise TactileError(f'tare: {answer.message}')
        return f'tare: {answer.message}'

    async def home(self, finger: str) -> str:
        """Home the guide."""
        return await asyncio.to_thread(self._operator(finger).home_guide)

    async def trial(self, finger: str, request: TrialRequest) -> str:
        """Run a trial."""
        operator = self._operator(finger)

        def run() -> str:
            self._before_trial(request)
            return f'trial {operator.run_trial(request)} done'

        return await asyncio.to_thread(run)

    def _operator(self, finger: str) -> OperatorNode:
        if finger not in {f.name for f in self._node.state.fingers}:
            raise TactileError(f'there is no finger "{finger}"')
        if finger not in self._operators:
            operator = OperatorNode((), self._context, finger, name='watch_operator')
            group = NodeGroup([operator], self._context)
            group.__enter__()
            self._operators[finger] = (operator, group)
        return self._operators[finger][0]

    async def _call(self, client: Any, path: str) -> Any:
        request = client.srv_type.Request()
        answer = asyncio.wrap_future(send(self._node, lambda: client.call_async(request)))
        try:
            return await asyncio.wait_for(answer, ANSWER_TIMEOUT_S)
        except asyncio.TimeoutError:
            raise TactileError(f'{path} does not answer within {ANSWER_TIMEOUT_S:g} s') from None
