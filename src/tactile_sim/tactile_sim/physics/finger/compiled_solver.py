# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The compiled solver: trials advance side by side in vector registers.

Loops over the trials of a block are innermost and free of branches, and its rows stand in
one array of known width, so that the compiler proves them independent. Contraction to fused
operations stays off: it would be 5 to 20 % faster, and give other bits than NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
import inspect
from pathlib import Path
from typing import Any
import zlib

from numba import njit
from numba.extending import overload, register_jitable
import numpy as np

from tactile_sim.physics.finger import bent_line, mechanics, row_operations, steps
from tactile_sim.physics.finger import layout as at
from tactile_sim.physics.finger.steps import MAX_HALVINGS, split_inputs

_OPTIONS: Any = {'error_model': 'numpy', 'boundscheck': False, 'fastmath': False}


@overload(mechanics.select, jit_options={**_OPTIONS, 'forceinline': True})
def _select(condition: Any, yes: Any, no: Any) -> Callable[..., Any]:
    def choose(condition: Any, yes: Any, no: Any) -> Any:
        return yes if condition else no

    return choose


for _module in (bent_line, mechanics, row_operations, steps):
    for _, _function in inspect.getmembers(_module, inspect.isfunction):
        if _function.__module__ == _module.__name__ and _function is not mechanics.select:
            register_jitable(forceinline=True, **_OPTIONS)(_function)


def _hash_sources() -> int:
    names = ('bent_line', 'mechanics', 'row_operations', 'layout', 'steps')
    sources = b''.join((Path(__file__).with_name(f'{name}.py')).read_bytes() for name in names)
    return zlib.crc32(sources + np.__version__.encode())  # constants come from it


@lru_cache
def make_advance(width: int) -> Callable[..., None]:
    """Compile the solver for blocks of ``width`` trials; see `solver.advance_trials`."""
    # numba keeps what it compiled, and looks at the age of this file alone: a number that
    # the code closes over makes it look at the others too.
    sources = _hash_sources()

    @register_jitable(forceinline=True, **_OPTIONS)
    def find_surface(z: Any, table: Any, per_spacing: float) -> None:
        for t in range(width):
            cell = z[at.CELL, t]
            i = np.uint64(cell)
            part = cell - i
            height, rise, slope, bend = table[i, 0], table[i, 1], table[i, 2], table[i, 3]
            z[at.HEIGHT, t] = height + part * rise
            z[at.INCLINE, t] = slope + part * bend
            z[at.BEND, t] = bend * per_spacing

    @register_jitable(forceinline=True, **_OPTIONS)
    def solve(z: Any, row: Any, inputs: Any, scene: Any, control: Any) -> None:
        constants, springs, table, grid, yields = scene
        grip, tolerance, trusted, iterations = control
        guide_m, material_m = inputs[at.GUIDE_INPUT], inputs[at.MATERIAL_INPUT]
        tendon_m = inputs[at.TENDON_INPUT]
        present = inputs[at.PRESENT_INPUT] > 0.0
        for t in range(width):
            row_operations.begin_step(z, t, row)
        for t in range(width):
            row_operations.begin_creep(z, t, row, constants)
        if yields:
            for t in range(width):
                row_operations.begin_object(z, t, row, springs)
        if not present:
            for t in range(width):
                z[at.NEW_FORCE, t] = 0.0
                z[at.FORCE_SLOPE, t] = 0.0
            if yields:
                for t in range(width):
                    row_operations.leave_object(z, t)
        for _ in range(iterations):
            for t in range(width):
                row_operations.locate(z, t, guide_m, constants)
            if len(table) > 1:
                for t in range(width):
                    row_operations.find_cell(
                        z, t, inputs[at.SHAPE_INPUT], grid[0], grid[1], grid[2]
                    )
                find_surface(z, table, grid[1])
            if present:
                if yields:
                    for t in range(width):
                        row_operations.press_object(z, t, constants)
                else:
                    for t in range(width):
                        row_operations.press_rigid(z, t, constants)
            for t in range(width):
                row_operations.improve(
                    z, t, row, tendon_m, material_m, grip, tolerance, trusted, constants
                )
            going = 0.0
            for t in range(width):
                going += z[at.OPEN, t]
            if going == 0.0:
                break
        for t in range(width):
            row_operations.end_step(z, t, row, grip, constants)
        if yields:
            for t in range(width):
                row_operations.end_object(z, t, row)

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
        z = np.zeros((at.ROWS, width))
        kept = np.zeros((at.STATE_ROWS, width))
        pending = np.zeros(width)
        part_inputs = np.empty(at.INPUTS)
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
                    # Who found no balance tries again from the step's start, in 2^level parts.
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
                    solve(z, coefficients[lengths[s], level], part_inputs, scene, control)
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

    compiled: Callable[..., None] = njit(cache=True, **_OPTIONS)(advance)
    return compiled
