# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The error falls with the step as it must, where nothing sticks, slips or touches."""

import dataclasses

import numpy as np
import pytest
from scenery import run

from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_scene

DURATION_S = 0.3
ROWS = [at.TENSION, at.FORCE, at.SENSED, at.MODES + 1, at.CREEP, at.SQUEEZED, at.BRANCHES]


def compute_error(scene, euler, steps):
    """Of several rows against many more steps, relative to how far they go, shape (rows,)."""

    def sample(count, euler):
        times_s = np.linspace(0.0, DURATION_S, count + 1)
        tendon_m = 0.0049 + 0.0003 * np.sin(2 * np.pi * times_s / DURATION_S) ** 2
        result = run(scene, DURATION_S / count, tendon_m, euler=euler, tolerance_nm=1e-11)
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
    finger = dataclasses.replace(scene.finger, tendon_friction=0.0)
    scene = dataclasses.replace(scene, finger=finger, friction=0.0)
    errors = np.array([compute_error(scene, euler, steps) for steps in (400, 800)])
    if label == 'F':
        errors = errors[:, :-1]  # a plate has no branches
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, 1 if euler else 2, atol=within)
    assert errors[-1].max() < (2e-2 if euler else 1e-3)
