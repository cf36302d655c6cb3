# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The equations of the finger: its centre line, its inertia, and the balance of moments.

The line is clamped horizontally. With xi from 0 at the base to 1 at the tip, its slope angle is

    theta(xi) = q0 xi + q1 (xi^2 - xi) + q2 (2 xi^3 - 3 xi^2 + xi),

where q0, q1 and q2 are the modes of the finger. Its curvature is q0 P0 + q1 P1 + q2 P2 with
Legendre polynomials P of 2 xi - 1. Because these polynomials are orthogonal, stiffness, damping
and creep of mode i are those of mode 0 divided by 2 i + 1. docs/simulation.md has all equations.

Every function that is evaluated in a time step works on numbers and on arrays of trials, and uses
only elementary arithmetic. Therefore, the solver, which passes single numbers, and the independent
solver in the tests, which passes arrays, compute exactly equal results.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


GRAVITY_M_S2 = 9.80665

# Gauss-Legendre nodes, at which integrals along the finger are evaluated. According to a test, the
# error of the tip's position with four nodes is below 1e-5 of the length for bends up to 115 deg.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
NODE_XI = tuple(float(p + 1) / 2 for p in _POINTS)
NODE_WEIGHT = tuple(float(w) / 2 for w in _WEIGHTS)

# Sine and cosine are computed as Taylor series about _MIDDLE_RAD. According to a test, their error
# is below 6e-11 for angles from -0.9 to 2.7 rad.
_MIDDLE_RAD = 0.9
_COS_MIDDLE, _SIN_MIDDLE = math.cos(_MIDDLE_RAD), math.sin(_MIDDLE_RAD)
_S3, _S5, _S7, _S9 = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880
_S11, _S13, _S15 = -1 / 39916800, 1 / 6227020800, -1 / 1307674368000
_C4, _C6, _C8, _C10 = 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800
_C12, _C14, _C16 = 1 / 479001600, -1 / 87178291200, 1 / 20922789888000
NO_MASSES = (0.0,) * 6
MAX_CHANGE_RAD = 0.2
"""Largest change of a mode in one iteration of Newton's method [rad]."""


class Node(NamedTuple):
    """A node of the Gauss-Legendre quadrature along the finger.

    ``b0`` to ``b2`` are the slope angles of the three modes at the node, per unit of the mode, and
    ``b00`` to ``b22`` are their products. ``beyond`` is the fraction of the finger's mass between
    the node and the tip.
    """

    b0: float
    b1: float
    b2: float
    b00: float
    b01: float
    b02: float
    b11: float
    b12: float
    b22: float
    weight: float
    beyond: float


def _make_node(xi: float, weight: float) -> Node:
    b0, b1, b2 = xi, xi * xi - xi, 2 * xi**3 - 3 * xi * xi + xi
    products = (b0 * b0, b0 * b1, b0 * b2, b1 * b1, b1 * b2, b2 * b2)
    return Node(b0, b1, b2, *products, weight, 1 - xi)


NODE_0, NODE_1, NODE_2, NODE_3 = (
    _make_node(xi, weight) for xi, weight in zip(NODE_XI, NODE_WEIGHT, strict=True)
)


def compute_sine_cosine(angle: Any) -> Any:
    """Return sine and cosine of a slope angle between -0.9 and 2.7 rad."""
    d = angle - _MIDDLE_RAD
    y = d * d
    y2 = y * y
    # Estrin's scheme has shorter chains of dependent operations than Horner's scheme.
    y4 = y2 * y2
    sine = d * (
        ((1 + _S3 * y) + y2 * (_S5 + _S7 * y)) + y4 * ((_S9 + _S11 * y) + y2 * (_S13 + _S15 * y))
    )
    cosine = ((1 - 0.5 * y) + y2 * (_C4 + _C6 * y)) + y4 * (
        ((_C8 + _C10 * y) + y2 * (_C12 + _C14 * y)) + y4 * _C16
    )
    return sine * _COS_MIDDLE + cosine * _SIN_MIDDLE, cosine * _COS_MIDDLE - sine * _SIN_MIDDLE


