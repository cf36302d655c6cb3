# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Independent reference of the compiled solver: NumPy, an array operation at a time.

It runs the same operations, number for number, so it gives the same bits without a compiler.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np

from tactile_sim.physics import layout as at
from tactile_sim.physics import solver, steps
from tactile_sim.physics.steps import MAX_HALVINGS, split_inputs

_ALL = slice(None)
_CROWDED = 0.7
"""Trials that have converged leave the batch once fewer than this share is open."""


@contextmanager
def in_use(name: str) -> Iterator[None]:
    """Let the simulator step with this solver, ``compiled`` or ``numpy``."""
    if name == 'compiled':
        yield
        return
    with mock.patch.object(solver, 'load_advance', return_value=advance):
        yield


def advance(
    state: Any,
    scene: Any,
    lengths: Any,
    start: Any,
    inputs: Any,
    coefficients: Any,
    control: Any,
    rows: Any,
    out: Any,
    failed: Any,
) -> None:
    """Advance all trials; see `solver.advance_trials`."""
    z = np.zeros((at.ROWS, state.shape[1]), dtype=state.dtype)
    z[: at.TRIAL_ROWS] = state
    before = start
    with np.errstate(all='ignore'):
        for s, length in enumerate(lengths):
            if s == 0 or length != lengths[s - 1]:
                z[at.FRESH] = 1.0
            z[at.ACTIVE] = failed < 0
            row = coefficients[length, 0].tolist()
            _solve(z, row, inputs[s].tolist(), scene, control)
            # A trial without balance stands where it was, and tries again in parts.
            pending = np.flatnonzero(z[at.ACTIVE] > z[at.SOLVED])
            level = 1
            while len(pending) and level <= MAX_HALVINGS:
                pending = _solve_in_parts(
                    z, pending, level, coefficients[length], before, inputs[s], scene, control
                )
                level += 1
            failed[pending] = s
            before = inputs[s]
            out[s] = z[rows]
    state[: at.STATE_ROWS] = z[: at.STATE_ROWS]


def _solve_in_parts(
    z: Any,
    pending: Any,
    level: int,
    coefficients: Any,
    before: Any,
    after: Any,
    scene: Any,
    control: Any,
) -> Any:
    """Advance some trials in 2^level parts of a step; return those that still find no balance."""
    row = coefficients[level].tolist()
    work = z[:, pending]
    work[at.ACTIVE] = 1.0
    work[at.FRESH] = 1.0
    inputs = np.empty(at.INPUTS)
    parts = 1 << level
    for part in range(parts):
        split_inputs(before, after, (part + 1.0) / parts, inputs)
        _solve(work, row, inputs.tolist(), scene, control)
        work[at.ACTIVE] = work[at.SOLVED]
    work[at.FRESH] = 1.0
    solved = work[at.SOLVED] > 0.0
    z[: at.STATE_ROWS, pending[solved]] = work[: at.STATE_ROWS, solved]
    return pending[~solved]


def _solve(z: Any, row: list[float], inputs: list[float], scene: Any, control: Any) -> None:
    constants, springs, _, _, yields = scene
    grip, _, _, iterations = control
    steps.begin_step(z, _ALL, row)
    steps.begin_creep(z, _ALL, row, constants)
    if yields:
        steps.begin_object(z, _ALL, row, springs)
    if inputs[at.PRESENT_INPUT] <= 0.0:
        z[at.NEW_FORCE] = 0.0
        z[at.FORCE_SLOPE] = 0.0
        if yields:
            steps.leave_object(z, _ALL)
    work, columns = z, None
    for _ in range(iterations):
        _iterate(work, row, inputs, scene, control)
        still = np.flatnonzero(work[at.OPEN])
        if len(still) == 0:
            break
        if len(still) < _CROWDED * work.shape[1]:
            if columns is None:
                columns = still
            else:
                z[:, columns] = work
                columns = columns[still]
            work = z[:, columns]
    if columns is not None:
        z[:, columns] = work
    steps.end_step(z, _ALL, row, grip, constants)
    if yields:
        steps.end_object(z, _ALL, row)


def _iterate(z: Any, row: list[float], inputs: list[float], scene: Any, control: Any) -> None:
    constants, _, table, grid, yields = scene
    grip, tolerance, trusted, _ = control
    steps.locate(z, _ALL, inputs[at.GUIDE_INPUT], constants)
    if len(table) > 1:
        steps.find_cell(z, _ALL, inputs[at.SHAPE_INPUT], *grid)
        cell = z[at.CELL]
        index = cell.astype(np.intp)
        part = cell - index
        height, rise, slope, bend = table[index].T
        z[at.HEIGHT] = height + part * rise
        z[at.INCLINE] = slope + part * bend
        z[at.BEND] = bend * grid[1]
    if inputs[at.PRESENT_INPUT] > 0.0:
        if yields:
            steps.press_object(z, _ALL, constants)
        else:
            steps.press_rigid(z, _ALL, constants)
    tendon_m, material_m = inputs[at.TENDON_INPUT], inputs[at.MATERIAL_INPUT]
    steps.improve(z, _ALL, row, tendon_m, material_m, grip, tolerance, trusted, constants)
