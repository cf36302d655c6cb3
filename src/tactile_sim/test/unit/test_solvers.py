# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The solver: agreement with the NumPy reference, independence of trials, failures, errors."""

import dataclasses
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scenery import (
    change,
    CONTACT_GUIDE_M,
    draw,
    free_scene,
    object_scene,
    plate_scene,
    PULL_M,
    ramp,
    run,
)

from tactile_sim.descriptions.description import Body, Branch
from tactile_sim.errors import SolverError
from tactile_sim.physics import layout as at
from tactile_sim.physics import solver as solver_module
from tactile_sim.physics.scene import build_scene

STEP_S = 1 / 600
TIMES_S = STEP_S * np.arange(301)


def make_trial(protocol, label, contact, count):
    """Return scene, tendon and guide positions, and variation of a press or of a glide."""
    scene = build_scene(protocol, label, contact)
    tendon = ramp(TIMES_S, 0.02, 0.0, PULL_M[contact], 0.03)
    glide = ramp(TIMES_S, 0.35, 0.0, 1.0, 0.015)
    guide = CONTACT_GUIDE_M + (glide if protocol == 'texture' else np.zeros(len(TIMES_S)))
    return scene, tendon, guide, draw(count, protocol, label, contact)


@pytest.mark.parametrize(
    ('names', 'trusted_nm', 'euler'),
    [
        (('texture', 'C1', 'abduction'), 1e-2, False),
        (('texture', 'F', 'flexion'), 0.0, True),
        (('stiffness', 'rubber_shell', 'flexion'), 0.0, False),
        (('stiffness', 'none', 'flexion'), 0.0, False),
        (('stiffness', 'sponge', 'abduction'), 0.0, True),
    ],
    ids=str,
)
def test_both_solvers_give_the_same_bytes(names, trusted_nm, euler):
    scene, *inputs, variation = make_trial(*names, 19)
    inputs = [value[::4] for value in inputs]
    options = {'variation': variation, 'trusted_nm': trusted_nm, 'euler': euler}
    one, other = (
        run(scene, 4 * STEP_S, *inputs, **options, solver=solver)
        for solver in ('compiled', 'numpy')
    )
    assert (one.failed == -1).all()
    assert np.isfinite(one.rows).all()
    assert one.rows.tobytes() == other.rows.tobytes()
    assert one.state.tobytes() == other.state.tobytes()
    assert np.ptp(one.rows[at.TENSION]) > 1.0


@pytest.mark.parametrize('stiffer', [1.0, 1e3])
def test_unchecked_changes_solve_the_steps(stiffer):
    """Changes up to ``trusted_nm`` are not checked, even if the tendon's friction reverses."""
    scene, *inputs, variation = make_trial('texture', 'C1', 'flexion', 4)
    presliding_m = scene.finger.tendon_presliding_m / stiffer
    scene = change(scene, tendon_presliding_m=presliding_m)
    exact, quick = (
        run(scene, STEP_S, *inputs, variation=variation, trusted_nm=trusted_nm).rows[at.TENSION]
        for trusted_nm in (0.0, 1e-2)
    )
    gliding = slice(240, None)
    ripple_n = np.std(exact[:, gliding], axis=1)
    error_n = np.sqrt(np.mean((quick - exact)[:, gliding] ** 2, axis=1))
    assert (error_n > 0.0).all()
    assert (error_n < 0.02 * ripple_n).all()


@pytest.mark.parametrize('trusted_nm', [0.0, 1e-2])
def test_a_trial_does_not_depend_on_its_neighbours(trusted_nm):
    scene, *inputs, variation = make_trial('texture', 'R3', 'flexion', 19)
    many = run(scene, STEP_S, *inputs, variation=variation, trusted_nm=trusted_nm)
    for some in (slice(0, 1), slice(3, 10), slice(16, 19)):
        selected = variation.select(some)
        few = run(scene, STEP_S, *inputs, variation=selected, trusted_nm=trusted_nm)
        assert few.rows.tobytes() == many.rows[:, some].tobytes()


def test_a_trial_that_failed_before_is_left_alone():
    scene, tendon, guide, variation = make_trial('texture', 'R3', 'flexion', 3)
    failed = np.array([-1, 7, -1])
    few = slice(31)
    rows = run(scene, STEP_S, tendon[few], guide[few], variation=variation, failed=failed).rows
    assert failed.tolist() == [-1, 7, -1]
    kept = [row for row in range(at.STATE_ROWS) if row != at.FRESH]
    assert np.array_equal(rows[kept, 1, -1], rows[kept, 1, 0])
    assert (rows[at.MODES, [0, 2], -1] != rows[at.MODES, [0, 2], 0]).all()


def test_no_balance_is_a_failure_from_that_step_on():
    tendon = np.array([0.001, 0.0011, 0.0012, np.nan, 0.0013])
    result = run(free_scene(), STEP_S, tendon)
    assert result.failed.tolist() == [2]
    tension = result.rows[at.TENSION, 0]
    assert tension[3] == tension[4] == tension[2] > tension[1]


def test_a_step_too_long_for_the_iterations_is_cut_into_parts():
    """In one step, a slack tendon closes the finger, so that Newton's method fails at first."""
    one, other = (
        run(free_scene(), 1.0, np.array([0.0, 0.02]), solver=solver)
        for solver in ('compiled', 'numpy')
    )
    assert one.failed.tolist() == [-1]
    assert one.rows.tobytes() == other.rows.tobytes()
    fine = run(free_scene(), 1e-3, ramp(1e-3 * np.arange(1001), 0.0, 0.0, 0.02, 0.02))
    assert one.rows[at.TENSION, 0, -1] == pytest.approx(fine.rows[at.TENSION, 0, -1], rel=0.02)


