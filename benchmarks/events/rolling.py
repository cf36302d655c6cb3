# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rolling and sliding objects under a holding finger: what one tendon's tension shows of them.

Everything is SIMULATED. Each pull has a twin: the same finger and the same object without the
pull. Their difference is what the pull does to the tension.
"""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from dataclasses import dataclass
from functools import partial
import math
from typing import Any

import numpy as np
from scipy.signal import fftconvolve

from benchmarks.events.grips import CONTACTS, FAST_HZ, FloatArray
from benchmarks.measuring import Report, Row
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.physics.fast_trials import simulate_motion, SimulatedMotion, STEPS_PER_SAMPLE
from tactile_sim.physics.finger import layout as at
from tactile_sim.physics.motion import move_duration_s
from tactile_sim.physics.scene import build_scene, Scene
from tactile_sim.physics.sensing import read_tension
from tactile_sim.physics.surface import build_crown_surface, build_surface, SPACING_M
from tactile_sim.physics.timeline import Move, Timeline
from tactile_sim.physics.variation import draw_variation

FIRST_SEED = 7000
SEEDS = 20
TRIALS = 6

THRESHOLD = 5.0
"""Of the bend, in standard deviations of white noise: that of the slip detector, not tuned."""

WINDOWS_S = (0.25, 0.5, 1.0, 2.0)
SETTLE_S = 3.0
AFTER_S = 0.5
WAY_M = 2e-3

SENSORS = {
    '60 Hz, 4 mN': (60.0, 0.004),
    '1 kHz, 4 mN': (FAST_HZ, 0.004),
    '1 kHz, 16 mN': (FAST_HZ, 0.004 * math.sqrt(FAST_HZ / 60.0)),
}
"""Rate and noise of each sample. The last has the noise density of the first."""


@dataclass(frozen=True, eq=False)
class PulledScene(Scene):
    """A scene whose pull can also move the material under the fingertip.

    Attributes
    ----------
    turn
        Way of the material for each metre of the pull: 2 for a cylinder that rolls on a table.
    resistance_m
        How far rolling friction stretches the fingertip's shear spring [m].
    """

    turn: float = 0.0
    resistance_m: float = 0.0

    def compute_inputs(
        self, tendon_m: FloatArray, guide_m: FloatArray, pulled_m: FloatArray | float = 0.0
    ) -> FloatArray:
        inputs = super().compute_inputs(tendon_m, guide_m, pulled_m)
        if self.rolls:
            begun = np.clip(np.asarray(pulled_m) / 1e-5, 0.0, 1.0)
            inputs[:, at.MATERIAL_INPUT] = self.turn * pulled_m + self.resistance_m * begun
        return inputs


@dataclass(frozen=True)
class Kind:
    """What lies under the fingertip and how it is pulled.

    Attributes
    ----------
    label : str
        Of a held object in the simulator's description.
    radius_m, speed_m_s : float
    rolling_friction_m : float
        Arm of the rolling resistance; a moment of this times the contact force.
    roughness_m : float
        Of the rolling surface: standard deviation of its height.
    turn : float
        See `PulledScene`.
    """

    label: str = 'cylinder'
    radius_m: float = 0.015
    speed_m_s: float = 1e-3
    rolling_friction_m: float = 0.0
    roughness_m: float = 0.0
    turn: float = 0.0


KINDS = {
    'held, not moving over the finger': Kind(label='rough'),
    'rolls, 1 mm/s, radius 15 mm': Kind(),
    '0.3 mm/s': Kind(speed_m_s=3e-4),
    '3 mm/s': Kind(speed_m_s=3e-3),
    '10 mm/s': Kind(speed_m_s=1e-2),
    'radius 5 mm': Kind(radius_m=0.005),
    'radius 50 mm': Kind(radius_m=0.05),
    'rolling friction 0.5 mm': Kind(rolling_friction_m=5e-4),
    'roughness 1 um': Kind(roughness_m=1e-6),
    'roughness 10 um': Kind(roughness_m=1e-5),
    'on a table: rubs the finger': Kind(turn=2.0),
    'slides': Kind(label='smooth'),
}
HELD = 'held, not moving over the finger'
USUAL = 'rolls, 1 mm/s, radius 15 mm'


@dataclass(frozen=True)
class Pulls:
    """The pulls of one kind and seed, and their twins that are not pulled.

    Attributes
    ----------
    pulled, still : SimulatedMotion
    begin_s, end_s : float
        Of the pull.
    grip_s : float
        When the finger has closed.
    way_m : ndarray of shape (samples,)
        How far the object was pulled.
    """

    scene: Scene
    pulled: SimulatedMotion
    still: SimulatedMotion
    begin_s: float
    end_s: float
    grip_s: float
    way_m: FloatArray
    bias_n: FloatArray

    def effect_n(self) -> FloatArray:
        """Return what the pull does to the sensed tension, without noise."""
        return np.asarray(self.pulled.sensed_n - self.still.sensed_n)


def build_kind(kind: Kind, contact: str, rate_hz: float, seed: int) -> Scene:
    """Compose the scene of a kind."""
    scene = build_scene('slip', kind.label, contact, default_catalogue())
    cell = scene.rig.load_cell
    if rate_hz != cell.rate_hz:
        cell = dataclasses.replace(cell, rate_hz=rate_hz, low_pass_hz=rate_hz / 2)
    fields = {f.name: getattr(scene, f.name) for f in dataclasses.fields(scene)}
    fields['rig'] = dataclasses.replace(scene.rig, load_cell=cell)
    if scene.rolls:
        surface = build_crown_surface(kind.radius_m, scene.finger.tip_radius_m)
        if kind.roughness_m:
            heights = np.append(surface.table[:, 0], surface.table[-1, :2].sum())
            rough = np.random.default_rng(seed).normal(size=len(heights) + 40)
            rough = np.convolve(rough, np.hanning(41), 'valid')  # some 0.2 mm wide
            heights = heights + kind.roughness_m * rough / rough.std()
            surface = build_surface(heights, surface.origin_m, SPACING_M)
        fields['surface'] = surface
        # A force of rolling friction times the contact force over the radius, of 1 N.
        force_n = kind.rolling_friction_m / kind.radius_m
        fields['resistance_m'] = force_n / scene.finger.tip_shear_stiffness_n_m
        fields['turn'] = kind.turn
    return PulledScene(**fields)


def simulate_pulls(
    kind: Kind, contact: str, rate_hz: float, seed: int, trials: int = TRIALS
) -> Pulls:
    """Simulate the pulls of one kind and seed; the seed draws a rig of its own."""
    planned = plan_trial(TrialConfig(simulated=True), TrialRequest('slip', contact))
    scene = build_kind(kind, contact, rate_hz, seed)
    grip_s = dict(planned.phases)['pull'] - 0.3
    begin_s = grip_s + SETTLE_S
    end_s = begin_s + move_duration_s(WAY_M, kind.speed_m_s, 0.5)
    timeline = dataclasses.replace(
        planned.timeline,
        tendon_moves=planned.timeline.tendon_moves[:1],
        object_moves=(Move(begin_s, WAY_M, kind.speed_m_s),),
        duration_s=end_s + AFTER_S,
    )
    steps = STEPS_PER_SAMPLE if rate_hz == 60.0 else 1
    # All kinds of one seed share finger, rig and place.
    variation, _ = draw_variation(
        default_catalogue(), contact, 'slip', 'cylinder', seed, 0, trials
    )
    phase = np.floor(variation.phase * steps) / steps
    variation = dataclasses.replace(variation, phase=phase)
    run = partial(simulate_motion, variation=variation, steps_per_sample=steps)
    still = run(scene, dataclasses.replace(timeline, object_moves=()))
    pulled = run(scene, timeline)
    share = np.clip((pulled.sample_times_s - begin_s) / (end_s - begin_s), 0.0, 1.0)
    return Pulls(
        scene, pulled, still, begin_s, end_s, grip_s, WAY_M * share, variation.sensor_bias_n
    )


def read(pulls: Pulls, sensed_n: FloatArray, noise_n: float, *names: int) -> FloatArray:
    """Return what the sensor reads."""
    cell = dataclasses.replace(pulls.scene.rig.load_cell, noise_n=noise_n)
    generators = [np.random.default_rng([*names, trial]) for trial in range(len(sensed_n))]
    return read_tension(cell, sensed_n, pulls.bias_n, generators)


def compute_bend(tension_n: FloatArray, rate_hz: float, first: int, last: int) -> FloatArray:
    """Return how far the tension bends down, in deviations of the noise.

    The largest of `WINDOWS_S`: the second-order coefficient of a parabola through the window
    that ends here, over its standard deviation under white noise, which the second differences
    of the samples from ``first`` to ``last`` give. Creep bends the other way: its rate falls.
    """
    bends = np.diff(tension_n[:, first:last], 2, axis=1)
    noise_n = np.sqrt(np.mean(bends**2, axis=1, keepdims=True) / 6)
    from_first = tension_n - tension_n[:, :1]
    found = np.full(tension_n.shape, -np.inf)
    for window_s in WINDOWS_S:
        count = round(window_s * rate_hz)
        place = np.linspace(-1.0, 1.0, count)
        weights = place**2 - np.mean(place**2)
        weights /= -np.linalg.norm(weights)
        here = fftconvolve(from_first, weights[np.newaxis], 'valid', axes=1)
        found[:, count - 1 :] = np.maximum(found[:, count - 1 :], here)
    return np.asarray(found / noise_n)


def compute_auroc(of_these: FloatArray, over_those: FloatArray) -> float:
    """Return how often one of these is larger than one of those; ties count half."""
    differences = of_these[:, np.newaxis] - over_those
    return float(np.mean((differences > 0) + 0.5 * (differences == 0)))


def compute_visibility(effect_n: FloatArray, explained: FloatArray, noise_n: float) -> FloatArray:
    """Return the deflection d' of each effect: its length over the noise.

    That is what a filter matched to the effect would see, after everything in the columns of
    ``explained`` has been taken away. No linear detector sees more.
    """
    basis, _ = np.linalg.qr(explained)
    rest = effect_n - (effect_n @ basis) @ basis.T
    return np.asarray(np.linalg.norm(rest, axis=1) / noise_n)


def tell_spread(values: list[float]) -> str:
    """Return mean and standard deviation, of those that are numbers."""
    known = np.array([v for v in values if math.isfinite(v)])
    if not len(known):
        return 'none'
    return f'{known.mean():.2f} ± {known.std(ddof=1) if len(known) > 1 else 0:.2f}'


def run_rolling(quick: bool) -> Report:
    """What rolling does to the tension, and whether a bend of it tells rolling from the rest."""
    seeds = range(FIRST_SEED, FIRST_SEED + (2 if quick else SEEDS))
    rows = []
    for contact in CONTACTS:
        simulate = _remember(contact)
        held: dict[tuple[str, int], FloatArray] = {}
        for name in KINDS:
            if quick and name not in (HELD, USUAL, '3 mm/s', 'slides'):
                continue
            for sensor in SENSORS:
                more = _judge(name, sensor, simulate, list(seeds), held)
                rows.append(Row(f'{contact}, {sensor}: {name}', more=more))
        rows += [
            Row(f'{contact}, {sensor}: still', more=_hold(contact, sensor, quick))
            for sensor in SENSORS
        ]
    return Report(
        f'rolling: SIMULATED, {len(seeds)} seeds of {TRIALS} pulls; mean ± deviation over seeds',
        'none: the table is about answers',
        "d': what a matched filter sees in deviations; AUROC and alarms of the bend",
        rows,
    )


Simulate = Callable[[str, float, int], Pulls]


def _remember(contact: str) -> Simulate:
    known: dict[tuple[str, float, int], Pulls] = {}

    def simulate(name: str, rate_hz: float, seed: int) -> Pulls:
        key = (name, rate_hz, seed)
        if key not in known:
            known[key] = simulate_pulls(KINDS[name], contact, rate_hz, seed)
        return known[key]

    return simulate


def _judge(
    name: str,
    sensor: str,
    simulate: Simulate,
    seeds: list[int],
    held: dict[tuple[str, int], FloatArray],
) -> dict[str, Any]:
    rate_hz, noise_n = SENSORS[sensor]
    kinds = list(KINDS)
    found: dict[str, list[float]] = {}
    delays: list[float] = []

    def note(column: str, value: float) -> None:
        found.setdefault(column, []).append(value)

    for seed in seeds:
        pulls = simulate(name, rate_hz, seed)
        times_s = pulls.pulled.sample_times_s
        begin, grip = (int(np.searchsorted(times_s, t)) for t in (pulls.begin_s, pulls.grip_s))
        near = slice(round(begin - rate_hz), None)
        effect_n = pulls.effect_n()
        here_s = times_s[near] - pulls.begin_s
        creep = np.exp(-here_s / pulls.scene.finger.creep_time_s)
        known = np.column_stack([np.ones_like(here_s), here_s, creep])
        sheared = np.column_stack([known, pulls.way_m[near]])
        note('effect mN', 1e3 * float(np.median(np.ptp(effect_n[:, near], axis=1))))
        note("d'", float(np.median(compute_visibility(effect_n[:, near], known, noise_n))))
        beyond = compute_visibility(effect_n[:, near], sheared, noise_n)
        note("d' beyond shear", float(np.median(beyond)))
        names = (seed, kinds.index(name), round(rate_hz), round(1e6 * noise_n))
        scores = {}
        for i, (what, motion) in enumerate((('pulled', pulls.pulled), ('still', pulls.still))):
            tension_n = read(pulls, motion.sensed_n, noise_n, *names, i)
            scores[what] = compute_bend(tension_n, rate_hz, round(grip + rate_hz), begin)
        best = {what: score[:, begin:].max(axis=1) for what, score in scores.items()}
        note('AUROC', compute_auroc(best['pulled'], best['still']))
        held.setdefault((sensor, seed), best['pulled'])
        note('AUROC over held', compute_auroc(best['pulled'], held[sensor, seed]))
        crossed = scores['pulled'][:, begin:] > THRESHOLD
        note('found', float(crossed.any(axis=1).mean()))
        delays += [float(np.argmax(row)) / rate_hz for row in crossed if row.any()]
    more = {column: tell_spread(values) for column, values in found.items()}
    more['delay s'] = f'{np.median(delays):.2f}' if delays else 'never'
    return more


def _hold(contact: str, sensor: str, quick: bool) -> dict[str, Any]:
    """Count alarms of the bend while the finger holds and nothing moves."""
    rate_hz, noise_n = SENSORS[sensor]
    alarms, hours = [], 0.0
    hold_s = 60.0 if rate_hz > 60.0 else 300.0
    for seed in range(FIRST_SEED + 100, FIRST_SEED + 100 + (2 if quick else SEEDS)):
        planned = plan_trial(TrialConfig(simulated=True), TrialRequest('slip', contact))
        scene = build_kind(KINDS[USUAL], contact, rate_hz, seed)
        grip_s = dict(planned.phases)['pull'] - 0.3
        timeline = Timeline(
            planned.timeline.guide_moves, planned.timeline.tendon_moves[:1], grip_s + hold_s
        )
        variation, generators = draw_variation(
            default_catalogue(), contact, 'slip', 'cylinder', seed, 0, 2
        )
        variation = dataclasses.replace(variation, phase=np.zeros(2))
        steps = 2 if rate_hz == 60.0 else 1
        motion = simulate_motion(scene, timeline, variation, steps_per_sample=steps)
        cell = dataclasses.replace(scene.rig.load_cell, noise_n=noise_n)
        tension_n = read_tension(cell, motion.sensed_n, variation.sensor_bias_n, generators)
        first = round((grip_s + 1.0) * rate_hz)
        score = compute_bend(tension_n, rate_hz, first, first + round(2 * rate_hz))
        high = score[:, first + round(max(WINDOWS_S) * rate_hz) :] > THRESHOLD
        width = round(rate_hz)  # one alarm a second at most
        parts = high[:, : high.shape[1] // width * width].reshape(len(high), -1, width)
        alarms.append(int(parts.any(axis=2).sum()))
        hours += 2 * (hold_s - 1.0 - max(WINDOWS_S)) / 3600
    return {
        'alarms': str(sum(alarms)),
        'hours': f'{hours:.2f}',
        'alarms/h': f'{sum(alarms) / hours:.1f}',
        'most in one seed': str(max(alarms)),
    }