def bend_node(node: Any, q0: Any, q1: Any, q2: Any) -> Any:
    """Return sine and cosine of the finger's slope at a node, times the weight of the node."""
    sine, cosine = compute_sine_cosine(q0 * node.b0 + q1 * node.b1 + q2 * node.b2)
    return node.weight * sine, node.weight * cosine


def compute_line(q0: Any, q1: Any, q2: Any, mass: float, tip_mass: float) -> Any:
    """Return quantities of the bent centre line, divided by the length of the finger.

    Returns
    -------
    tuple of 19
        Drop z and reach x of the tip; derivatives z_i of z by the three modes; derivatives x_i of
        x; moment of the weight on each mode [N]; sine and cosine of the slope at each node, times
        the weight of the node. `curve_line` computes second derivatives from the last ones.
    """
    a, b, c, d = NODE_0, NODE_1, NODE_2, NODE_3
    sa, ca = bend_node(a, q0, q1, q2)
    sb, cb = bend_node(b, q0, q1, q2)
    sc, cc = bend_node(c, q0, q1, q2)
    sd, cd = bend_node(d, q0, q1, q2)
    # The slope at a node lowers all of the mass between the node and the tip.
    ga = ca * (GRAVITY_M_S2 * (mass * a.beyond + tip_mass))
    gb = cb * (GRAVITY_M_S2 * (mass * b.beyond + tip_mass))
    gc = cc * (GRAVITY_M_S2 * (mass * c.beyond + tip_mass))
    gd = cd * (GRAVITY_M_S2 * (mass * d.beyond + tip_mass))
    return (
        (sa + sb) + (sc + sd),
        (ca + cb) + (cc + cd),
        (ca * a.b0 + cb * b.b0) + (cc * c.b0 + cd * d.b0),
        (ca * a.b1 + cb * b.b1) + (cc * c.b1 + cd * d.b1),
        (ca * a.b2 + cb * b.b2) + (cc * c.b2 + cd * d.b2),
        -((sa * a.b0 + sb * b.b0) + (sc * c.b0 + sd * d.b0)),
        -((sa * a.b1 + sb * b.b1) + (sc * c.b1 + sd * d.b1)),
        -((sa * a.b2 + sb * b.b2) + (sc * c.b2 + sd * d.b2)),
        (ga * a.b0 + gb * b.b0) + (gc * c.b0 + gd * d.b0),
        (ga * a.b1 + gb * b.b1) + (gc * c.b1 + gd * d.b1),
        (ga * a.b2 + gb * b.b2) + (gc * c.b2 + gd * d.b2),
        sa,
        ca,
        sb,
        cb,
        sc,
        cc,
        sd,
        cd,
    )


def curve_line(line: Any, of_z: Any, of_x: Any, mass: float, tip_mass: float) -> Any:
    """Return ``of_z * z_ij + of_x * x_ij - w_ij`` for pairs of modes 00, 01, 02, 11, 12 and 22.

    z_ij and x_ij are the second derivatives of the tip's drop and reach by the modes i and j. w_ij
    is the derivative of the weight's moment on mode i by mode j. All are divided by the length.
    ``line`` is the result of `compute_line`.
    """
    a, b, c, d = NODE_0, NODE_1, NODE_2, NODE_3
    ka = line[11] * (GRAVITY_M_S2 * (mass * a.beyond + tip_mass) - of_z) - line[12] * of_x
    kb = line[13] * (GRAVITY_M_S2 * (mass * b.beyond + tip_mass) - of_z) - line[14] * of_x
    kc = line[15] * (GRAVITY_M_S2 * (mass * c.beyond + tip_mass) - of_z) - line[16] * of_x
    kd = line[17] * (GRAVITY_M_S2 * (mass * d.beyond + tip_mass) - of_z) - line[18] * of_x
    return (
        (ka * a.b00 + kb * b.b00) + (kc * c.b00 + kd * d.b00),
        (ka * a.b01 + kb * b.b01) + (kc * c.b01 + kd * d.b01),
        (ka * a.b02 + kb * b.b02) + (kc * c.b02 + kd * d.b02),
        (ka * a.b11 + kb * b.b11) + (kc * c.b11 + kd * d.b11),
        (ka * a.b12 + kb * b.b12) + (kc * c.b12 + kd * d.b12),
        (ka * a.b22 + kb * b.b22) + (kc * c.b22 + kd * d.b22),
    )


