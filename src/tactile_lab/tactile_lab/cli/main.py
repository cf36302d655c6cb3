# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ``tactile`` command.

Imports of the work are inside the functions: ``--help`` must not wait for ROS.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import functools
import inspect
import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperOption

from tactile_lab.cli import experiment
from tactile_lab.cli.devices import calibrate, check, devices
from tactile_lab.cli.recordings import (
    compare,
    evaluate,
    features,
    import_recordings,
    repair,
    replay,
    robustness,
    show,
    simulate,
    train,
)
from tactile_lab.cli.running import demo, hand, rig, sense, trials, watch
from tactile_ros.errors import TactileError
from tactile_ros.programs.signals import held_signals
from tactile_ros.programs.transports import choose_transports

# A newer Click names the likely command itself, and a Typer that uses it would name it once more.
_CLICK_ERRORS = getattr(getattr(typer.core, 'click', None), 'exceptions', None)
_SUGGESTIONS = {'suggest_commands': False} if hasattr(_CLICK_ERRORS, 'NoSuchCommand') else {}

app = typer.Typer(
    name='tactile',
    no_args_is_help=True,
    rich_markup_mode='markdown',
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
    **_SUGGESTIONS,  # type: ignore[arg-type]
)


OF_ROS = {
    'ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'domain_coordinator',
    'geometry_msgs', 'lifecycle_msgs', 'rcl_interfaces', 'rclpy', 'rosgraph_msgs',
    'sensor_msgs', 'std_msgs', 'std_srvs', 'tactile_msgs',
}  # fmt: skip
"""Packages that a Python without ROS 2 lacks."""


def _print_version(is_wanted: bool) -> None:
    if not is_wanted:
        return
    from importlib.metadata import PackageNotFoundError, version

    for distribution in ('tendon-tactile', 'tactile_lab'):  # from pip, from colcon
        with suppress(PackageNotFoundError):
            typer.echo(f'tactile {version(distribution)}')
            raise typer.Exit
    raise TactileError('these packages are not installed: neither pip nor colcon knows them')


@app.callback()
def tactile(
    version: Annotated[
        bool,
        typer.Option(
            '--version', callback=_print_version, is_eager=True, help='Print the version.'
        ),
    ] = False,
) -> None:
    """Touch through the tendon of a soft robotic finger: texture and stiffness from tension."""


UNTIL_A_SIGNAL = (rig, sense, hand, watch)
"""These run until SIGINT or SIGTERM, which is their regular end. The others are interrupted."""


RENAMED = {'--model': '--models', '--running': '--partial'}
"""Options of version 0.1, with their new names."""


class StrictCommand(TyperCommand):
    """Refuses an option that is given twice where only the last one counts, and old names."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # Click 8.5 has a help of its own for arguments, and with it Typer loses theirs.
        declared = inspect.signature(self.callback).parameters if self.callback else {}
        for param in self.params:
            if isinstance(param, TyperArgument) and not param.help and param.name in declared:
                (info, *_) = getattr(declared[param.name].annotation, '__metadata__', (None,))
                param.help = getattr(info, 'help', None)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        known = {opt for param in self.params for opt in param.opts}
        for old in {arg.partition('=')[0] for arg in args} & RENAMED.keys() - known:
            raise typer.BadParameter(f'the option {old} is now called {RENAMED[old]}')
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        for param in order:
            is_value = isinstance(param, TyperOption) and not param.is_flag
            if is_value and not param.multiple and order.count(param) > 1:
                several = '; `tactile experiment` takes several' * (param.name == 'label')
                raise typer.BadParameter(
                    f'{param.opts[0]} is given {order.count(param)} times; give it once{several}'
                )
        return super().parse_args(ctx, args)


REFUSALS = {
    'tactile_bringup.trial_protocols.ProtocolError',
    'tactile_classifier.errors.ClassifierError',
    'tactile_features.errors.FeatureError',
    'tactile_ros.errors.TactileError',
    'tactile_sim.errors.TactileSimError',
}
"""Errors that we raise on purpose. By name: importing them would import what raises them."""


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn the errors that we raise on purpose into one sentence and exit code 2."""
    try:
        yield
    except Exception as error:
        if not {f'{c.__module__}.{c.__qualname__}' for c in type(error).__mro__} & REFUSALS:
            raise
        typer.echo(f'tactile: {error}', err=True)
        raise typer.Exit(2) from error


def _guard(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that refuses in one sentence, and that signals interrupt."""

    @functools.wraps(command)
    def run(*arguments: Any, **options: Any) -> None:
        signals = held_signals()
        with _refusals():
            # Without held signals this process is another's, such as a test's.
            if signals is None or command in UNTIL_A_SIGNAL:
                command(*arguments, **options)
                return
            try:
                with signals.raising():
                    command(*arguments, **options)
            except KeyboardInterrupt:
                raise typer.Exit(128 + signals.received) from None  # as shells say it

    return run


for command in (
    demo,
    simulate,
    import_recordings,
    train,
    evaluate,
    compare,
    features,
    robustness,
    replay,
    repair,
    show,
    trials,
    rig,
    sense,
    hand,
    watch,
    devices,
    check,
    calibrate,
):
    name = 'import' if command is import_recordings else None  # a word of Python
    app.command(name, cls=StrictCommand)(_guard(command))
app.add_typer(experiment.make_app(_guard, StrictCommand), name='experiment')


def main() -> int:
    """Run the command that the arguments name."""
    # Other computers cannot reach our nodes unless the environment allows it.
    os.environ.update(choose_transports(os.environ, 'LOCALHOST'))
    try:
        app()
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except ModuleNotFoundError as error:
        if (error.name or '').partition('.')[0] not in OF_ROS:
            raise
        name = sys.argv[1]
        also = ' `--no-nodes` replays without them.' if name == 'replay' else ''
        typer.echo(
            f'tactile: `tactile {name}` runs ROS 2 nodes, and this Python has no {error.name}. '
            f'In a clone of the repository ./tactile {name} brings ROS 2 along; or source a '
            f'ROS 2 workspace that has these packages.{also}',
            err=True,
        )
        return 2
    return 0
