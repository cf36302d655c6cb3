# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Functions that compute one time step of a trial, and coefficients that depend on its length.

In all functions, ``z`` is a block of trials, an array of shape (layout.ROWS, trials), and ``t``
selects trials. In the solver, ``t`` is a number. In the independent solver of the tests, it is a
slice of all trials.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_sim.physics import layout as at
from tactile_sim.physics.equations import (
    compute_balance,
    compute_line,
    compute_object_contact,
    compute_rigid_contact,
    select,
)

_SERIES_BELOW = 1.0
_SERIES_TERMS = 22  # the terms after these are below 1e-21

FloatArray = NDArray[np.float64]
MAX_HALVINGS = 10
"""If no balance is found in a time step, it is divided into 2, 4, ... up to 2^10 parts."""

MAX_TURN_RAD = 0.35
"""Largest change of q0 in one time step [rad]. With a larger change, the solver may have found a
different solution of the equations, so the step is divided."""

_MIDDLE_RAD, _RANGE_RAD = 0.9, 1.8
_SURPRISE = 0.01
"""Largest ``surprise`` of `compute_balance` with which an iteration of Newton's method can be the
last one without a check of the residual, as a fraction of ``trusted`` [1]."""


def compute_relaxation(step_s: float, time_s: float) -> tuple[float, float, float]:
    """Return coefficients (alpha, beta, gamma) for one time step of ``y' = (u - y) / time_s``.

    y changes from y0 to ``y1 = alpha y0 + beta u0 + gamma u1``. This is exact if the input u
    changes linearly from u0 to u1 (first-order hold). With a = step_s / time_s, alpha is exp(-a),
    beta is (1 - exp(-a)) / a - exp(-a), and gamma is 1 - (1 - exp(-a)) / a. Their sum is 1. For
    an infinite step, they are (0, 0, 1).
    """
    if math.isinf(step_s):
        return 0.0, 0.0, 1.0
    a = step_s / time_s
    alpha = math.exp(-a)
    if a >= _SERIES_BELOW:
        mean = -math.expm1(-a) / a
        return alpha, mean - alpha, 1 - mean
    # For short steps, the formulas above suffer from cancellation, so Taylor series are used.
    beta = gamma = 0.0
    term = 1.0
    for k in range(1, _SERIES_TERMS):
        term *= -a / (k + 1)  # the term is now (-a)^k / (k + 1)!
        beta -= k * term
        gamma -= term
    return alpha, beta, gamma


def compute_coefficients(
    steps_s: Sequence[float],
    creep_time_s: float,
    branch_times_s: Sequence[float],
    sensor_time_s: float,
) -> FloatArray:
    """Return the coefficients for each step length, and for its parts if a step is divided.

    An infinite length stands for the state of rest. The result has the shape (lengths,
    MAX_HALVINGS + 1, COLUMNS). Index i of the second axis is for steps that are divided into 2^i
    parts. The module `layout` has the columns.
    """
    table = np.zeros((len(steps_s), MAX_HALVINGS + 1, at.COLUMNS))
    for index in np.ndindex(table.shape[:2]):
        step_s, row = steps_s[index[0]] / 2 ** index[1], table[index]
        row[at.RATE_COLUMN] = 1 / step_s
        row[at.CREEP_COLUMN : at.CREEP_COLUMN + 3] = compute_relaxation(step_s, creep_time_s)
        for branch in range(at.MAX_BRANCHES):
            time_s = branch_times_s[branch] if branch < len(branch_times_s) else 1.0
            column = at.BRANCH_COLUMN + 3 * branch
            row[column : column + 3] = compute_relaxation(step_s, time_s)
        row[at.SENSOR_COLUMN : at.SENSOR_COLUMN + 3] = compute_relaxation(step_s, sensor_time_s)
    return table


def split_inputs(before: Any, after: Any, share: float, out: Any) -> None:
    """Write inputs to ``out``, interpolated linearly at the fraction ``share`` of a time step."""
    for i in range(at.PRESENT_INPUT):
        # With this formula, the result for ``share`` = 1 is exactly ``after``.
        out[i] = after[i] - (1.0 - share) * (after[i] - before[i])
    out[at.PRESENT_INPUT] = after[at.PRESENT_INPUT]  # is either 0 or 1


