# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy on simulated trials as one condition of sensor and rig at a time gets worse.

Sensor effects (noise, drift, lost samples, jitter) are added to the same clean motion. For other
speeds, depths and sample rates the motion is simulated anew. Features come from the extractor of
the live node. Training and tests are in different sessions: the rig is set up anew between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from joblib import delayed, Parallel
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.measuring import Report, Row
from tactile_bringup.trial_protocols import glide_speed_m_s, TrialConfig, TrialRequest
from tactile_classifier.estimators.classifiers import build_estimator, DEFAULT_SCALING
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.records import Outcome, PROTOCOL_STIFFNESS, PROTOCOL_TEXTURE, TrialEvent
from tactile_lab.simulation.simulated_trials import EPOCH_NS, plan_trial
from tactile_ros.strain import StrainBlock
from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue
from tactile_sim.descriptions.description import LoadCell
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.sensing import read_tension
from tactile_sim.physics.trials import simulate_motion, STEPS_PER_SAMPLE
from tactile_sim.physics.variation import draw_variation, make_generator

FloatArray = NDArray[np.float64]

CLASSIFIER = 'knn'
SAMPLE_RATE = 'sample rate (Hz)'
"""A model refuses another sample rate than its own: it is trained as it is tested alone."""

_GLIDE_S = 4.2  # long enough for the window at any speed, where the plate is


@dataclass(frozen=True)
class Sensing:
    """Sensor effects on the same motion; None keeps the value of the rig's description.

    Attributes
    ----------
    noise_n, drift_n_rt_s : float or None
        Standard deviation of noise (N), random walk of the zero in a root second [N].
    lost : float
        Fraction of samples lost, each independently [1].
    jitter : float
        Standard deviation of the sampling time, in periods [1]. The stamps do not show it.
    """

    noise_n: float | None = None
    drift_n_rt_s: float | None = None
    lost: float = 0.0
    jitter: float = 0.0


@dataclass(frozen=True)
class Setting:
    """One condition: how the trial runs, how fast is sampled, what the sensor does.

    Gaps of up to ``max_gap_samples`` are bridged; see `FeatureConfig`.
    """

    axis: str
    value: float
    glide_speed_m_s: float | None = None
    depth: float = 1.0
    rate_hz: float | None = None
    max_gap_samples: int = 0
    sensing: Sensing = field(default_factory=Sensing)

    @property
    def motion(self) -> tuple[float | None, float, float | None]:
        """Values that define the motion; a different tuple needs a new simulation."""
        return self.glide_speed_m_s, self.depth, self.rate_hz


@dataclass(frozen=True)
class Study:
    """Contact, seed, sessions, and trials of each label in each session."""

    contact: str = 'flexion'
    seed: int = 1
    train_sessions: int = 3
    test_sessions: int = 3
    train_trials: int = 8
    test_trials: int = 4


@dataclass(frozen=True)
class Features:
    """Features and labels of those of some trials that have any."""

    values: FloatArray
    labels: NDArray[np.str_]
    trials: int


def list_settings(cell: LoadCell, config: TrialConfig) -> list[Setting]:
    """Return what is varied, around the rig's own values."""
    noise_n, drift_n_rt_s, speed_m_s = cell.noise_n, cell.drift_n_rt_s, config.glide_speed_m_s
    steps, lost = (1.0, 3.0, 10.0, 30.0), (0.0, 0.003, 0.01, 0.03, 0.1)
    found = [
        Setting('noise (N)', noise_n * s, sensing=Sensing(noise_n=noise_n * s)) for s in steps
    ]
    drifts = [drift_n_rt_s * s**2 for s in steps]
    found += [Setting('drift (N/rt s)', d, sensing=Sensing(drift_n_rt_s=d)) for d in drifts]
    found += [Setting('lost samples (1)', share, sensing=Sensing(lost=share)) for share in lost]
    found += [
        Setting('lost, gaps bridged (1)', share, max_gap_samples=3, sensing=Sensing(lost=share))
        for share in lost
    ]
    jitters = (0.0, 0.1, 0.3, 0.6)
    found += [Setting('jitter (periods)', j, sensing=Sensing(jitter=j)) for j in jitters]
    speeds_m_s = (0.005, 0.010, 0.0135, speed_m_s, 0.0165)
    found += [Setting('glide speed (m/s)', v, glide_speed_m_s=v) for v in speeds_m_s]
    found += [Setting('contact depth (1)', depth, depth=depth) for depth in (0.8, 0.9, 1.0, 1.1)]
    rates_hz = (15.0, 30.0, cell.rate_hz, 120.0)
    return [*found, *(Setting(SAMPLE_RATE, hz, rate_hz=hz) for hz in rates_hz)]


