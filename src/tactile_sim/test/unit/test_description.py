# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import pytest

from tactile_sim.description import (
    Body,
    Finger,
    Plate,
    Rig,
    list_objects,
    load_body,
    load_finger,
    load_plate,
    load_rig,
    parse_description,
)
from tactile_sim.errors import DescriptionError

GOOD = {'stiffness_n_m': 1.0, 'branch_stiffness_n_m': 0, 'relaxation_time_s': 1.0, 'friction': 0.1}


def test_all_descriptions_load():
    assert list_objects('texture') == ('F', 'R1', 'R2', 'R3', 'T1', 'T2', 'C1', 'C2')
    assert list_objects('stiffness') == ('pla', 'solid_rubber', 'rubber_shell', 'sponge', 'none')
    for label in list_objects('texture'):
        assert load_plate(label).length_m == pytest.approx(0.070)
    stiffness = [load_body(label).stiffness_n_m for label in list_objects('stiffness')]
    assert stiffness == sorted(stiffness, reverse=True)


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'stiffness_n_m': '1e3'}, "stiffness_n_m is '1e3'; it must be a finite number"),
        ({'stiffness_n_m': float('nan')}, 'must be a finite number'),
        ({'stiffness_n_m': True}, 'must be a finite number'),
        ({'stiffness_n_m': -1.0}, 'must be at least 0.0'),
        ({'relaxation_time_s': 0.0}, 'must be above 0.0'),
        ({'colour': 3}, 'colour is unknown'),
        ({'stiffness_n_m': 0.0, 'branch_stiffness_n_m': 1.0}, 'cannot have a branch'),
    ],
)
def test_bad_body_is_refused_with_a_sentence(change, sentence):
    with pytest.raises(DescriptionError, match=sentence):
        parse_description(Body, {**GOOD, **change}, 'object x')


def test_missing_and_wrong_shapes_are_refused():
    with pytest.raises(DescriptionError, match='friction is missing'):
        parse_description(Body, {k: v for k, v in GOOD.items() if k != 'friction'}, 'object x')
    with pytest.raises(DescriptionError, match='must be a mapping'):
        parse_description(Finger, [1], 'finger')
    plate = dataclasses.asdict(load_plate('R1'))
    with pytest.raises(DescriptionError, match='groove is'):
        parse_description(Plate, {**plate, 'groove': 'square'}, 'plate')
    with pytest.raises(DescriptionError, match='width_mm'):
        parse_description(Plate, {**plate, 'width_mm': 7.0}, 'plate')
    with pytest.raises(DescriptionError, match='depth_mm'):
        parse_description(Plate, {**plate, 'groove': 'circular', 'depth_mm': 1.6}, 'plate')
    finger = dataclasses.asdict(load_finger('flexion'))
    with pytest.raises(DescriptionError, match='bend_stop_deg'):
        parse_description(Finger, {**finger, 'bend_stop_deg': 30.0}, 'finger')
    rig = dataclasses.asdict(load_rig())
    rig['tendon']['counts_per_turn'] = 4096.5
    with pytest.raises(DescriptionError, match=r'rig\.tendon\.counts_per_turn .* whole number'):
        parse_description(Rig, rig, 'rig')


def test_unknown_names_are_refused():
    for load in (load_finger, load_plate, load_body, list_objects):
        with pytest.raises(DescriptionError, match="'wood'"):
            load('wood')