def begin_step(z: Any, t: Any, coefficients: Any) -> None:
    """Begin a time step: predict the modes, and compute the bases in the formulas of their rates.

    The predicted change of the modes is the change in the last step. The rate of a mode q at the
    end of the step is ``(q - base) * RATE``. This is the backward difference formula of second
    order (Gear, "Numerical initial value problems in ordinary differential equations", 1971). If
    the last step had another length, it is of first order (Euler). The acceleration is computed
    from the rates with the same formula, as ``q * RATE^2 - swing base``.
    """
    z[at.OPEN, t] = z[at.ACTIVE, t]
    known = 1.0 - z[at.FRESH, t]
    share = (1.0 / 3.0) * known
    q0, q1, q2 = z[at.MODES, t], z[at.MODES + 1, t], z[at.MODES + 2, t]
    d0, d1, d2 = z[at.DIFFERENCES, t], z[at.DIFFERENCES + 1, t], z[at.DIFFERENCES + 2, t]
    z[at.BASES, t], z[at.NEW_MODES, t] = q0 + share * d0, q0 + known * d0
    z[at.BASES + 1, t], z[at.NEW_MODES + 1, t] = q1 + share * d1, q1 + known * d1
    z[at.BASES + 2, t], z[at.NEW_MODES + 2, t] = q2 + share * d2, q2 + known * d2
    z[at.SQUEEZED_BASE, t] = z[at.SQUEEZED, t] + share * z[at.SQUEEZED_DIFFERENCE, t]
    z[at.RATE, t] = coefficients[at.RATE_COLUMN] * (1.0 + 0.5 * known)
    for i in range(3):
        velocity = z[at.VELOCITIES + i, t] + share * z[at.VELOCITY_DIFFERENCES + i, t]
        z[at.SWING_BASES + i, t] = z[at.RATE, t] * (z[at.RATE, t] * z[at.BASES + i, t] + velocity)


def begin_creep(z: Any, t: Any, coefficients: Any, constants: Any) -> None:
    """Compute the moments of the finger's creeping branch on the modes.

    The relaxation of the branch in this time step is computed exactly.
    """
    keep, early = coefficients[at.CREEP_COLUMN], coefficients[at.CREEP_COLUMN + 1]
    k = constants.creep_stiffness
    z[at.CREEP_MOMENTS, t] = k * (keep * z[at.CREEP, t] + early * z[at.MODES, t])
    z[at.CREEP_MOMENTS + 1, t] = (k / 3) * (keep * z[at.CREEP + 1, t] + early * z[at.MODES + 1, t])
    z[at.CREEP_MOMENTS + 2, t] = (k / 5) * (keep * z[at.CREEP + 2, t] + early * z[at.MODES + 2, t])


def begin_object(z: Any, t: Any, coefficients: Any, springs: Any) -> None:
    """Compute the stiffness of the object in this time step.

    Also compute the decrease of its force that is due to the relaxation of its branches.
    """
    factor, pressed = z[at.OBJECT_FACTOR, t], z[at.PRESSED, t]
    material, rest = springs[0], 0.0 * pressed
    for b in range(at.MAX_BRANCHES):
        k, column = springs[1 + b], at.BRANCH_COLUMN + 3 * b
        keep, early, late = (
            coefficients[column],
            coefficients[column + 1],
            coefficients[column + 2],
        )
        material = material + k * (1.0 - late)
        rest = rest + k * (keep * z[at.BRANCHES + b, t] + early * pressed)
    z[at.MATERIAL, t] = factor * material
    z[at.REST, t] = factor * rest


def locate(z: Any, t: Any, guide_m: float, constants: Any) -> None:
    """Compute the centre line of the bent finger, and the coordinate of its tip on the surface."""
    line = compute_line(
        z[at.NEW_MODES, t],
        z[at.NEW_MODES + 1, t],
        z[at.NEW_MODES + 2, t],
        constants.mass,
        constants.tip_mass,
    )
    z[at.REACH, t] = z[at.OFFSET, t] + z[at.SCALE, t] * guide_m + constants.length * line[1]
    i = at.LINE
    z[i, t], z[i + 1, t], z[i + 2, t], z[i + 3, t] = line[0], line[1], line[2], line[3]
    z[i + 4, t], z[i + 5, t], z[i + 6, t], z[i + 7, t] = line[4], line[5], line[6], line[7]
    z[i + 8, t], z[i + 9, t], z[i + 10, t], z[i + 11, t] = line[8], line[9], line[10], line[11]
    z[i + 12, t], z[i + 13, t], z[i + 14, t] = line[12], line[13], line[14]
    z[i + 15, t], z[i + 16, t], z[i + 17, t], z[i + 18, t] = line[15], line[16], line[17], line[18]


def find_cell(z: Any, t: Any, origin_m: float, per_spacing: float, last: float) -> None:
    """Find the cell of the surface's grid under the tip, or the nearest end of the grid."""
    cell = (z[at.REACH, t] - origin_m) * per_spacing
    cell = select(cell > 0.0, cell, 0.0)
    z[at.CELL, t] = select(cell < last, cell, last)


