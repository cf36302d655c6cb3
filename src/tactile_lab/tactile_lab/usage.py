# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Help and errors of the command line by Typer, without breaks in names and paths."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import shutil
from typing import Any, TYPE_CHECKING

import typer

from tactile_ros.errors import plain_text

if TYPE_CHECKING:
    from typer.core import TyperCommand as _Command
else:
    _Command = object

LEAST_HELP_WIDTH = 80
"""Smallest number of columns. If there are fewer, Typer truncates the names of options."""

LONGEST_REFUSAL = 4_000
"""Largest number of printed characters of an error, because a name in it can be very long."""

_ClickError: type[Any] = next(
    each for each in typer.BadParameter.__mro__ if each.__name__ == 'ClickException'
)
"""Base class, which is defined by Click, or by the copy of Click in newer versions of Typer."""


class WholeNames(_Command):
    """Mixin for commands: names of options are not truncated in the help."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        from typer import rich_utils  # imported lazily: only help needs it

        rich_utils.MAX_WIDTH = max(shutil.get_terminal_size().columns, LEAST_HELP_WIDTH)
        super().format_help(ctx, formatter)


@contextmanager
def plain_errors() -> Iterator[None]:
    """Print errors of the command line as lines of text; Typer's box breaks names and paths."""
    try:
        yield
    except _ClickError as error:
        context = getattr(error, 'ctx', None)
        if text := error.format_message():  # empty if the help is printed instead
            if context is not None:
                typer.echo(' '.join(context.get_usage().split()), err=True)
                text += f"\nTry '{context.command_path} --help' for help."
            say_refusal(text)
        raise typer.Exit(error.exit_code) from error


def say_refusal(text: str) -> None:
    """Print the reason why a command does nothing, to standard error."""
    text = plain_text(f'tactile: {text}', '\n\t')
    typer.echo(text[:LONGEST_REFUSAL] + ' ...' * (len(text) > LONGEST_REFUSAL), err=True)
