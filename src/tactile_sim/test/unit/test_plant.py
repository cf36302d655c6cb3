# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest

from tactile_sim.description import Body, load_finger, load_rig
from tactile_sim.errors import ConvergenceError
from tactile_sim.plant import Mount, Plant, Variation, compute_gravity_moment, compute_tip

NOTHING = Mount(Body(0.0, 0.0, 1.0, 0.0), None, 0.0, 0.06, np.inf)
LIGHT = dataclasses.replace(load_finger('flexion'), mass_kg=0.0, tip_mass_kg=0.0)


def make_plant(finger=LIGHT, mount=NOTHING, tendon_m=0.0, variation=None):
    return Plant(finger, load_rig(), mount, variation or Variation.none(), 0.06, tendon_m)


@pytest.mark.parametrize('contact', ['flexion', 'abduction'])
def test_free_finger_bends_as_the_closed_form(contact):
    finger = dataclasses.replace(load_finger(contact), mass_kg=0.0, tip_mass_kg=0.0)
    plant = make_plant(finger, tendon_m=0.004)
    a, k_t = finger.moment_arm_m, finger.tendon_stiffness_n_m
    q = a * k_t * 0.004 / (finger.bending_stiffness_nm_rad + k_t * a * a)
    assert plant.bend_rad[0] == pytest.approx(q, rel=1e-6)
    assert plant.tension_n[0] == pytest.approx(finger.bending_stiffness_nm_rad * q / a, rel=1e-6)
    assert plant.contact_force_n[0] == 0.0


@pytest.mark.parametrize('contact', ['flexion', 'abduction'])
def test_tension_range_bends_as_in_the_paper(contact):
    finger = load_finger(contact)
    at_contact, at_limit = {'flexion': (5.0, 15.0), 'abduction': (2.0, 3.0)}[contact]
    displacements = np.linspace(0.0, 0.02, 400)
    plant = Plant(finger, load_rig(), NOTHING, Variation.none(400), 0.06, displacements)
    bend = np.degrees(np.interp([0.0, at_contact, at_limit], plant.tension_n, plant.bend_rad))
    assert np.degrees(plant.bend_rad[0]) < 8.0  # gravity alone: slightly
    assert bend[1] == pytest.approx(40.0, abs=6.0)
    assert 50.0 < bend[2] < 125.0


def test_weight_is_the_slope_of_the_potential():
    finger = load_finger('flexion')
    q = np.concatenate([[-2e-3, -5e-4, 1e-9, 5e-4, 2e-3], np.linspace(0.01, 2.2, 50)])

    def drop(q):
        s = np.linspace(0.0, 1.0, 20001)[:, None]
        arc = finger.length_m * (1 - np.cos(q * s)) / q
        mean = (arc[1:] + arc[:-1]).mean(axis=0) / 2
        return finger.mass_kg * mean + finger.tip_mass_kg * arc[-1]

    h = 1e-5
    slope = (drop(q + h) - drop(q - h)) / (2 * h)
    moment = compute_gravity_moment(finger, q, compute_tip(finger.length_m, q))
    np.testing.assert_allclose(moment, 9.80665 * slope, rtol=2e-5)


def test_tip_derivatives_match_differences_through_zero():
    q, h = np.linspace(-0.01, 2.0, 400), 1e-5
    for value, slope in ((0, 1), (1, 2), (3, 4), (4, 5)):
        ahead, behind = compute_tip(0.08, q + h), compute_tip(0.08, q - h)
        numeric = (ahead[value] - behind[value]) / (2 * h)
        np.testing.assert_allclose(compute_tip(0.08, q)[slope], numeric, atol=2e-6)


def test_object_relaxes_by_the_analytic_exponential():
    # A finger and fingertip so stiff, and damped so little, that the indentation stays what it is.
    finger = dataclasses.replace(
        LIGHT,
        tip_stiffness_n_m=1e12,
        tendon_stiffness_n_m=1e9,
        creep_stiffness_nm_rad=0.0,
        damping_nm_s_rad=1e-15,
        tendon_friction=0.0,
    )
    body = Body(200.0, 300.0, 2.0, 0.0)
    pulled_m = finger.moment_arm_m * np.radians(43.0)
    plant = make_plant(finger, Mount(body, None, 0.0, 0.06, np.inf))
    plant.step(0.06, pulled_m, 1e-9)
    contact_rad = np.radians(finger.contact_bend_deg)
    drops = compute_tip(finger.length_m, np.array([plant.bend_rad[0], contact_rad]))[0]
    depth_m = drops[0] - drops[1]
    assert plant.contact_force_n[0] == pytest.approx(500.0 * depth_m, rel=1e-6)
    for step in range(1, 4001):
        plant.step(0.06, pulled_m, 1e-3)
        if step % 1000 == 0:
            expected = depth_m * (200.0 + 300.0 * np.exp(-step * 1e-3 / 2.0))
            assert plant.contact_force_n[0] == pytest.approx(expected, rel=1e-3)


