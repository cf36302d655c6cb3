# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exceptions that several packages share. This module does not import ROS."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class TactileError(Exception):
    """A request of the user cannot be fulfilled.

    The message is a sentence for the user. It states the problem, the thing that has it, and a
    remedy.
    """


@contextmanager
def named_errors(task: str, path: Path) -> Iterator[None]:
    """Convert an OSError of the ``with`` block to a `TactileError` with the task and the path."""
    try:
        yield
    except OSError as error:
        raise TactileError(f'cannot {task} {path}: {error.strerror or error}') from error


def plain_text(text: str, keep: str = '') -> str:
    """Return a text with "?" in place of control characters, except those in ``keep``."""
    return ''.join(c if c.isprintable() or c in keep else '?' for c in text)


LONGEST_REASON = 300
"""Largest number of characters in the reason of a `MessageError`; longer ones are truncated."""


class MessageError(ValueError):
    """A message contains an invalid or unknown value.

    Conversions raise this exception. The node then refuses the message and keeps running; see
    `tactile_ros.lifecycle.MessageGuard`. The reason is logged and may contain text from other
    nodes, so control characters are replaced and long reasons are truncated.
    """

    def __init__(self, reason: str) -> None:
        text = plain_text(reason[: LONGEST_REASON + 1])
        super().__init__(text if len(text) <= LONGEST_REASON else f'{text[:LONGEST_REASON]}...')