def compute_mass_matrix(
    length_m: float, mass_kg: float, tip_mass_kg: float, bend_rad: float
) -> tuple[float, ...]:
    """Return the mass matrix M of the modes, for a finger that is bent to an arc [kg m^2].

    The result has the elements 00, 01, 02, 11, 12 and 22. M_ij is the mass times the mean of
    r_i . r_j along the finger, plus the tip mass times r_i . r_j at the tip. r_i is the derivative
    of the position of a point on the centre line by mode i.
    """
    points, weights = np.polynomial.legendre.leggauss(12)
    nodes = [(float(p + 1) / 2, float(w) / 2) for p, w in zip(points, weights, strict=True)]
    sums = [0.0] * 6
    for xi, share in [*((xi, mass_kg * weight) for xi, weight in nodes), (1.0, tip_mass_kg)]:
        moved = [[0.0, 0.0] for _ in range(3)]
        for part, weight in nodes:
            s = xi * part
            step_m = length_m * xi * weight
            sine, cosine = math.sin(bend_rad * s), math.cos(bend_rad * s)
            for place, slope in zip(moved, (s, s * s - s, 2 * s**3 - 3 * s * s + s), strict=True):
                place[0] -= step_m * slope * sine
                place[1] += step_m * slope * cosine
        pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        for k, (i, j) in enumerate(pairs):
            sums[k] += share * (moved[i][0] * moved[j][0] + moved[i][1] * moved[j][1])
    return tuple(sums)


class Constants(NamedTuple):
    """Constants of the equations that all trials of a scene share, in SI units.

    Most of them are values of `Finger`. Names with ``per_`` are reciprocals, which are stored
    because a division takes as much time as several products. ``masses`` is the mass matrix of the
    modes, with the elements 00, 01, 02, 11, 12 and 22 [kg m^2]; zero for a finger without inertia.
    """

    length: float
    arm: float
    tendon_stiffness: float
    tendon_friction: float
    presliding_rad: float
    per_presliding: float
    stiffness: float
    creep_stiffness: float
    damping: float
    mass: float
    tip_mass: float
    stop_rad: float
    stop_stiffness: float
    tip_stiffness: float
    tip_damping: float
    shear_stiffness: float
    per_shear_stiffness: float
    inverse_softening: float
    crosstalk: float
    masses: tuple[float, ...] = NO_MASSES