def test_energy_of_a_free_finger_never_grows():
    finger = load_finger('flexion')
    plant = make_plant(finger, tendon_m=0.012)

    def energy():
        q = plant.bend_rad
        strain = q - plant._creep_rad
        x = compute_tip(finger.length_m, q)
        potential = 9.80665 * (
            finger.mass_kg * (finger.length_m - x[3]) / q + finger.tip_mass_kg * x[0]
        )
        return float(
            finger.bending_stiffness_nm_rad * q[0] ** 2 / 2
            + finger.creep_stiffness_nm_rad * strain[0] ** 2 / 2
            - potential[0]
        )

    energies = []
    for _ in range(3000):
        plant.step(0.06, 0.0, 1e-3)
        energies.append(energy())
    assert plant.tension_n[0] == 0.0
    assert energies[0] - energies[-1] > 1e-3
    assert max(np.diff(energies)) <= 1e-12


def test_slack_tendon_bears_nothing_and_contact_only_pushes():
    plant = make_plant(load_finger('flexion'), tendon_m=-0.01)
    assert plant.tension_n[0] == 0.0
    rigid = Mount(Body(1e9, 0.0, 1.0, 0.4), None, 0.0, 0.06, np.inf)
    plant = make_plant(load_finger('flexion'), rigid, 0.0)
    for i in range(500):
        plant.step(0.06, 0.006 * np.sin(i / 500 * np.pi), 1e-3)
        assert plant.contact_force_n[0] >= 0.0
        assert plant.tension_n[0] >= 0.0


def test_friction_opposes_sliding():
    forces = {}
    for friction in (0.0, 0.5):
        rigid = Mount(Body(1e9, 0.0, 1.0, friction), None, 0.0, 0.06, np.inf)
        for direction in (1, -1):
            plant = make_plant(load_finger('flexion'), rigid, 0.0055)
            for i in range(1, 400):
                plant.step(0.06 + direction * 15e-6 * i, 0.0055, 1e-3)
            forces[friction, direction] = plant.contact_force_n[0]
    # Sliding ahead, friction presses the bent finger down; sliding back, it lifts it.
    assert forces[0.5, 1] > forces[0.0, 1] * 1.05
    assert forces[0.5, -1] < forces[0.0, -1] * 0.95
    assert forces[0.0, 1] == pytest.approx(forces[0.0, -1], rel=1e-6)


def test_object_out_of_reach_relaxes_without_force():
    body = Body(200.0, 300.0, 2.0, 0.0)
    mount = Mount(body, None, 0.0, 0.06, 0.01)
    plant = make_plant(load_finger('flexion'), mount)
    for _ in range(1000):
        plant.step(0.06, 0.006, 1e-3)
    assert plant.contact_force_n[0] > 0.1
    indented_m = plant._indent_m[0]
    assert indented_m > 1e-4
    # Away from it the finger bends deeper than the object's top: it must not feel that.
    for _ in range(1000):
        plant.step(0.09, 0.008, 1e-3)
        assert plant.contact_force_n[0] == 0.0
    # Without force the branch decays with the time 2 s (200 + 300) / 200.
    assert plant._indent_m[0] == pytest.approx(indented_m * np.exp(-1.0 / 5.0), rel=1e-3)
    for _ in range(200):
        plant.step(0.09, 0.0, 1e-3)
    for _ in range(1000):
        plant.step(0.06, 0.006, 1e-3)
    assert plant.contact_force_n[0] > 0.1


def test_step_without_solution_raises():
    plant = make_plant()
    with pytest.raises(ConvergenceError, match='no equilibrium'):
        plant.step(0.06, float('nan'), 1e-3)
