# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Descriptions of the rig: packaged values, values of the user, and errors in them."""

from contextlib import suppress
import dataclasses
import math
import os
import pickle

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest

from tactile_ros.errors import TactileError
from tactile_ros.yaml_files import load_yaml
from tactile_sim.descriptions.catalogue import (
    Catalogue,
    default_catalogue,
    list_objects,
    parse_description,
)
from tactile_sim.descriptions.description import Body, CONTACTS, Finger, Plate, Rig
from tactile_sim.errors import DescriptionError

BRANCH = {'stiffness_n_m': 2.0, 'relaxation_time_s': 3.0}
BODY = {'stiffness_n_m': 1.0, 'branches': [BRANCH], 'softening_m': 0.0, 'friction': 0.1}
FLAT = {'groove': 'none', 'end_mm': 10.0, 'grooved_mm': 50.0, 'friction': 0.4}
GROOVED = {**FLAT, 'groove': 'circular', 'pitch_mm': 4.0, 'width_mm': 2.0, 'depth_mm': 1.0}
OWN = {**FLAT, 'groove': 'profile', 'points_mm': [[0, 0], [20.5, -1], [50, 0]]}
FINGER = dataclasses.asdict(default_catalogue().finger('flexion'))
RIG = dataclasses.asdict(default_catalogue().rig())


@pytest.mark.parametrize(
    ('kind', 'good', 'change', 'sentence'),
    [
        (Body, BODY, {'stiffness_n_m': '1 N/m'}, "thing.stiffness_n_m is '1 N/m'; .* finite"),
        (Body, BODY, {'stiffness_n_m': math.nan}, 'must be a finite number'),
        (Body, BODY, {'stiffness_n_m': True}, 'must be a finite number'),
        (
            Body,
            BODY,
            {'stiffness_n_m': -1.0},
            'thing.stiffness_n_m is -1.0; .* 0.0 and 1000000000.0',
        ),
        (Body, BODY, {'colour': 3}, "'colour'.* stiffness_n_m, branches"),
        (Body, BODY, {'branches': BRANCH}, r'thing.branches is .* list'),
        (Body, BODY, {'branches': [{**BRANCH, 'relaxation_time_s': 0}]}, r'branches\[0\].relax'),
        (Body, BODY, {'branches': [BRANCH] * 4}, 'branches has 4 .* 3'),
        (Body, BODY, {'stiffness_n_m': 0.0}, 'stiffness_n_m .*branches'),
        (Plate, FLAT, {'groove': 'square'}, 'groove is'),
        (Plate, FLAT, {'width_mm': 1.0}, 'pitch_mm, width_mm and depth_mm'),
        (Plate, FLAT, {'points_mm': [[0, 0], [50, 0]]}, 'groove: profile'),
        (Plate, GROOVED, {'width_mm': 7.0}, 'width_mm is 7, pitch_mm 4'),
        (Plate, GROOVED, {'pitch_mm': 60.0}, 'grooved_mm 50'),
        (Plate, GROOVED, {'width_mm': 0.0}, 'width .* 0.05'),
        (Plate, GROOVED, {'depth_mm': 0.0}, 'depth_mm'),
        (Plate, GROOVED, {'depth_mm': 1.1}, 'width_mm'),
        (Plate, OWN, {'points_mm': []}, 'points_mm has 0 points'),
        (Plate, OWN, {'points_mm': [[0, 0], [50]]}, r'points_mm\[1\] has 1 .* 2'),
        (Plate, OWN, {'points_mm': [[0, 0], [50, 'deep']]}, r'points_mm\[1\]\[1\] is .deep.'),
        (Plate, OWN, {'points_mm': [[0, 0], [49, 0]]}, 'points_mm .*grooved_mm, .* 50'),
        (Plate, OWN, {'points_mm': [[0, 0], [9, 0], [9, -1], [50, 0]]}, 'points_mm'),
        (Plate, OWN, {'points_mm': [[0, 0], [9, 0.1], [50, 0]]}, 'points_mm'),
        (Plate, OWN, {'points_mm': [[x / 100, 0] for x in range(5001)]}, 'needs 2 to 1000'),
        (Finger, FINGER, {'bend_stop_deg': 30.0}, 'is 40;.* bend_stop_deg'),
        (Rig, RIG, {'tendon': {**RIG['tendon'], 'counts_per_turn': 4096.5}}, 'whole number'),
        (Rig, RIG, {'guide': {**RIG['guide'], 'power_up_m': 0.3}}, 'power_up_m .*travel_m'),
        (Rig, RIG, {'guide': {**RIG['guide'], 'travel_m': 0.05, 'power_up_m': 0.0}}, 'texture_'),
        (
            Rig,
            RIG,
            {'load_cell': {**RIG['load_cell'], 'resolution_n': 9, 'capacity_n': 5}},
            'capacity_n',
        ),
        (Rig, RIG, {'variation': {**RIG['variation'], 'trial': {}}}, 'height_m'),
    ],
)
def test_what_is_no_description_is_refused_with_a_sentence(kind, good, change, sentence):
    parse_description(kind, good, 'thing')
    with pytest.raises(DescriptionError, match=sentence):
        parse_description(kind, {**good, **change}, 'thing')


