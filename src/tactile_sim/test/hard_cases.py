# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hard cases of the simulator: each returns a value and the bound on it.

Infinite where a step found no balance. Most compare the tension with that of steps 40 times
finer: rms over its alternating part.
"""

import dataclasses
import math

import numpy as np
from scenery import change, CONTACT_GUIDE_M, free_scene, object_scene, plate_scene, ramp, run

from tactile_sim.descriptions.description import Body, Branch, Plate
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_plate_surface, build_scene

STEP_S = 1 / 960
FINER = 40


def _glide(times_s):
    """Press within 0.2 s, then glide over the grooves at 15 mm/s."""
    tendon_m = ramp(times_s, 0.02, 0.0, 0.0054, 0.03)
    return tendon_m, 0.074 + ramp(times_s, 0.25, 0.0, 1.0, 0.015)


def _tension(scene, inputs, duration_s, step_s):
    times_s = step_s * np.arange(round(duration_s / step_s) + 1)
    result = run(scene, step_s, *inputs(times_s))
    tension_n = result.get(at.TENSION)[0]
    return times_s, np.where(result.failed[0] < 0, tension_n, np.inf)


def _compare(scene, bound, inputs=_glide, duration_s=0.7, after_s=0.3):
    times_s, coarse = _tension(scene, inputs, duration_s, STEP_S)
    fine = _tension(scene, inputs, duration_s, STEP_S / FINER)[1][::FINER]
    late = times_s > after_s
    alternating_n = fine[late].std()
    assert alternating_n > 1e-3
    with np.errstate(invalid='ignore'):
        value = (coarse - fine)[late].std() / alternating_n
    return value if np.isfinite(value) else math.inf, bound


def contact_stiffness(factor):
    scene = plate_scene('R3', tip_stiffness_n_m=3000.0 * factor)
    return _compare(scene, _bound_contact(factor))


def undamped_contact(factor):
    scene = plate_scene('R3', tip_stiffness_n_m=3000.0 * factor, tip_damping_n_s_m=0.0)
    return _compare(scene, _bound_contact(factor))


def _bound_contact(factor):
    # A finger with mass bounces on what is a thousand times as stiff.
    return 0.1 if factor >= 1000 else 0.06


def shear_stiffness(factor):
    """Friction is not smoothed by speed: a stiff shear spring is the counterpart of that."""
    scene = plate_scene('R3', tip_shear_stiffness_n_m=2000.0 * factor)
    return _compare(scene, 0.06)


def tendon_presliding(factor):
    scene = plate_scene('R3', tendon_presliding_m=max(3e-5 * factor, 1e-7))
    return _compare(scene, 0.06)


def zero_friction():
    scene = dataclasses.replace(plate_scene('R3', tendon_friction=0.0), friction=0.0)
    return _compare(scene, 0.06)


def zero_mass():
    return _compare(plate_scene('R3', mass_kg=0.0, tip_mass_kg=0.0), 0.02)


def _plate(**dimensions):
    finger = plate_scene('F').finger
    plate = Plate('rectangular', end_mm=10.0, grooved_mm=50.0, friction=0.4, **dimensions)
    surface = build_plate_surface(plate, finger.tip_radius_m, 0.002)
    return dataclasses.replace(plate_scene('F'), surface=surface)


def edge_at_a_sample():
    """The guide stops with the tip's centre on a groove's edge, to within rounding."""
    scene = _plate(pitch_mm=16.0, width_mm=12.0, depth_mm=0.3)
    offset_m = 0.010 + 0.002 - _reach_at_rest(scene)

    def inputs(times_s):
        tendon_m = np.full(len(times_s), 0.0052)
        return tendon_m, offset_m - 0.003 + ramp(times_s, 0.0, 0.0, 0.003, 0.015)

    return _compare(scene, 0.06, inputs, 0.4, 0.0)


def _reach_at_rest(scene):
    state = run(scene, STEP_S, np.full(2, 0.0052), 0.075).state
    return state[at.TIP_SLIDER, 0] - 0.075


def groove_narrower_than_the_tip():
    """A tenth of a millimetre wide: the tip of 5 mm hardly feels it."""
    flat = _tension(plate_scene('F'), _glide, 0.7, STEP_S)[1]
    grooved = _tension(_plate(pitch_mm=2.0, width_mm=0.1, depth_mm=5.0), _glide, 0.7, STEP_S)[1]
    value = np.abs(flat - grooved).max()
    # It feels slopes of 0.05 / 5 at most: as much as 0.01 of friction, of 0.4, would change.
    return value, 0.02


def slack_tendon(displacement_m):
    tendon_m = np.full(301, displacement_m)
    rows = run(free_scene(), STEP_S, tendon_m).rows[:, 0]
    moved = np.ptp(rows[at.MODES]) + rows[at.TENSION].max() * 1e3
    if displacement_m == 0.0:
        # It hangs lower than straight: just slack means that it bears nothing.
        assert rows[at.MODES, 0] > 0.01
    return moved, 1e-6


def long_steps(factor):
    """Three orders too long at most: bounded, and close to the truth, at the steps' ends."""
    step_s = STEP_S * factor
    scene = plate_scene('R3')
    times_s = step_s * np.arange(max(round(2.0 / step_s), 2) + 1)
    result = run(scene, step_s, *_glide(times_s))
    fine_s = STEP_S * np.arange(round(times_s[-1] / STEP_S) + 1)
    fine = run(scene, STEP_S, *_glide(fine_s)).get(at.TENSION)[0]
    tension = result.get(at.TENSION)[0]
    if result.failed[0] >= 0:
        return 0.0, 0.0  # it says so
    value = np.abs(tension - np.interp(times_s, fine_s, fine)).max() / fine.max()
    return value, 0.2


