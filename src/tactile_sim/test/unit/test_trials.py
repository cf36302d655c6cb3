# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated trials: agreement with the paper, single steps, and mounting of objects."""

import dataclasses

import numpy as np
import pytest
from scenery import ramp, run

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.errors import ConvergenceError, DescriptionError
from tactile_sim.physics import layout as at
from tactile_sim.physics.motion import Move, plan_timeline, Timeline
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.trials import (
    Plant,
    simulate_motion,
    simulate_trials,
    STEPS_PER_SAMPLE,
    TRUSTED_NM,
)
from tactile_sim.physics.variation import draw_variation, Variation
from tactile_sim.rig import PalpationRig, STEP_S

CELL = default_catalogue().rig().load_cell
SHORT = Timeline([Move(0.5, 0.070, 0.015)], [Move(0.1, 0.0054, 0.02)], 1.3)
PRESS = {
    contact: Timeline([], [Move(0.2, pull_m, 0.02), Move(2.0, 0.0, 0.02)], 2.8)
    for contact, pull_m in (('flexion', 0.0049), ('abduction', 0.0074))
}


def test_same_seed_same_bytes_whatever_the_count_and_the_first():
    names = ('texture', 'T1', 'flexion', SHORT)
    many = simulate_trials(*names, 70, 5)  # 70 trials are more than one batch
    assert many.tension_n.shape == (70, len(many.sample_times_s))
    for first, count in ((0, 2), (62, 4)):
        some, part = simulate_trials(*names, count, 5, first=first), slice(first, first + count)
        assert some.tension_n.tobytes() == many.tension_n[part].tobytes()
        for name, values in many.truth.items():
            assert some.truth[name].tobytes() == values[part].tobytes()
    assert len({row.tobytes() for row in many.tension_n}) == 70
    for other in (simulate_trials(*names, 2, 6), simulate_trials(*names, 2, 5, session=1)):
        assert not np.array_equal(other.tension_n, many.tension_n[:2])


def test_samples_come_at_the_cells_rate_and_saturate():
    hard = Timeline([], [Move(0.1, 0.009, 0.02)], 1.0)
    trials = simulate_trials('stiffness', 'pla', 'flexion', hard, 1, 1)
    np.testing.assert_allclose(np.diff(trials.sample_times_s), (1 + 30e-6) / 60, rtol=1e-9)
    assert trials.sample_times_s[0] == 0.0
    assert 1.0 - 1 / 59 < trials.sample_times_s[-1] <= 1.0
    assert trials.truth['tension_n'].max() > 25.0
    assert trials.tension_n.max() == pytest.approx(CELL.capacity_n, abs=CELL.resolution_n)


def test_a_phase_of_the_sampling_is_a_motion_that_is_later_by_it():
    scene = build_scene('texture', 'R3', 'flexion')
    half = dataclasses.replace(Variation.none(), phase=np.array([0.5]))
    lagging = simulate_motion(scene, SHORT, half).truth['bend_rad'][0]

    def delay(moves):
        return [dataclasses.replace(m, start_s=m.start_s + CELL.period_s / 2) for m in moves]

    late = Timeline(delay(SHORT.guide_moves), delay(SHORT.tendon_moves), SHORT.duration_s)
    delayed = simulate_motion(scene, late, Variation.none()).truth['bend_rad'][0]
    prompt = simulate_motion(scene, SHORT, Variation.none()).truth['bend_rad'][0]
    # Sudden changes of the motion lie differently between the steps, so the results differ a bit.
    assert np.abs(lagging - delayed).max() < 2e-4
    assert np.abs(lagging - prompt).max() > 5e-3


def test_drawn_phases_are_cut_to_whole_steps():
    trials = simulate_trials('texture', 'R3', 'flexion', SHORT, 3, 5)
    variation, _ = draw_variation(default_catalogue(), 'flexion', 'texture', 'R3', 5, 0, 3)
    scene = build_scene('texture', 'R3', 'flexion')
    steps = np.floor(variation.phase * STEPS_PER_SAMPLE)
    for more in (0, 1):
        cut = dataclasses.replace(variation, phase=(steps + more) / STEPS_PER_SAMPLE)
        tension_n = simulate_motion(scene, SHORT, cut).truth['tension_n']
        assert np.array_equal(tension_n, trials.truth['tension_n']) == (more == 0)


def test_only_steps_with_inertia_end_unchecked():
    for protocol, label in (('texture', 'R3'), ('stiffness', 'sponge')):
        scene = build_scene(protocol, label, 'flexion')
        usual, solved = (
            simulate_motion(scene, SHORT, Variation.none(), trusted_nm=trusted_nm).sensed_n
            for trusted_nm in (TRUSTED_NM, 0.0)
        )
        assert (usual.tobytes() == solved.tobytes()) == (protocol == 'stiffness')
        np.testing.assert_allclose(usual, solved, rtol=0, atol=0.02)


