# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.descriptions.description import VariationLevels, VariationSpread
from tactile_sim.errors import DescriptionError
from tactile_sim.physics.variation import draw_variation, make_generator, Variation

NAMES = [field.name for field in dataclasses.fields(Variation)]
FACTORS = ('friction', 'object_stiffness', 'finger_stiffness', 'glide_speed')
PACKAGED = default_catalogue()
RIG = PACKAGED.rig()


def with_variation(**levels):
    """Return the packaged catalogue with only the given spreads of trial, mounting or session."""
    fixed = VariationSpread(*[0.0] * 8)
    variation = VariationLevels(**{'trial': fixed, 'mounting': fixed, 'session': fixed, **levels})
    return PACKAGED.with_rig(dataclasses.replace(RIG, variation=variation))


SESSIONS = with_variation(session=RIG.variation.session)
MOUNTINGS = with_variation(mounting=RIG.variation.mounting)


def draw(
    count=1,
    first=0,
    contact='flexion',
    protocol='texture',
    label='R1',
    seed=5,
    session=0,
    per_mounting=1,
    catalogue=PACKAGED,
):
    names = (catalogue, contact, protocol, label)
    return draw_variation(*names, seed, session, count, first, per_mounting)


def rows(variation):
    return np.stack([getattr(variation, name) for name in NAMES])


def test_a_trial_does_not_depend_on_how_many_there_are():
    many, generators = draw(7)
    noise = [generator.standard_normal(3).tolist() for generator in generators]
    for first, count in ((0, 3), (5, 2)):
        part = slice(first, first + count)
        few, fewer = draw(count, first)
        assert np.array_equal(rows(many)[:, part], rows(few))
        assert noise[part] == [generator.standard_normal(3).tolist() for generator in fewer]


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
    ids=str,
)
def test_everything_named_makes_another_trial_and_mounting(change):
    assert draw()[0].phase[0] != draw(**change)[0].phase[0]
    one, other = draw(catalogue=MOUNTINGS)[0], draw(catalogue=MOUNTINGS, **change)[0]
    assert one.placement_m[0] != other.placement_m[0]


def test_no_variation_is_the_description():
    variation = Variation.none(3)
    for name in NAMES:
        assert getattr(variation, name).tolist() == [1.0 if name in FACTORS else 0.0] * 3


def test_trials_of_a_mounting_share_it_however_they_are_cut():
    whole = draw(9, per_mounting=4, catalogue=MOUNTINGS)[0]
    mountings = [set(part) for part in np.split(whole.placement_m, [4, 8])]
    assert [len(part) for part in mountings] == [1, 1, 1]
    assert len(set.union(*mountings)) == 3
    assert len(set(whole.finger_stiffness)) == 1  # mountings do not change the finger
    cut = [draw(n, first, per_mounting=4, catalogue=MOUNTINGS)[0] for first, n in ((0, 3), (3, 6))]
    assert np.array_equal(np.concatenate([rows(part) for part in cut], axis=1), rows(whole))
    once = draw(9, per_mounting=9, catalogue=MOUNTINGS)[0]
    assert once.placement_m.tolist() == [whole.placement_m[0]] * 9
    with pytest.raises(DescriptionError, match='per_mounting'):
        draw(per_mounting=0)


def test_a_session_shares_its_set_up_whatever_lies_under_the_finger():
    def draw_shared(**names):
        # The last row is the phase of the sampling, which differs between trials.
        values = rows(draw(2, catalogue=SESSIONS, **names)[0])[:-1]
        assert np.array_equal(values[:, 0], values[:, 1])
        return values[:, 0]

    shared = draw_shared()
    assert np.array_equal(draw_shared(label='C2'), shared)
    assert np.array_equal(draw_shared(protocol='stiffness', label='sponge'), shared)
    assert (draw_shared(session=1) != shared).all()
    assert (draw_shared(contact='abduction') != shared).all()


@pytest.mark.parametrize(
    ('level', 'per_mounting'), [('trial', 1000), ('mounting', 1)], ids=['trial', 'mounting']
)
def test_spread_within_a_session_is_its_levels(level, per_mounting):
    levels = {'session': RIG.variation.session, level: getattr(RIG.variation, level)}
    variation = draw(1000, per_mounting=per_mounting, catalogue=with_variation(**levels))[0]
    assert 0.0 <= variation.phase.min() < variation.phase.max() < 1.0
    assert variation.phase.std() == pytest.approx(np.sqrt(1 / 12), rel=0.09)
    for name, size in dataclasses.asdict(levels[level]).items():
        if name == 'temperature_k':  # the temperature of a session is constant
            assert np.ptp(variation.sensor_bias_n) == 0.0
            continue
        values = getattr(variation, name)
        # The deviation that all trials of the session have in common is removed.
        deviations = values / values.mean() - 1 if name in FACTORS else values - values.mean()
        assert deviations.std() == pytest.approx(size, rel=0.09, abs=1e-15), name


def test_spread_of_sessions_is_the_sessions():
    drawn = [draw(session=number, catalogue=SESSIONS)[0] for number in range(1000)]
    spread = RIG.variation.session
    finger = PACKAGED.finger('flexion')
    sizes = dataclasses.asdict(spread)
    warmth_k = sizes.pop('temperature_k')
    sizes['sensor_bias_n'] = RIG.load_cell.bias_n_per_k * warmth_k
    sizes['finger_stiffness'] = np.hypot(
        spread.finger_stiffness, finger.stiffness_per_k * warmth_k
    )
    for name, size in sizes.items():
        values = np.array([getattr(variation, name)[0] for variation in drawn])
        middle = 1.0 if name in FACTORS else 0.0
        assert values.mean() == pytest.approx(middle, abs=4 * size / np.sqrt(1000)), name
        assert values.std() == pytest.approx(size, rel=0.09), name
        if name != 'finger_stiffness':  # it also deviates with the temperature
            assert np.abs(values - middle).max() <= 3 * size * (1 + 1e-12)


def test_warmth_softens_the_finger_and_moves_the_sensors_zero():
    warm = VariationSpread(*[0.0] * 7, temperature_k=2.0)
    drawn = draw(5, catalogue=with_variation(trial=warm))[0]
    warmer_k = drawn.sensor_bias_n / RIG.load_cell.bias_n_per_k
    assert len(set(warmer_k)) == 5
    per_k = PACKAGED.finger('flexion').stiffness_per_k
    assert drawn.finger_stiffness == pytest.approx(1 + per_k * warmer_k)


def test_streams_of_names_do_not_meet():
    streams = [(1, 0), (0, 1), (1,), (1, 0, 0), (1 << 32,), (0, '1'), ('1', 0), ('1, 0',), (-1,)]
    first = [make_generator(*names).random() for names in streams]
    assert len(set(first)) == len(first)
    assert make_generator(np.int64(3)).random() == make_generator(3).random()
