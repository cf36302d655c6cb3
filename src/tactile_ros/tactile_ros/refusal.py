# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The refusal of a request, as a value."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ['Refusal']


class Refusal(NamedTuple):
    """Why a request is refused. Functions return ``Refusal | None``; None means accepted.

    Neither text ends in a full stop; ``str`` joins both to one sentence.
    """

    reason: str  # the problem, and the thing that has it
    remedy: str  # action for the user

    def __str__(self) -> str:
        return f'{self.reason}; {self.remedy}.'