def test_kept_modes_begin_with_the_bend():
    scene = build_scene('texture', 'F', 'flexion')
    motion = simulate_motion(scene, SHORT, Variation.none(3), keep_modes=True)
    assert motion.truth['modes_rad'].shape == (3, len(motion.sample_times_s), 3)
    assert np.array_equal(motion.truth['modes_rad'][..., 0], motion.truth['bend_rad'])
    assert np.abs(motion.truth['modes_rad'][..., 1]).max() > 1e-2


def test_failed_trials_are_not_numbers_from_there_on():
    scene = build_scene('texture', 'R2', 'flexion')
    surface = scene.surface
    # The second of two trials reaches positions where the height of the surface is NaN.
    table = surface.table.copy()
    table[: round((0.020 - surface.origin_m) / surface.spacing_m)] = np.nan
    spoilt = dataclasses.replace(scene, surface=dataclasses.replace(surface, table=table))
    glide = Timeline([Move(0.5, 0.090, 0.015)], [Move(0.1, 0.0054, 0.02)], 2.0, 0.100)
    variation = dataclasses.replace(Variation.none(2), placement_m=np.array([0.0, -0.017]))
    motion, healthy = (
        simulate_motion(scene, glide, variation, keep_modes=True) for scene in (spoilt, scene)
    )
    assert np.isnan(healthy.failed_at_s).all()
    assert np.isnan(motion.failed_at_s[0])
    failed_s = motion.failed_at_s[1]
    assert 0.5 < failed_s < 1.5
    after = motion.sample_times_s > failed_s
    values = {'sensed_n': motion.sensed_n, **motion.truth}
    sound = {'sensed_n': healthy.sensed_n, **healthy.truth}
    for name, rows in values.items():
        assert np.isnan(rows[1, after]).all()
        assert rows[1, ~after][:-1].tobytes() == sound[name][1, ~after][:-1].tobytes()
        assert rows[0].tobytes() == sound[name][0].tobytes()


@pytest.mark.parametrize('contact', ['flexion', 'abduction'])
def test_softer_objects_give_less_tension_and_all_relax(contact):
    # Largest tension [N] in the paper's Fig. 1.
    limit = {'flexion': 15.0, 'abduction': 3.0}[contact]
    levels, slopes = [], []
    for label in ('pla', 'solid_rubber', 'rubber_shell', 'sponge', 'none'):
        # The friction of all objects is made equal, so that only the stiffness differs.
        scene = dataclasses.replace(build_scene('stiffness', label, contact), friction=0.4)
        motion = simulate_motion(scene, PRESS[contact], Variation.none())
        held = (motion.sample_times_s > 0.9) & (motion.sample_times_s < 1.9)
        tension = motion.truth['tension_n'][0]
        levels.append(tension[held].mean())
        slopes.append(np.polyfit(motion.sample_times_s[held], tension[held], 1)[0])
        assert tension.max() < limit
        assert tension[-1] == pytest.approx(0.0, abs=0.05)
    assert levels == sorted(levels, reverse=True)
    assert max(slopes) < 0.0


def test_the_papers_stiffness_trial():
    """In Fig. 7, the tension on the rubber shell falls from 12.62 N by 0.90 N/s (r = -0.99)."""
    scene = build_scene('stiffness', 'rubber_shell', 'flexion')
    timeline = Timeline([], [Move(0.2, 0.0049, 0.01)], 5.0)
    motion = simulate_motion(scene, timeline, Variation.none())
    held_s = motion.sample_times_s - plan_timeline(scene.rig, timeline)[1].end_s
    held = (held_s >= 0.2) & (held_s <= 4.0)
    tension = motion.sensed_n[0, held]
    slope, intercept = np.polyfit(held_s[held], tension, 1)
    assert slope == pytest.approx(-0.90, abs=0.03)
    assert intercept == pytest.approx(12.62, abs=0.15)
    assert np.corrcoef(held_s[held], tension)[0, 1] == pytest.approx(-0.99, abs=0.005)


def test_the_free_finger_bends_as_in_the_papers_figure_1():
    scene = build_scene('stiffness', 'none', 'flexion')
    # All pulls are simulated at once, as trials whose zero of the tendon differs.
    pulls_m = np.linspace(0.0, 0.016, 33)
    variation = dataclasses.replace(Variation.none(33), tendon_zero_m=-pulls_m)
    inputs = scene.compute_inputs(np.zeros(1), np.array([0.06]))[0]
    state = scene.start_trials(variation, inputs)
    pulled_n, bends_deg = state[at.TENSION], np.degrees(state[at.MODES])
    assert np.all(np.diff(pulled_n) >= 0)
    for tension_n, bend_deg, within_deg in ((0.0, 4.0, 4.0), (5.0, 40.0, 6.0), (15.0, 115.0, 3.0)):
        found_deg = np.interp(tension_n, pulled_n, bends_deg)
        assert found_deg == pytest.approx(bend_deg, abs=within_deg)


