# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The solver and its NumPy reference: same bytes, independent trials, honest failures."""

import dataclasses
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scenery import change, CONTACT_GUIDE_M, draw, free_scene, plate_scene, PULL_M, ramp, run

from tactile_sim.errors import SolverError
from tactile_sim.physics import layout as at
from tactile_sim.physics import solver as solver_module
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.solver import advance_trials

STEP_S = 1 / 600
TIMES_S = STEP_S * np.arange(301)


def make_trial(protocol, label, contact, count):
    """Press at 20 mm/s, then glide or pull."""
    scene = build_scene(protocol, label, contact)
    tendon = ramp(TIMES_S, 0.02, 0.0, PULL_M[contact], 0.03)
    later = ramp(TIMES_S, 0.35, 0.0, 1.0, 0.015)
    guide = CONTACT_GUIDE_M + (later if protocol == 'texture' else 0.0)
    pulled = later if protocol == 'slip' else 0.0
    return scene, tendon, guide, pulled, draw(count, protocol, label, contact)


@pytest.mark.parametrize(
    ('names', 'trusted_nm', 'euler'),
    [
        (('texture', 'C1', 'abduction'), 1e-2, False),
        (('texture', 'F', 'flexion'), 0.0, True),
        (('stiffness', 'rubber_shell', 'flexion'), 0.0, False),
        (('stiffness', 'none', 'flexion'), 0.0, False),
        (('slip', 'smooth', 'flexion'), 0.0, True),
        (('slip', 'cylinder', 'abduction'), 0.0, False),
    ],
    ids=str,
)
def test_both_solvers_give_the_same_bytes(names, trusted_nm, euler):
    scene, *inputs, variation = make_trial(*names, 19)
    inputs = [value[::2] if np.ndim(value) else value for value in inputs]
    options = {'variation': variation, 'trusted_nm': trusted_nm, 'euler': euler}
    one, other = (
        run(scene, 2 * STEP_S, *inputs, **options, solver=solver)
        for solver in ('compiled', 'numpy')
    )
    assert (one.failed == -1).all()
    assert np.isfinite(one.rows).all()
    assert one.rows.tobytes() == other.rows.tobytes()
    assert one.state.tobytes() == other.state.tobytes()
    assert np.ptp(one.rows[at.TENSION]) > 1.0


@pytest.mark.parametrize('stiffer', [1.0, 1e3])
def test_unchecked_changes_solve_the_steps(stiffer):
    """Also where the tendon's friction turns round within a step."""
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
    scene, tendon, guide, _, variation = make_trial('texture', 'R3', 'flexion', 3)
    inputs = scene.compute_inputs(tendon, guide)
    state = scene.start_trials(variation, inputs[0])
    before, failed = state.copy(), np.array([-1, 7, -1])
    advance_trials(
        state,
        scene.parameters,
        np.zeros(30, dtype=np.int64),
        inputs[0],
        inputs[1:31],
        scene.compute_coefficients((STEP_S,)),
        (),
        failed,
    )
    assert failed.tolist() == [-1, 7, -1]
    kept = [row for row in range(at.TRIAL_ROWS) if row != at.FRESH]
    assert np.array_equal(state[kept, 1], before[kept, 1])
    assert (state[at.MODES, [0, 2]] != before[at.MODES, [0, 2]]).all()


def test_no_balance_is_a_failure_from_that_step_on():
    tendon = np.array([0.001, 0.0011, 0.0012, np.nan, 0.0013])
    result = run(free_scene(), STEP_S, tendon)
    assert result.failed.tolist() == [2]
    tension = result.rows[at.TENSION, 0]
    assert tension[3] == tension[4] == tension[2] > tension[1]


def test_a_step_too_long_for_the_iterations_is_cut_into_parts():
    """From slack to closed within one step: Newton's method alone turns too far."""
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
    with pytest.raises(SolverError, match=r'the simulator needs numba, .*: .*; pip install'):
        run(free_scene(), STEP_S, np.zeros(3))


def test_a_solver_that_numba_cannot_compile_says_so(monkeypatch):
    monkeypatch.setattr(solver_module, 'load_advance', solver_module.load_advance.__wrapped__)

    def make_advance(numba, width):
        return numba.njit(lambda *arguments: arguments[0].no_such_method())

    monkeypatch.setattr(solver_module, '_make_advance', make_advance)
    with pytest.raises(SolverError, match=r'numba [0-9.]+ cannot compile the solver .* NumPy'):
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
