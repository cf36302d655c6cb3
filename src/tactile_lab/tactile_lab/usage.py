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
"""Smallest width of the help [characters]. If it is narrower, Typer truncates option names."""

LONGEST_REFUSAL = 4_000
"""Largest number of characters of a printed error, which may contain a very long name."""

_ClickError: type[Any] = next(
    each for each in typer.BadParameter.__mro__ if each.__name__ == 'ClickException'
)
"""Base class of the errors of the command line. Newer versions of Typer contain a copy of Click,
so it cannot be imported from Click."""


class WholeNames(_Command):
    """Mixin for commands and groups: option names are not truncated in the help."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        from typer import rich_utils  # imported lazily: only help needs it

        rich_utils.MAX_WIDTH = max(shutil.get_terminal_size().columns, LEAST_HELP_WIDTH)
        super().format_help(ctx, formatter)


@contextmanager
def plain_errors() -> Iterator[None]:
    """Print errors of the command line as plain text.

    Typer would print them in a box, with line breaks inside names and paths.
    """
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
    """Print the reason why a command was refused to standard error."""
    text = plain_text(f'tactile: {text}', '\n\t')
    typer.echo(text[:LONGEST_REFUSAL] + ' ...' * (len(text) > LONGEST_REFUSAL), err=True)
