# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The finger's shape against integrals and derivatives made in another way."""

import itertools

from finger_modes import FINE_WEIGHT, FINE_XI, MASS, shapes, TIP_MASS
import numpy as np
import pytest

from tactile_sim.physics.equations import (
    compute_curve,
    compute_line,
    compute_sine_cosine,
    GRAVITY_M_S2,
)


def random_modes(bend_deg, count=300):
    high = np.array([np.radians(bend_deg), 0.3, 0.2])
    low = np.array([np.radians(-5.0), -0.3, -0.2])
    modes = np.random.default_rng(3).uniform(low, high, (count, 3))
    return np.concatenate([modes, list(itertools.product(*zip(low, high, strict=True)))])


def test_sine_and_cosine_in_their_range():
    angle = np.linspace(-0.9, 2.7, 4001)
    sine, cosine = compute_sine_cosine(angle)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=0, atol=6e-11)
    np.testing.assert_allclose(cosine, np.cos(angle), rtol=0, atol=6e-11)
    middle = np.abs(angle - 0.9) < 1.3
    np.testing.assert_allclose(sine[middle], np.sin(angle[middle]), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ('bend_deg', 'bound', 'of_slopes'), [(60.0, 1.3e-6, 1.5e-5), (115.0, 7e-6, 6e-5)]
)
def test_tip_and_its_slopes_against_64_nodes_in_extended_precision(bend_deg, bound, of_slopes):
    modes = random_modes(bend_deg)
    line = compute_line(*modes.T, MASS, TIP_MASS)
    shape = shapes(FINE_XI)
    angle = np.asarray(modes, dtype=np.longdouble) @ shape
    drop, reach = np.sin(angle) @ FINE_WEIGHT, np.cos(angle) @ FINE_WEIGHT
    np.testing.assert_allclose(line[0], drop, rtol=0, atol=bound)
    np.testing.assert_allclose(line[1], reach, rtol=0, atol=bound)
    for i in range(3):
        of_drop = (np.cos(angle) * shape[i]) @ FINE_WEIGHT
        of_reach = -(np.sin(angle) * shape[i]) @ FINE_WEIGHT
        np.testing.assert_allclose(line[2 + i], of_drop, rtol=0, atol=of_slopes)
        np.testing.assert_allclose(line[5 + i], of_reach, rtol=0, atol=of_slopes)


@pytest.mark.parametrize(('bend_deg', 'bound'), [(60.0, 2e-5), (115.0, 6e-5)])
def test_weight_is_the_slope_of_the_potential(bend_deg, bound):
    # Drop of every point of the line, one integral inside the other; slopes by complex step.
    points, weight = np.polynomial.legendre.leggauss(16)
    xi, weight = (points + 1) / 2, weight / 2
    inner = shapes(np.outer(xi, xi).ravel())

    def compute_potential(modes):
        drops = xi * (np.sin(modes @ inner).reshape(16, 16) @ weight)
        return GRAVITY_M_S2 * (
            MASS * drops @ weight + TIP_MASS * np.sin(modes @ shapes(xi)) @ weight
        )

    for modes in random_modes(bend_deg, 30):
        line = compute_line(*modes, MASS, TIP_MASS)
        for i in range(3):
            slope = compute_potential(modes + 1e-30j * np.eye(3)[i]).imag / 1e-30
            assert line[8 + i] == pytest.approx(
                slope, abs=bound * GRAVITY_M_S2 * (MASS + TIP_MASS)
            )


def test_curve_ends_at_the_tip():
    modes = np.array([0.9, -0.2, 0.1])
    line = compute_line(*modes, MASS, TIP_MASS)
    curve = compute_curve(0.08, modes)
    assert curve.shape == (65, 2)
    np.testing.assert_allclose(curve[-1], [0.08 * line[1], 0.08 * line[0]], rtol=1e-5)
    np.testing.assert_allclose(np.hypot(*np.diff(curve, axis=0).T).sum(), 0.08, rtol=1e-4)
