# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes with changed descriptions, and short runs of them with any step."""

import dataclasses
from typing import NamedTuple

import numpy as np
import numpy_solver

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_scene, Scene
from tactile_sim.physics.solver import advance_trials, TOLERANCE_NM
from tactile_sim.physics.variation import draw_variation, Variation

CONTACT_GUIDE_M = 0.060
PULL_M = {'flexion': 0.0054, 'abduction': 0.0075}
"""Tendon displacement that presses the fingertip on a plate with some 1 N."""


class Run(NamedTuple):
    """States before the first step and after each, shape (rows, trials, steps + 1)."""

    rows: np.ndarray
    failed: np.ndarray
    state: np.ndarray

    def get(self, row):
        """One row of a run of all state rows, shape (trials, steps + 1)."""
        return self.rows[row]


def change(scene, body=None, rig=None, load_cell=None, **finger):
    """The scene with another body, rig or load cell, or with other fields of its finger."""
    made = {'finger': dataclasses.replace(scene.finger, **finger)} if finger else {}
    if body is not None:
        made['body'] = body
    if load_cell is not None:
        made['rig'] = dataclasses.replace(scene.rig, load_cell=load_cell)
    return dataclasses.replace(scene, **made)


def free_scene(contact='flexion', **finger):
    """Nothing under the finger."""
    return change(build_scene('stiffness', 'none', contact), **finger)


def object_scene(body, contact='flexion', **finger):
    """A body of one's own under the finger."""
    return change(build_scene('stiffness', 'sponge', contact), body=body, **finger)


def plate_scene(label='F', contact='flexion', **finger):
    """A packaged plate, with another finger."""
    scene = build_scene('texture', label, contact)
    return change(scene, **finger) if finger else scene


def draw(count, protocol='texture', label='R2', contact='flexion', seed=1):
    """Deviations of some trials."""
    catalogue = default_catalogue()
    return draw_variation(catalogue, contact, protocol, label, seed, 0, count)[0]


def ramp(times_s, start_s, before, after, speed):
    """From one value to another with constant speed."""
    way = np.clip((times_s - start_s) * speed, 0.0, abs(after - before))
    return before + np.copysign(way, after - before)


def run(
    scene: Scene,
    step_s,
    tendon_m,
    guide_m=CONTACT_GUIDE_M,
    pulled_m=0.0,
    *,
    variation=None,
    solver='compiled',
    euler=False,
    tolerance_nm=TOLERANCE_NM,
    trusted_nm=0.0,
):
    """Advance from rest; inputs are given before the first step and at the end of each.

    With ``euler`` each step is as one of another length than the one before.
    """
    tendon_m = np.asarray(tendon_m)
    steps = len(tendon_m) - 1
    guide_m, pulled_m = (np.broadcast_to(v, steps + 1) for v in (guide_m, pulled_m))
    inputs = scene.compute_inputs(tendon_m, guide_m, pulled_m)
    with numpy_solver.in_use(solver):
        return _run(
            scene, step_s, inputs, variation or Variation.none(), euler, tolerance_nm, trusted_nm
        )


def _run(scene, step_s, inputs, variation, euler, tolerance_nm, trusted_nm):
    steps = len(inputs) - 1
    state = scene.start_trials(variation, inputs[0])
    failed = np.full(len(variation.phase), -1, dtype=np.int64)
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
    # From (blocks, steps + 1, rows, width) to trials side by side.
    rows = np.moveaxis(out, 0, 2).reshape(out.shape[1], out.shape[2], -1)
    return Run(np.transpose(rows[..., : len(failed)], (1, 2, 0)), failed, state)
