# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texture at a sliding speed that training never saw: accuracy, and what it rests on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from benchmarks.measuring import Report, Row
from benchmarks.recordings import FABRIC_SLIDE, find_recording, say_missing
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.datasets.archive import load_archive
from tactile_classifier.estimators.classifiers import build_estimator, CLASSIFIERS, SCALINGS
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import features_from_trials
from tactile_features.feature_sets.texture_spatial import SpatialWindow
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_lab.simulation.simulated_trials import plan_trial
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.fast_trials import simulate_trials

Array = NDArray[Any]

FABRIC_LENGTH_M = 0.048
"""What the slowest slides cover, without a sample at either end."""

FABRIC_FINEST_M = 0.003
"""At 100 mm/s and 35.6 Hz there is a sample every 2.8 mm: nothing finer can be served."""

THINNING = (2, 5, 9)
FASTEST_M_S = 0.1
"""Every second, fifth, ninth sample of a slow slide is what a faster one gives, up to this."""

POSITIONS_M = tuple(np.arange(-24, 25, 3) / 1e3)
BETWEEN_M = (-0.010, -0.005, 0.0, 0.005, 0.010)

SIMULATED_MM_S = (5, 10, 15, 20, 25, 30)
SIMULATED_LENGTH_M, SIMULATED_FINEST_M, SIMULATED_CROP_M = 0.045, 0.0005, 0.009
TIME_MM_S = (5, 10, 15)
"""At higher speeds the plate is too short for the paper's three seconds."""

SESSIONS, TRIALS = 4, 5
"""Of each plate at each speed. A speed has seeds of its own, and so its own sessions."""


