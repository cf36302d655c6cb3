# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest

from tactile_sim.errors import DescriptionError
from tactile_sim.fast_trials import (
    STEP_S,
    Move,
    Timeline,
    simulate_motion,
    simulate_trials,
)
from tactile_sim.plant import Variation

SHORT = Timeline([Move(0.9, 0.090, 0.015)], [Move(0.1, 0.0054, 0.01)], 2.5)
PRESS = {
    contact: Timeline([], [Move(0.2, pull_m, 0.02), Move(4.0, 0.0, 0.02)], 4.8)
    for contact, pull_m in (('flexion', 0.0060), ('abduction', 0.0075))
}


def test_same_seed_same_bytes_whatever_the_batch():
    many = simulate_trials('texture', 'T1', 'flexion', SHORT, 9, 5)
    few = simulate_trials('texture', 'T1', 'flexion', SHORT, 2, 5)
    assert many.tension_n.shape == (9, len(many.sample_times_s))
    assert few.tension_n.tobytes() == many.tension_n[:2].tobytes()
    for name in many.truth:
        assert few.truth[name].tobytes() == many.truth[name][:2].tobytes()
    other = simulate_trials('texture', 'T1', 'flexion', SHORT, 2, 6)
    assert not np.array_equal(other.tension_n, few.tension_n)
    assert not np.array_equal(many.tension_n[0], many.tension_n[1])


@pytest.mark.parametrize(('plate', 'contact'), [('R3', 'flexion'), ('T1', 'abduction')])
def test_step_is_fine_enough(plate, contact):
    pull_m = {'flexion': 0.0054, 'abduction': 0.0075}[contact]
    timeline = Timeline([Move(0.6, 0.085, 0.015)], [Move(0.1, pull_m, 0.02)], 1.3, 0.070)
    times, coarse = simulate_motion('texture', plate, contact, timeline, Variation.none())
    _, fine = simulate_motion('texture', plate, contact, timeline, Variation.none(), STEP_S / 10)
    gliding = times > 0.8
    ripple = fine['tension_n'][0][gliding]
    difference = coarse['tension_n'][0][gliding] - ripple
    assert ripple.std() > 0.005
    assert np.sqrt(np.mean(difference**2)) < 0.02 * ripple.std()


def test_readings_are_noisy_quantised_and_limited():
    trials = simulate_trials('texture', 'F', 'flexion', SHORT, 3, 1)
    counts = trials.tension_n / 9.80665 / 1e-5
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    noise = trials.tension_n - trials.truth['tension_n']
    assert noise.std() == pytest.approx(0.004, rel=0.2)
    hard = Timeline([], [Move(0.1, 0.009, 0.02)], 1.0)
    pressed = simulate_trials('stiffness', 'pla', 'flexion', hard, 1, 1)
    assert pressed.truth['tension_n'].max() > 25.0
    assert pressed.tension_n.max() == pytest.approx(19.6133, abs=1e-4)


def test_samples_come_at_the_cells_rate():
    trials = simulate_trials('stiffness', 'none', 'abduction', PRESS['abduction'], 1, 1)
    period_s = np.diff(trials.sample_times_s)
    np.testing.assert_allclose(period_s, (1 + 30e-6) / 60, rtol=1e-9)
    assert trials.sample_times_s[0] == 0.0
    assert trials.sample_times_s[-1] <= 4.8


@pytest.mark.parametrize('contact', ['flexion', 'abduction'])
def test_softer_objects_give_less_tension_and_all_relax(contact):
    limit = {'flexion': 15.0, 'abduction': 3.0}[contact]
    peaks, slopes = [], []
    for label in ('pla', 'solid_rubber', 'rubber_shell', 'sponge', 'none'):
        times, truth = simulate_motion(
            'stiffness', label, contact, PRESS[contact], Variation.none(), 1e-3
        )
        held = (times > 1.0) & (times < 3.9)
        tension = truth['tension_n'][0]
        peaks.append(tension[held].mean())
        slopes.append(np.polyfit(times[held], tension[held], 1)[0])
        assert tension.max() < limit
        assert tension[-1] < 0.05
    assert peaks == sorted(peaks, reverse=True)
    assert max(slopes) < 0.0
    if contact == 'flexion':
        assert min(slopes) < -0.3


@pytest.mark.parametrize(
    ('timeline', 'sentence'),
    [
        (Timeline([Move(0, 0.1, 0.01), Move(1, 0.06, 0.01)], [], 9), 'starts before'),
        (Timeline([Move(0, 0.3, 0.01)], [], 9), 'cannot go'),
        (Timeline([Move(0, 0.1, 0.5)], [], 9), 'limit'),
        (Timeline([], [Move(0, 0.01, 0.5)], 9), 'limit'),
        (Timeline([], [], 0), 'duration_s'),
        (Timeline([], [], 9, guide_start_m=-1), 'guide_start_m'),
    ],
)
def test_impossible_timelines_are_refused(timeline, sentence):
    with pytest.raises(DescriptionError, match=sentence):
        simulate_trials('texture', 'F', 'flexion', timeline, 1, 1)


def test_impossible_trials_are_refused():
    for wrong in (
        ('texture', 'sponge', 'flexion'),
        ('stiffness', 'R1', 'flexion'),
        ('smell', 'F', 'flexion'),
        ('texture', 'F', 'extension'),
    ):
        with pytest.raises(DescriptionError):
            simulate_trials(*wrong, SHORT, 1, 1)
    with pytest.raises(DescriptionError, match='count'):
        simulate_trials('texture', 'F', 'flexion', SHORT, 0, 1)
