# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulator of texture trials: speed against error, by scheme and step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.measuring import Ratio, Report, Row
from benchmarks.simulator.trials import (
    compare,
    CONTACTS,
    draw_trials,
    FloatArray,
    name_choice,
    PLATES,
    remove_line,
    remove_mean,
    time_in_turns,
    TrialSet,
)
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_sim.physics.fast_trials import STEPS_PER_SAMPLE, TRUSTED_NM
from tactile_sim.physics.finger.steps import BDF2, EULER, Scheme

STEPS = (4, 6, 8, 10, 12, 16, 20, 24, 40)
REFERENCE_STEPS = 160
BOUND_PERCENT = 2.5
"""Of what the sensor gets, which is what leaves the simulator; the tension stands beside it."""


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of all trials, shape (trials, samples): tension and what the sensor gets [N]."""

    tension_n: FloatArray
    sensed_n: FloatArray


@dataclass(frozen=True, eq=False)
class Errors:
    """Deviations from a reference, shape (trials,) [%].

    Attributes
    ----------
    tension_percent, sensed_percent
        Of the tension and of what the sensor gets, without their straight lines.
    mean_only_percent
        Of the tension without its mean.
    spectrum_percent
        Of the amplitudes of what the sensor gets.
    """

    tension_percent: FloatArray
    sensed_percent: FloatArray
    mean_only_percent: FloatArray
    spectrum_percent: FloatArray


@dataclass(frozen=True)
class Choice:
    """What a scheme with so many steps a sample costs, and how far off it is.

    Attributes
    ----------
    trial_s
        Time per trial, best of the rounds [s of one core].
    ratio
        Time over that of the default.
    """

    scheme: Scheme
    steps: int
    trial_s: float
    ratio: Ratio
    errors: Errors


def draw_texture_sets(count: int) -> list[TrialSet]:
    """So many trials on every plate with every contact."""
    return [
        draw_trials('texture', plate, contact, count) for plate in PLATES for contact in CONTACTS
    ]


def simulate_windows(
    sets: list[TrialSet], scheme: Scheme, steps: int, trusted_nm: float = TRUSTED_NM
) -> Windows:
    """Simulate all sets and keep their windows."""
    tension, sensed = [], []
    for trials in sets:
        motion = trials.simulate(scheme, steps, trusted_nm=trusted_nm)
        if np.isfinite(motion.failed_at_s).any():
            raise RuntimeError(f'a texture trial failed with {scheme.name}, {steps} steps')
        tension.append(motion.truth['tension_n'][:, trials.window])
        sensed.append(motion.sensed_n[:, trials.window])
    return Windows(np.concatenate(tension), np.concatenate(sensed))


def measure_choices(quick: bool) -> list[Choice]:
    """Measure every scheme with every number of steps."""
    sets = draw_texture_sets(32 if quick else 64)
    timed = draw_texture_sets(16) if quick else sets
    count = sum(len(trials.variation.phase) for trials in timed)
    reference = simulate_windows(sets, BDF2, REFERENCE_STEPS)
    pairs = [(scheme, steps) for scheme in (EULER, BDF2) for steps in STEPS]
    works = [partial(_simulate_all, timed, scheme, steps) for scheme, steps in pairs]
    times_s = time_in_turns(works, 3 if quick else 9)
    ratios = times_s / times_s[pairs.index((BDF2, STEPS_PER_SAMPLE))]
    choices = []
    for index, (scheme, steps) in enumerate(pairs):
        low, median, high = np.quantile(ratios[index], (0.25, 0.5, 0.75)).tolist()
        errors = compare_windows(simulate_windows(sets, scheme, steps), reference)
        trial_s = float(times_s[index].min()) / count
        choices.append(Choice(scheme, steps, trial_s, Ratio(median, low, high), errors))
    return choices


def _simulate_all(
    sets: list[TrialSet], scheme: Scheme, steps: int, trusted_nm: float = TRUSTED_NM
) -> None:
    for trials in sets:
        trials.simulate(scheme, steps, trusted_nm=trusted_nm)


def compare_windows(ours: Windows, reference: Windows) -> Errors:
    """Compare window by window."""
    return Errors(
        compare(remove_line(ours.tension_n), remove_line(reference.tension_n)),
        compare(remove_line(ours.sensed_n), remove_line(reference.sensed_n)),
        compare(remove_mean(ours.tension_n), remove_mean(reference.tension_n)),
        compare(compute_spectrum(ours.sensed_n), compute_spectrum(reference.sensed_n)),
    )


def run_simulator(quick: bool) -> Report:
    """Vary scheme and step on drawn texture trials."""
    rows = []
    for choice in measure_choices(quick):
        is_default = choice.scheme == BDF2 and choice.steps == STEPS_PER_SAMPLE
        rows.append(
            Row(
                name_choice(choice.scheme, choice.steps),
                choice.ratio,
                float(np.quantile(choice.errors.sensed_percent, 0.95)),
                BOUND_PERCENT if is_default else None,
                more={'trials/s': 1 / choice.trial_s, **_name_errors(choice.errors)},
            )
        )
    rows += [_measure_solved(quick), _measure_reference(quick)]
    return Report(
        f'simulator: texture trials on {", ".join(PLATES)}, flexion and abduction; errors in %',
        f'the default, {BDF2.name} with {STEPS_PER_SAMPLE} steps a sample',
        f'rms deviation from {name_choice(BDF2, REFERENCE_STEPS)}, over the rms, in the 180 '
        'samples without their straight line: of the tension, and of what the sensor gets (error: '
        'its 95th percentile over the trials); line in: of the tension with its line; '
        'spectrum: of the 91 amplitudes of what the sensor gets; each step solved: how far '
        'the default is from it',
        rows,
    )


def _measure_solved(quick: bool) -> Row:
    """The default's steps, each solved to the tolerance."""
    sets, pair = draw_texture_sets(16 if quick else 64), (BDF2, STEPS_PER_SAMPLE)
    count = sum(len(trials.variation.phase) for trials in sets)
    works = [partial(_simulate_all, sets, *pair, trusted) for trusted in (TRUSTED_NM, 0.0)]
    times_s = time_in_turns(works, 3 if quick else 9)
    low, median, high = np.quantile(times_s[1] / times_s[0], (0.25, 0.5, 0.75)).tolist()
    errors = compare_windows(simulate_windows(sets, *pair), simulate_windows(sets, *pair, 0.0))
    return Row(
        f'{BDF2.name} {STEPS_PER_SAMPLE}, each step solved',
        Ratio(median, low, high),
        float(np.quantile(errors.sensed_percent, 0.95)),
        more={'trials/s': count / float(times_s[1].min()), **_name_errors(errors)},
    )


def _measure_reference(quick: bool) -> Row:
    """The reference against one of half its step: what is left of its own error."""
    sets = draw_texture_sets(8 if quick else 32)
    finer = simulate_windows(sets, BDF2, 2 * REFERENCE_STEPS)
    errors = compare_windows(simulate_windows(sets, BDF2, REFERENCE_STEPS), finer)
    return Row(
        f'{name_choice(BDF2, REFERENCE_STEPS)} against {2 * REFERENCE_STEPS}',
        error=float(np.quantile(errors.sensed_percent, 0.95)),
        more=_name_errors(errors),
    )


def _name_errors(errors: Errors) -> dict[str, float]:
    tension, sensed = errors.tension_percent, errors.sensed_percent
    return {
        'tension p50': float(np.median(tension)),
        'tension p95': float(np.quantile(tension, 0.95)),
        'line in p95': float(np.quantile(errors.mean_only_percent, 0.95)),
        'spectrum p95': float(np.quantile(errors.spectrum_percent, 0.95)),
        'sensed p50': float(np.median(sensed)),
    }
