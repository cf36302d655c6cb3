# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reference implementation of the compiled solver with NumPy arrays.

Both solvers execute the same arithmetic operations, so that their results are exactly equal.
"""

import contextlib
from unittest import mock

import numpy as np

from tactile_sim.physics import layout as at
from tactile_sim.physics import solver, steps

_ALL = slice(None)


def in_use(name):
    """Return a context in which the simulator uses the solver ``compiled`` or ``numpy``."""
    if name == 'compiled':
        return contextlib.nullcontext()
    return mock.patch.object(solver, 'load_advance', return_value=advance)


def advance(state, scene, lengths, start, inputs, coefficients, control, rows, out, failed):
    """Advance all trials by all steps; see `solver.advance_trials`."""
    z = np.zeros((at.ROWS, state.shape[1]))
    z[: at.TRIAL_ROWS] = state
    part_inputs = np.empty(at.INPUTS)
    before = start
    with np.errstate(all='ignore'):
        for s, length in enumerate(lengths):
            if s == 0 or length != lengths[s - 1]:
                z[at.FRESH] = 1.0
            pending = failed < 0
            for level in range(steps.MAX_HALVINGS + 1):
                # If no balance was found for a trial, its step is repeated in 2^level parts.
                kept = z[: at.STATE_ROWS].copy()
                z[at.ACTIVE] = pending
                z[at.FRESH, pending] = 1.0 if level else z[at.FRESH, pending]
                row = coefficients[length, level].tolist()
                for part in range(1 << level):
                    share = (part + 1.0) / (1 << level)
                    steps.split_inputs(before, inputs[s], share, part_inputs)
                    _solve(z, row, part_inputs.tolist(), scene, control)
                    z[at.ACTIVE] = z[at.SOLVED]
                solved = z[at.SOLVED] > 0.0
                z[at.FRESH, solved] = 1.0 if level else z[at.FRESH, solved]
                pending &= ~solved
                z[: at.STATE_ROWS, pending] = kept[:, pending]
                if not pending.any():
                    break
            failed[pending] = s
            before = inputs[s]
            out[s] = z[rows]
    state[: at.STATE_ROWS] = z[: at.STATE_ROWS]


def _solve(z, row, inputs, scene, control):
    constants, springs, table, grid, yields = scene
    grip, tolerance, trusted, iterations = control
    present = inputs[at.PRESENT_INPUT] > 0.0
    steps.begin_step(z, _ALL, row)
    steps.begin_creep(z, _ALL, row, constants)
    if yields:
        steps.begin_object(z, _ALL, row, springs)
    if not present:
        z[[at.NEW_FORCE, at.FORCE_SLOPE]] = 0.0
        if yields:
            steps.leave_object(z, _ALL)
    for _ in range(iterations):
        steps.locate(z, _ALL, inputs[at.GUIDE_INPUT], constants)
        if len(table) > 1:
            steps.find_cell(z, _ALL, *grid)
            index = z[at.CELL].astype(np.intp)
            part = z[at.CELL] - index
            height, rise, slope, bend = table[index].T
            z[at.HEIGHT] = height + part * rise
            z[at.INCLINE] = slope + part * bend
            z[at.BEND] = bend * grid[1]
        if present:
            press = steps.press_object if yields else steps.press_rigid
            press(z, _ALL, constants)
        tendon_m = inputs[at.TENDON_INPUT]
        steps.improve(z, _ALL, row, tendon_m, grip, tolerance, trusted, constants)
        if not z[at.OPEN].any():
            break
    steps.end_step(z, _ALL, row, grip, constants)
    if yields:
        steps.end_object(z, _ALL, row)
