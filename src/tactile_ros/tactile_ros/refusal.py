# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The reason why a request is refused, as a value."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ['Refusal']


class Refusal(NamedTuple):
    """Why a request is refused. Functions return ``Refusal | None``; None means accepted.

    ``reason`` says what is wrong with which thing, ``remedy`` what to do. Neither ends in a full
    stop; ``str`` joins both to one sentence.
    """

    reason: str
    remedy: str

    def __str__(self) -> str:
        return f'{self.reason}; {self.remedy}.'
