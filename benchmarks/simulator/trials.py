# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Functions for benchmarks of the simulator: random trials, their windows, and their errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from dataclasses import dataclass
from functools import lru_cache
import time

import numpy as np
from numpy.typing import NDArray

from tactile_bringup.trial_protocols import TrialConfig, TrialRequest
from tactile_features.config import FeatureConfig
from tactile_lab.simulation.simulated_trials import plan_trial, TrialSchedule
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.motion import Timeline
from tactile_sim.physics.scene import build_scene, Scene
from tactile_sim.physics.trials import simulate_motion, SimulatedMotion, STEPS_PER_SAMPLE
from tactile_sim.physics.variation import draw_variation, Variation

FloatArray = NDArray[np.float64]

PLATES = ('R1', 'R3', 'T1', 'C2')
CONTACTS = ('flexion', 'abduction')
SEED = 1
_SESSION_TRIALS = 8  # several sessions, to include their variation


@dataclass(frozen=True, eq=False)
class DrawnTrials:
    """Random trials on one plate or object, planned like `tactile simulate`.

    ``window`` is the range of samples used for features.
    """

    scene: Scene
    planned: TrialSchedule
    variation: Variation
    window: slice

    def simulate(self, steps: int) -> SimulatedMotion:
        """Simulate all trials with ``steps`` steps per sample."""
        return simulate_motion(self.scene, self.planned.timeline, self.variation, steps)


@lru_cache
def draw_trials(protocol: str, label: str, contact: str, count: int) -> DrawnTrials:
    """Draw random trials of several sessions.

    The samples of a trial are shifted by 0 or half a sample period. Therefore each sample
    coincides with the end of a step for any even number of steps per sample, as in
    `simulate_trials`.
    """
    parts = []
    for session in range(-(-count // _SESSION_TRIALS)):
        some = min(_SESSION_TRIALS, count - session * _SESSION_TRIALS)
        catalogue = default_catalogue()
        parts.append(draw_variation(catalogue, contact, protocol, label, SEED, session, some)[0])
    names = [item.name for item in dataclasses.fields(Variation)]
    drawn = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    drawn['phase'] = np.floor(2 * drawn['phase']) / 2
    planned = plan_trial(TrialConfig(), TrialRequest(protocol, contact))
    scene = build_scene(protocol, label, contact)
    return DrawnTrials(scene, planned, Variation(**drawn), find_window(protocol, planned))


def find_window(protocol: str, planned: TrialSchedule) -> slice:
    """Return the range of samples, within the glide or the hold, that is used for features."""
    config, phases = FeatureConfig(), dict(planned.phases)
    if protocol == 'texture':
        first = int(np.ceil((phases['glide'] + config.texture_crop_start_s) * planned.rate_hz))
        return slice(first, first + config.texture_samples)
    first = int(np.ceil((phases['hold'] + config.stiffness_settle_s) * planned.rate_hz))
    end_s = phases['release'] - config.stiffness_crop_end_s
    return slice(first, int(end_s * planned.rate_hz))


def cut_after_window(planned: TrialSchedule, window: slice) -> Timeline:
    """Return the planned motion of a trial up to the end of the window."""
    moves = planned.timeline
    until_s = (window.stop + 1) / planned.rate_hz
    return Timeline(
        [move for move in moves.guide_moves if move.start_s < until_s],
        [move for move in moves.tendon_moves if move.start_s < until_s],
        until_s,
        moves.guide_start_m,
    )


def remove_mean(windows: FloatArray) -> FloatArray:
    """Subtract the means along the last axis."""
    return np.asarray(windows - windows.mean(axis=-1, keepdims=True))


def remove_line(windows: FloatArray) -> FloatArray:
    """Subtract least-squares lines along the last axis."""
    centred = remove_mean(windows)
    along = np.arange(windows.shape[-1]) - (windows.shape[-1] - 1) / 2
    slopes = centred @ along / (along @ along)
    return np.asarray(centred - slopes[..., np.newaxis] * along)


def compare(ours: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the error of ``ours``, along the last axis [%].

    It is the norm of the difference divided by the norm of the reference.
    """
    distance = np.linalg.norm(ours - reference, axis=-1)
    return np.asarray(100 * distance / np.linalg.norm(reference, axis=-1))


def time_in_turns(works: Sequence[Callable[[], object]], rounds: int) -> FloatArray:
    """Measure the time of each function in each round, shape (works, rounds) [s of one core].

    Processor time excludes waiting for other programs. The functions run alternately, so that
    remaining effects of other load are the same for all.
    """
    for work in works:
        work()
    times_s = np.empty((len(works), rounds))
    for turn in range(rounds):
        for index, work in enumerate(works):
            start_s = time.process_time()
            work()
            times_s[index, turn] = time.process_time() - start_s
    return times_s


def name_choice(steps: int) -> str:
    """Return the name, for a report, of a simulation with ``steps`` steps per sample."""
    return f'{steps} steps' + (', default' if steps == STEPS_PER_SAMPLE else '')
