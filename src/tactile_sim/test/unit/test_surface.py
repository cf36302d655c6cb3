# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue, list_objects
from tactile_sim.physics.scene import (
    build_plate_surface,
    compute_plate_profile,
    dilate_by_circle,
    SPACING_M,
)

RADIUS_M = 5e-3


def grid(length_m):
    return SPACING_M * np.arange(-round(length_m / SPACING_M), round(length_m / SPACING_M) + 1)


def test_circle_on_step_rolls_over_the_edge():
    x = grid(0.01)
    step = np.where(x <= 0, 0.0, -2e-3)
    dilated = dilate_by_circle(step, SPACING_M, RADIUS_M)
    # Beyond the edge the circle turns about it until it reaches the lower level.
    lower = np.sqrt(RADIUS_M**2 - (RADIUS_M - 2e-3) ** 2)
    edge = np.sqrt(RADIUS_M**2 - np.clip(x, 0, RADIUS_M) ** 2) - RADIUS_M
    expected = np.where(x <= 0, 0.0, np.where(x >= lower, -2e-3, edge))
    np.testing.assert_allclose(dilated, expected, atol=1e-12)


@pytest.mark.parametrize('width_m', [0.5e-3, 1.5e-3, 3e-3, 6e-3])
def test_circle_over_groove_sinks_by_the_sagitta_or_to_the_bottom(width_m):
    x, depth = grid(0.01), 0.3e-3
    groove = np.where(np.abs(x) < width_m / 2, -depth, 0.0)
    dilated = dilate_by_circle(groove, SPACING_M, RADIUS_M)
    sagitta = RADIUS_M - np.sqrt(RADIUS_M**2 - (width_m / 2) ** 2)
    assert dilated.min() == pytest.approx(-min(sagitta, depth), abs=width_m / RADIUS_M * SPACING_M)


@pytest.mark.parametrize('label', [label for label in list_objects('texture') if label != 'F'])
def test_profile_has_the_stated_grooves(label):
    plate = default_catalogue().plate(label)
    x = SPACING_M * (np.arange(round(plate.length_m / SPACING_M)) + 0.5)
    bare = compute_plate_profile(plate, x, 2e-3)
    cut = np.flatnonzero(np.diff((bare < -1e-9).astype(int)) == 1)
    assert len(cut) == int(plate.grooved_mm / plate.pitch_mm + 1e-9)
    assert np.diff(x[cut]) == pytest.approx(plate.pitch_mm * 1e-3, abs=1.01 * SPACING_M)
    assert bare.min() == pytest.approx(-plate.depth_mm * 1e-3, rel=0.02)


def test_circular_groove_is_an_arc():
    plate = default_catalogue().plate('C1')
    off = np.linspace(-1.2e-3, 1.2e-3, 50)
    centre = (plate.end_mm + plate.pitch_mm / 2) * 1e-3
    bottom = compute_plate_profile(plate, centre + off, 2e-3)
    radius = (1.25e-3**2 + 1e-3**2) / 2e-3
    np.testing.assert_allclose(np.hypot(off, bottom - (radius - 1e-3)), radius, rtol=1e-12)


def test_all_plates_feel_different():
    x = np.linspace(0.01, 0.06, 5000)
    felt = [
        build_plate_surface(default_catalogue().plate(label), RADIUS_M, 2e-3).sample(x)[0]
        for label in list_objects('texture')
    ]
    for i, one in enumerate(felt):
        for other in felt[:i]:
            assert np.sqrt(np.mean((one - other) ** 2)) > 1e-5


def test_slope_is_the_derivative_of_the_height():
    surface = build_plate_surface(default_catalogue().plate('R1'), RADIUS_M, 2e-3)
    x, h = np.linspace(0.012, 0.05, 4001), 2e-5
    ahead, behind = surface.sample(x + h)[0], surface.sample(x - h)[0]
    difference = np.abs((ahead - behind) / (2 * h) - surface.sample(x)[1])
    # Corners are rounded over one cell.
    assert np.quantile(difference, 0.97) < 3e-3
