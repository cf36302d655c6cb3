# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Advance trials of one scene through time, with whichever solver is at hand."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
import importlib.util
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_sim.errors import DescriptionError
from tactile_sim.physics.finger import layout as at

FloatArray = NDArray[np.float64]

SOLVERS = ('compiled', 'numpy')
TOLERANCE_NM = 1e-7
"""Largest moment that a solved step leaves unbalanced; about 2e-5 N of tension."""

_BLOCK = 16
_ITERATIONS = 12


def choose_solver(name: str = '') -> str:
    """Return the solver of this name; without one, the compiled one where numba is installed.

    Raises
    ------
    DescriptionError
        There is no such solver, or it needs numba, which is not installed.
    """
    has_numba = importlib.util.find_spec('numba') is not None
    if not name:
        return 'compiled' if has_numba else 'numpy'
    if name not in SOLVERS:
        raise DescriptionError(f'no solver {name!r}; there are {" and ".join(SOLVERS)}')
    if name == 'compiled' and not has_numba:
        raise DescriptionError('the compiled solver needs numba: pip install numba')
    return name


def advance_trials(
    solver: str,
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
    """Advance every trial through the same steps.

    A trial's result does not depend on the others beside it, nor on the solver.

    Parameters
    ----------
    solver
        From `choose_solver`.
    state : ndarray of float, shape (TRIAL_ROWS, trials)
        See `layout`; holds the new state afterwards.
    scene
        `Scene.parameters`.
    lengths : ndarray of int, shape (steps,)
        Which row of ``coefficients`` belongs to each step.
    start, inputs : ndarray of float, shapes (INPUTS,) and (steps, INPUTS)
        Before the first step, and at the end of each.
    coefficients
        From `compute_coefficients`.
    rows
        Rows of the state to return of each step.
    failed : ndarray of int, shape (trials,)
        -1 for a trial that goes on; afterwards the step at which it found no balance.
    grip
        1, or 0 to let go of all friction.
    tolerance_nm
        A step is solved when no moment is left unbalanced by more [N m].
    trusted_nm
        A change of Newton's method from a residual within this ends the step, unchecked, where
        friction does as foreseen; for surfaces that do not yield [N m].

    Returns
    -------
    ndarray of float, shape (blocks, steps + 1, rows, width)
        Before the first step and after each; of a failed trial, as it was last. Trial i
        stands in block i // width at place i % width.
    """
    control = (grip, tolerance_nm, trusted_nm, _ITERATIONS)
    trials = state.shape[1]
    wanted = np.array(rows, dtype=np.int64)
    width = trials if solver == 'numpy' else _BLOCK
    # A block is always full: the last trial stands in for those that are missing.
    columns = np.minimum(np.arange(-(-trials // width) * width), trials - 1).reshape(-1, width)
    out = np.empty((len(columns), len(lengths) + 1, len(rows), width), dtype=state.dtype)
    advance = _load_advance(solver)
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
def _load_advance(solver: str) -> Callable[..., None]:
    # Here, because numba takes half a second to load: only who simulates pays for it.
    if solver == 'numpy':
        from tactile_sim.physics.finger.numpy_solver import advance

        return advance
    from tactile_sim.physics.finger.compiled_solver import make_advance

    return make_advance(_BLOCK)
