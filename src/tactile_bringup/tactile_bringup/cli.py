# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ``tactile`` command.

Imports of the work are inside the functions: ``--help`` must not wait for ROS.
"""

import os
import sys

import typer

from tactile_bringup.cli_bags import repair, replay
from tactile_bringup.cli_data import evaluate, robustness, simulate, train
from tactile_bringup.cli_rig import check, demo, devices, hand, rig, sense, trials

app = typer.Typer(
    name='tactile',
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode='markdown',
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
    help='Touch through the tendon of a soft robotic finger: texture and stiffness from one '
    'tension signal.',
)

for command in (
    demo,
    simulate,
    train,
    evaluate,
    robustness,
    replay,
    repair,
    trials,
    rig,
    sense,
    hand,
    devices,
    check,
):
    app.command()(command)


def main() -> int:
    """Entry point of the console script."""
    # Nobody else on the network moves our rig, nor hears it, unless the environment says so.
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    try:
        app()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    return 0