@dataclass(frozen=True)
class Glides:
    """Ready-cut glides: signals (trials, samples), labels and speeds (trials,)."""

    x: Array
    label: Array
    speed_m_s: Array
    rate_hz: float

    def take(self, keep: Array) -> Glides:
        """Return the glides of a mask."""
        return replace(
            self, x=self.x[keep], label=self.label[keep], speed_m_s=self.speed_m_s[keep]
        )

    def moved(self, by_m: float) -> Glides:
        """Return the glides with another piece of their path in the middle, where it is long."""
        step_m = self.speed_m_s / self.rate_hz
        room_m = step_m * (self.x.shape[1] - 3) - 2 * abs(by_m)
        glides = self if by_m == 0 else self.take(room_m >= FABRIC_LENGTH_M)
        places = np.rint(by_m / (glides.speed_m_s / self.rate_hz)).astype(int)
        rows = [np.roll(row, -place) for row, place in zip(glides.x, places, strict=True)]
        return replace(glides, x=np.array(rows))

    def thinned(self) -> list[Glides]:
        """Return the slower glides as faster ones would have been sampled."""
        copies = []
        for factor in THINNING:
            slow = self.take(self.speed_m_s * factor <= FASTEST_M_S * (1 + 1e-9))
            length = self.x.shape[1] // factor
            copies += [
                replace(
                    slow, x=slow.x[:, phase::factor][:, :length], rate_hz=self.rate_hz / factor
                )
                for phase in sorted({0, factor // 2, factor - 1})
                if len(slow.label)
            ]
        return copies


View = Callable[[Glides], Array]


def over_distance(finest_m: float = FABRIC_FINEST_M, length_m: float = FABRIC_LENGTH_M) -> View:
    """Return the features of the set ``texture_spatial``."""
    config = FeatureConfig(
        texture_features='texture_spatial', spatial_length_m=length_m, spatial_finest_m=finest_m
    )
    return lambda g: features_from_trials(
        'texture', g.x, g.rate_hz, config=config, speeds_m_s=g.speed_m_s
    )[0]


def spectrum_over_distance(glides: Glides) -> Array:
    """Return the spatial frequencies of ``texture_spatial`` alone."""
    window = SpatialWindow(FABRIC_LENGTH_M, FABRIC_FINEST_M)
    return over_distance()(glides)[:, : window.component_count]


def resample(glides: Glides) -> Array:
    """Return the smoothed signal itself, with its level, over the middle of the path."""
    count = glides.x.shape[1]
    at_s = (np.arange(count) - (count - 1) / 2) / glides.rate_hz
    grid_m = ((np.arange(24) + 0.5) / 24 - 0.5) * FABRIC_LENGTH_M
    rows = []
    for row, speed_m_s in zip(glides.x, glides.speed_m_s, strict=True):
        apart = (grid_m[:, None] - speed_m_s * at_s) / FABRIC_FINEST_M
        weights = np.exp(-0.5 * apart**2)
        rows.append(weights @ row / weights.sum(axis=1))
    return np.array(rows)


def waveform(glides: Glides) -> Array:
    """Return the smoothed signal without its mean: it knows where it is."""
    values: Array = resample(glides)
    return values - values.mean(axis=1, keepdims=True)


def over_time(glides: Glides) -> Array:
    """Return the paper's features: of the tension without its mean."""
    return compute_spectrum(glides.x, detrend='mean')


ESTIMATORS: dict[str, Callable[[], Any]] = {
    f'{name}, {scaling}': lambda name=name, scaling=scaling: build_estimator(name, scaling)
    for name in CLASSIFIERS
    for scaling in SCALINGS
}
OURS = tuple(ESTIMATORS)
ESTIMATORS['discriminant, standard'] = lambda: make_pipeline(
    StandardScaler(), LinearDiscriminantAnalysis(solver='lsqr', shrinkage='auto')
)
ESTIMATORS['extra trees, none'] = lambda: ExtraTreesClassifier(150, random_state=0)


class HeldOut:
    """Accuracies with speeds held out, for choosing and for reporting.

    Parameters
    ----------
    view : callable
    train, test : sequence of Glides
        What may be trained on and what is tested: rows of the held-out speed are taken from
        ``test``, those of the other speeds from ``train``.
    """

    def __init__(self, view: View, train: Sequence[Glides], test: Sequence[Glides]) -> None:
        self._train = [(view(g), g.label, g.speed_m_s) for g in train]
        self._test = [(view(g), g.label, g.speed_m_s) for g in test]
        self.speeds = np.unique(np.concatenate([g.speed_m_s for g in test]))

    def accuracy(self, estimator: str, test_m_s: float, without_m_s: Sequence[float]) -> float:
        """Return the accuracy at one speed after training on all but ``without_m_s``."""
        kept = [(v[k], y[k]) for v, y, s in self._train for k in [~np.isin(s, without_m_s)]]
        fitted = ESTIMATORS[estimator]().fit(
            np.concatenate([v for v, _ in kept]), np.concatenate([y for _, y in kept])
        )
        right = [fitted.predict(v[s == test_m_s]) == y[s == test_m_s]
                 for v, y, s in self._test if np.any(s == test_m_s)]  # fmt: skip
        return float(np.mean(np.concatenate(right)))

    def report(self, case: str, names: Sequence[str]) -> Row:
        """Return the row of a case; the classifier is chosen without the held-out speed."""
        outer = []
        chosen = []
        for held in self.speeds:
            inner = [s for s in self.speeds if s != held]
            means = {
                name: np.mean([self.accuracy(name, s, (held, s)) for s in inner])
                for name in (names if len(names) > 1 else ())
            }
            name = max(means, key=lambda n: means[n]) if means else names[0]
            outer.append(self.accuracy(name, held, (held,)))
            chosen.append(name)
        more = {'accuracy, %': round(100 * float(np.mean(outer)), 1)}
        for held, value in zip(self.speeds, outer, strict=True):
            more[f'{1e3 * held:g} mm/s'] = round(100 * value)
        more['chosen'] = '; '.join(dict.fromkeys(chosen))
        return Row(case, more=more)


def run_speeds(quick: bool) -> Report:
    """Hold each sliding speed out in turn, on fabrics that others slid over."""
    path = find_recording(FABRIC_SLIDE)
    if path is None:
        return _report([Row(say_missing(FABRIC_SLIDE))])
    trials = load_archive(path).where('balanced')
    speed_m_s = trials.columns['speed_mm_s'] / 1e3

    def glides(channel: int | None) -> Glides:
        return Glides(trials.signal(channel), trials.label, speed_m_s, trials.rate_hz)

    rows = []
    names = OURS[:2] if quick else tuple(ESTIMATORS)
    for title, one in (('channel 0', glides(0)), ('mean of 16', glides(None))):
        cases = {
            'over time (paper)': (over_time, [one], [one]),
            'waveform over mm': (waveform, [one], [one]),
            'spectrum over mm': (spectrum_over_distance, [one], [one]),
            'texture_spatial': (over_distance(), [one], [one]),
            'the same, thinned copies': (over_distance(), [one, *one.thinned()], [one]),
        }
        rows += [
            HeldOut(*inputs).report(f'{title}: {name}', names) for name, inputs in cases.items()
        ]
        rows.append(
            HeldOut(over_distance(), [one], [one]).report(
                f'{title}: texture_spatial, our four', OURS
            )
        )
        everywhere = [one.moved(by_m) for by_m in POSITIONS_M]
        between = [one.moved(by_m) for by_m in BETWEEN_M]
        other = [one.moved(by_m) for by_m in (-0.012, -0.006, 0.006, 0.012)]
        for name, view in (('texture_spatial', over_distance()), ('waveform', waveform)):
            fixed = ('extra trees, none',)
            if not quick:
                row = HeldOut(view, everywhere, between).report(
                    f'{title}: {name}, trained at many places, met between', fixed
                )
                rows.append(row)
            shifted = HeldOut(view, [one], other).report(
                f'{title}: {name}, met 6 and 12 mm away', fixed
            )
            rows.append(shifted)
    sixteen = [glides(channel) for channel in range(trials.x.shape[1])]
    for name, view in (('waveform over mm', waveform), ('texture_spatial', over_distance())):
        wide = np.hstack([view(one) for one in sixteen])
        rows.append(
            HeldOut(lambda _, wide=wide: wide, sixteen[:1], sixteen[:1]).report(
                f'16 channels: {name}', names
            )
        )
    return _report(rows)


def run_simulated_speeds(quick: bool) -> Report:
    """Hold each sliding speed out in turn, on simulated plates."""
    speeds = SIMULATED_MM_S[::2] if quick else SIMULATED_MM_S
    by_speed = {mm_s: simulate(mm_s) for mm_s in speeds}
    window = SpatialWindow(SIMULATED_LENGTH_M, SIMULATED_FINEST_M)
    cut = [cut_window(by_speed[mm_s], window) for mm_s in speeds]
    view = over_distance(SIMULATED_FINEST_M, SIMULATED_LENGTH_M)
    names = OURS[:4] if quick else tuple(ESTIMATORS)
    rows = [
        HeldOut(view, cut, cut).report('SIMULATED: texture_spatial', names),
        HeldOut(view, cut, cut).report('SIMULATED: texture_spatial, our four', OURS),
    ]
    timed = [replace(g, x=g.x[:, 36:216]) for mm_s, g in by_speed.items() if mm_s in TIME_MM_S]
    if len(timed) > 2:
        rows.append(HeldOut(over_time, timed, timed).report('SIMULATED: over time (paper)', names))
    return _report(rows)


def simulate(mm_s: int) -> Glides:
    """Return simulated glides in flexion, from the start of the glide on."""
    catalogue = Catalogue(None)
    config = TrialConfig(simulated=True, glide_speed_m_s=mm_s / 1e3)
    plan = plan_trial(config, TrialRequest('texture', 'flexion'), catalogue)
    start_s = dict(plan.phases)['glide']
    x: list[Array] = []
    labels: list[str] = []
    for label in catalogue.labels('texture'):
        for session in range(SESSIONS):
            done = simulate_trials(
                'texture', label, 'flexion', plan.timeline, TRIALS, 100 + mm_s,
                session=session, first=0, catalogue=catalogue,
            )  # fmt: skip
            x += list(done.tension_n[:, np.searchsorted(done.sample_times_s, start_s) :])
            labels += [label] * TRIALS
    return Glides(np.array(x), np.array(labels), np.full(len(x), mm_s / 1e3), plan.rate_hz)


def cut_window(glides: Glides, window: SpatialWindow) -> Glides:
    """Return the samples that the live window would hold."""
    speed_m_s = float(glides.speed_m_s[0])
    first = int(np.ceil(round(SIMULATED_CROP_M / speed_m_s * glides.rate_hz, 6)))
    end = first + window.sample_count(speed_m_s, glides.rate_hz)
    return replace(glides, x=glides.x[:, first:end])


def _report(rows: list[Row]) -> Report:
    return Report(
        title='texture at a sliding speed that training never saw',
        floor='none: this topic is about accuracy',
        error='none; each speed is held out in turn, and where there are several classifiers the '
        'one is chosen by holding out one of the other speeds in turn',
        rows=rows,
    )