def run_robustness(quick: bool) -> Report:
    """Simulate all conditions, and say what neighbours make of them."""
    study = Study(train_sessions=1, test_sessions=1, train_trials=4) if quick else Study()
    catalogue = default_catalogue()
    settings = list_settings(catalogue.rig().load_cell, TrialConfig(simulated=True))
    rows = [
        row
        for protocol in (PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS)
        for row in _run_protocol(study, catalogue, protocol, settings)
    ]
    return Report(
        f'robustness: SIMULATED trials, {study.contact}, {CLASSIFIER} with the default scaling',
        '',
        f'named correctly of all tested trials [%]: trained as usual in {study.train_sessions} '
        f'sessions, or as tested; tested in {study.test_sessions} others; trials without '
        'features [%]',
        rows,
    )


def _run_protocol(
    study: Study, catalogue: Catalogue, protocol: str, settings: Sequence[Setting]
) -> Iterator[Row]:
    by_motion: dict[Any, list[Setting]] = {}
    for setting in settings:
        if protocol == PROTOCOL_TEXTURE or setting.glide_speed_m_s is None:
            by_motion.setdefault(setting.motion, []).append(setting)
    groups = list(by_motion.values())
    done = Parallel(n_jobs=-1)(
        delayed(make_features)(study, catalogue, protocol, group) for group in groups
    )
    found = [pair for pairs in done for pair in pairs]
    of = dict(zip([setting for group in groups for setting in group], found, strict=True))
    usual = of[Setting('contact depth (1)', 1.0)][0]
    for setting, (train, test) in of.items():
        shares = {'as tested': score(protocol, train, test)}
        if setting.axis != SAMPLE_RATE:
            shares = {'as usual': score(protocol, usual, test), **shares}
        shares['none'] = 1.0 - len(test.labels) / test.trials
        more = {k: 'none' if v is None else round(100 * v) for k, v in shares.items()}
        yield Row(f'{protocol}, {setting.axis}: {setting.value:.3g}', more=more)


def score(protocol: str, train: Features, test: Features) -> float | None:
    """Return the share of all tested trials named correctly; None: nothing to train on."""
    if len(train.labels) < 3 or len(np.unique(train.labels)) < 2:
        return None
    if not len(test.labels):
        return 0.0
    estimator = build_estimator(CLASSIFIER, DEFAULT_SCALING[protocol])
    estimator.fit(train.values, train.labels)
    return float(np.sum(estimator.predict(test.values) == test.labels) / test.trials)


def make_features(
    study: Study, catalogue: Catalogue, protocol: str, settings: Sequence[Setting]
) -> list[tuple[Features, Features]]:
    """Return features to train on and to test on, for settings that share their motion."""
    config, features, catalogue = _configure(study, catalogue, settings[0])
    rows: list[tuple[list[Any], list[Any]]] = [([], []) for _ in settings]
    for label in catalogue.labels(protocol):
        for session in range(study.train_sessions + study.test_sessions):
            is_test = session >= study.train_sessions
            count = study.test_trials if is_test else study.train_trials
            trials = CleanTrials(protocol, label, study, config, catalogue, session, count)
            for i, setting in enumerate(settings):
                policy = replace(features, max_gap_samples=setting.max_gap_samples)
                found = trials.extract(setting.sensing, policy)
                rows[i][is_test].extend((label, values) for values in found)
    return [(_gather(train), _gather(test)) for train, test in rows]


def _gather(rows: Sequence[tuple[str, FloatArray | None]]) -> Features:
    answered = [(label, values) for label, values in rows if values is not None]
    values = np.array([values for _, values in answered])
    return Features(values, np.array([label for label, _ in answered]), len(rows))


def _configure(
    study: Study, catalogue: Catalogue, setting: Setting
) -> tuple[TrialConfig, FeatureConfig, Catalogue]:
    usual = TrialConfig(simulated=True)
    speed_m_s = setting.glide_speed_m_s or usual.glide_speed_m_s
    depth = f'{study.contact}_displacement_m'
    config = replace(
        usual,
        glide_speed_m_s=speed_m_s,
        glide_length_m=min(usual.glide_length_m, speed_m_s * _GLIDE_S),
        **{depth: getattr(usual, depth) * setting.depth},
    )
    rig, features = catalogue.rig(), FeatureConfig(measures=False)
    rate_hz = setting.rate_hz or rig.load_cell.rate_hz
    samples = round(features.texture_samples / features.rate_hz * rate_hz)
    features = replace(features, rate_hz=rate_hz, texture_samples=samples)
    cell = replace(rig.load_cell, rate_hz=rate_hz)
    return config, features, catalogue.with_rig(replace(rig, load_cell=cell))


