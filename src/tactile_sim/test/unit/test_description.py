# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue, parse_description, parse_text
from tactile_sim.descriptions.description import Body, Finger, HeldObject, Plate, Rig
from tactile_sim.errors import DescriptionError

BRANCH = {'stiffness_n_m': 2.0, 'relaxation_time_s': 3.0}
BODY = {'stiffness_n_m': 1.0, 'branches': [BRANCH], 'softening_m': 0.0, 'friction': 0.1}
HELD = {
    'body': BODY,
    'motion': 'roll',
    'radius_m': 0.01,
    'kinetic_friction': 0.8,
    'weakening_m': 1e-4,
    'healing_s': 0.1,
    'drive_stiffness_n_m': 100.0,
}
FLAT = {'groove': 'none', 'end_mm': 10.0, 'grooved_mm': 50.0, 'friction': 0.4}
GROOVED = {**FLAT, 'groove': 'circular', 'pitch_mm': 4.0, 'width_mm': 2.0, 'depth_mm': 1.0}
OWN = {**FLAT, 'groove': 'profile', 'points_mm': [[0, 0], [20.5, -1], [50, 0]]}
FINGER = dataclasses.asdict(default_catalogue().finger('flexion'))
RIG = dataclasses.asdict(default_catalogue().rig())


def refuse(kind, good, change, sentence):
    parse_description(kind, good, 'thing')
    with pytest.raises(DescriptionError, match=sentence):
        parse_description(kind, {**good, **change}, 'thing')


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'stiffness_n_m': '1e3 N/m'}, "thing.stiffness_n_m is '1e3 N/m'; it must be a finite"),
        ({'stiffness_n_m': float('nan')}, 'must be a finite number'),
        ({'stiffness_n_m': math.inf}, 'must be a finite number'),
        ({'stiffness_n_m': True}, 'must be a finite number'),
        ({'stiffness_n_m': None}, 'must be a finite number'),
        ({'stiffness_n_m': -1.0}, 'is -1; it must be at least 0 and at most 1e[+]09'),
        ({'colour': 3}, "'colour' is unknown, known are stiffness_n_m, branches"),
        ({'branches': BRANCH}, r'thing.branches is .*; it must be a list'),
        ({'branches': [{**BRANCH, 'relaxation_time_s': 0}]}, r'branches\[0\].relaxation_time_s'),
        ({'branches': [BRANCH] * 4}, 'branches has 4 entries; at most 3'),
        ({'stiffness_n_m': 0.0}, 'without stiffness_n_m cannot have branches'),
        ({'softening_m': 1.0}, 'softening_m is 1; it must be at least 0 and at most 0.1'),
    ],
)
def test_bad_body_is_refused_with_a_sentence(change, sentence):
    refuse(Body, BODY, change, sentence)


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'motion': 'jump'}, "motion is 'jump'"),
        ({'motion': 3}, 'motion is 3; it must be a word'),
        ({'radius_m': 0}, 'radius_m of an object that rolls'),
        ({'motion': 'slide'}, 'radius_m of an object that slides must be 0'),
        ({'kinetic_friction': 0.0}, 'must be above 0 and at most 1'),
        ({'kinetic_friction': 1.1}, 'must be above 0 and at most 1'),
        ({'body': {**BODY, 'friction': 9}}, r'thing\.body\.friction is 9'),
        ({'body': {**BODY, 'stiffness_n_m': 0, 'branches': []}}, 'body.stiffness_n_m'),
        ({'body': 3}, 'thing.body must be a mapping'),
    ],
)
def test_bad_held_object_is_refused_with_a_sentence(change, sentence):
    refuse(HeldObject, HELD, change, sentence)


