# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile watch`: show a live page of nodes that run elsewhere."""

from typing import Annotated

import typer

from tactile_lab.output import Output


def watch(
    host: Annotated[
        str,
        typer.Option(
            help='Address to listen on. If it is not the default, everyone on the network can see '
            'the page and press Stop: see docs/security.md.'
        ),
    ] = '127.0.0.1',
    port: Annotated[
        int,
        typer.Option(min=0, max=65535, help='Port of the page. Default: 8642, or a free one.'),
    ] = 0,
) -> None:
    """Show every finger live in a browser, until Ctrl-C.

    Run it along with `tactile rig`, `tactile sense`, `tactile hand` or any launch file. It finds
    the fingers by their topics on the same ROS domain. These commands also accept ``--watch``,
    which needs less memory and processor time than a separate process.

    For each finger the page shows the tension with the phases of the trial, the spectrum of the
    window, the label with its probabilities or *unknown*, and the health of each device with a
    remedy for each fault. Its buttons tare the sensor, home the guide and run a trial. They work
    only if the page was opened with the complete printed address, which contains a token. Without
    the token, the page only shows the fingers and can **stop** the rig. Stop does not replace the
    emergency stop of your rig.
    """
    from tactile_bringup.nodes.graph_runner import ros_context  # imports rclpy
    from tactile_lab.running import say_address
    from tactile_lab.watch.access import WatchOptions
    from tactile_lab.watch.watching import watching
    from tactile_ros.process import hold_signals

    signals = hold_signals()
    if signals.received:
        return
    with ros_context() as context, watching(context, WatchOptions(host, port)) as watched:
        say_address(watched, Output(as_json=False))
        while not signals.wait():
            pass
