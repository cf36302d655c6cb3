# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ``tactile`` command: the table of its commands, each loaded when it is called.

Each command is a module of `tactile_lab.commands` with a function of the same name. The parameters
of the function are the options of the command, and its docstring is the help. A parameter whose
default is a dataclass is replaced by an option for each field (`expand`). The module imports only
Typer, the options and the output at its top. Its functions import everything else, so that
``--help`` and errors in the options do not have to wait for ROS or scikit-learn.

Ubuntu 24.04 has Typer 0.9, which supports neither ``X | None`` nor annotations that are strings.
Therefore modules with options use ``Optional[X]`` without ``from __future__ import annotations``.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import functools
from importlib import import_module
import inspect
import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from tactile_lab.usage import plain_errors, say_refusal, WholeNames
from tactile_ros.errors import TactileError
from tactile_ros.process import choose_transports, held_signals

COMMANDS = {
    'demo': (
        'Run everything from training to live trials on the **simulated** rig, in about a minute.'
    ),
    'simulate': 'Make bags of **simulated** trials, without waiting in real time.',
    'import': 'Convert recordings of other programs to one archive.',
    'export': 'Write the trials of recordings as one long table, with a dataset card beside it.',
    'train': 'Choose features and classifier by cross-validation, and write model files.',
    'classify': 'Classify the trials of recordings with a model file.',
    'evaluate': 'Print the accuracy of the model that *train* would write, or of model files.',
    'features': 'Write the features of recordings as a table, for notebooks and other programs.',
    'replay': 'Run a recording through features and classification again, and compare.',
    'repair': 'Write a closed copy of a bag whose recorder was killed.',
    'show': 'List the contents of a recording, a model file or an archive.',
    'trials': 'Run trials on one plate or object, one after the other, and record them.',
    'experiment': (
        'Record objects x sessions x contacts in a random order, with prompts and resume.'
    ),
    'rig': 'Run all nodes of the rig in this process until Ctrl-C; print each classification.',
    'sense': (
        'Run the nodes of one finger that another program moves, in this process until Ctrl-C.'
    ),
    'hand': 'Run the nodes of any number of fingers, in this process until Ctrl-C.',
    'event': 'Publish one event of a trial from the shell: a phase begins now.',
    'watch': 'Show every finger live in a browser, until Ctrl-C.',
    'devices': 'List the connected devices and the parameters that fit them.',
    'check': 'Test each device and print the results; exit with 1 when there is a fault.',
    'calibrate': 'Calibrate a load cell against known weights.',
}
"""First line of the help of each command."""

ELSEWHERE = {'import': ('import_recordings', 'import_recordings'), 'hand': ('sense', 'hand')}
"""Module and function of commands whose names differ from the name of their module or function."""

UNTIL_A_SIGNAL = {'rig', 'sense', 'hand', 'watch'}
"""Commands that run until SIGINT, SIGTERM or SIGHUP, and then end regularly. The other commands
are interrupted by these signals."""

OF_ROS = {
    'ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'domain_coordinator',
    'geometry_msgs', 'lifecycle_msgs', 'rcl_interfaces', 'rclpy', 'rosgraph_msgs',
    'sensor_msgs', 'std_msgs', 'std_srvs', 'tactile_msgs',
}  # fmt: skip
"""Modules that can be imported only if ROS 2 is installed."""

REFUSALS = {
    'tactile_bringup.trial_protocols.ProtocolError',
    'tactile_classifier.errors.ClassifierError',
    'tactile_features.errors.FeatureError',
    'tactile_ros.errors.TactileError',
    'tactile_sim.errors.TactileSimError',
}
"""Names of the exceptions that are printed as a sentence. They are names instead of classes,
because importing the classes would take too long."""

# Newer versions of Click suggest a similar command, so Typer must not suggest it a second time.
_CLICK_ERRORS = getattr(getattr(typer.core, 'click', None), 'exceptions', None)
_SUGGESTIONS = {'suggest_commands': False} if hasattr(_CLICK_ERRORS, 'NoSuchCommand') else {}


