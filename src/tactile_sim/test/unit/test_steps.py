# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Steps of time: the order of their error, and what is exact however long they are."""

import dataclasses

import numpy as np
import pytest
from scenery import change, object_scene, ramp, run

from tactile_sim.descriptions.description import Body, Branch
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.solver import advance_trials

ROWS = [at.TENSION, at.FORCE, at.SENSED, at.MODES + 1, at.CREEP, at.SQUEEZED, at.BRANCHES]


def compute_error(scene, euler, steps):
    """Of several rows against many more steps, relative to how far they go, shape (rows,)."""

    def sample(count, euler):
        times_s = np.linspace(0.0, 0.3, count + 1)
        tendon_m = 0.0049 + 0.0003 * np.sin(2 * np.pi * times_s / 0.3) ** 2
        result = run(scene, 0.3 / count, tendon_m, euler=euler, tolerance_nm=1e-11)
        assert result.failed.tolist() == [-1]
        return result.rows[ROWS, 0, :: count // 50]

    fine = sample(6400, euler=False)
    assert (fine[1] > 0).all()  # it is touched all the time
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
        errors = errors[:, :-1]  # a plate has no branches
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
    # Taken from under the tip, its compression falls with the time 2 s (200 + 300) / 200.
    count = round(2.0 / step_s)
    tendon_m = np.full(count + 1, 0.006)
    guide_m = np.full(count + 1, 0.090)
    inputs = scene.compute_inputs(tendon_m, guide_m)
    failed = np.full(1, -1, dtype=np.int64)
    out = advance_trials(
        pressed,
        scene.parameters,
        np.zeros(count, dtype=np.int64),
        inputs[0],
        inputs[1:],
        scene.compute_coefficients((step_s,)),
        (at.BRANCHES, at.PRESSED, at.FORCE),
        failed,
    )
    branch, left, force = out[0, :, :, 0].T
    assert force[1:].max() == 0.0
    assert failed.tolist() == [-1]
    times_s = step_s * np.arange(count + 1)
    expected = branch[1] * np.exp(-(times_s[1:] - step_s) / 5.0)
    np.testing.assert_allclose(branch[1:], expected, rtol=2e-5 if step_s < 0.01 else 2e-3)
    np.testing.assert_allclose(left[1:], 0.6 * branch[1:], rtol=1e-9)
