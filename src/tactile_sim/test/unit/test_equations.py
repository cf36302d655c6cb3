# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The equations of the finger agree with numerical integrals and derivatives."""

import itertools

import numpy as np
import pytest

from tactile_sim.physics.equations import (
    compute_balance,
    compute_curve,
    compute_line,
    compute_object_contact,
    compute_rigid_contact,
    compute_sine_cosine,
    GRAVITY_M_S2,
    MAX_CHANGE_RAD,
    NODE_WEIGHT,
    NODE_XI,
)
from tactile_sim.physics.scene import build_scene

FINE_XI, FINE_WEIGHT = (np.longdouble(v) for v in np.polynomial.legendre.leggauss(64))
FINE_XI, FINE_WEIGHT = (FINE_XI + 1) / 2, FINE_WEIGHT / 2
MASS, TIP_MASS = 0.02, 0.007


def shapes(xi):
    """Return the angles of the three curvature modes at ``xi``, shape (3, positions)."""
    return np.stack([xi, xi**2 - xi, 2 * xi**3 - 3 * xi**2 + xi])


# -- shape -----------------------------------------------------------------------------------


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
    # The potential contains the drop of every point of the finger, which is itself an integral.
    # The potential is differentiated by complex steps.
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


# -- balance ---------------------------------------------------------------------------------

MASSES = (2e-5, -6e-6, 1e-6, 3e-6, -5e-7, 4e-7)
CONSTANTS = build_scene('texture', 'F', 'flexion').constants._replace(
    mass=MASS, tip_mass=TIP_MASS, inverse_softening=1e3, masses=MASSES
)
MASS_MATRIX = np.array(MASSES)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
RATE, GRID_LINE = 600.0, np.array(NODE_XI)


class Reference:
    """The balance of the three modes, written as in docs/simulation.md.

    Modes can be complex numbers, so that the balance can be differentiated by complex steps.
    """

    def __init__(self, case):
        self.case = case
        self.middle = self.place(case['modes'])[1]

    def place(self, modes):
        angle = modes @ shapes(GRID_LINE)
        c = CONSTANTS
        return (
            c.length * (np.sin(angle) @ np.array(NODE_WEIGHT)),
            c.length * (np.cos(angle) @ np.array(NODE_WEIGHT)),
        )

    def press(self, drop, reach):
        """Return the normal force and the slope of the surface."""
        case = self.case
        beside = reach - self.middle
        height = case['incline'] * beside + case['bend'] * beside**2 / 2
        push = case['tip'] * (case['indentation'] + drop - self.drop0 + height) - case['held']
        if case['material'] is None:
            force = push if push.real > 0 else 0.0
        else:
            # The compression p of the object is the solution of the quadratic equation
            # k p - rest = push - tip (p + s p^2 / 2).
            k, s = case['material'], CONSTANTS.inverse_softening
            a, b, const = case['tip'] * s / 2, case['tip'] + k, -(push + case['rest'])
            p = (-b + np.sqrt(b * b - 4 * a * const)) / (2 * a)
            force = k * p - case['rest']
            force = force if force.real > 0 else 0.0
        return force, case['incline'] + case['bend'] * beside

    def loads(self, modes):
        """Return tension, normal force, slope, and friction at the tip and along the tendon.

        The friction along the tendon is given as a fraction of its limit, from -1 to 1.
        """
        case, c = self.case, CONSTANTS
        drop, reach = self.place(modes)
        force, incline = self.press(drop, reach)
        stretch = case['tendon'] - c.arm * modes[0]
        tension = c.tendon_stiffness * stretch if stretch.real > 0 else 0.0
        ahead = (modes[0] - case['sliders'][1]) / c.presliding_rad
        if abs(ahead.real) >= 1:
            ahead = np.sign(ahead.real)
        shear = c.shear_stiffness * (case['place'] + reach - self.middle - case['sliders'][0])
        limit = case['friction'] * force
        if abs(shear.real) > limit.real:
            shear = limit * np.sign(shear.real)
        return tension, force, incline, shear, ahead

    def end(self, modes):
        """Return tension, normal force, and the positions at which tip and tendon stick."""
        tension, force, _, shear, ahead = self.loads(modes)
        place = self.case['place'] + self.place(modes)[1] - self.middle
        tip = place - shear / CONSTANTS.shear_stiffness
        return tension, force, tip, modes[0] - ahead * CONSTANTS.presliding_rad

    def moments(self, modes):
        """Return the sum of all moments without creep, shape (3,). In balance, it is zero."""
        case, c = self.case, CONSTANTS
        share = np.array([1, 1 / 3, 1 / 5])
        xi, weight = np.float64(FINE_XI), np.float64(FINE_WEIGHT)
        tension, force, incline, shear, ahead = self.loads(modes)
        nodes = shapes(GRID_LINE)
        angle = modes @ nodes
        drop_i = c.length * (nodes * np.cos(angle)) @ np.array(NODE_WEIGHT)
        reach_i = -c.length * (nodes * np.sin(angle)) @ np.array(NODE_WEIGHT)
        beyond = (1 - GRID_LINE) * c.mass + c.tip_mass
        hang = GRAVITY_M_S2 * c.length * (nodes * np.cos(angle) * beyond) @ np.array(NODE_WEIGHT)
        legendre = np.stack([np.ones(64), 2 * xi - 1, 6 * xi**2 - 6 * xi + 1])
        loss = np.exp(-c.tendon_friction * modes[0] * ahead * xi)
        pull = c.arm * tension * (legendre * loss) @ weight
        excess = modes[0] - c.stop_rad
        stop = np.array([c.stop_stiffness * excess if excess.real > 0 else 0.0, 0.0, 0.0])
        own = c.damping * RATE * (modes - case['bases'])
        own = own + case['stiff'] * (c.stiffness + case['creep_stiffness']) * modes
        swing = MASS_MATRIX @ (RATE**2 * modes - case['swing_bases'])
        return (
            swing
            + share * own
            - hang
            - pull
            + stop
            + force * (drop_i + incline * reach_i)
            + shear * (reach_i - incline * drop_i)
        )


