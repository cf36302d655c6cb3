# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The shape of the bent finger: a planar line with three curvature modes, and its weight.

The line is clamped level. With xi from 0 at the base to 1 at the tip, its slope angle is

    theta(xi) = q0 xi + q1 (xi^2 - xi) + q2 (2 xi^3 - 3 xi^2 + xi),

that is, the curvature is q0 P0 + q1 P1 + q2 P2 with Legendre polynomials of 2 xi - 1. As those
of `mechanics`, the functions work on numbers and on arrays of trials alike, and give the same
bits.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

GRAVITY_M_S2 = 9.80665

# Gauss-Legendre nodes along the finger. With |q1| up to 0.3 and |q2| up to 0.2, four of them
# integrate the tip's place to 1.3e-6 of the length up to 60 deg, to 7e-6 up to 115 deg (a test).
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
NODE_XI = tuple(float(p + 1) / 2 for p in _POINTS)
NODE_WEIGHT = tuple(float(w) / 2 for w in _WEIGHTS)


class Node(NamedTuple):
    """One Gauss point: slope angle of each mode, their products, weight, mass beyond it."""

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

# sin and cos about the middle of the angles that occur; Taylor series, error below 6e-11
# for angles from -0.9 to 2.7 rad, below 1e-12 for -0.4 to 2.2 rad (a test).
_MIDDLE_RAD = 0.9
_COS_MIDDLE, _SIN_MIDDLE = math.cos(_MIDDLE_RAD), math.sin(_MIDDLE_RAD)
_S3, _S5, _S7, _S9 = -1 / 6, 1 / 120, -1 / 5040, 1 / 362880
_S11, _S13, _S15 = -1 / 39916800, 1 / 6227020800, -1 / 1307674368000
_C4, _C6, _C8, _C10 = 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800
_C12, _C14, _C16 = 1 / 479001600, -1 / 87178291200, 1 / 20922789888000


def compute_sine_cosine(angle: Any) -> Any:
    """Sine and cosine of a slope angle [rad]; see `_MIDDLE_RAD` for the range."""
    d = angle - _MIDDLE_RAD
    y = d * d
    y2 = y * y
    y4 = y2 * y2  # Estrin's scheme: shorter chains of operations than Horner's
    sine = d * (
        ((1 + _S3 * y) + y2 * (_S5 + _S7 * y)) + y4 * ((_S9 + _S11 * y) + y2 * (_S13 + _S15 * y))
    )
    cosine = ((1 - 0.5 * y) + y2 * (_C4 + _C6 * y)) + y4 * (
        ((_C8 + _C10 * y) + y2 * (_C12 + _C14 * y)) + y4 * _C16
    )
    return sine * _COS_MIDDLE + cosine * _SIN_MIDDLE, cosine * _COS_MIDDLE - sine * _SIN_MIDDLE


def bend_node(node: Any, q0: Any, q1: Any, q2: Any) -> Any:
    """Weighted sine and cosine of the slope at a node."""
    sine, cosine = compute_sine_cosine(q0 * node.b0 + q1 * node.b1 + q2 * node.b2)
    return node.weight * sine, node.weight * cosine


def compute_line(q0: Any, q1: Any, q2: Any, mass: float, tip_mass: float) -> Any:
    """The bent line per unit of length: its tip, its weight, and their slopes by the modes.

    Returns
    -------
    tuple of 19
        Drop z and reach x; z_i; x_i; moment of the weight on each mode [N]; the weighted
        sine and cosine at each node, from which `curve_line` makes second derivatives.
    """
    a, b, c, d = NODE_0, NODE_1, NODE_2, NODE_3
    sa, ca = bend_node(a, q0, q1, q2)
    sb, cb = bend_node(b, q0, q1, q2)
    sc, cc = bend_node(c, q0, q1, q2)
    sd, cd = bend_node(d, q0, q1, q2)
    # The mass beyond a node hangs on its slope.
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
    """Sums of ``of_z z_ij + of_x x_ij`` minus the weight's derivative, per unit of length.

    Returns
    -------
    tuple of 6
        In the order 00, 01, 02, 11, 12, 22.
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