def select(condition: Any, yes: Any, no: Any) -> Any:
    """Return ``yes`` where the condition is true, else ``no``, for numbers or arrays."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, yes, no)
    return yes if condition else no


def compute_rigid_contact(indentation: Any, tip_stiffness: Any, held: Any) -> Any:
    """Return the normal force on a fingertip that touches a rigid surface [N].

    The second result is the derivative of the force by the indentation [N/m]. The fingertip is a
    spring in parallel with a damper. In a time step, it pushes with the force
    ``tip_stiffness * indentation - held``, but it never pulls.
    """
    force = tip_stiffness * indentation - held
    apart = force <= 0.0  # False for NaN, so that NaN is not replaced by 0
    return select(apart, 0.0, force), select(apart, 0.0, tip_stiffness)


def compute_object_contact(
    indentation: Any,
    rest: Any,
    material: Any,
    tip_stiffness: Any,
    held: Any,
    inverse_softening: float,
) -> Any:
    """Return the normal force on a fingertip that touches a soft object.

    Fingertip and object are springs in series. The object pushes with ``material * p - rest``,
    where p is its effective compression. Its compression u is p + p^2 / (2 softening). For small
    u, its force is therefore proportional to u, and for large u to the square root of u, as for a
    buckled shell (Pogorelov, "Bending of surfaces and stability of shells", 1988).

    Returns the normal force [N], its derivative by the indentation [N/m], and p [m].
    """
    push = tip_stiffness * indentation - held + rest
    push = select(push <= 0.0, 0.0, push)  # does not replace NaN
    both = tip_stiffness + material
    root = np.sqrt(both * both + 2 * tip_stiffness * inverse_softening * push)
    compression = 2 * push / (both + root)
    force = material * compression - rest
    apart = force <= 0.0
    slope = select(apart, 0.0, material * tip_stiffness / root)
    # Without contact, no force acts on the object, so that it recovers its shape.
    alone = rest / select(material > 0.0, material, 1.0)
    return select(apart, 0.0, force), slope, select(apart, alone, compression)


def compute_balance(
    line: Any,
    contact: Any,
    surface: Any,
    place: Any,
    modes: Any,
    bases: Any,
    swing_bases: Any,
    sliders: Any,
    creep: Any,
    factors: Any,
    tendon_m: Any,
    rate: float,
    grip: float,
    constants: Any,
) -> Any:
    """Compute one iteration of Newton's method for the balance of moments on the three modes.

    Parameters
    ----------
    line : tuple
        Result of `compute_line`.
    contact : tuple
        Normal force on the fingertip [N], and its derivative by the indentation [N/m].
    surface : tuple
        Slope [1] and curvature [1/m] of the surface under the tip.
    place : float or ndarray
        Coordinate of the tip on the surface [m].
    modes, bases : tuple
        The modes q [rad], and the bases in the formula of their rates, (q - base) * rate.
    swing_bases : tuple
        Bases in the formula of the modes' accelerations, q * rate^2 - swing base [rad/s^2].
    sliders : tuple
        Positions at which the tip [m] and the tendon [rad] last stuck by friction.
    creep : tuple
        Moment of the finger's creeping branch on each mode [N m], and the stiffness of this branch
        in the time step [N m/rad].
    factors : tuple
        Friction coefficient of the tip, and stiffness of the finger relative to its description.
    tendon_m : float or ndarray
        Displacement of the tendon [m].
    rate : float or ndarray
        Factor in the formulas of rates and accelerations [1/s]; 0 for the state of rest.
    grip : float
        1, or 0 for a finger without friction.
    constants : Constants
        Constants of the scene.

    Returns
    -------
    residual
        Largest moment that is not balanced [N m].
    changes : tuple
        Values to subtract from the three modes [rad].
    now : tuple
        For the present modes: tension [N], friction of the tip [N] and new ``sliders``.
    after : tuple
        For the changed modes, to first order: tension [N], normal force [N], new ``sliders``.
    surprise
        Error of the friction's linearisation [N m]. It is large if friction begins to stick or
        slide, or changes its direction.
    """
    c = constants
    (force, force_slope), (incline, bend) = contact, surface
    q0, q1, q2 = modes
    friction, stiff = factors
    m0, m1, m2, creep_stiffness = creep
    z0, z1, z2 = c.length * line[2], c.length * line[3], c.length * line[4]
    x0, x1, x2 = c.length * line[5], c.length * line[6], c.length * line[7]

    # Tension of the tendon, and its friction in the bent finger (capstan equation). Below a small
    # displacement, the tendon sticks like a spring.
    stretch = tendon_m - c.arm * q0
    slack = stretch <= 0.0  # False for NaN, so that NaN is not replaced by 0
    tension = select(slack, 0.0, c.tendon_stiffness * stretch)
    tension_0 = select(slack, 0.0, -c.tendon_stiffness * c.arm)
    ahead = (q0 - sliders[1]) * c.per_presliding
    sticks = abs(ahead) < 1.0
    drag = grip * select(sticks, ahead, select(ahead > 0.0, 1.0, -1.0))
    drag_0 = grip * select(sticks, c.per_presliding, 0.0)
    tendon_slider = q0 - drag * c.presliding_rad
    wrap = c.tendon_friction * q0 * drag
    wrap_0 = c.tendon_friction * (drag + q0 * drag_0)
    # Moments of the tension, which decreases along the finger as exp(-wrap xi), on the modes, as
    # power series in wrap. xi is 0 at the base and 1 at the tip.
    p0 = 1 - wrap * (1 / 2 - wrap * (1 / 6 - wrap * (1 / 24 - wrap * (1 / 120))))
    p1 = -wrap * (1 / 6 - wrap * (1 / 12 - wrap * (1 / 40 - wrap * (1 / 180))))
    p2 = wrap * wrap * (1 / 60 - wrap * (1 / 120 - wrap * (1 / 420)))
    p0_0 = -wrap_0 * (1 / 2 - wrap * (1 / 3 - wrap * (1 / 8 - wrap * (1 / 30))))
    p1_0 = -wrap_0 * (1 / 6 - wrap * (1 / 6 - wrap * (3 / 40 - wrap * (1 / 45))))
    p2_0 = wrap_0 * wrap * (1 / 30 - wrap * (1 / 40 - wrap * (1 / 105)))
    pull, pull_0 = c.arm * tension, c.arm * tension_0

    # Friction of the tip: the force of its shear spring, limited to the Coulomb friction.
    spring = c.shear_stiffness * (place - sliders[0])
    limit = grip * friction * force
    slips = abs(spring) > limit
    signed = select(spring > 0.0, grip * friction, -grip * friction)
    rub = select(slips, signed * force, spring)
    rub_place = select(slips, 0.0, c.shear_stiffness)
    rub_force = select(slips, signed, 0.0)
    tip_slider = place - rub * c.per_shear_stiffness

    # Lever arms of the normal force, and of friction along the surface.
    n0, n1, n2 = z0 + incline * x0, z1 + incline * x1, z2 + incline * x2
    t0, t1, t2 = x0 - incline * z0, x1 - incline * z1, x2 - incline * z2
    f0, f1, f2 = force_slope * n0, force_slope * n1, force_slope * n2
    r0 = rub_place * x0 + rub_force * f0
    r1 = rub_place * x1 + rub_force * f1
    r2 = rub_place * x2 + rub_force * f2

    stop = q0 - c.stop_rad
    stopped = stop > 0.0
    d0 = c.damping * rate
    k0 = stiff * (c.stiffness + creep_stiffness)
    d1, d2, k1, k2 = d0 / 3, d0 / 5, k0 / 3, k0 / 5
    swing = rate * rate
    g0, g1 = q0 * swing - swing_bases[0], q1 * swing - swing_bases[1]
    g2 = q2 * swing - swing_bases[2]
    mass_00, mass_01, mass_02, mass_11, mass_12, mass_22 = c.masses
    i00, i01, i02 = swing * mass_00, swing * mass_01, swing * mass_02
    i11, i12, i22 = swing * mass_11, swing * mass_12, swing * mass_22
    weight = c.length
    e0 = d0 * (q0 - bases[0]) + k0 * q0 - stiff * m0 - weight * line[8] - pull * p0
    e1 = d1 * (q1 - bases[1]) + k1 * q1 - stiff * m1 - weight * line[9] - pull * p1
    e2 = d2 * (q2 - bases[2]) + k2 * q2 - stiff * m2 - weight * line[10] - pull * p2
    e0 = e0 + select(stopped, c.stop_stiffness * stop, 0.0) + force * n0 + rub * t0
    e1 = e1 + force * n1 + rub * t1
    e2 = e2 + force * n2 + rub * t2
    e0 = e0 + (mass_00 * g0 + mass_01 * g1 + mass_02 * g2)
    e1 = e1 + (mass_01 * g0 + mass_11 * g1 + mass_12 * g2)
    e2 = e2 + (mass_02 * g0 + mass_12 * g1 + mass_22 * g2)

    # Elements a_ij of the Jacobian matrix that are due to second derivatives of drop and reach,
    # the weight and the inertia. After them, all elements j_ij of the matrix.
    a00, a01, a02, a11, a12, a22 = curve_line(
        line, force - rub * incline, force * incline + rub, c.mass, c.tip_mass
    )
    a00, a01, a02 = c.length * a00 + i00, c.length * a01 + i01, c.length * a02 + i02
    a11, a12, a22 = c.length * a11 + i11, c.length * a12 + i12, c.length * a22 + i22
    h_n, h_t = bend * force, bend * rub
    b0, b1, b2 = h_n * x0 - h_t * z0, h_n * x1 - h_t * z1, h_n * x2 - h_t * z2
    stop_0 = select(stopped, c.stop_stiffness, 0.0)
    j00 = d0 + k0 + stop_0 - pull_0 * p0 - pull * p0_0 + a00 + f0 * n0 + r0 * t0 + b0 * x0
    j10 = -pull_0 * p1 - pull * p1_0 + a01 + f0 * n1 + r0 * t1 + b1 * x0
    j20 = -pull_0 * p2 - pull * p2_0 + a02 + f0 * n2 + r0 * t2 + b2 * x0
    j01, j02 = a01 + f1 * n0 + r1 * t0 + b0 * x1, a02 + f2 * n0 + r2 * t0 + b0 * x2
    j11, j12 = d1 + k1 + a11 + f1 * n1 + r1 * t1 + b1 * x1, a12 + f2 * n1 + r2 * t1 + b1 * x2
    j21, j22 = a12 + f1 * n2 + r1 * t2 + b2 * x1, d2 + k2 + a22 + f2 * n2 + r2 * t2 + b2 * x2

    # Solve the linear equations by Cramer's rule, and limit the changes to MAX_CHANGE_RAD.
    c00, c01, c02 = j11 * j22 - j12 * j21, j12 * j20 - j10 * j22, j10 * j21 - j11 * j20
    c10, c11, c12 = j02 * j21 - j01 * j22, j00 * j22 - j02 * j20, j01 * j20 - j00 * j21
    c20, c21, c22 = j01 * j12 - j02 * j11, j02 * j10 - j00 * j12, j00 * j11 - j01 * j10
    over = 1.0 / (j00 * c00 + j01 * c01 + j02 * c02)
    s0 = (c00 * e0 + c10 * e1 + c20 * e2) * over
    s1 = (c01 * e0 + c11 * e1 + c21 * e2) * over
    s2 = (c02 * e0 + c12 * e1 + c22 * e2) * over
    residual = larger(abs(e0), larger(abs(e1), abs(e2)))
    s0, s1, s2 = shorten(s0), shorten(s1), shorten(s2)
    now = (tension, rub, tip_slider, tendon_slider)

    # Results for the changed modes, which are used if this iteration is the last one.
    stretch = stretch + c.arm * s0
    tension = select(stretch <= 0.0, 0.0, c.tendon_stiffness * stretch)
    force = force - (f0 * s0 + f1 * s1 + f2 * s2)
    force = select(force <= 0.0, 0.0, force)
    place = place - (x0 * s0 + x1 * s1 + x2 * s2)
    spring = c.shear_stiffness * (place - sliders[0])
    limit = grip * friction * force
    slides = select(spring > 0.0, limit, -limit)
    end_rub = select(abs(spring) > limit, slides, spring)
    q0 = q0 - s0
    ahead = (q0 - sliders[1]) * c.per_presliding
    end_drag = grip * select(abs(ahead) < 1.0, ahead, select(ahead > 0.0, 1.0, -1.0))
    tip_slider = place - end_rub * c.per_shear_stiffness
    after = (tension, force, tip_slider, q0 - end_drag * c.presliding_rad)
    foreseen = rub - (r0 * s0 + r1 * s1 + r2 * s2)
    surprise = abs(end_rub - foreseen) * c.length
    foreseen = drag - drag_0 * s0
    surprise = surprise + abs(end_drag - foreseen) * abs(c.tendon_friction * q0 * pull)
    return residual, (s0, s1, s2), now, after, surprise


def shorten(change: Any) -> Any:
    """Limit a change to MAX_CHANGE_RAD."""
    change = select(change > MAX_CHANGE_RAD, MAX_CHANGE_RAD, change)
    return select(change < -MAX_CHANGE_RAD, -MAX_CHANGE_RAD, change)


def larger(a: Any, b: Any) -> Any:
    """Return the larger of two numbers, or of each pair of elements of two arrays."""
    return select(a > b, a, b)


def compute_curve(length_m: float, modes_rad: FloatArray, points: int = 65) -> FloatArray:
    """Return points on the finger's centre line from base to tip, shape (points, 2) [m].

    The columns are reach and drop. ``modes_rad`` are the modes q0, q1 and q2 [rad].
    """
    fine = np.linspace(0.0, 1.0, 8 * (points - 1) + 1)
    q0, q1, q2 = modes_rad
    middle = (fine[1:] + fine[:-1]) / 2
    slope = q0 * middle + q1 * (middle**2 - middle)
    slope += q2 * (2 * middle**3 - 3 * middle**2 + middle)
    steps = np.stack([np.cos(slope), np.sin(slope)], axis=1) * length_m / len(middle)
    curve = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.asarray(curve[::8], dtype=np.float64)
