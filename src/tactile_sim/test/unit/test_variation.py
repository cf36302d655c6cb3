# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue
from tactile_sim.errors import DescriptionError
from tactile_sim.physics.variation import draw_variation, make_generator, Variation

NAMES = [field.name for field in dataclasses.fields(Variation)]
FACTORS = ('friction', 'object_stiffness', 'finger_stiffness', 'glide_speed')


def draw(
    count,
    first=0,
    contact='flexion',
    protocol='texture',
    label='R1',
    seed=5,
    session=0,
    per_mounting=1,
    catalogue=None,
):
    catalogue = catalogue or default_catalogue()
    return draw_variation(
        catalogue, contact, protocol, label, seed, session, count, first, per_mounting
    )


def rows(variation):
    return np.stack([getattr(variation, name) for name in NAMES])


def divide_levels(values, name):
    """Deviation of each trial from the one that all of its session share."""
    return values / values.mean() - 1 if name in FACTORS else values - values.mean()


def test_a_trial_does_not_depend_on_how_many_there_are():
    many, generators = draw(7)
    few, fewer = draw(3)
    assert np.array_equal(rows(many)[:, :3], rows(few))
    later, latest = draw(2, first=5)
    assert np.array_equal(rows(many)[:, 5:], rows(later))
    noise = [generator.standard_normal(3).tolist() for generator in generators]
    assert noise[:3] == [generator.standard_normal(3).tolist() for generator in fewer]
    assert noise[5:] == [generator.standard_normal(3).tolist() for generator in latest]


@pytest.mark.parametrize(
    'change',
    [
        {'seed': 6},
        {'session': 1},
        {'contact': 'abduction'},
        {'protocol': 'stiffness'},
        {'label': 'R2'},
        {'first': 1},
    ],
)
def test_everything_named_makes_another_trial(change):
    assert draw(1)[0].phase[0] != draw(1, **change)[0].phase[0]


def test_no_variation_is_the_description():
    variation = Variation.none(3)
    for name in NAMES:
        assert getattr(variation, name).tolist() == [1.0 if name in FACTORS else 0.0] * 3


def lay_over_variation(tmp_path, text):
    (tmp_path / 'rig.yaml').write_text(f'variation: {text}\n')
    return Catalogue(tmp_path)


NONE = (
    '{contact_height_m: 0, placement_m: 0, friction: 0, object_stiffness: 0, '
    'finger_stiffness: 0, glide_speed: 0, tendon_zero_m: 0, temperature_k: 0}'
)
SESSIONS_ONLY = f'{{trial: {NONE}, mounting: {NONE}}}'
MOUNTINGS_ONLY = f'{{trial: {NONE}, session: {NONE}}}'


def test_trials_of_a_mounting_share_it_however_they_are_cut(tmp_path):
    catalogue = lay_over_variation(tmp_path, MOUNTINGS_ONLY)
    whole = draw(9, per_mounting=4, catalogue=catalogue)[0]
    for name, shared in (('placement_m', True), ('finger_stiffness', False)):
        values = getattr(whole, name)
        assert len(set(values[:4])) == len(set(values[4:8])) == 1
        assert len(set(values)) == (3 if shared else 1)
    parts = [
        draw(count, first, per_mounting=4, catalogue=catalogue)[0]
        for first, count in ((0, 3), (3, 6))
    ]
    assert np.array_equal(np.concatenate([rows(part) for part in parts], axis=1), rows(whole))
    once = draw(9, per_mounting=9, catalogue=catalogue)[0]
    assert once.placement_m.tolist() == [whole.placement_m[0]] * 9
    for change in ({'label': 'R2'}, {'session': 1}, {'protocol': 'stiffness'}, {'seed': 6}):
        other = draw(1, per_mounting=4, catalogue=catalogue, **change)[0]
        assert other.placement_m[0] != whole.placement_m[0]
    with pytest.raises(DescriptionError, match='at least 1'):
        draw(1, per_mounting=0)


