# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Watch fingers and serve the live page, for commands that run nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
import os

from rclpy.context import Context

from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.watch.access import WatchOptions
from tactile_lab.watch.node import WatchNode
from tactile_lab.watch.state import WatchState
from tactile_ros.node_group import NodeGroup


@dataclass
class Watch:
    """The state of the fingers, and the address of the page; None if no page is served."""

    state: WatchState
    address: str | None = None


@contextmanager
def watching(
    context: Context,
    options: WatchOptions | None = None,
    *,
    simulated: bool = False,
    objects: Mapping[str, Sequence[str]] | None = None,
    before_trial: Callable[[TrialRequest], object] = lambda request: None,
    answers_only: bool = False,
) -> Iterator[Watch]:
    """Watch the fingers of a ROS context until the block ends.

    If ``options`` is given, serve a live page.

    Parameters
    ----------
    simulated : bool
        True if the rig is known to be simulated. Messages of simulated trials also state this.
    objects : mapping
        For each protocol, labels that the page proposes for a trial.
    before_trial : callable
        Called with the request of a trial before the page starts it.
    answers_only : bool
        Subscribe only to events and predictions, to print them in the terminal.
    """
    reach = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET').lower()
    where = f'ROS domain {context.get_domain_id()}, range {reach}'
    watch = Watch(WatchState(where, objects, simulated=simulated))
    with ExitStack() as stack:
        node = WatchNode(watch.state, context, answers_only=answers_only)
        stack.enter_context(NodeGroup([node], context))
        if options is not None:
            # Imported lazily: the web server takes 15 MB.
            from tactile_lab.watch.controls import WatchControls
            from tactile_lab.watch.server import WatchServer

            controls = WatchControls(node, context, before_trial)
            stack.callback(controls.close)
            server = stack.enter_context(WatchServer(watch.state, controls, options))
            watch.address = server.address
        yield watch
