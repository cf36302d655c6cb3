# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors that several packages share; free of ROS, so that all can import them."""


class TactileError(Exception):
    """A command, a launch file or a bag cannot do as asked.

    The message is a sentence for the user: what is wrong, with which thing, what to do.
    """


def plain_text(text: str, keep: str = '') -> str:
    """Return a text with "?" for what a terminal would obey; the characters ``keep`` stay."""
    return ''.join(c if c.isprintable() or c in keep else '?' for c in text)


LONGEST_REASON = 300
"""Characters of the reason of a `MessageError`; the rest is cut off."""


class MessageError(ValueError):
    """A message holds a value that it must not hold, or that is not known here.

    A conversion raises it. The node refuses that message and runs on; see
    `tactile_ros.lifecycle`. The reason goes into logs, so what others sent stands in it
    without what a terminal would obey, and shortened.
    """

    def __init__(self, reason: str) -> None:
        text = plain_text(reason[: LONGEST_REASON + 1])
        super().__init__(text if len(text) <= LONGEST_REASON else f'{text[:LONGEST_REASON]}...')