class StrictCommand(WholeNames, TyperCommand):
    """Command that refuses an option if it is given repeatedly but has only one value."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # With Click 8.5, Typer loses the help of arguments, so it is set here.
        declared = inspect.signature(self.callback).parameters if self.callback else {}
        for param in self.params:
            if isinstance(param, TyperArgument) and not param.help and param.name in declared:
                (info, *_) = getattr(declared[param.name].annotation, '__metadata__', (None,))
                param.help = getattr(info, 'help', None)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        for param in order:
            is_value = isinstance(param, TyperOption) and not param.is_flag
            if is_value and not param.multiple and order.count(param) > 1:
                several = '; `tactile experiment` accepts several' * (param.name == 'label')
                raise typer.BadParameter(
                    f'{param.opts[0]} is given {order.count(param)} times; give it once{several}'
                )
        return super().parse_args(ctx, args)


class LazyGroup(WholeNames, TyperGroup):
    """The commands of `COMMANDS`, imported when they are called or their help is printed."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.commands = {name: TyperCommand(name, help=line) for name, line in COMMANDS.items()}

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        with plain_errors():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        with plain_errors():
            return super().invoke(ctx)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        return name, load_command(str(name)) if command is not None else None, rest


@functools.cache
def load_command(name: str) -> Any:
    """Import a command of `COMMANDS`, and return it as a Click command."""
    from tactile_lab.options import expand

    function = load_function(name)
    if isinstance(function, typer.Typer):  # a command with subcommands
        app = function
        for command in app.registered_commands:
            assert command.callback is not None
            command.callback = _guard(expand(command.callback), name)
            command.cls = StrictCommand
    else:
        app = typer.Typer(rich_markup_mode='markdown', add_completion=False)
        app.command(name, cls=StrictCommand)(_guard(expand(function), name))
    return typer.main.get_command(app)


def load_function(name: str) -> Any:
    """Import and return the function of a command, or the `Typer` object if it has subcommands."""
    module, function = ELSEWHERE.get(name, (name, name))
    return getattr(import_module(f'tactile_lab.commands.{module}'), function)


def _guard(command: Callable[..., None], name: str) -> Callable[..., None]:
    """Wrap the function of a command: print errors as a sentence, and let signals interrupt it."""

    @functools.wraps(command)
    def run(*arguments: Any, **options: Any) -> None:
        signals = held_signals()
        with _refusals():
            # Without `hold_signals`, the command was called by other code, such as a test.
            if signals is None or name in UNTIL_A_SIGNAL:
                command(*arguments, **options)
                return
            try:
                with signals.raising():
                    command(*arguments, **options)
            except KeyboardInterrupt:
                raise typer.Exit(128 + signals.received) from None  # the exit code that shells use

    return run


@contextmanager
def _refusals() -> Iterator[None]:
    """Print an exception of `REFUSALS` as a sentence, and exit with code 2."""
    try:
        yield
    except Exception as error:
        if not {f'{c.__module__}.{c.__qualname__}' for c in type(error).__mro__} & REFUSALS:
            raise
        say_refusal(str(error))
        raise typer.Exit(2) from error


app = typer.Typer(
    name='tactile',
    cls=LazyGroup,
    no_args_is_help=True,
    rich_markup_mode='markdown',
    pretty_exceptions_enable=False,
    context_settings={'help_option_names': ['-h', '--help']},
    **_SUGGESTIONS,  # type: ignore[arg-type]
)


def _print_version(is_wanted: bool) -> None:
    if not is_wanted:
        return
    from importlib.metadata import PackageNotFoundError, version

    # The first distribution is installed by pip, the second one by colcon.
    for distribution in ('tendon-tactile', 'tactile_lab'):
        with suppress(PackageNotFoundError):
            typer.echo(f'tactile {version(distribution)}')
            raise typer.Exit
    raise TactileError(
        'the version is not known, because the packages are installed neither by pip nor colcon'
    )


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


def main() -> int:
    """Run the command in ``sys.argv``; return its exit code."""
    # By default, the nodes can be reached only from this computer.
    os.environ.update(choose_transports(os.environ, 'LOCALHOST'))
    try:
        app(prog_name='tactile')
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
            f'In a clone of the repository use ./tactile {name}, which installs ROS 2, or source '
            f'a ROS 2 workspace that has these packages.{also}',
            err=True,
        )
        return 2
    return 0
