# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live rig's physics, a step at a time, and what can be mounted on the rig."""

import numpy as np
import pytest
from scenery import ramp, run

from tactile_sim.errors import ConvergenceError, DescriptionError, RigError
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.trials import Plant
from tactile_sim.physics.variation import Variation
from tactile_sim.rig import PalpationRig, STEP_S

TIMES_S = STEP_S * np.arange(801)
TENDON_M = ramp(TIMES_S, 0.05, 0.0, 0.0054, 0.02)
GUIDE_M = 0.060 + ramp(TIMES_S, 0.5, 0.0, 1.0, 0.015)


def make_plant(protocol='texture', label='R2', tendon_m=0.0):
    scene = build_scene(protocol, label, 'flexion')
    return Plant(scene, Variation.none(), 0.060, tendon_m, STEP_S)


def test_live_steps_are_those_of_a_run_by_euler():
    """It may not use the differences of the step before: every call could be the first."""
    plant = make_plant()
    tension = [plant.tension_n]
    for guide_m, tendon_m in zip(GUIDE_M[1:], TENDON_M[1:], strict=True):
        plant.step(guide_m, tendon_m)
        tension.append(plant.tension_n)
    scene = build_scene('texture', 'R2', 'flexion')
    at_once = run(scene, STEP_S, TENDON_M, GUIDE_M, euler=True).rows[at.TENSION, 0]
    assert np.ptp(at_once) > 3.0
    np.testing.assert_allclose(tension, at_once, atol=1e-4)


@pytest.mark.parametrize(
    ('before', 'after'),
    [(('texture', 'R2'), ('stiffness', 'none')), (('stiffness', 'sponge'), ('texture', 'F'))],
)
def test_exchange_brings_the_finger_to_rest_on_what_is_new(before, after):
    plant = make_plant(*before)
    for guide_m, tendon_m in zip(GUIDE_M, TENDON_M, strict=True):
        plant.step(guide_m, tendon_m)
    assert plant.bend_rad > 0.5
    for tendon_m in ramp(TIMES_S, 0.0, TENDON_M[-1], 0.0004, 0.02):
        plant.step(0.060, tendon_m)
    plant.exchange(build_scene(*after, 'flexion'), Variation.none(), 0.060, 0.0004)
    fresh = make_plant(*after, 0.0004)
    assert plant.tension_n == pytest.approx(fresh.tension_n, abs=1e-4)
    assert plant.bend_rad == pytest.approx(fresh.bend_rad, abs=1e-6)
    # It is at rest: nothing happens but that the tendon begins to stick.
    for _ in range(20):
        plant.step(0.060, 0.0004)
    assert plant.bend_rad == pytest.approx(fresh.bend_rad, abs=1e-5)


@pytest.mark.parametrize('where', [(np.nan, 0.001), (0.060, np.nan)])
def test_a_step_without_balance_raises(where):
    plant = make_plant('texture', 'F')
    plant.step(0.060, 0.001)
    with pytest.raises(ConvergenceError, match='no balance of the finger with the guide at'):
        plant.step(*where)


def test_the_rig_refuses_what_it_cannot_do():
    rig = PalpationRig(seed=1, variation=Variation.none())
    with pytest.raises(RigError, match='nothing on the rig pulls a held object'):
        rig.mount('slip', 'rough', 'flexion')
    with pytest.raises(DescriptionError, match='no texture plate'):
        rig.mount('texture', 'sponge', 'flexion')
    assert rig.read_truth()['mount']['object'] == 'none'


def test_mounting_draws_the_next_trials_variation():
    """A plate that is mounted twice is not at the same place twice, but again on another rig."""
    places = []
    for _ in range(2):
        rig = PalpationRig(seed=3)
        rows = []
        for label in ('F', 'F', 'R1'):
            assert rig.mount('texture', label, 'flexion')['ok']
            rows.append(rig._plant._state[[at.CLEARANCE, at.OFFSET, at.FRICTION], 0].tolist())
        places.append(rows)
        assert rows[0] != rows[1]
    assert places[0] == places[1]
    mounted = {'protocol': 'texture', 'object': 'R1', 'contact': 'flexion'}
    assert rig.read_truth()['mount'] == mounted