@pytest.mark.parametrize(
    ('good', 'change', 'sentence'),
    [
        (FLAT, {'groove': 'square'}, 'groove is'),
        (FLAT, {'width_mm': 1.0}, 'groove: none has no pitch_mm, width_mm and depth_mm'),
        (FLAT, {'points_mm': [[0, 0], [50, 0]]}, 'points_mm is only for groove: profile'),
        (GROOVED, {'width_mm': 7.0}, 'width_mm is 7, pitch_mm 4'),
        (GROOVED, {'pitch_mm': 60.0}, 'grooved_mm 50'),
        (GROOVED, {'width_mm': 0.0}, 'a width is at least 0.05'),
        (GROOVED, {'depth_mm': 0.0}, 'must be above 0'),
        (GROOVED, {'depth_mm': 1.1}, 'at most half its width_mm'),
        (OWN, {'points_mm': []}, 'points_mm has 0 points'),
        (OWN, {'points_mm': [[0, 0], [50]]}, r'points_mm\[1\] has 1 entries; it must have 2'),
        (OWN, {'points_mm': [[0, 0], [50, 'deep']]}, r'points_mm\[1\]\[1\] is .deep.'),
        (OWN, {'points_mm': [[0, 0], [50, math.nan]]}, 'must be a finite number'),
        (OWN, {'points_mm': [[0, 0], [49, 0]]}, 'must rise from 0 to grooved_mm, which is 50'),
        (OWN, {'points_mm': [[0, 0], [9, 0], [9, -1], [50, 0]]}, 'must rise from 0'),
        (OWN, {'points_mm': [[0, 0], [9, 0.1], [50, 0]]}, 'must be between -100 and 0'),
        (OWN, {'points_mm': [[x / 100, 0] for x in range(5001)]}, 'needs 2 to 1000'),
        (OWN, {'pitch_mm': 2.0}, 'groove: profile has no pitch_mm'),
    ],
)
def test_bad_plate_is_refused_with_a_sentence(good, change, sentence):
    refuse(Plate, good, change, sentence)


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'bend_stop_deg': 30.0}, 'contact_bend_deg is 40; it must be below bend_stop_deg'),
        ({'moment_arm_m': 0.12}, 'moment_arm_m is 0.12; it must be at least 0.0001 and at most'),
        ({'length_m': 80.0}, 'length_m is 80'),
    ],
)
def test_bad_finger_is_refused_with_a_sentence(change, sentence):
    refuse(Finger, FINGER, change, sentence)


@pytest.mark.parametrize(
    ('part', 'change', 'sentence'),
    [
        ('tendon', {'counts_per_turn': 4096.5}, r'thing\.tendon\.counts_per_turn .* whole number'),
        ('guide', {'power_up_m': 0.3}, 'power_up_m must be at most travel_m'),
        ('guide', {'travel_m': 0.05, 'power_up_m': 0.0}, 'texture_guide_m must be at most guide'),
        ('load_cell', {'resolution_n': 1.0, 'capacity_n': 0.5}, 'at most capacity_n'),
        ('load_cell', {'rate_hz': 0.0}, 'load_cell.rate_hz is 0'),
        ('variation', {'trial': {}}, 'variation.trial: contact_height_m is missing'),
    ],
)
def test_bad_rig_is_refused_with_a_sentence(part, change, sentence):
    refuse(Rig, RIG, {part: {**RIG[part], **change}}, sentence)


def test_missing_and_wrong_shapes_are_refused():
    with pytest.raises(DescriptionError, match='friction is missing'):
        parse_description(Body, {k: v for k, v in BODY.items() if k != 'friction'}, 'object x')
    with pytest.raises(DescriptionError, match='must be a mapping'):
        parse_description(Finger, [1], 'finger')


def test_a_description_survives_a_round_trip():
    for kind, values in [(Body, BODY), (HeldObject, HELD), (Plate, OWN), (Plate, GROOVED)]:
        built = parse_description(kind, values, 'thing')
        assert parse_description(kind, dataclasses.asdict(built), 'thing') == built
        assert hash(built) == hash(parse_description(kind, values, 'thing'))
    own = parse_description(Plate, OWN, 'thing')
    assert own.points_mm == ((0.0, 0.0), (20.5, -1.0), (50.0, 0.0))
    assert own.length_m == pytest.approx(0.070)


