# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Helpers that build scenes with changed fingers or objects, and simulate them."""

import dataclasses
from typing import NamedTuple

import numpy as np
import numpy_solver

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_plate_surface, build_scene
from tactile_sim.physics.solver import advance_trials, TOLERANCE_NM
from tactile_sim.physics.variation import draw_variation, Variation

CONTACT_GUIDE_M = 0.060
PULL_M = {'flexion': 0.0054, 'abduction': 0.0075}
"""Tendon displacement [m] that presses the fingertip on a plate with about 1 N."""


class Run(NamedTuple):
    """Result of `run`; ``rows`` are the states at all times, shape (rows, trials, steps + 1)."""

    rows: np.ndarray
    failed: np.ndarray
    state: np.ndarray


def change(scene, body=None, **finger):
    """Return the scene with another object (``body``) and changed fields of its finger."""
    finger = dataclasses.replace(scene.finger, **finger)
    return dataclasses.replace(scene, finger=finger, body=body or scene.body)


def free_scene(contact='flexion', **finger):
    """Return a scene without a plate or object under the finger."""
    return change(build_scene('stiffness', 'none', contact), **finger)


def object_scene(body, contact='flexion', **finger):
    """Return a scene with the object ``body`` under the finger."""
    return change(build_scene('stiffness', 'sponge', contact), body=body, **finger)


def plate_scene(label='F', contact='flexion', **finger):
    """Return a scene with a packaged plate and a changed finger."""
    return change(build_scene('texture', label, contact), **finger)


def own_plate(plate):
    """Return a scene with the given plate under the packaged finger."""
    scene = plate_scene('F')
    surface = build_plate_surface(plate, scene.finger.tip_radius_m, 0.002)
    return dataclasses.replace(scene, surface=surface, friction=plate.friction)


def draw(count, protocol='texture', label='R2', contact='flexion', seed=1):
    """Return a random variation of ``count`` trials."""
    catalogue = default_catalogue()
    return draw_variation(catalogue, contact, protocol, label, seed, 0, count)[0]


def ramp(times_s, start_s, before, after, speed):
    """Return values that change from one value to another with constant speed."""
    way = np.clip((times_s - start_s) * speed, 0.0, abs(after - before))
    return before + np.copysign(way, after - before)


def run(
    scene,
    step_s,
    tendon_m,
    guide_m=CONTACT_GUIDE_M,
    *,
    variation=None,
    solver='compiled',
    euler=False,
    tolerance_nm=TOLERANCE_NM,
    trusted_nm=0.0,
    state=None,
    failed=None,
):
    """Simulate trials from rest, or from ``state``, with one step per interval of ``tendon_m``.

    ``tendon_m`` and ``guide_m`` are the positions before the first step and after each step. If
    ``euler`` is True, all steps are implicit Euler steps, as after a change of the step length.
    ``failed`` contains the step at which each trial has failed in an earlier run, or -1.
    """
    tendon_m = np.asarray(tendon_m)
    steps = len(tendon_m) - 1
    inputs = scene.compute_inputs(tendon_m, np.broadcast_to(guide_m, steps + 1))
    variation = variation or Variation.none()
    if failed is None:
        failed = np.full(len(variation.phase), -1, dtype=np.int64)
    with numpy_solver.in_use(solver):
        if state is None:
            state = scene.start_trials(variation, inputs[0])
        out = advance_trials(
            state,
            scene.parameters,
            np.arange(steps) % 2 if euler else np.zeros(steps, dtype=np.int64),
            inputs[0],
            inputs[1:],
            scene.compute_coefficients((step_s, step_s)),
            tuple(range(at.STATE_ROWS)),
            failed,
            tolerance_nm=tolerance_nm,
            trusted_nm=trusted_nm,
        )
    # The shape (blocks, steps + 1, rows, width) becomes (rows, trials, steps + 1).
    rows = np.moveaxis(out, 0, 2).reshape(out.shape[1], out.shape[2], -1)
    return Run(np.transpose(rows[..., : len(failed)], (1, 2, 0)), failed, state)
