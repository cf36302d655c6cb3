# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every part and deviation of a scene has its intended effect, and omitted parts have none."""

import dataclasses

import numpy as np
import pytest
from scenery import CONTACT_GUIDE_M, draw, plate_scene, ramp, run

from tactile_sim.descriptions.catalogue import default_catalogue, list_objects
from tactile_sim.descriptions.description import Plate
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import (
    build_plate_surface,
    build_scene,
    compute_plate_profile,
    dilate_by_circle,
    SPACING_M,
)

STEP_S = 1 / 600
TIMES_S = STEP_S * np.arange(481)
TENDON_M = ramp(TIMES_S, 0.02, 0.0, 0.0054, 0.03)


def test_an_object_out_of_reach_is_not_felt():
    scene = build_scene('stiffness', 'sponge', 'flexion')
    half = scene.half_width_m
    away = run(scene, STEP_S, TENDON_M, CONTACT_GUIDE_M + 1.01 * half)
    nothing = run(build_scene('stiffness', 'none', 'flexion'), STEP_S, TENDON_M)
    near = run(scene, STEP_S, TENDON_M, CONTACT_GUIDE_M + 0.99 * half)
    assert away.rows[at.FORCE].max() == 0.0
    assert near.rows[at.FORCE].max() > 0.1
    np.testing.assert_allclose(away.rows[at.TENSION], nothing.rows[at.TENSION], atol=1e-4)


def test_the_mounting_height_and_the_tendons_zero_shift_the_contact():
    base = draw(1)
    flat = plate_scene('F')
    tendon_m = ramp(TIMES_S, 0.02, 0.0, 0.0054, 0.012)

    def touch(**deviations):
        spread = {name: np.array([value]) for name, value in deviations.items()}
        quiet = dataclasses.replace(
            base,
            **dict.fromkeys(('contact_height_m', 'tendon_zero_m', 'placement_m'), 0 * base.phase),
            finger_stiffness=1 + 0 * base.phase,
        )
        force = run(flat, STEP_S, tendon_m, variation=dataclasses.replace(quiet, **spread))
        return tendon_m[np.argmax(force.rows[at.FORCE][0] > 0)]

    described = touch()
    assert touch(contact_height_m=5e-4) < described - 5e-5
    assert touch(contact_height_m=-5e-4) > described + 5e-5
    # With a zero of 0.1 mm, the tendon becomes taut later, so the contact also begins later.
    assert touch(tendon_zero_m=1e-4) - described == pytest.approx(1e-4, abs=2.1e-5)


# -- surfaces --------------------------------------------------------------------------------

RADIUS_M = 5e-3


def grid(length_m):
    return SPACING_M * np.arange(-round(length_m / SPACING_M), round(length_m / SPACING_M) + 1)


def test_circle_on_step_rolls_over_the_edge():
    x = grid(0.01)
    step = np.where(x <= 0, 0.0, -2e-3)
    dilated = dilate_by_circle(step, SPACING_M, RADIUS_M)
    # The circle rolls around the edge of the step until it touches the lower level.
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


def test_a_profile_of_ones_own_is_a_polyline_over_the_grooved_zone():
    plate = Plate('profile', 10.0, 20.0, 0.4, points_mm=((0.0, 0.0), (5.0, -1.0), (20.0, 0.0)))
    x_m = np.array([0.005, 0.010, 0.0125, 0.015, 0.0225, 0.031])
    height_m = compute_plate_profile(plate, x_m, 2e-3)
    np.testing.assert_allclose(height_m, [0.0, 0.0, -0.5e-3, -1e-3, -0.5e-3, 0.0], atol=1e-15)


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
    # The slopes differ at the corners, because `sample` rounds them over one cell of the table.
    assert np.quantile(difference, 0.97) < 3e-3