def test_a_session_shares_its_set_up_whatever_lies_under_the_finger(tmp_path):
    catalogue = lay_over_variation(tmp_path, SESSIONS_ONLY)

    def draw_shared(protocol, label, session, contact='flexion'):
        drawn = draw_variation(catalogue, contact, protocol, label, 5, session, 2)[0]
        values = {name: set(getattr(drawn, name).tolist()) for name in NAMES if name != 'phase'}
        assert all(len(value) == 1 for value in values.values())
        return values

    shared = draw_shared('texture', 'R1', 0)
    assert draw_shared('texture', 'C2', 0) == shared
    assert draw_shared('stiffness', 'sponge', 0) == shared
    other, turned = draw_shared('texture', 'R1', 1), draw_shared('texture', 'R1', 0, 'abduction')
    for name, value in shared.items():
        assert other[name] != value
        assert turned[name] != value


@pytest.mark.parametrize(
    ('level', 'per_mounting'), [('trial', 1000), ('mounting', 1)], ids=['trial', 'mounting']
)
def test_spread_within_a_session_is_its_levels(tmp_path, level, per_mounting):
    catalogue = lay_over_variation(tmp_path, f'{{trial: {NONE}}}') if level == 'mounting' else None
    variation = draw(1000, per_mounting=per_mounting, catalogue=catalogue)[0]
    spread = getattr(default_catalogue().rig().variation, level)
    for name in NAMES:
        deviations = divide_levels(getattr(variation, name), name)
        if name == 'phase':
            assert variation.phase.min() >= 0.0
            assert variation.phase.max() < 1.0
            assert deviations.std() == pytest.approx(np.sqrt(1 / 12), rel=0.09)
        elif name == 'sensor_bias_n':  # the packaged temperature keeps still within a session
            assert np.ptp(deviations) == 0.0
        elif getattr(spread, name) == 0.0:
            assert np.ptp(deviations) == pytest.approx(0.0, abs=1e-15)
        else:
            assert deviations.std() == pytest.approx(getattr(spread, name), rel=0.09), name


def test_spread_of_sessions_is_the_sessions(tmp_path):
    catalogue = lay_over_variation(tmp_path, SESSIONS_ONLY)
    drawn = [draw_variation(catalogue, 'flexion', 'texture', 'F', 1, s, 1)[0] for s in range(1000)]
    spread = catalogue.rig().variation.session
    finger, cell = catalogue.finger('flexion'), catalogue.rig().load_cell
    wanted = {name: getattr(spread, name, None) for name in NAMES if name != 'phase'}
    wanted['sensor_bias_n'] = cell.bias_n_per_k * spread.temperature_k
    wanted['finger_stiffness'] = np.hypot(
        spread.finger_stiffness, finger.stiffness_per_k * spread.temperature_k
    )
    for name, size in wanted.items():
        values = np.array([getattr(variation, name)[0] for variation in drawn])
        middle = 1.0 if name in FACTORS else 0.0
        assert values.mean() == pytest.approx(middle, abs=4 * size / np.sqrt(1000)), name
        assert values.std() == pytest.approx(size, rel=0.09), name
        if name != 'finger_stiffness':  # a product of two
            assert np.abs(values - middle).max() <= 3 * size * (1 + 1e-12)


def test_warmth_softens_the_finger_and_moves_the_sensors_zero(tmp_path):
    (tmp_path / 'rig.yaml').write_text(
        'variation: {session: {temperature_k: 2, finger_stiffness: 0}}\n'
    )
    catalogue = Catalogue(tmp_path)
    bias = catalogue.rig().load_cell.bias_n_per_k
    for session in range(5):
        drawn = draw_variation(catalogue, 'flexion', 'texture', 'F', 1, session, 1)[0]
        warmer_k = drawn.sensor_bias_n / bias
        per_k = catalogue.finger('flexion').stiffness_per_k
        assert drawn.finger_stiffness == pytest.approx(1 + per_k * warmer_k)


def test_streams_of_names_do_not_meet():
    streams = [(1, 0), (0, 1), (1,), (1, 0, 0), (1 << 32,), (0, '1'), ('1', 0), ('1, 0',), (-1,)]
    first = [make_generator(*names).random() for names in streams]
    assert len(set(first)) == len(first)
    assert make_generator(np.int64(3)).random() == make_generator(3).random()