class CleanTrials:
    """The motion of some trials of one label in one session, to be sensed in several ways."""

    def __init__(
        self,
        protocol: str,
        label: str,
        study: Study,
        config: TrialConfig,
        catalogue: Catalogue,
        session: int,
        count: int,
    ) -> None:
        self._draw = (catalogue, study.contact, protocol, label, study.seed, session, count, 0)
        request = TrialRequest(protocol, study.contact)
        self.planned = plan_trial(config, request, catalogue)
        speed_m_s = glide_speed_m_s(config, request)
        self._event = TrialEvent(
            0, 'trial', str(session), protocol, study.contact, label, '', '', speed_m_s, True
        )
        scene = build_scene(protocol, label, study.contact, catalogue)
        self._cell = scene.rig.load_cell
        variation, _ = draw_variation(*self._draw)
        phase = np.floor(variation.phase * STEPS_PER_SAMPLE) / STEPS_PER_SAMPLE
        motion = simulate_motion(scene, self.planned.timeline, replace(variation, phase=phase))
        self._times_s, self._sensed_n = motion.sample_times_s, motion.sensed_n

    def sense(self, sensing: Sensing) -> FloatArray:
        """Return the readings, shape (trials, samples) [N]; NaN where a trial failed."""
        variation, generators = draw_variation(*self._draw)
        stated = {'noise_n': sensing.noise_n, 'drift_n_rt_s': sensing.drift_n_rt_s}
        changes = {name: value for name, value in stated.items() if value is not None}
        cell = replace(self._cell, **changes)
        clean_n = self._sensed_n
        if sensing.jitter:
            shaken = [self._shake(row, sensing.jitter, i) for i, row in enumerate(clean_n)]
            clean_n = np.array(shaken)
        return read_tension(cell, clean_n, variation.sensor_bias_n, generators)

    def make_generator(self, what: str, trial: int) -> np.random.Generator:
        """Return numbers of a trial's own, the same ones at each strength."""
        _, contact, protocol, label, seed, session, *_ = self._draw
        return make_generator(what, seed, session, protocol, contact, label, trial)

    def _shake(self, clean_n: FloatArray, jitter: float, trial: int) -> FloatArray:
        """Return what is sampled a little too early or late, from a spline through the samples."""
        if not np.isfinite(clean_n).all():
            return clean_n
        times_s = self._times_s
        late = jitter * self.make_generator('jitter', trial).standard_normal(len(times_s))
        at_s = np.clip(times_s + late * self._cell.period_s, times_s[0], times_s[-1])
        return np.asarray(CubicSpline(times_s, clean_n)(at_s))

    def extract(self, sensing: Sensing, config: FeatureConfig) -> list[FloatArray | None]:
        """Return the features of each trial, or None where there are none."""
        rows: list[FloatArray | None] = []
        for i, tension_n in enumerate(self.sense(sensing)):
            kept = np.isfinite(tension_n)
            kept &= self.make_generator('loss', i).random(len(kept)) >= sensing.lost
            rows.append(self._extract_one(tension_n, kept, config))
        return rows

    def _extract_one(
        self, tension_n: FloatArray, kept: NDArray[np.bool_], config: FeatureConfig
    ) -> FloatArray | None:
        extractor = TrialFeatureExtractor(config)
        for phase, at_s in self.planned.phases:
            stamp_ns = EPOCH_NS + round(at_s * 1e9)
            extractor.add_event(replace(self._event, stamp_ns=stamp_ns, phase=phase))
        period_ns = round(1e9 / config.rate_hz)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]])))
        windows = []
        for first, end in edges.reshape(-1, 2).tolist():
            stamp_ns = EPOCH_NS + round(first * 1e9 / config.rate_hz)
            block = StrainBlock(stamp_ns, first, period_ns, tension_n[first:end])
            windows += extractor.add_block(block)
        windows += extractor.finish()
        usable = [window.values for window in windows if window.outcome == Outcome.OK]
        return usable[0] if usable else None
