# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Hard cases stay within their bounds; descriptions that are merely accepted never mislead."""

import dataclasses
import math

from hard_cases import CASES
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scenery import build_scene, change, ramp, run

from tactile_sim.descriptions.description import Body, Branch, Finger, Plate
from tactile_sim.errors import ConvergenceError, DescriptionError
from tactile_sim.physics import layout as at
from tactile_sim.physics.scene import build_plate_surface
from tactile_sim.physics.trials import TRUSTED_NM


def name_case(value):
    return value.__name__ if callable(value) else '-'.join(map(str, value)) or 'once'


@pytest.mark.parametrize(('measure', 'arguments'), CASES, ids=name_case)
def test_hard_case(measure, arguments):
    value, bound = measure(*arguments)
    assert value <= bound


def any_number(field):
    """Over the whole accepted range, by orders of magnitude."""
    low = field.metadata.get('from', field.metadata.get('above'))
    high = field.metadata['to']
    if low < 0.0 < high:
        return st.floats(low, high)
    least = max(low, high * 1e-9)
    spread = st.floats(math.log(least), math.log(high)).map(math.exp)
    number = spread.map(lambda v: min(max(v, least), high))
    return st.one_of(st.just(0.0), number) if 'from' in field.metadata and low == 0.0 else number


def any_of(kind, **fixed):
    numbers = {
        field.name: any_number(field)
        for field in dataclasses.fields(kind)
        if 'to' in field.metadata and field.name not in fixed
    }
    return st.fixed_dictionaries({**numbers, **fixed})


def make(kind, values):
    try:
        return kind(**values)
    except DescriptionError:
        return None


def make_finger(values, share):
    # The stop lies beyond the contact, as every description must have it.
    stop_deg = values['bend_stop_deg']
    return make(Finger, {**values, 'contact_bend_deg': share * stop_deg})


FINGERS = st.builds(make_finger, any_of(Finger, contact_bend_deg=st.none()), st.floats(0.01, 0.99))
BODIES = any_of(
    Body, branches=st.lists(any_of(Branch).map(lambda v: Branch(**v)), max_size=3).map(tuple)
)
TIMES_S = np.arange(61) / 600
TENDON_M = ramp(TIMES_S, 0.0, 0.0, 0.006, 0.12) - ramp(TIMES_S, 0.07, 0.0, 0.006, 0.25)
GUIDE_M = 0.060 + ramp(TIMES_S, 0.03, 0.0, 0.002, 0.05)


def check(scene):
    """Finite rows, and a failure says where; a trial that goes on does what springs allow."""
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
    # The tendon stretches by what is pulled beyond the bend.
    stretch = TENDON_M[: known.shape[1]] - scene.finger.moment_arm_m * known[at.MODES]
    expected = scene.finger.tendon_stiffness_n_m * np.maximum(stretch, 0.0)
    rounding = 1e-15 * scene.finger.tendon_stiffness_n_m
    np.testing.assert_allclose(known[at.TENSION], expected, rtol=1e-9, atol=rounding)


@pytest.mark.parametrize('names', [('stiffness', 'sponge'), ('texture', 'R3')], ids='-'.join)
@settings(max_examples=25, derandomize=True)
@given(finger=FINGERS)
def test_any_accepted_finger_gives_finite_trials_or_says_that_it_cannot(names, finger):
    if finger is not None:
        check(dataclasses.replace(build_scene(*names, 'flexion'), finger=finger))


@settings(max_examples=25, derandomize=True)
@given(values=BODIES)
def test_any_accepted_object_gives_finite_trials_or_says_that_it_cannot(values):
    body = make(Body, values)
    if body is not None and body.stiffness_n_m > 0:
        scene = change(build_scene('stiffness', 'sponge', 'flexion'), body=body)
        check(dataclasses.replace(scene, friction=body.friction))


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
    scene = build_scene('texture', 'F', 'flexion')
    surface = build_plate_surface(plate, scene.finger.tip_radius_m, 0.002)
    check(dataclasses.replace(scene, surface=surface, friction=friction))