def test_a_profile_keeps_its_points():
    own = parse_description(Plate, OWN, 'thing')
    assert own.points_mm == ((0.0, 0.0), (20.5, -1.0), (50.0, 0.0))
    assert own.length_m == pytest.approx(0.070)


# -- text ------------------------------------------------------------------------------------

YAML_SIGNS = '[]{}:,-?&*!|>%@`"\'#\n \t~0189.eE+xaB\\\r\u2028\ufeff\x00\ud800'
YAML_WORDS = ['---', '...', '<<', '!!', '.inf', 'null', '\\U', '|9', '&a', ':', '%YAML']
YAML_PIECES = st.sampled_from([*YAML_SIGNS, *YAML_WORDS, '\n  ', '%YAML 1.1\n'])


@given(st.lists(YAML_PIECES, max_size=40).map(''.join) | st.text(max_size=60))
def test_any_text_is_a_plate_or_refused(text):
    with suppress(DescriptionError, TactileError):
        parse_description(Plate, load_yaml(text), 'x.yaml')


# -- the catalogue ---------------------------------------------------------------------------

FILES = {
    'finger_abduction.yaml': Finger,
    'finger_flexion.yaml': Finger,
    'rig.yaml': Rig,
    'plates.yaml': Plate,
    'objects.yaml': Body,
}
OWN_PLATE = (
    '{groove: profile, end_mm: 10, grooved_mm: 2, friction: 0.4, '
    'points_mm: [[0, 0], [1, -1], [2, 0]]}'
)


def lay_over(folder, **texts):
    for name, text in texts.items():
        (folder / f'{name}.yaml').write_text(text, encoding='utf-8')
    return Catalogue(folder)


def test_packaged_descriptions():
    catalogue = default_catalogue()
    assert list_objects('texture') == ('F', 'R1', 'R2', 'R3', 'T1', 'T2', 'C1', 'C2')
    assert list_objects('stiffness') == ('pla', 'solid_rubber', 'rubber_shell', 'sponge', 'none')
    for label in list_objects('texture'):
        assert catalogue.plate(label).length_m == pytest.approx(0.070)
    stiffness = [catalogue.body(label).stiffness_n_m for label in list_objects('stiffness')]
    assert stiffness == sorted(stiffness, reverse=True)
    for contact in CONTACTS:
        finger = catalogue.finger(contact)
        shear = finger.tip_shear_stiffness_n_m / finger.tip_stiffness_n_m
        assert shear == pytest.approx(2 / 3, rel=1e-3)


def test_unknown_names_are_refused():
    catalogue = default_catalogue()
    for find in (catalogue.finger, catalogue.plate, catalogue.body):
        with pytest.raises(DescriptionError, match="'wood'"):
            find('wood')
    with pytest.raises(DescriptionError, match=r"protocol is 'wood'.*texture"):
        catalogue.labels('wood')
    for names in ('texture F wood', 'stiffness wood flexion', 'wood F flexion'):
        with pytest.raises(DescriptionError, match="'wood'"):
            catalogue.check_mount(*names.split())


def test_a_users_files_are_laid_over_by_key_and_label(tmp_path):
    packaged = default_catalogue()
    (tmp_path / '.notes').write_text('not looked at')
    assert Catalogue(tmp_path) == packaged
    assert Catalogue(tmp_path).digest == packaged.digest
    catalogue = lay_over(
        tmp_path,
        plates=f'mine: {OWN_PLATE}\nR1: {OWN_PLATE}',
        objects='jelly: {stiffness_n_m: 5e1, branches: [], softening_m: 0, friction: 0.5}',
        finger_flexion='# mine is longer\nlength_m: 0.09',
        rig='load_cell: {noise_n: 0}\nvariation: {session: {friction: 0}}',
    )
    assert catalogue.labels('texture') == (*packaged.labels('texture'), 'mine')
    assert catalogue.plate('R1') == catalogue.plate('mine') != packaged.plate('R1')
    assert catalogue.plate('R2') == packaged.plate('R2')
    assert catalogue.body('jelly').stiffness_n_m == 50.0
    catalogue.check_mount('stiffness', 'jelly', 'flexion')
    flexion = packaged.finger('flexion')
    assert catalogue.finger('flexion') == dataclasses.replace(flexion, length_m=0.09)
    assert catalogue.finger('abduction') == packaged.finger('abduction')
    rig, was = catalogue.rig(), packaged.rig()
    assert rig.load_cell == dataclasses.replace(was.load_cell, noise_n=0.0)
    assert rig.variation.trial == was.variation.trial
    assert rig.variation.session == dataclasses.replace(was.variation.session, friction=0.0)
    assert catalogue != packaged
    assert catalogue.digest != packaged.digest
    # A pickled catalogue does not need the files from which it was read.
    data = pickle.dumps(catalogue)
    for path in tmp_path.iterdir():
        path.unlink()
    there = pickle.loads(data)
    assert there == catalogue
    assert hash(there) == hash(catalogue)


