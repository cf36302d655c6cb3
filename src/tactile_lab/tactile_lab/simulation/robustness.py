# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Robustness study: accuracy on simulated trials as one condition at a time gets worse.

Sensor effects (noise, drift, lost samples, jitter) are added to the same clean motion. For other
speeds, depths and sample rates the motion is simulated anew. Features come from the extractor of
the live node. Training and tests are in different sessions: the rig is set up anew between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from joblib import delayed, Parallel
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import glide_speed_m_s, TrialRequest
from tactile_classifier.estimators.classifiers import build_estimator, DEFAULT_SCALING
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.records import Outcome, PROTOCOL_STIFFNESS, PROTOCOL_TEXTURE, TrialEvent
from tactile_lab.simulation.robustness_axes import list_axes, Sensing, Setting
from tactile_lab.simulation.simulated_trials import EPOCH_NS, plan_trial, PlannedTrial
from tactile_ros.strain import StrainBlock
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.sensing import read_tension
from tactile_sim.physics.trials import simulate_motion, STEPS_PER_SAMPLE
from tactile_sim.physics.variation import draw_variation, make_generator

FloatArray = NDArray[np.float64]

CLASSIFIER = 'knn'
"""With the default scaling of its task: what `tactile train` writes when nothing is asked for."""

_GLIDE_S = 4.2  # long enough for the window at any speed, where the plate is

_Row = tuple[str, FloatArray | None]
"""Label and features of a trial; None: it gave none."""


@dataclass(frozen=True)
class Point:
    """Accuracies in one condition.

    Attributes
    ----------
    nominal, matched : float or None
        Accuracy on all tested trials of a model trained at the nominal condition, and of one
        trained in this condition [1]; None: not computed.
    refused : float
        Share of tested trials that gave no features [1].
    """

    protocol: str
    axis: str
    value: float
    nominal: float | None
    matched: float | None
    refused: float


@dataclass(frozen=True)
class Study:
    """Contact, seed and set sizes of the simulated trials of a study.

    Attributes
    ----------
    train_sessions, test_sessions : int
        Number of sessions; test sessions come after training sessions.
    train_trials, test_trials : int
        Trials of each label in each session.
    """

    contact: str = 'flexion'
    seed: int = 1
    train_sessions: int = 3
    test_sessions: int = 3
    train_trials: int = 8
    test_trials: int = 4


@dataclass(frozen=True)
class _Features:
    """Features and labels of those of some trials that have any."""

    values: FloatArray
    labels: NDArray[np.str_]
    trials: int


def run_study(
    study: Study,
    catalogue: Catalogue,
    *,
    jobs: int | None = -1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Point]:
    """Simulate all conditions and return what the classifiers make of them."""
    axes = list_axes(catalogue.rig().load_cell, TrialConfig(simulated=True))
    work = []
    for protocol in (PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS):
        by_motion: dict[tuple[float | None, float, float | None], list[Setting]] = {}
        for axis in axes:
            for setting in axis.settings:
                if protocol == PROTOCOL_TEXTURE or axis.name != 'glide speed':
                    by_motion.setdefault(setting.motion, []).append(setting)
        work += [(protocol, tuple(settings)) for settings in by_motion.values()]
    found: dict[tuple[str, str, float], tuple[_Features, _Features]] = {}
    done = Parallel(n_jobs=jobs, return_as='generator')(
        delayed(make_features)(study, catalogue, protocol, settings) for protocol, settings in work
    )
    for i, ((protocol, settings), features) in enumerate(zip(work, done, strict=True)):
        for setting, pair in zip(settings, features, strict=True):
            found[protocol, setting.axis, setting.value] = pair
        progress(i + 1, len(work))
    points = []
    for protocol in (PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS):
        usual = found[protocol, 'contact depth', 1.0][0]
        for axis in axes:
            for setting in axis.settings:
                pair = found.get((protocol, axis.name, setting.value))
                if pair is not None:
                    trained = usual if axis.trains_elsewhere else None
                    points.append(_judge(protocol, setting, trained, *pair))
    return points


def _judge(
    protocol: str, setting: Setting, usual: _Features | None, train: _Features, test: _Features
) -> Point:
    return Point(
        protocol,
        setting.axis,
        setting.value,
        None if usual is None else score(protocol, usual, test),
        score(protocol, train, test),
        1.0 - len(test.labels) / test.trials,
    )


def score(protocol: str, train: _Features, test: _Features) -> float | None:
    """Return the share of all tested trials named correctly; None: nothing to train on."""
    if len(train.labels) < 3 or len(np.unique(train.labels)) < 2:
        return None
    if not len(test.labels):
        return 0.0
    estimator = build_estimator(CLASSIFIER, DEFAULT_SCALING[protocol])
    estimator.fit(train.values, train.labels)
    right = np.sum(estimator.predict(test.values) == test.labels)
    return float(right / test.trials)


