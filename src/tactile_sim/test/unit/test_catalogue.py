# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import os
import pickle

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest

from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue, list_objects
from tactile_sim.descriptions.description import Body, CONTACTS, Finger, HeldObject, Plate, Rig
from tactile_sim.errors import DescriptionError

FILES = {
    'finger_abduction.yaml': Finger,
    'finger_flexion.yaml': Finger,
    'rig.yaml': Rig,
    'plates.yaml': Plate,
    'objects.yaml': Body,
    'held_objects.yaml': HeldObject,
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
    assert list_objects('slip') == ('rough', 'smooth', 'cylinder')
    for label in list_objects('texture'):
        assert catalogue.plate(label).length_m == pytest.approx(0.070)
    stiffness = [catalogue.body(label).stiffness_n_m for label in list_objects('stiffness')]
    assert stiffness == sorted(stiffness, reverse=True)
    assert catalogue.held_object('cylinder').motion == 'roll'
    # The same pull moves all three.
    drives = {catalogue.held_object(label).drive_stiffness_n_m for label in list_objects('slip')}
    assert len(drives) == 1
    for contact in CONTACTS:
        finger = catalogue.finger(contact)
        shear = finger.tip_shear_stiffness_n_m / finger.tip_stiffness_n_m
        assert shear == pytest.approx(2 / 3, rel=1e-3)


def test_unknown_names_are_refused():
    catalogue = default_catalogue()
    for find in (catalogue.finger, catalogue.plate, catalogue.body, catalogue.held_object):
        with pytest.raises(DescriptionError, match="'wood'"):
            find('wood')
    with pytest.raises(DescriptionError, match='there are rough, smooth, cylinder'):
        catalogue.held_object('rough ')
    for labels in (catalogue.labels, list_objects):
        with pytest.raises(DescriptionError, match="protocol is 'wood'; it must be one of"):
            labels('wood')


def test_an_empty_folder_changes_nothing(tmp_path):
    (tmp_path / '.notes').write_text('not looked at')
    assert Catalogue(tmp_path) == default_catalogue()


def test_a_users_files_are_laid_over_by_key_and_label(tmp_path):
    catalogue = lay_over(
        tmp_path,
        plates=f'mine: {OWN_PLATE}\nR1: {OWN_PLATE}',
        objects='jelly: {stiffness_n_m: 5e1, branches: [], softening_m: 0, friction: 0.5}',
        finger_flexion='# mine is longer\nlength_m: 0.09',
        rig='load_cell: {noise_n: 0}\nvariation: {session: {friction: 0}}',
    )
    packaged = default_catalogue()
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


def test_a_catalogue_travels_without_its_files(tmp_path):
    catalogue = lay_over(tmp_path, plates=f'mine: {OWN_PLATE}')
    data = pickle.dumps(catalogue)
    (tmp_path / 'plates.yaml').unlink()
    there = pickle.loads(data)
    assert there == catalogue
    assert hash(there) == hash(catalogue)
    assert there.plate('mine').groove == 'profile'
    assert len(data) < 20000


@pytest.mark.parametrize(
    ('name', 'text', 'sentence'),
    [
        ('plates', 'mine: 3', 'plates.yaml: mine must be a mapping'),
        ('plates', 'mine: {groove: none}', 'plates.yaml: mine: end_mm is missing'),
        (
            'plates',
            'mine: {groove: triangular, pitch_mm: 2, width_mm: 3, depth_mm: 1, end_mm: 10, '
            'grooved_mm: 50, friction: 0.4}',
            'plates.yaml: mine: width_mm is 3, pitch_mm 2 .* a width is .* at most the pitch',
        ),
        ('plates', f'my plate: {OWN_PLATE}', "plates.yaml: the label 'my plate' must be 1 to 64"),
        ('plates', f'"": {OWN_PLATE}', "the label '' must be"),
        ('plates', f'../x: {OWN_PLATE}', "the label '../x' must be"),
        ('plates', f'"x\\n": {OWN_PLATE}', 'the label .* must be'),
        ('objects', 'jelly: {stiffness_n_m: .nan}', 'branches is missing'),
        ('held_objects', 'held: {motion: roll}', 'held_objects.yaml: held: body is missing'),
        ('finger_flexion', 'moment_arm_m: 0.2', r'finger_flexion.yaml.moment_arm_m is 0\.2'),
        ('finger_flexion', 'mass_kg: 2', 'hangs lower than its contact_bend_deg'),
        ('finger_flexion', 'moment_arm_m: 1e-3', 'needs .* N for its contact_bend_deg'),
        ('finger_flexion', 'stiffness_per_k: 0.05\ncolour: red', "'colour' is unknown"),
        ('rig', 'load_cell: 3', 'rig.yaml.load_cell must be a mapping'),
        ('rig', 'load_cell: {capacity_n: 2}', 'load_cell.capacity_n is 2; lower'),
        ('rig', 'variation: {session: {temperature_k: 20}, trial: {temperature_k: 12}}', '96 K'),
        ('rig', '', 'rig.yaml must be a mapping'),
    ],
)
def test_nonsense_is_refused_by_file_label_and_key(tmp_path, name, text, sentence):
    with pytest.raises(DescriptionError, match=sentence) as caught:
        lay_over(tmp_path, **{name: text})
    assert str(caught.value).count('\n') == 0


def test_unusable_folders_and_files_are_refused(tmp_path):
    with pytest.raises(DescriptionError, match='No such file or directory; name a folder with'):
        Catalogue(tmp_path / 'nowhere')
    plain = tmp_path / 'plain'
    plain.write_text('')
    with pytest.raises(DescriptionError, match='Not a directory'):
        Catalogue(plain)
    with pytest.raises(DescriptionError, match=r"has 'plain', which is no .* finger_abduction"):
        Catalogue(tmp_path)
    plain.unlink()
    (tmp_path / 'plates.yml').write_text('')
    with pytest.raises(DescriptionError, match=r"has 'plates\.yml', which is no description"):
        Catalogue(tmp_path)


def test_unreadable_files_are_refused(tmp_path):
    plates = tmp_path / 'plates.yaml'
    plates.write_text('#' * (1 << 20) + 'x: 1')
    with pytest.raises(DescriptionError, match=r'plates\.yaml is larger than 1 MiB'):
        Catalogue(tmp_path)
    plates.write_bytes(b'a: \xff')
    with pytest.raises(DescriptionError, match=r'plates\.yaml is no text in UTF-8'):
        Catalogue(tmp_path)
    plates.unlink()
    os.mkfifo(plates)  # nobody writes: reading it would wait for ever
    with pytest.raises(DescriptionError, match=r'plates\.yaml is no file'):
        Catalogue(tmp_path)
    plates.unlink()
    plates.mkdir()
    with pytest.raises(DescriptionError, match=r'plates\.yaml is no file'):
        Catalogue(tmp_path)


def test_endlessly_many_labels_are_refused(tmp_path):
    with pytest.raises(DescriptionError, match='has 1001 labels'):
        lay_over(tmp_path, plates=''.join(f'x{i}: 1\n' for i in range(1001)))


KEYS = sorted(
    {field.name for kind in FILES.values() for field in dataclasses.fields(kind)}
    | {'F', 'rough', 'noise_n', 'trial', 'relaxation_time_s', 'mine'}
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


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(
    st.sampled_from(sorted(FILES)),
    st.text(max_size=60).map(lambda text: text.encode('utf-8', 'surrogatepass'))
    | st.binary(max_size=60)
    | st.dictionaries(st.sampled_from(KEYS), VALUES, max_size=4).map(
        lambda v: '\n'.join(f'{key}: {value}' for key, value in v.items()).encode()
    ),
)
def test_any_file_gives_a_catalogue_or_a_sentence(tmp_path, name, data):
    for path in tmp_path.iterdir():
        path.unlink()
    (tmp_path / name).write_bytes(data)
    try:
        assert hash(Catalogue(tmp_path)) is not None
        said = name
    except DescriptionError as error:
        said = str(error)
    # A rig that does not fit the packaged finger is refused under the finger's name.
    assert name in said or 'contact_bend_deg' in said
    assert '\n' not in said


def test_digest_is_that_of_the_descriptions_wherever_they_were_read(tmp_path):
    assert Catalogue(tmp_path).digest == default_catalogue().digest
    (tmp_path / 'finger_flexion.yaml').write_text('tip_radius_m: 0.0051\n')
    assert Catalogue(tmp_path).digest != default_catalogue().digest