@pytest.mark.parametrize(
    ('text', 'values'),
    [
        ('a: 1e-3', {'a': 0.001}),
        ('a: -7', {'a': -7}),
        ('a: .5', {'a': 0.5}),
        ('a: no', {'a': 'no'}),
        ('a: 1:30', {'a': '1:30'}),
        ('a: 2026-02-30', {'a': '2026-02-30'}),
        ('a: "1"', {'a': '1'}),
        ('a: true', {'a': True}),
        ('a:', {'a': None}),
        ('a: .inf', {'a': math.inf}),
        ('1: {2: [3, [4.0]]}', {'1': {'2': [3, [4.0]]}}),
        ('# only\n---\na: 1\n...\n', {'a': 1}),
    ],
)
def test_plain_values(text, values):
    assert parse_text(text, 'x.yaml') == values


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('', 'x.yaml must be a mapping'),
        ('# nothing', 'x.yaml must be a mapping'),
        ('- 1', 'x.yaml must be a mapping'),
        ('a: [', 'x.yaml is no YAML in line 1'),
        ('a: 1\nb: 2\na: 3', "x.yaml is no YAML in line 3: it has 'a' twice; remove one"),
        ('a: {b: {c: 1, c: 2}}', "in line 1: it has 'c' twice"),
        ('a: &x [1]\nb: *x', r'in line 2: it has the alias \*x; write the value itself'),
        ('a: &x {k: *x}', r'alias \*x'),
        ('a: !!python/object:os.system {}', 'in line 1: it has the tag'),
        ('a: !!int "3"', 'has the tag'),
        ('? [1, 2]\n: 3', 'a key that is no word'),
        ('a: 1\n---\nb: 2', 'more than one document'),
        ('a: \x07', 'x.yaml is no YAML'),
        ('a: "\\UFFFFFFFF"', 'x.yaml is no YAML'),
    ],
)
def test_text_that_is_no_description_is_refused(text, sentence):
    with pytest.raises(DescriptionError, match=sentence):
        parse_text(text, 'x.yaml')


@pytest.mark.parametrize('piece', ['[', '{b: ', '- '])
def test_nesting_without_end_is_refused(piece):
    start = '' if piece == '- ' else 'a: '
    with pytest.raises(DescriptionError, match='nested too deeply'):
        parse_text(start + piece * 100000, 'x.yaml')


def test_numbers_without_end_are_refused():
    values = parse_text('a: ' + '9' * 100000, 'x.yaml')
    with pytest.raises(DescriptionError, match='it must be a finite number'):
        parse_description(Finger, {**FINGER, 'length_m': values['a']}, 'x')
    with pytest.raises(DescriptionError, match=r'x\.yaml is no YAML'):
        parse_text('%YAML ' + '9' * 5000 + '.1\n---\na: 1', 'x.yaml')


YAML_PIECES = st.sampled_from(
    [
        *'[]{}:,-?&*!|>%@`"\'#\n \t~0189.eE+xaB\\\r\u2028\ufeff\x00\ud800',
        '---',
        '...',
        '<<',
        '!!',
        '.inf',
        'null',
        '\n  ',
        ': ',
        '%YAML 1.1\n',
        '\\U',
        '|9\n',
        '&a',
    ]
)


@given(st.lists(YAML_PIECES, max_size=40).map(''.join) | st.text(max_size=60))
def test_any_text_is_a_mapping_or_refused(text):
    said = 'x.yaml'
    try:
        assert isinstance(parse_text(text, 'x.yaml'), dict)
    except DescriptionError as error:
        said = str(error)
    assert said.startswith('x.yaml')
    assert '\n' not in said