@pytest.mark.parametrize(
    ('name', 'text', 'sentence'),
    [
        ('plates', 'mine: 3', 'plates.yaml: mine'),
        ('plates', 'mine: {groove: none}', 'plates.yaml: mine: end_mm'),
        (
            'plates',
            'mine: {groove: triangular, pitch_mm: 2, width_mm: 3, depth_mm: 1, end_mm: 10, '
            'grooved_mm: 50, friction: 0.4}',
            'plates.yaml: mine: width_mm is 3, pitch_mm 2',
        ),
        ('plates', f'my plate: {OWN_PLATE}', "plates.yaml.*'my plate'"),
        ('plates', f'../x: {OWN_PLATE}', "'../x'"),
        ('plates', f'"x\\n": {OWN_PLATE}', 'label'),
        ('plates', ''.join(f'x{i}: 1\n' for i in range(1001)), '1001 labels'),
        ('objects', 'mine: {friction: 1}', 'objects.yaml: mine: branches'),
        ('finger_flexion', 'moment_arm_m: 0.2', r'finger_flexion.yaml.moment_arm_m is 0\.2'),
        ('finger_flexion', 'mass_kg: 2', 'contact_bend_deg'),
        ('finger_flexion', 'moment_arm_m: 1e-3', ' N .*contact_bend_deg'),
        ('rig', 'load_cell: 3', 'rig.yaml.load_cell'),
        ('rig', 'load_cell: {capacity_n: 2}', 'load_cell.capacity_n is 2'),
        ('rig', 'variation: {session: {temperature_k: 20}, trial: {temperature_k: 12}}', '96 K'),
        ('rig', '', 'rig.yaml'),
        ('rig', '- 1', 'rig.yaml'),
        ('plates', 'a: [', 'plates.yaml: .*not valid YAML'),
        ('plates', f'1: {OWN_PLATE}', 'label 1 '),
        ('plates', f'm: {OWN_PLATE}\nm: {OWN_PLATE}', "plates.yaml: .*'m' occurs twice"),
        ('rig', 'load_cell: {1: 2}', 'rig.yaml.load_cell'),
        ('plates', '#' * (1 << 20) + 'x: 1', r'plates\.yaml: .*1048576'),
    ],
    ids=lambda value: value[:20],
)
def test_nonsense_is_refused_by_file_label_and_key(tmp_path, name, text, sentence):
    with pytest.raises(DescriptionError, match=sentence) as caught:
        lay_over(tmp_path, **{name: text})
    assert str(caught.value).count('\n') == 0


def test_unusable_folders_and_files_are_refused(tmp_path):
    with pytest.raises(DescriptionError, match='nowhere'):
        Catalogue(tmp_path / 'nowhere')
    wrong = tmp_path / 'plates.yml'
    wrong.write_text('')
    with pytest.raises(DescriptionError, match=r'plates\.yml'):
        Catalogue(wrong)
    with pytest.raises(DescriptionError, match=r"'plates\.yml'.* finger_abd"):
        Catalogue(tmp_path)
    wrong.unlink()
    plates = tmp_path / 'plates.yaml'
    plates.write_bytes(b'a: \xff')
    with pytest.raises(DescriptionError, match=r'plates\.yaml: .*UTF-8'):
        Catalogue(tmp_path)
    plates.unlink()
    os.mkfifo(plates)  # to read this named pipe would block forever
    with pytest.raises(DescriptionError, match=r'plates\.yaml'):
        Catalogue(tmp_path)


KEYS = sorted(
    {field.name for kind in FILES.values() for field in dataclasses.fields(kind)}
    | {'F', 'sponge', 'noise_n', 'trial', 'relaxation_time_s', 'mine'}
)
VALUES = st.recursive(
    st.sampled_from(['1', '0', '-1', '1e308', '.nan', '.inf', 'null', 'true', 'none', '[]', '""'])
    | st.floats().map(repr)
    | st.integers().map(str),
    lambda inner: st.lists(inner, max_size=3).map(lambda v: f'[{", ".join(v)}]')
    | st.dictionaries(st.sampled_from(KEYS), inner, max_size=4).map(
        lambda v: '{' + ', '.join(f'{key}: {value}' for key, value in v.items()) + '}'
    ),
    max_leaves=8,
)
CONTENTS = st.binary(max_size=60) | st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=4).map(
    lambda v: '\n'.join(f'{key}: {value}' for key, value in v.items()).encode()
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(st.sampled_from(sorted(FILES)), CONTENTS)
def test_any_file_gives_a_catalogue_or_a_sentence(tmp_path, name, data):
    for path in tmp_path.iterdir():
        path.unlink()
    (tmp_path / name).write_bytes(data)
    try:
        hash(Catalogue(tmp_path))
    except DescriptionError as error:
        said = str(error)
        # A valid rig.yaml can contradict the packaged finger, whose field is then named.
        assert name in said or 'contact_bend_deg' in said
        assert '\n' not in said