def make_features(
    study: Study, catalogue: Catalogue, protocol: str, settings: Sequence[Setting]
) -> list[tuple[_Features, _Features]]:
    """Return features to train on and to test on, for settings that share their motion."""
    config, features, catalogue = _configure(study, catalogue, settings[0])
    rows: list[tuple[list[_Row], list[_Row]]] = [([], []) for _ in settings]
    for label in catalogue.labels(protocol):
        for session in range(study.train_sessions + study.test_sessions):
            is_test = session >= study.train_sessions
            count = study.test_trials if is_test else study.train_trials
            trials = CleanTrials(protocol, label, study, config, catalogue, session, count)
            for i, setting in enumerate(settings):
                policy = replace(features, max_gap_samples=setting.max_gap_samples)
                found = trials.extract(setting.sensing, policy)
                rows[i][is_test].extend((label, features) for features in found)
    return [(_gather(train), _gather(test)) for train, test in rows]


def _gather(rows: Sequence[_Row]) -> _Features:
    answered = [(label, values) for label, values in rows if values is not None]
    return _Features(
        np.array([values for _, values in answered]),
        np.array([label for label, _ in answered]),
        len(rows),
    )


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
    rig = catalogue.rig()
    rate_hz = setting.rate_hz or rig.load_cell.rate_hz
    features = FeatureConfig()
    window_s = features.texture_samples / features.rate_hz
    features = replace(
        features, rate_hz=rate_hz, texture_samples=round(window_s * rate_hz), measures=False
    )
    if rate_hz != rig.load_cell.rate_hz:
        cell = replace(rig.load_cell, rate_hz=rate_hz)
        catalogue = catalogue.with_rig(replace(rig, load_cell=cell))
    return config, features, catalogue


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
        self.planned: PlannedTrial = plan_trial(config, request, catalogue)
        self._event = TrialEvent(
            0,
            'trial',
            str(session),
            protocol,
            study.contact,
            label,
            '',
            simulated=True,
            glide_speed_m_s=glide_speed_m_s(config, request),
        )
        scene = build_scene(protocol, label, study.contact, catalogue)
        self._cell = scene.rig.load_cell
        variation, _ = draw_variation(*self._draw)
        phase = np.floor(variation.phase * STEPS_PER_SAMPLE) / STEPS_PER_SAMPLE
        motion = simulate_motion(scene, self.planned.timeline, replace(variation, phase=phase))
        self._times_s = motion.sample_times_s
        self._sensed_n = motion.sensed_n

    def sense(self, sensing: Sensing) -> FloatArray:
        """Return the readings, shape (trials, samples) [N]; NaN where a trial failed."""
        variation, generators = draw_variation(*self._draw)
        stated = {'noise_n': sensing.noise_n, 'drift_n_rt_s': sensing.drift_n_rt_s}
        changes = {name: value for name, value in stated.items() if value is not None}
        cell = replace(self._cell, **changes)
        clean_n = self._sensed_n
        if sensing.jitter:
            clean_n = np.array(
                [self._shake(row, sensing.jitter, i) for i, row in enumerate(clean_n)]
            )
        return read_tension(cell, clean_n, variation.sensor_bias_n, generators)

    def _generator(self, what: str, trial: int) -> np.random.Generator:
        """Return numbers of a trial's own, the same ones at each strength."""
        _, contact, protocol, label, seed, session, *_ = self._draw
        return make_generator(what, seed, session, protocol, contact, label, trial)

    def _shake(self, clean_n: FloatArray, jitter: float, trial: int) -> FloatArray:
        """Return what is sampled a little too early or late, from a spline through the samples."""
        if not np.isfinite(clean_n).all():
            return clean_n
        times_s = self._times_s
        late = jitter * self._generator('jitter', trial).standard_normal(len(times_s))
        at_s = np.clip(times_s + late * self._cell.period_s, times_s[0], times_s[-1])
        return np.asarray(CubicSpline(times_s, clean_n)(at_s))

    def extract(self, sensing: Sensing, config: FeatureConfig) -> list[FloatArray | None]:
        """Return the features of each trial, or None where there are none."""
        rows: list[FloatArray | None] = []
        for i, tension_n in enumerate(self.sense(sensing)):
            kept = np.isfinite(tension_n)
            kept &= self._generator('loss', i).random(len(kept)) >= sensing.lost
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
            windows += extractor.add_block(
                StrainBlock(stamp_ns, first, period_ns, tension_n[first:end])
            )
        windows += extractor.finish()
        usable = [window.values for window in windows if window.outcome == Outcome.OK]
        return usable[0] if usable else None


def describe(study: Study, catalogue: Catalogue, points: Sequence[Point]) -> dict[str, Any]:
    """Return the study as what JSON can hold."""
    axes = list_axes(catalogue.rig().load_cell, TrialConfig(simulated=True))
    return {
        'simulated': True,
        'study': asdict(study),
        'classifier': CLASSIFIER,
        'scaling': DEFAULT_SCALING,
        'split': (
            f'trained on sessions 0 to {study.train_sessions - 1}, tested on the '
            f'{study.test_sessions} after them'
        ),
        'description_sha256': catalogue.digest,
        'axes': [{'name': axis.name, 'unit': axis.unit, 'nominal': axis.nominal} for axis in axes],
        'points': [asdict(point) for point in points],
    }