def press_rigid(z: Any, t: Any, constants: Any) -> None:
    """Compute the normal force between the fingertip and a rigid surface."""
    indentation = constants.length * z[at.LINE, t] - z[at.CLEARANCE, t] + z[at.HEIGHT, t]
    damper = constants.tip_damping * z[at.RATE, t]
    z[at.NEW_FORCE, t], z[at.FORCE_SLOPE, t] = compute_rigid_contact(
        indentation, constants.tip_stiffness + damper, damper * z[at.SQUEEZED_BASE, t]
    )


def press_object(z: Any, t: Any, constants: Any) -> None:
    """Compute the normal force between the fingertip and a soft object, and its compression."""
    indentation = constants.length * z[at.LINE, t] - z[at.CLEARANCE, t] + z[at.HEIGHT, t]
    damper = constants.tip_damping * z[at.RATE, t]
    z[at.NEW_FORCE, t], z[at.FORCE_SLOPE, t], z[at.NEW_PRESSED, t] = compute_object_contact(
        indentation,
        z[at.REST, t],
        z[at.MATERIAL, t],
        constants.tip_stiffness + damper,
        damper * z[at.SQUEEZED_BASE, t],
        constants.inverse_softening,
    )


def leave_object(z: Any, t: Any) -> None:
    """Compute the compression of an object that is not under the tip, so that it recovers."""
    material = z[at.MATERIAL, t]
    z[at.NEW_PRESSED, t] = z[at.REST, t] / select(material > 0.0, material, 1.0)


def improve(
    z: Any,
    t: Any,
    coefficients: Any,
    tendon_m: float,
    grip: float,
    tolerance: float,
    trusted: float,
    constants: Any,
) -> None:
    """Make one iteration of Newton's method for the trials that are not yet solved.

    A trial is solved when its residual moment is within ``tolerance``. It is also solved when the
    residual before this iteration was within ``trusted`` and friction is nearly linear.
    """
    i = at.LINE
    line = (
        z[i, t],
        z[i + 1, t],
        z[i + 2, t],
        z[i + 3, t],
        z[i + 4, t],
        z[i + 5, t],
        z[i + 6, t],
        z[i + 7, t],
        z[i + 8, t],
        z[i + 9, t],
        z[i + 10, t],
        z[i + 11, t],
        z[i + 12, t],
        z[i + 13, t],
        z[i + 14, t],
        z[i + 15, t],
        z[i + 16, t],
        z[i + 17, t],
        z[i + 18, t],
    )
    factor, late = z[at.FINGER_FACTOR, t], coefficients[at.CREEP_COLUMN + 2]
    residual, (s0, s1, s2), (tension, _, tip, tendon), after, surprise = compute_balance(
        line,
        (z[at.NEW_FORCE, t], z[at.FORCE_SLOPE, t]),
        (z[at.INCLINE, t], z[at.BEND, t]),
        z[at.REACH, t],
        (z[at.NEW_MODES, t], z[at.NEW_MODES + 1, t], z[at.NEW_MODES + 2, t]),
        (z[at.BASES, t], z[at.BASES + 1, t], z[at.BASES + 2, t]),
        (z[at.SWING_BASES, t], z[at.SWING_BASES + 1, t], z[at.SWING_BASES + 2, t]),
        (z[at.TIP_SLIDER, t], z[at.TENDON_SLIDER, t]),
        (
            z[at.CREEP_MOMENTS, t],
            z[at.CREEP_MOMENTS + 1, t],
            z[at.CREEP_MOMENTS + 2, t],
            constants.creep_stiffness * (1.0 - late),
        ),
        (z[at.FRICTION, t], factor),
        tendon_m + z[at.TENDON_ZERO, t],
        z[at.RATE, t],
        grip,
        constants,
    )
    was_open = z[at.OPEN, t] > 0.0
    # Because comparisons with NaN are false, a trial with NaN remains unsolved.
    go = select(residual <= tolerance, 0.0, z[at.OPEN, t])
    ends = select(residual <= trusted, 0.0, go)
    z[at.OPEN, t] = select(surprise <= _SURPRISE * trusted, ends, go)
    goes = go > 0.0
    kept, force = z[at.NEW_TENSION, t], z[at.NEW_FORCE, t]
    z[at.NEW_TENSION, t] = select(goes, after[0], select(was_open, tension, kept))
    z[at.END_FORCE, t] = select(goes, after[1], select(was_open, force, z[at.END_FORCE, t]))
    z[at.NEW_TIP, t] = select(goes, after[2], select(was_open, tip, z[at.NEW_TIP, t]))
    z[at.NEW_TENDON, t] = select(goes, after[3], select(was_open, tendon, z[at.NEW_TENDON, t]))
    z[at.NEW_MODES, t] = z[at.NEW_MODES, t] - go * s0
    z[at.NEW_MODES + 1, t] = z[at.NEW_MODES + 1, t] - go * s1
    z[at.NEW_MODES + 2, t] = z[at.NEW_MODES + 2, t] - go * s2


