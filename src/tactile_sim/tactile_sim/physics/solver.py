# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The solver, which advances trials of one scene through time. It is compiled by numba.

The compiler computes the trials of a block in parallel with vector instructions. For this purpose,
the innermost loops are over the trials of a block and have no branches, and all values of a block
are in one array whose width is a constant. Fused multiply-add operations are not used. They would
make the solver 5 to 20 % faster, but its results would depend on the processor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from importlib.util import find_spec
import inspect
from pathlib import Path
from typing import Any
import zlib

import numpy as np
from numpy.typing import NDArray

from tactile_sim.errors import SolverError
from tactile_sim.physics import equations, steps
from tactile_sim.physics import layout as at
from tactile_sim.physics.steps import MAX_HALVINGS, split_inputs

FloatArray = NDArray[np.float64]

TOLERANCE_NM = 1e-7
"""Largest residual moment of a solved time step [N m]. It corresponds to an error of the tension
of about 2e-5 N."""

BLOCK = 16
"""Number of trials that are computed in parallel."""

_ITERATIONS = 12
_OPTIONS: Any = {'error_model': 'numpy', 'boundscheck': False, 'fastmath': False}


def advance_trials(
    state: Any,
    scene: Any,
    lengths: NDArray[np.int64],
    start: FloatArray,
    inputs: FloatArray,
    coefficients: FloatArray,
    rows: tuple[int, ...],
    failed: NDArray[np.int64],
    grip: float = 1.0,
    tolerance_nm: float = TOLERANCE_NM,
    trusted_nm: float = 0.0,
) -> Any:
    """Simulate trials of one scene for a number of time steps, which are the same for all trials.

    The result of a trial does not depend on the other trials.

    Parameters
    ----------
    state : ndarray of shape (TRIAL_ROWS, trials)
        State and parameters of each trial; see `layout`. The call writes the new state to it.
    scene : tuple
        Value of `Scene.parameters`.
    lengths : ndarray of int, shape (steps,)
        For each time step, the index of its length in ``coefficients``.
    coefficients : ndarray
        Result of `compute_coefficients`.
    start, inputs : ndarray of shape (INPUTS,) and (steps, INPUTS)
        Inputs before the first step, and at the end of each step.
    rows : ndarray of int
        Rows of the state to return for each step.
    failed : ndarray of int, shape (trials,)
        -1 for each trial to simulate. If the solver finds no balance of moments for a trial, it
        writes the number of the time step.
    grip : float
        1, or 0 to simulate without friction.
    tolerance_nm : float
        Largest residual moment of a solved time step [N m].
    trusted_nm : float
        If the residual moment before an iteration of Newton's method is at most this value [N m],
        and friction is nearly linear in this iteration, the residual after it is not checked. Use
        a value above 0 only for rigid surfaces.

    Returns
    -------
    ndarray of shape (blocks, steps + 1, rows, width)
        The rows before the first step and after each step; for a failed trial, its last values.
        Trial i is in block i // width at position i % width.

    Raises
    ------
    SolverError
        When numba is missing, or cannot compile the solver.

    Notes
    -----
    If numba is missing, a single trial is solved by Python, which is about 300 times slower.
    """
    control = (grip, tolerance_nm, trusted_nm, _ITERATIONS)
    trials = state.shape[1]
    wanted = np.array(rows, dtype=np.int64)
    # If there are not enough trials for the last block, the last trial is repeated in it.
    width = 1 if trials == 1 and _lacks_numba() else BLOCK
    columns = np.minimum(np.arange(-(-trials // width) * width), trials - 1).reshape(-1, width)
    out = np.empty((len(columns), len(lengths) + 1, len(rows), width))
    advance = load_advance() if width == BLOCK else load_interpreted()
    for block, some in zip(out, columns, strict=True):
        part, stops = np.ascontiguousarray(state[:, some]), failed[some]
        block[0] = part[wanted]
        advance(
            part, scene, lengths, start, inputs, coefficients, control, wanted, block[1:], stops
        )
        state[: at.STATE_ROWS, some] = part[: at.STATE_ROWS]
        failed[some] = stops
    return out


@lru_cache
def load_advance() -> Callable[..., None]:
    """Return the compiled function that simulates a block of `BLOCK` trials.

    Raises `SolverError` when numba is missing or cannot compile the solver.
    """
    # numba is imported here, because this takes 0.5 s and only simulations need it.
    try:
        import numba
        from numba.core.errors import NumbaError
    except (ImportError, OSError) as error:
        raise SolverError(
            f'the simulator needs numba, which cannot be imported: {error}; '
            'pip install --upgrade numba'
        ) from error
    compiled = _make_advance(numba, BLOCK)

    def advance(*arguments: Any) -> None:
        try:
            compiled(*arguments)
        except NumbaError as error:
            (why, *_) = str(error).strip().splitlines() or ['it gives no reason']
            raise SolverError(
                f'numba {numba.__version__} cannot compile the solver of the simulator with '
                f'NumPy {np.__version__}: {why}; pip install --upgrade numba numpy'
            ) from error

    return advance


@lru_cache
def _lacks_numba() -> bool:
    return find_spec('numba') is None


@lru_cache
def load_interpreted() -> Callable[..., None]:
    """Return the solver as plain Python, for a single trial. Its results are exactly equal."""

    def zeros(shape: Any) -> Any:
        # The elements of a memoryview are Python numbers, with which calculations are several
        # times faster than with NumPy scalars.
        values: Any = np.zeros(shape)
        return memoryview(values)

    plain = _write_advance(lambda function: function, 1, zeros, int)

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
        constants, springs, table, grid, yields = scene
        scene = (constants, springs, memoryview(table), grid, yields)
        numbers = (some.tolist() for some in (lengths, start, inputs, coefficients))
        try:
            plain(state, scene, *numbers, control, rows.tolist(), out, failed)
        except ArithmeticError:  # compiled code would continue with infinity and find no balance
            failed[:] = 0

    return advance


def _make_advance(numba: Any, width: int) -> Callable[..., None]:
    from numba.extending import overload, register_jitable

    inline = register_jitable(forceinline=True, **_OPTIONS)

    @overload(equations.select, jit_options={**_OPTIONS, 'forceinline': True})
    def _select(condition: Any, yes: Any, no: Any) -> Callable[..., Any]:
        def choose(condition: Any, yes: Any, no: Any) -> Any:
            return yes if condition else no

        return choose

    for module in (equations, steps):
        for _, function in inspect.getmembers(module, inspect.isfunction):
            if function.__module__ == module.__name__ and function is not equations.select:
                inline(function)
    advance = _write_advance(inline, width, np.zeros, np.uint64)
    try:
        compiled: Callable[..., None] = numba.njit(cache=True, **_OPTIONS)(advance)
    except RuntimeError:  # numba finds no writable folder for its cache
        compiled = numba.njit(**_OPTIONS)(advance)
    return compiled


def _write_advance(
    inline: Callable[..., Any], width: int, zeros: Callable[..., Any], to_index: Callable[..., Any]
) -> Callable[..., None]:
    """Return the function that simulates a block of ``width`` trials, not yet compiled.

    ``inline`` decorates the functions that it calls.
    """
    # numba keeps compiled code in a cache while this file is unchanged, even if another file has
    # changed. It also compares variables of the closure, so one of them is a hash of other files.
    sources = _hash_sources()

    @inline
    def find_surface(z: Any, table: Any, per_spacing: float) -> None:
        for t in range(width):
            cell = z[at.CELL, t]
            i = to_index(cell)
            part = cell - i
            height, rise, slope, bend = table[i, 0], table[i, 1], table[i, 2], table[i, 3]
            z[at.HEIGHT, t] = height + part * rise
            z[at.INCLINE, t] = slope + part * bend
            z[at.BEND, t] = bend * per_spacing

    @inline
    def solve(z: Any, row: Any, inputs: Any, scene: Any, control: Any) -> None:
        constants, springs, table, grid, yields = scene
        grip, tolerance, trusted, iterations = control
        guide_m, tendon_m = inputs[at.GUIDE_INPUT], inputs[at.TENDON_INPUT]
        present = inputs[at.PRESENT_INPUT] > 0.0
        for t in range(width):
            steps.begin_step(z, t, row)
        for t in range(width):
            steps.begin_creep(z, t, row, constants)
        if yields:
            for t in range(width):
                steps.begin_object(z, t, row, springs)
        if not present:
            for t in range(width):
                z[at.NEW_FORCE, t] = 0.0
                z[at.FORCE_SLOPE, t] = 0.0
            if yields:
                for t in range(width):
                    steps.leave_object(z, t)
        for _ in range(iterations):
            for t in range(width):
                steps.locate(z, t, guide_m, constants)
            if len(table) > 1:
                for t in range(width):
                    steps.find_cell(z, t, grid[0], grid[1], grid[2])
                find_surface(z, table, grid[1])
            if present:
                if yields:
                    for t in range(width):
                        steps.press_object(z, t, constants)
                else:
                    for t in range(width):
                        steps.press_rigid(z, t, constants)
            for t in range(width):
                steps.improve(z, t, row, tendon_m, grip, tolerance, trusted, constants)
            going = 0.0
            for t in range(width):
                going += z[at.OPEN, t]
            if going == 0.0:
                break
        for t in range(width):
            steps.end_step(z, t, row, grip, constants)
        if yields:
            for t in range(width):
                steps.end_object(z, t, row)

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
        _ = sources
        z = zeros((at.ROWS, width))
        kept = zeros((at.STATE_ROWS, width))
        pending = zeros(width)
        part_inputs = zeros(at.INPUTS)
        before = start
        for r in range(at.TRIAL_ROWS):
            for t in range(width):
                z[r, t] = state[r, t]
        for s in range(len(lengths)):
            if s == 0 or lengths[s] != lengths[s - 1]:
                for t in range(width):
                    z[at.FRESH, t] = 1.0
            for t in range(width):
                pending[t] = 1.0 if failed[t] < 0 else 0.0
            for level in range(MAX_HALVINGS + 1):
                if level > 0:
                    # No balance was found. Repeat the time step in 2^level shorter steps.
                    for t in range(width):
                        z[at.FRESH, t] = 1.0 if pending[t] > 0.0 else z[at.FRESH, t]
                    for r in range(at.STATE_ROWS):
                        for t in range(width):
                            kept[r, t] = z[r, t]
                for t in range(width):
                    z[at.ACTIVE, t] = pending[t]
                parts = 1 << level
                for part in range(parts):
                    split_inputs(before, inputs[s], (part + 1.0) / parts, part_inputs)
                    solve(z, coefficients[lengths[s]][level], part_inputs, scene, control)
                    for t in range(width):
                        z[at.ACTIVE, t] = z[at.SOLVED, t]
                if level > 0:
                    for t in range(width):
                        z[at.FRESH, t] = 1.0 if z[at.SOLVED, t] > 0.0 else z[at.FRESH, t]
                    for r in range(at.STATE_ROWS):
                        for t in range(width):
                            partly = pending[t] - z[at.SOLVED, t]
                            z[r, t] = kept[r, t] if partly > 0.0 else z[r, t]
                missing = 0.0
                for t in range(width):
                    pending[t] -= z[at.SOLVED, t]
                    missing += pending[t]
                if missing == 0.0:
                    break
            for t in range(width):
                failed[t] = s if pending[t] > 0.0 else failed[t]
            before = inputs[s]
            for o in range(len(rows)):
                for t in range(width):
                    out[s, o, t] = z[rows[o], t]
        for r in range(at.STATE_ROWS):
            for t in range(width):
                state[r, t] = z[r, t]

    return advance


def _hash_sources() -> int:
    names = ('equations', 'layout', 'steps')
    sources = b''.join((Path(__file__).with_name(f'{name}.py')).read_bytes() for name in names)
    return zlib.crc32(sources + np.__version__.encode())  # NumPy computes constants