def random_case(generator, kind):
    modes = generator.uniform([0.1, -0.2, -0.1], [1.2, 0.2, 0.1])
    case = {
        'modes': modes,
        'bases': modes + generator.normal(0, 1e-3, 3),
        'swing_bases': RATE**2 * modes + generator.normal(0, 100.0, 3),
        'tendon': CONSTANTS.arm * modes[0] + generator.uniform(2e-5, 3e-4),
        'indentation': generator.uniform(1e-4, 1e-3),
        'held': 0.3,
        'tip': CONSTANTS.tip_stiffness + CONSTANTS.tip_damping * RATE,
        'material': None,
        'rest': 0.2,
        'incline': generator.uniform(-0.3, 0.3),
        'bend': generator.uniform(-50.0, 50.0),
        'place': 0.003,
        # The tip sticks, because its shear is far below the limit, and so does the tendon.
        'sliders': [0.003 - 2e-5, modes[0] - 0.003],
        'friction': 0.4,
        'stiff': 1.05,
        'creep_stiffness': 0.01,
    }
    if kind == 'slack':
        case['tendon'] = CONSTANTS.arm * modes[0] - 1e-4
    if kind in ('sliding', 'soft, sliding'):
        case['sliders'] = [0.003 + generator.choice([-1, 1]) * 5e-3, modes[0] - 0.1]
    if kind in ('soft', 'soft, sliding'):
        case['material'] = 1000.0
    if kind == 'apart':
        case['indentation'] = -1e-3
    if kind == 'closed':
        more = np.array([1.5, 0.0, 0.0])
        case['modes'], case['bases'] = modes + more, case['bases'] + more
        case['swing_bases'] += RATE**2 * more
        case['tendon'] += CONSTANTS.arm * 1.5
        case['sliders'][1] += 1.5
    return case


def press(case):
    """Return the normal force and its derivative with respect to the indentation."""
    arguments = (case['tip'], case['held'])
    if case['material'] is None:
        return compute_rigid_contact(case['indentation'], *arguments)
    return compute_object_contact(
        case['indentation'],
        case['rest'],
        case['material'],
        *arguments,
        CONSTANTS.inverse_softening,
    )[:2]


def balance(case, creep=(0.0, 0.0, 0.0), grip=1.0):
    return compute_balance(
        compute_line(*case['modes'], CONSTANTS.mass, CONSTANTS.tip_mass),
        press(case),
        (case['incline'], case['bend']),
        case['place'],
        case['modes'],
        case['bases'],
        case['swing_bases'],
        case['sliders'],
        (*creep, case['creep_stiffness']),
        (case['friction'], case['stiff']),
        case['tendon'],
        RATE,
        grip,
        CONSTANTS,
    )


KINDS = ('sticking', 'sliding', 'soft', 'soft, sliding', 'apart', 'slack', 'closed')


@pytest.mark.parametrize('kind', KINDS)
def test_balance_and_its_derivatives_against_the_documented_sum(kind):
    generator = np.random.default_rng(KINDS.index(kind))
    for _ in range(20):
        case = random_case(generator, kind)
        reference = Reference(case)
        reference.drop0 = reference.place(case['modes'])[0]
        exact = reference.moments(case['modes'])
        jacobian = np.stack(
            [reference.moments(case['modes'] + 1e-30j * e).imag / 1e-30 for e in np.eye(3)], axis=1
        )

        def lend(missing, case=case, exact=exact):
            return balance(case, (exact - missing) / case['stiff'])

        # `lend` adds an external moment that balances the finger except for ``missing``.
        assert lend(np.zeros(3))[0] < 2e-9
        # For a small missing moment, the change of the modes solves the linear equations.
        for missing in 1e-4 * np.eye(3):
            residual, changes, *_ = lend(missing)
            assert residual == pytest.approx(1e-4, rel=1e-4)
            np.testing.assert_allclose(jacobian @ changes, missing, rtol=0, atol=3e-8)
        # For an even smaller one, the values predicted after the change agree with exact ones.
        for missing in 1e-6 * np.eye(3):
            _, changes, _, after, surprise = lend(missing)
            expected = reference.end(case['modes'] - np.array(changes))
            np.testing.assert_allclose(after[:2], expected[:2], rtol=0, atol=1e-7)
            np.testing.assert_allclose(after[2:], expected[2:], rtol=0, atol=1e-10)
            assert surprise < 1e-12
        assert max(abs(np.array(lend(np.full(3, 1e6))[1]))) <= MAX_CHANGE_RAD


