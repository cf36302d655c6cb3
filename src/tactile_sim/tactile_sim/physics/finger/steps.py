# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The coefficients that belong to a length of step, and the inputs of its parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_sim.physics.finger.layout import (
    BRANCH_COLUMN,
    COLUMNS,
    CREEP_COLUMN,
    HEALING_COLUMN,
    MAX_BRANCHES,
    PRESENT_INPUT,
    RATE_COLUMN,
    SENSOR_COLUMN,
)
from tactile_sim.physics.finger.relaxation import compute_relaxation

FloatArray = NDArray[np.float64]

MAX_HALVINGS = 10
"""A step that finds no balance is cut into up to 2^10 parts."""


def compute_coefficients(
    steps_s: Sequence[float],
    creep_time_s: float,
    branch_times_s: Sequence[float],
    sensor_time_s: float,
    healing_time_s: float = 1.0,
) -> FloatArray:
    """Coefficients of every length of step, and of its parts.

    Parameters
    ----------
    steps_s
        The lengths that occur [s]; infinity seeks rest.

    Returns
    -------
    ndarray of float, shape (lengths, MAX_HALVINGS + 1, COLUMNS)
        See `layout`.
    """
    table = np.zeros((len(steps_s), MAX_HALVINGS + 1, COLUMNS))
    for index in np.ndindex(table.shape[:2]):
        step_s, row = steps_s[index[0]] / 2 ** index[1], table[index]
        row[RATE_COLUMN] = 1 / step_s
        row[CREEP_COLUMN : CREEP_COLUMN + 3] = compute_relaxation(step_s, creep_time_s)
        for branch in range(MAX_BRANCHES):
            time_s = branch_times_s[branch] if branch < len(branch_times_s) else 1.0
            column = BRANCH_COLUMN + 3 * branch
            row[column : column + 3] = compute_relaxation(step_s, time_s)
        row[SENSOR_COLUMN : SENSOR_COLUMN + 3] = compute_relaxation(step_s, sensor_time_s)
        row[HEALING_COLUMN] = compute_relaxation(step_s, healing_time_s)[0]
    return table


def split_inputs(before: Any, after: Any, share: float, out: Any) -> None:
    """Inputs at a share of a step, on a line from its start to its end.

    Parameters
    ----------
    before, after, out : ndarray of float, shape (INPUTS,)
    """
    for i in range(PRESENT_INPUT):
        # Counted from the end, so that a whole step has exactly its inputs.
        out[i] = after[i] - (1.0 - share) * (after[i] - before[i])
    out[PRESENT_INPUT] = after[PRESENT_INPUT]  # present or not is no motion
