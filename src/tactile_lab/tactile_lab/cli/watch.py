# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arguments and help of `tactile watch`; the work is in `tactile_lab.commands`.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations
that are strings: so ``Optional[X]``, and no ``from __future__ import annotations`` here.
"""

from typing import Annotated

import typer

from tactile_lab.options import refusals


def watch(
    host: Annotated[
        str,
        typer.Option(
            help='Address to listen on. With another address than the default, everybody on the '
            'network can see the page and press Stop: see docs/security.md.'
        ),
    ] = '127.0.0.1',
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help='Port of the page. Default: 8642, or a free one.'),
    ] = 0,
    terminal: Annotated[
        bool, typer.Option('--terminal', help='Draw in this terminal; serve no page.')
    ] = False,
) -> None:
    """Show every finger live in a browser, until Ctrl-C.

    Run it beside `tactile rig`, `tactile sense`, `tactile hand` or any launch file: it finds
    fingers by their topics on the same ROS domain. Those commands also take ``--watch``, which
    costs less than a process of its own.

    For each finger the page shows tension with the phases of the trial, the spectrum of the
    partial window, the label with its probabilities or *unknown*, slip, and the health of each
    device with its remedy. Its buttons tare the sensor, home the guide and run a trial. They need
    the token in the printed address. Without the token a page can only show and **stop**. Stop
    does not replace the emergency stop of your rig.
    """
    with refusals():
        from tactile_lab.commands.running.watch import run_watch
        from tactile_lab.watch.options import WatchOptions

        run_watch(WatchOptions(host, port), terminal=terminal)