def test_sliders_stay_behind_by_what_the_springs_bear_and_not_without_grip():
    case = random_case(np.random.default_rng(2), 'sliding')
    case['sliders'][0] = case['place'] - 5e-3
    _, rub, tip, tendon = balance(case)[2]
    assert rub == pytest.approx(0.4 * press(case)[0], rel=1e-14)
    assert case['place'] - tip == pytest.approx(rub / CONSTANTS.shear_stiffness, rel=1e-10)
    assert case['modes'][0] - tendon == pytest.approx(CONSTANTS.presliding_rad, rel=1e-10)
    assert balance(case, grip=0.0)[2][1:] == (0.0, case['place'], case['modes'][0])


def test_rigid_contact_pushes_and_never_pulls():
    force, slope = compute_rigid_contact(np.array([-1e-3, 0.0, 1e-3, 2e-3]), 3000.0, 1.5)
    np.testing.assert_allclose(force, [0.0, 0.0, 1.5, 4.5])
    np.testing.assert_allclose(slope, [0.0, 0.0, 3000.0, 3000.0])


@pytest.mark.parametrize('inverse_softening', [0.0, 1.0, 1e3, 1e5])
@pytest.mark.parametrize('material', [1.0, 500.0, 1e6])
def test_object_is_a_spring_behind_the_fingertip(material, inverse_softening):
    tip, rest = 3000.0, material * 1e-4
    indentation = np.linspace(-1e-3, 5e-3, 2001)
    force, slope, p = compute_object_contact(
        indentation, rest, material, tip, 0.0, inverse_softening
    )
    touching = force > 0
    assert 0 < touching.sum() < 2001
    # The compressions of tip and object add up to the indentation, as in two springs in series.
    u = p + p**2 * inverse_softening / 2
    both = (force / tip + u)[touching]
    np.testing.assert_allclose(both, indentation[touching], rtol=0, atol=1e-15 + 1e-12 * 5e-3)
    np.testing.assert_allclose(force[touching], (material * p - rest)[touching], rtol=1e-12)
    np.testing.assert_allclose(p[~touching], rest / material)
    # The force grows continuously; if the object softens, it grows less and less steeply.
    assert np.all(np.diff(force) >= 0)
    assert force[touching][0] <= tip * (indentation[1] - indentation[0])
    middle = (slope[1:] + slope[:-1])[touching[:-1]] / 2
    rise = (np.diff(force) / np.diff(indentation))[touching[:-1]]
    np.testing.assert_allclose(rise, middle, rtol=2e-3)
    if inverse_softening:
        assert np.all(np.diff(slope[touching]) < 0)
    else:
        np.testing.assert_allclose(slope[touching], tip * material / (tip + material))


@pytest.mark.parametrize(('wrap', 'bound'), [(0.0, 4e-15), (0.125, 2e-7), (0.3, 1e-5)])
def test_capstan_series(wrap, bound):
    """The series for the capstan friction agrees with integrals of exp(-wrap xi).

    With the packaged friction, ``wrap`` is 0.125 at a bend of 115 degrees.
    """
    constants = CONSTANTS._replace(
        tendon_friction=wrap, stiffness=0.0, mass=0.0, tip_mass=0.0, arm=1.0, tendon_stiffness=1.0
    )
    xi, weight = np.float64(FINE_XI), np.float64(FINE_WEIGHT)
    legendre = np.stack([np.ones(64), 2 * xi - 1, 6 * xi**2 - 6 * xi + 1])
    for sign in (1.0, -1.0):
        exact = (legendre * np.exp(-sign * wrap * xi)) @ weight
        residual = compute_balance(
            compute_line(1.0, 0.0, 0.0, 0.0, 0.0),
            (0.0, 0.0),
            (0.0, 0.0),
            0.0,
            (1.0, 0.0, 0.0),
            (1.0, 0.0, 0.0),
            (RATE**2, 0.0, 0.0),
            (0.0, 1.0 - sign),
            (*-exact, 0.0),
            (0.0, 1.0),
            2.0,
            RATE,
            1.0,
            constants,
        )[0]
        assert residual <= bound