def end_step(z: Any, t: Any, coefficients: Any, grip: float, constants: Any) -> None:
    """Write the results of the time step to the state of each trial that is solved."""
    q0 = z[at.NEW_MODES, t]
    turn = select(abs(q0 - z[at.MODES, t]) <= MAX_TURN_RAD, 1.0, 1.0 - grip)
    inside = select(abs(q0 - _MIDDLE_RAD) <= _RANGE_RAD, turn, 0.0)
    solved = (z[at.ACTIVE, t] - z[at.OPEN, t]) * inside
    z[at.SOLVED, t] = solved
    done = solved > 0.0
    keep, early, late = (
        coefficients[at.CREEP_COLUMN],
        coefficients[at.CREEP_COLUMN + 1],
        coefficients[at.CREEP_COLUMN + 2],
    )
    for i in range(3):
        old, new = z[at.MODES + i, t], z[at.NEW_MODES + i, t]
        relaxed = keep * z[at.CREEP + i, t] + early * old + late * new
        z[at.CREEP + i, t] = select(done, relaxed, z[at.CREEP + i, t])
        z[at.DIFFERENCES + i, t] = select(done, new - old, z[at.DIFFERENCES + i, t])
        velocity = (new - z[at.BASES + i, t]) * z[at.RATE, t]
        change = velocity - z[at.VELOCITIES + i, t]
        z[at.VELOCITY_DIFFERENCES + i, t] = select(done, change, z[at.VELOCITY_DIFFERENCES + i, t])
        z[at.VELOCITIES + i, t] = select(done, velocity, z[at.VELOCITIES + i, t])
        z[at.MODES + i, t] = select(done, new, old)
    z[at.FRESH, t] = select(done, 0.0, z[at.FRESH, t])
    damper = constants.tip_damping * z[at.RATE, t]
    squeezed = z[at.END_FORCE, t] + damper * z[at.SQUEEZED_BASE, t]
    squeezed = squeezed / (constants.tip_stiffness + damper)
    change = squeezed - z[at.SQUEEZED, t]
    z[at.SQUEEZED_DIFFERENCE, t] = select(done, change, z[at.SQUEEZED_DIFFERENCE, t])
    z[at.SQUEEZED, t] = select(done, squeezed, z[at.SQUEEZED, t])
    z[at.TIP_SLIDER, t] = select(done, z[at.NEW_TIP, t], z[at.TIP_SLIDER, t])
    z[at.TENDON_SLIDER, t] = select(done, z[at.NEW_TENDON, t], z[at.TENDON_SLIDER, t])
    z[at.TENSION, t] = select(done, z[at.NEW_TENSION, t], z[at.TENSION, t])
    z[at.FORCE, t] = select(done, z[at.END_FORCE, t], z[at.FORCE, t])
    felt = z[at.NEW_TENSION, t] + constants.crosstalk * z[at.END_FORCE, t]
    sensed = (
        coefficients[at.SENSOR_COLUMN] * z[at.SENSED, t]
        + coefficients[at.SENSOR_COLUMN + 1] * z[at.SENSOR_INPUT, t]
        + coefficients[at.SENSOR_COLUMN + 2] * felt
    )
    z[at.SENSED, t] = select(done, sensed, z[at.SENSED, t])
    z[at.SENSOR_INPUT, t] = select(done, felt, z[at.SENSOR_INPUT, t])


def end_object(z: Any, t: Any, coefficients: Any) -> None:
    """Update the relaxation of the object's branches; must be called after `end_step`."""
    done = z[at.SOLVED, t] > 0.0
    old, new = z[at.PRESSED, t], z[at.NEW_PRESSED, t]
    for b in range(at.MAX_BRANCHES):
        column = at.BRANCH_COLUMN + 3 * b
        relaxed = (
            coefficients[column] * z[at.BRANCHES + b, t]
            + coefficients[column + 1] * old
            + coefficients[column + 2] * new
        )
        z[at.BRANCHES + b, t] = select(done, relaxed, z[at.BRANCHES + b, t])
    z[at.PRESSED, t] = select(done, new, old)
