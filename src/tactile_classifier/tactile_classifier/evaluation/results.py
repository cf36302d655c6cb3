# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results of an evaluation as what JSON can hold."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True)
class Result:
    """Base of the records that reports and ``--json`` print."""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields by name as what JSON can hold."""
        return {f.name: _to_plain(getattr(self, f.name)) for f in dataclasses.fields(self)}


def _to_plain(value: Any) -> Any:
    if isinstance(value, Result):
        return value.to_dict()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_to_plain(each) for each in value] if isinstance(value, tuple) else value