def full_speed_release(label):
    """48 mm/s is all that the drive can do: contact and tension are lost within 0.1 s."""
    scene = plate_scene('R3') if label == 'R3' else build_scene('stiffness', label, 'flexion')

    def inputs(times_s):
        tendon_m = ramp(times_s, 0.02, 0.0, 0.0054, 0.03) + ramp(times_s, 0.3, 0.0, -0.0054, 0.048)
        return tendon_m, np.full(len(times_s), CONTACT_GUIDE_M)

    return _compare(scene, 0.01, inputs, 0.6, 0.25)


def long_hold():
    """After ten minutes everything has relaxed: what is left is the rest of springs alone."""
    branches = (Branch(240.0, 3.0), Branch(100.0, 30.0))
    scene = dataclasses.replace(
        object_scene(Body(60.0, branches, 0.0, 0.0), tendon_friction=0.0), friction=0.0
    )
    step_s = 1 / 120
    times_s = step_s * np.arange(72001)
    held = run(scene, step_s, ramp(times_s, 0.1, 0.0, 0.0052, 0.02))
    if held.failed[0] >= 0:
        return math.inf, 0.0
    # Another scene, that never had branches or creep, at rest at once.
    relaxed = change(scene, body=Body(60.0, (), 0.0, 0.0), creep_stiffness_nm_rad=0.0)
    rest = run(relaxed, 1e3, np.full(2, 0.0052)).get(at.TENSION)[0, -1]
    value = abs(held.get(at.TENSION)[0, -1] - rest) / rest
    return value, 1e-5


def shortest_lengths():
    """Everything that may be zero or tiny is: finger, tip, groove, branches, damping."""
    finger = {
        'length_m': 0.01,
        'moment_arm_m': 1e-4,
        'tip_radius_m': 2e-4,
        'tendon_presliding_m': 1e-7,
        'tip_damping_n_s_m': 0.0,
        'damping_nm_s_rad': 1e-7,
        'creep_stiffness_nm_rad': 0.0,
        'mass_kg': 0.0,
        'tip_mass_kg': 0.0,
    }
    scene = change(object_scene(Body(1e-3, (), 0.0, 0.0)), **finger)
    times_s = STEP_S * np.arange(301)
    result = run(scene, STEP_S, ramp(times_s, 0.02, 0.0, 1e-4, 1e-3))
    failed = result.failed[0] >= 0 or not np.isfinite(result.rows).all()
    return float(failed), 0.0


CASES = (
    *((contact_stiffness, (factor,)) for factor in (0.1, 1.0, 10.0, 100.0, 1000.0)),
    (undamped_contact, (1.0,)),
    (undamped_contact, (1000.0,)),
    (shear_stiffness, (1000.0,)),
    (tendon_presliding, (0.001,)),
    (zero_friction, ()),
    (zero_mass, ()),
    (edge_at_a_sample, ()),
    (groove_narrower_than_the_tip, ()),
    (slack_tendon, (0.0,)),
    (slack_tendon, (-0.01,)),
    *((long_steps, (factor,)) for factor in (10.0, 100.0, 1000.0)),
    (full_speed_release, ('R3',)),
    (full_speed_release, ('sponge',)),
    (long_hold, ()),
    (shortest_lengths, ()),
)
