# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of the simulation are bounded in numerically difficult cases and for any description.

Each function of a hard case returns an error and the largest accepted error. The error is infinite
if no balance was found in a step. In most cases, the tension is compared with the tension of a
simulation whose steps are 40 times finer. The error is then the standard deviation of the
difference, relative to the standard deviation of the tension.
"""

import dataclasses
import math

from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scenery import (
    change,
    CONTACT_GUIDE_M,
    free_scene,
    object_scene,
    own_plate,
    plate_scene,
    ramp,
    run,
)

from tactile_sim.descriptions.description import Body, Branch, Finger, Plate
from tactile_sim.errors import ConvergenceError
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.trials import TRUSTED_NM

STEP_S = 1 / 960
FINER = 40


def _glide(times_s):
    """Return tendon and guide positions of a press, followed by a glide at 15 mm/s."""
    tendon_m = ramp(times_s, 0.02, 0.0, 0.0054, 0.03)
    return tendon_m, 0.074 + ramp(times_s, 0.25, 0.0, 1.0, 0.015)


def _tension(scene, inputs, duration_s, step_s):
    times_s = step_s * np.arange(round(duration_s / step_s) + 1)
    result = run(scene, step_s, *inputs(times_s))
    tension_n = result.rows[at.TENSION][0]
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


def _plate(**dimensions):
    plate = Plate('rectangular', end_mm=10.0, grooved_mm=50.0, friction=0.4, **dimensions)
    return own_plate(plate)


def edge_at_a_sample():
    """The guide stops when the centre of the tip is exactly above the edge of a groove."""
    scene = _plate(pitch_mm=16.0, width_mm=12.0, depth_mm=0.3)
    rest = run(scene, STEP_S, np.full(2, 0.0052), 0.075).state
    offset_m = 0.010 + 0.002 - (rest[at.TIP_SLIDER, 0] - 0.075)

    def inputs(times_s):
        tendon_m = np.full(len(times_s), 0.0052)
        return tendon_m, offset_m - 0.003 + ramp(times_s, 0.0, 0.0, 0.003, 0.015)

    return _compare(scene, 0.06, inputs, 0.4, 0.0)


def groove_narrower_than_the_tip():
    """A groove of 0.1 mm hardly changes the path of a tip with a radius of 5 mm."""
    flat = _tension(plate_scene('F'), _glide, 0.7, STEP_S)[1]
    grooved = _tension(_plate(pitch_mm=2.0, width_mm=0.1, depth_mm=5.0), _glide, 0.7, STEP_S)[1]
    value = np.abs(flat - grooved).max()
    # The slope of the tip's path is at most half the groove's width divided by the tip's radius,
    # which is 0.01. It has the same effect as a change of the friction coefficient by 0.01.
    return value, 0.02


def slack_tendon(displacement_m):
    tendon_m = np.full(301, displacement_m)
    rows = run(free_scene(), STEP_S, tendon_m).rows[:, 0]
    moved = np.ptp(rows[at.MODES]) + rows[at.TENSION].max() * 1e3
    if displacement_m == 0.0:
        # The free finger sags under its weight, so that the tendon is slack.
        assert rows[at.MODES, 0] > 0.01
    return moved, 1e-6


def long_steps(factor):
    """Steps that are up to 1000 times too long still give approximate tensions at their ends."""
    step_s = STEP_S * factor
    scene = plate_scene('R3')
    times_s = step_s * np.arange(max(round(2.0 / step_s), 2) + 1)
    result = run(scene, step_s, *_glide(times_s))
    fine_s = STEP_S * np.arange(round(times_s[-1] / STEP_S) + 1)
    fine = run(scene, STEP_S, *_glide(fine_s)).rows[at.TENSION][0]
    tension = result.rows[at.TENSION][0]
    if result.failed[0] >= 0:
        return 0.0, 0.0  # a step without balance is accepted, because the result reports it
    value = np.abs(tension - np.interp(times_s, fine_s, fine)).max() / fine.max()
    return value, 0.2


def _release(times_s):
    """Return positions of a press and a release at 48 mm/s, the highest speed of the drive."""
    tendon_m = ramp(times_s, 0.02, 0.0, 0.0054, 0.03) + ramp(times_s, 0.3, 0.0, -0.0054, 0.048)
    return tendon_m, np.full(len(times_s), CONTACT_GUIDE_M)


def long_hold():
    """After a press of ten minutes, the tension is the same as without relaxation and creep."""
    branches = (Branch(240.0, 3.0), Branch(100.0, 30.0))
    scene = dataclasses.replace(
        object_scene(Body(60.0, branches, 0.0, 0.0), tendon_friction=0.0), friction=0.0
    )
    step_s = 1 / 30
    times_s = step_s * np.arange(18001)
    held = run(scene, step_s, ramp(times_s, 0.1, 0.0, 0.0052, 0.02))
    if held.failed[0] >= 0:
        return math.inf, 0.0
    # The comparison scene has no relaxing branches and no creep, so it is at rest immediately.
    relaxed = change(scene, body=Body(60.0, (), 0.0, 0.0), creep_stiffness_nm_rad=0.0)
    rest = run(relaxed, 1e3, np.full(2, 0.0052)).rows[at.TENSION][0, -1]
    value = abs(held.rows[at.TENSION][0, -1] - rest) / rest
    return value, 1e-5


def shortest_lengths():
    """A finger whose dimensions and dampings are zero or the smallest accepted values."""
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


COMPARED = {
    # With the stiffest contact, the finger bounces on the surface, so the error is larger.
    **{f'contact {n}': ({'tip_stiffness_n_m': n * 3e3}, 0.06) for n in (0.1, 1, 10, 100)},
    'contact 1000': ({'tip_stiffness_n_m': 3e6}, 0.1),
    'undamped contact': ({'tip_damping_n_s_m': 0.0}, 0.06),
    'undamped contact 1000': ({'tip_stiffness_n_m': 3e6, 'tip_damping_n_s_m': 0.0}, 0.1),
    # The stiff shear spring makes the friction change its sign almost abruptly.
    'shear 1000': ({'tip_shear_stiffness_n_m': 2e6}, 0.06),
    'tendon presliding': ({'tendon_presliding_m': 1e-7}, 0.06),
    'no mass': ({'mass_kg': 0.0, 'tip_mass_kg': 0.0}, 0.02),
}
CASES = {
    **{
        name: lambda finger=finger, bound=bound: _compare(plate_scene('R3', **finger), bound)
        for name, (finger, bound) in COMPARED.items()
    },
    'no friction': lambda: _compare(
        dataclasses.replace(plate_scene('R3', tendon_friction=0.0), friction=0.0), 0.06
    ),
    'release from a plate': lambda: _compare(plate_scene('R3'), 0.01, _release, 0.6, 0.25),
    'release from a sponge': lambda: _compare(
        build_scene('stiffness', 'sponge', 'flexion'), 0.01, _release, 0.6, 0.25
    ),
    'edge at a sample': edge_at_a_sample,
    'narrow groove': groove_narrower_than_the_tip,
    'slack': lambda: slack_tendon(0.0),
    'very slack': lambda: slack_tendon(-0.01),
    **{f'steps {n} times as long': lambda n=n: long_steps(n) for n in (10, 100, 1000)},
    'long hold': long_hold,
    'shortest lengths': shortest_lengths,
}


@pytest.mark.parametrize('name', CASES)
def test_hard_case(name):
    value, bound = CASES[name]()
    assert value <= bound


def any_number(field):
    """Return a Hypothesis strategy for all accepted numbers, with uniform logarithms."""
    low, high = field.metadata['range']
    if low < 0.0 < high:
        return st.floats(low, high)
    least = max(low, high * 1e-9)
    spread = st.floats(math.log(least), math.log(high)).map(math.exp)
    number = spread.map(lambda v: min(max(v, least), high))
    return st.one_of(st.just(0.0), number) if low == 0.0 else number


def any_of(kind, **fixed):
    numbers = {
        field.name: any_number(field)
        for field in dataclasses.fields(kind)
        if 'range' in field.metadata and field.name not in fixed
    }
    return st.fixed_dictionaries({**numbers, **fixed})


def make_finger(values, share):
    # A valid finger touches the object before it reaches its bend stop.
    return Finger(**{**values, 'contact_bend_deg': share * values['bend_stop_deg']})


FINGERS = st.builds(make_finger, any_of(Finger, contact_bend_deg=st.none()), st.floats(0.01, 0.99))
BRANCHES = st.lists(any_of(Branch).map(lambda v: Branch(**v)), max_size=3).map(tuple)
TIMES_S = np.arange(61) / 600
TENDON_M = ramp(TIMES_S, 0.0, 0.0, 0.006, 0.12) - ramp(TIMES_S, 0.07, 0.0, 0.006, 0.25)
GUIDE_M = 0.060 + ramp(TIMES_S, 0.03, 0.0, 0.002, 0.05)


def check(scene):
    """Check that all values are finite, and that the tension fits the stretch of the tendon."""
    try:
        trusted_nm = TRUSTED_NM if scene.inertia else 0.0
        result = run(scene, 1 / 600, TENDON_M, GUIDE_M, trusted_nm=trusted_nm)
    except ConvergenceError:
        return
    rows = result.rows[:, 0]
    known = rows[:, : result.failed[0] + 1] if result.failed[0] >= 0 else rows
    assert np.isfinite(known).all()
    assert (known[at.TENSION] >= 0.0).all()
    assert (known[at.FORCE] >= 0.0).all()
    # The stretch of the tendon is its displacement minus the part that bends the finger.
    stretch = TENDON_M[: known.shape[1]] - scene.finger.moment_arm_m * known[at.MODES]
    expected = scene.finger.tendon_stiffness_n_m * np.maximum(stretch, 0.0)
    rounding = 1e-15 * scene.finger.tendon_stiffness_n_m
    np.testing.assert_allclose(known[at.TENSION], expected, rtol=1e-9, atol=rounding)


@pytest.mark.parametrize('names', [('stiffness', 'sponge'), ('texture', 'R3')], ids='-'.join)
@settings(max_examples=25, derandomize=True)
@given(finger=FINGERS)
def test_any_accepted_finger_gives_finite_trials_or_says_that_it_cannot(names, finger):
    check(dataclasses.replace(build_scene(*names, 'flexion'), finger=finger))


@settings(max_examples=25, derandomize=True)
@given(values=any_of(Body, branches=BRANCHES))
def test_any_accepted_object_gives_finite_trials_or_says_that_it_cannot(values):
    assume(values['stiffness_n_m'] > 0)
    check(dataclasses.replace(object_scene(Body(**values)), friction=values['friction']))


@settings(max_examples=25, derandomize=True)
@given(
    groove=st.sampled_from(['rectangular', 'triangular', 'circular']),
    width_mm=st.floats(0.05, 10.0),
    pitch=st.floats(1.0, 4.0),
    count=st.floats(1.0, 5.0),
    depth=st.floats(1e-6, 0.5),
    friction=st.floats(0.0, 5.0),
)
def test_any_accepted_plate_gives_finite_trials_or_says_that_it_cannot(
    groove, width_mm, pitch, count, depth, friction
):
    plate = Plate(
        groove,
        end_mm=0.1,
        grooved_mm=width_mm * pitch * count,
        friction=friction,
        pitch_mm=width_mm * pitch,
        width_mm=width_mm,
        depth_mm=width_mm * depth,
    )
    check(own_plate(plate))