def test_without_a_filter_the_cell_gets_tension_and_crosstalk():
    scene = build_scene('texture', 'R2', 'flexion')
    cell = dataclasses.replace(CELL, low_pass_hz=1e5)
    rig = dataclasses.replace(scene.rig, load_cell=cell)
    motion = simulate_motion(dataclasses.replace(scene, rig=rig), SHORT, Variation.none())
    force = motion.truth['contact_force_n'][0]
    expected = motion.truth['tension_n'][0] + CELL.crosstalk * force
    assert force.max() > 0.5
    np.testing.assert_allclose(motion.sensed_n[0], expected, atol=1e-3)
    filtered = simulate_motion(scene, SHORT, Variation.none())
    assert np.abs(filtered.sensed_n[0] - expected).max() > 0.05
    assert filtered.truth['tension_n'].tobytes() == motion.truth['tension_n'].tobytes()


@pytest.mark.parametrize(
    ('timeline', 'sentence'),
    [
        (Timeline([Move(0, 0.1, 0.01), Move(1, 0.06, 0.01)], [], 9), ''),
        (Timeline([Move(0, 0.3, 0.01)], [], 9), 'guide|tendon'),
        (Timeline([Move(0, 0.1, 0.5)], [], 9), 'limit'),
        (Timeline([], [Move(0, 0.01, 0.5)], 9), 'limit'),
        (Timeline([], [], 0), 'duration_s'),
        (Timeline([], [], 9, guide_start_m=-1), 'guide_start_m'),
        (Timeline([], [], float('nan')), 'duration_s'),
        (Timeline([Move(0, float('nan'), 0.01)], [], 9), 'guide|tendon'),
        (Timeline([], [Move(float('nan'), 0.005, 0.01)], 9), ''),
    ],
)
def test_impossible_timelines_are_refused(timeline, sentence):
    with pytest.raises(DescriptionError, match=sentence):
        simulate_trials('texture', 'F', 'flexion', timeline, 1, 1)


@pytest.mark.parametrize(
    'wrong', [{'count': 0}, {'seed': -1}, {'first': -1}, {'session': -1}], ids=str
)
def test_impossible_numbers_of_trials_are_refused(wrong):
    with pytest.raises(DescriptionError, match=next(iter(wrong))):
        simulate_trials('texture', 'F', 'flexion', SHORT, **{'count': 1, 'seed': 1, **wrong})


def test_impossible_trials_are_refused():
    for names in (
        ('stiffness', 'R1', 'flexion'),
        ('smell', 'F', 'flexion'),
        ('texture', 'F', 'x'),
    ):
        with pytest.raises(DescriptionError):
            simulate_trials(*names, SHORT, 1, 1)


# -- one trial as its devices move -----------------------------------------------------------

TIMES_S = STEP_S * np.arange(801)
TENDON_M = ramp(TIMES_S, 0.05, 0.0, 0.0054, 0.02)
GUIDE_M = 0.060 + ramp(TIMES_S, 0.5, 0.0, 1.0, 0.015)


def make_plant(protocol='texture', label='R2', tendon_m=0.0):
    scene = build_scene(protocol, label, 'flexion')
    return Plant(scene, Variation.none(), 0.060, tendon_m, STEP_S)


def test_live_steps_are_those_of_a_run_by_euler():
    """A single step of `Plant` is an implicit Euler step, which does not use the last change."""
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
    # The finger is already at rest, so further steps hardly change its bend.
    for _ in range(20):
        plant.step(0.060, 0.0004)
    assert plant.bend_rad == pytest.approx(fresh.bend_rad, abs=1e-5)


@pytest.mark.parametrize('where', [(np.nan, 0.001), (0.060, np.nan)])
def test_a_step_without_balance_raises(where):
    plant = make_plant('texture', 'F')
    plant.step(0.060, 0.001)
    with pytest.raises(ConvergenceError):
        plant.step(*where)


def test_the_rig_refuses_what_it_cannot_do():
    rig = PalpationRig(seed=1, variation=Variation.none())
    with pytest.raises(DescriptionError, match='sponge'):
        rig.mount('texture', 'sponge', 'flexion')
    assert rig.read_truth()['mount']['object'] == 'none'


def test_mounting_draws_the_next_trials_variation():
    """Two mountings of a plate differ, but another rig draws the same two mountings."""
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