def test_rest_is_where_a_long_wait_ends():
    for scene in (plate_scene('F'), build_scene('stiffness', 'solid_rubber', 'flexion')):
        no_friction = change(dataclasses.replace(scene, friction=0.0), tendon_friction=0.0)
        rest = run(no_friction, 0.5, np.full(2, 0.005))
        waited = run(no_friction, 0.5, np.concatenate([[0.0], np.full(400, 0.005)]))
        for row in (at.TENSION, at.FORCE, at.MODES, at.MODES + 1, at.MODES + 2):
            assert waited.rows[row, 0, -1] == pytest.approx(rest.rows[row, 0, 0], rel=1e-5)


def test_without_numba_the_simulator_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, 'numba', None)
    monkeypatch.setattr(solver_module, 'load_advance', solver_module.load_advance.__wrapped__)
    with pytest.raises(SolverError, match='pip install'):
        run(free_scene(), STEP_S, np.zeros(3), variation=draw(2))


@pytest.mark.parametrize(
    'names', [('texture', 'C1', 'abduction'), ('stiffness', 'sponge', 'flexion')]
)
def test_without_numba_a_single_trial_has_the_same_bytes(names, monkeypatch):
    scene, *inputs, variation = make_trial(*names, 1)
    one = run(scene, STEP_S, *inputs, variation=variation, euler=True)
    monkeypatch.setattr(solver_module, '_lacks_numba', lambda: True)
    monkeypatch.setattr(solver_module, 'load_advance', None)
    other = run(scene, STEP_S, *inputs, variation=variation, euler=True)
    assert np.ptp(one.rows[at.TENSION]) > 1.0
    assert one.rows.tobytes() == other.rows.tobytes()
    assert one.state.tobytes() == other.state.tobytes()


def test_a_solver_that_numba_cannot_compile_says_so(monkeypatch):
    monkeypatch.setattr(solver_module, 'load_advance', solver_module.load_advance.__wrapped__)

    def make_advance(numba, width):
        return numba.njit(lambda *arguments: arguments[0].no_such_method())

    monkeypatch.setattr(solver_module, '_make_advance', make_advance)
    with pytest.raises(SolverError, match=r'numba [0-9.]+.* NumPy'):
        run(free_scene(), STEP_S, np.zeros(3))


def test_without_a_folder_for_its_cache_numba_compiles_all_the_same():
    asked = []

    def njit(cache=False, **options):
        asked.append(cache)
        if cache:
            raise RuntimeError('cannot cache function: no locator available')
        return lambda function: function

    assert solver_module._make_advance(SimpleNamespace(njit=njit), 16).__name__ == 'advance'
    assert asked == [True, False]


# -- steps of time ---------------------------------------------------------------------------

ROWS = [at.TENSION, at.FORCE, at.SENSED, at.MODES + 1, at.CREEP, at.SQUEEZED, at.BRANCHES]


def compute_error(scene, euler, steps):
    """Return the largest error of each quantity in `ROWS`, relative to its range.

    The exact values are those of a simulation with many more steps.
    """

    def sample(count, euler):
        times_s = np.linspace(0.0, 0.3, count + 1)
        tendon_m = 0.0049 + 0.0003 * np.sin(2 * np.pi * times_s / 0.3) ** 2
        result = run(scene, 0.3 / count, tendon_m, euler=euler, tolerance_nm=1e-11)
        assert result.failed.tolist() == [-1]
        return result.rows[ROWS, 0, :: count // 50]

    fine = sample(6400, euler=False)
    assert (fine[1] > 0).all()  # the finger never loses contact
    error = np.abs(sample(steps, euler) - fine).max(axis=1)
    return error / np.maximum(np.ptp(fine, axis=1), 1e-12)


@pytest.mark.parametrize(('euler', 'within'), [(True, 0.15), (False, 0.3)])
@pytest.mark.parametrize('label', ['rubber_shell', 'F'])
def test_order_of_convergence_is_the_one_claimed(euler, within, label):
    protocol = 'texture' if label == 'F' else 'stiffness'
    scene = build_scene(protocol, label, 'flexion')
    scene = dataclasses.replace(change(scene, tendon_friction=0.0), friction=0.0)
    errors = np.array([compute_error(scene, euler, steps) for steps in (400, 800)])
    if label == 'F':
        errors = errors[:, :-1]  # a plate has no relaxing branches
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, 1 if euler else 2, atol=within)
    assert errors[-1].max() < (2e-2 if euler else 1e-3)


@pytest.mark.parametrize('step_s', [1e-3, 0.1])
def test_a_pressed_object_recovers_alone_once_it_is_out_of_reach(step_s):
    body = Body(200.0, (Branch(300.0, 2.0),), 0.0, 0.0)
    scene = object_scene(body)
    press = ramp(1e-3 * np.arange(1001), 0.0, 0.0, 0.006, 0.1)
    pressed = run(scene, 1e-3, press).state
    assert pressed[at.FORCE, 0] > 0.1
    # Without contact, the time constant of the object's recovery is the relaxation time of 2 s
    # times the ratio of all springs to the static spring, (200 + 300) / 200.
    count = round(2.0 / step_s)
    result = run(scene, step_s, np.full(count + 1, 0.006), 0.090, state=pressed)
    branch, left, force = result.rows[[at.BRANCHES, at.PRESSED, at.FORCE], 0]
    assert force[1:].max() == 0.0
    assert result.failed.tolist() == [-1]
    expected = branch[1] * np.exp(-step_s * np.arange(count) / 5.0)
    np.testing.assert_allclose(branch[1:], expected, rtol=2e-5 if step_s < 0.01 else 2e-3)
    np.testing.assert_allclose(left[1:], 0.6 * branch[1:], rtol=1e-9)
