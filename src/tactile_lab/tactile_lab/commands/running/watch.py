# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile watch`: a live page beside nodes that run elsewhere."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from tactile_lab.commands.output import Output
from tactile_lab.watch.options import WatchOptions
from tactile_ros.programs.signals import hold_signals

if TYPE_CHECKING:
    from tactile_lab.watch.watching import Watch


def run_watch(options: WatchOptions, *, terminal: bool) -> None:
    """Serve the page, or draw in the terminal, until SIGINT or SIGTERM.

    Raises
    ------
    TactileError
        When the page cannot be served there.
    """
    from tactile_bringup.nodes.graph_runner import ros_context  # rclpy
    from tactile_lab.watch.terminal import show_until
    from tactile_lab.watch.watching import watching

    signals = hold_signals()
    if signals.received:
        return
    with ros_context() as context, watching(context, None if terminal else options) as watch:
        if terminal:
            show_until(watch.state, signals.wait)
            return
        say_address(watch, Output(as_json=False))
        while not signals.wait():
            pass


def answer_line(line: str) -> str:
    """Return the line of the terminal about an answer: its time first."""
    return f'{time.strftime("%H:%M:%S")}  {line}'


def say_address(watch: Watch, output: Output) -> None:
    """Print where the page is, if one is served."""
    if watch.address:
        output.say(f'Live page: [bold]{watch.address}[/bold]')
