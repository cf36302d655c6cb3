# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The class `Refusal`, which functions return instead of raising an exception."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ['Refusal']


class Refusal(NamedTuple):
    """The reason why a request is refused, and a remedy.

    Functions return ``Refusal | None``; None means that the request is accepted. ``str`` joins
    reason and remedy to one sentence, so neither of them ends with a full stop.
    """

    reason: str  # the problem, and the device, node or value that has it
    remedy: str  # how the user can solve the problem

    def __str__(self) -> str:
        return f'{self.reason}; {self.remedy}.'
