# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracy on simulated trials with one degraded condition of sensor or rig at a time.

Noise and lost samples are added to the same simulated motion. Other speeds and depths need a new
simulation. Features are computed by the extractor of the live node. Training and test trials are
from different sessions, that is, with a new set-up of the rig.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from joblib import delayed, Parallel
import numpy as np
from numpy.typing import NDArray

from benchmarks.measuring import Report, Row
from tactile_bringup.trial_protocols import glide_speed_m_s, TrialConfig, TrialRequest
from tactile_classifier.estimators.classifiers import build_estimator, DEFAULT_SCALING
from tactile_features.config import FeatureConfig
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.types import PROTOCOL_STIFFNESS, PROTOCOL_TEXTURE, TrialEvent, WindowOutcome
from tactile_lab.simulation.simulated_trials import EPOCH_NS, plan_trial
from tactile_ros.strain import StrainBlock
from tactile_sim.descriptions.catalogue import Catalogue, default_catalogue
from tactile_sim.physics.scene import build_scene
from tactile_sim.physics.sensing import read_tension
from tactile_sim.physics.trials import simulate_motion, STEPS_PER_SAMPLE
from tactile_sim.physics.variation import draw_variation, make_generator

FloatArray = NDArray[np.float64]

CLASSIFIER = 'knn'
_GLIDE_S = 4.2  # duration of the glide, long enough for the window at all speeds


@dataclass(frozen=True)
class Setting:
    """One condition of motion and sensor.

    ``noise_n`` is a standard deviation [N]; None selects the value in the description of the rig.
    ``lost`` is the probability of losing a sample. Gaps of up to ``max_gap_samples`` are
    interpolated; see `FeatureConfig`.
    """

    axis: str
    value: float
    glide_speed_m_s: float | None = None
    depth: float = 1.0
    noise_n: float | None = None
    lost: float = 0.0
    max_gap_samples: int = 0

    @property
    def motion(self) -> tuple[float | None, float]:
        """Values that define the motion. If they differ, the motion must be simulated again."""
        return self.glide_speed_m_s, self.depth


USUAL = Setting('contact depth (1)', 1.0)


@dataclass(frozen=True)
class Study:
    """Contact, seed, numbers of sessions, and numbers of trials per label and session."""

    contact: str = 'flexion'
    seed: int = 1
    train_sessions: int = 3
    test_sessions: int = 3
    train_trials: int = 8
    test_trials: int = 4


@dataclass(frozen=True)
class Features:
    """Features and labels of the trials that have features, and the number of all trials."""

    values: FloatArray
    labels: NDArray[np.str_]
    trials: int


def list_settings(noise_n: float, speed_m_s: float) -> list[Setting]:
    """Return the tested conditions, for a rig with this noise and this speed by default."""
    lost = (0.0, 0.003, 0.01, 0.03, 0.1)
    found = [
        Setting('noise (N)', noise_n * s, noise_n=noise_n * s) for s in (1.0, 3.0, 10.0, 30.0)
    ]
    found += [Setting('lost samples (1)', share, lost=share) for share in lost]
    found += [
        Setting('lost, gaps bridged (1)', share, lost=share, max_gap_samples=3) for share in lost
    ]
    speeds_m_s = (0.005, 0.010, 0.0135, speed_m_s, 0.0165)
    found += [Setting('glide speed (m/s)', v, glide_speed_m_s=v) for v in speeds_m_s]
    return [*found, *(replace(USUAL, value=d, depth=d) for d in (0.8, 0.9, 1.0, 1.1))]


def run_robustness(quick: bool) -> Report:
    """Simulate all conditions, and measure the accuracy of a nearest-neighbour classifier."""
    study = Study(train_sessions=1, test_sessions=1, train_trials=4) if quick else Study()
    catalogue = default_catalogue()
    speed_m_s = TrialConfig().glide_speed_m_s
    settings = list_settings(catalogue.rig().load_cell.noise_n, speed_m_s)
    rows = [
        row
        for protocol in (PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS)
        for row in _run_protocol(study, catalogue, protocol, settings)
    ]
    return Report(
        f'robustness: SIMULATED trials, {study.contact}, {CLASSIFIER} with the default scaling',
        '',
        f'accuracy [%], trained under usual conditions or as tested, on {study.train_sessions} '
        f'sessions; tested on {study.test_sessions} other sessions; trials without features [%]',
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
    usual, _ = of[USUAL]
    for setting, (train, test) in of.items():
        shares = {
            'as usual': score(protocol, usual, test),
            'as tested': score(protocol, train, test),
            'none': 1.0 - len(test.labels) / test.trials,
        }
        more = {k: 'none' if v is None else round(100 * v) for k, v in shares.items()}
        yield Row(f'{protocol}, {setting.axis}: {setting.value:.3g}', more=more)


def score(protocol: str, train: Features, test: Features) -> float | None:
    """Return the accuracy over all test trials, or None if there are too few training trials.

    Test trials without features count as wrong.
    """
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
    """Return training and test features for settings with the same motion."""
    config = _configure(study, settings[0])
    rows: list[tuple[list[Any], list[Any]]] = [([], []) for _ in settings]
    for label in catalogue.labels(protocol):
        for session in range(study.train_sessions + study.test_sessions):
            is_test = session >= study.train_sessions
            count = study.test_trials if is_test else study.train_trials
            trials = CleanTrials(protocol, label, study, config, catalogue, session, count)
            for i, setting in enumerate(settings):
                found = trials.extract(setting)
                rows[i][is_test].extend((label, values) for values in found)
    return [(_gather(train), _gather(test)) for train, test in rows]


def _gather(rows: Sequence[tuple[str, FloatArray | None]]) -> Features:
    answered = [(label, values) for label, values in rows if values is not None]
    values = np.array([values for _, values in answered])
    return Features(values, np.array([label for label, _ in answered]), len(rows))


def _configure(study: Study, setting: Setting) -> TrialConfig:
    usual = TrialConfig()
    speed_m_s = setting.glide_speed_m_s or usual.glide_speed_m_s
    depth = f'{study.contact}_displacement_m'
    return replace(
        usual,
        glide_speed_m_s=speed_m_s,
        glide_length_m=min(usual.glide_length_m, speed_m_s * _GLIDE_S),
        **{depth: getattr(usual, depth) * setting.depth},
    )


class CleanTrials:
    """Simulated motion of several trials of one label in one session.

    The readings of different sensors can be computed from the same motion.
    """

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
        self._sensed_n = motion.sensed_n

    def sense(self, noise_n: float | None = None) -> FloatArray:
        """Return the readings of a sensor, shape (trials, samples) [N]; NaN if a trial failed."""
        variation, generators = draw_variation(*self._draw)
        cell = self._cell if noise_n is None else replace(self._cell, noise_n=noise_n)
        return read_tension(cell, self._sensed_n, variation.sensor_bias_n, generators)

    def draw_losses(self, trial: int, count: int) -> FloatArray:
        """Return a random number from 0 to 1 per sample, the same for all loss rates."""
        _, contact, protocol, label, seed, session, *_ = self._draw
        return make_generator('loss', seed, session, protocol, contact, label, trial).random(count)

    def extract(self, setting: Setting) -> list[FloatArray | None]:
        """Return the features of each trial, or None for trials without features."""
        config = FeatureConfig(max_gap_samples=setting.max_gap_samples)
        rows: list[FloatArray | None] = []
        for i, tension_n in enumerate(self.sense(setting.noise_n)):
            kept = np.isfinite(tension_n) & (self.draw_losses(i, len(tension_n)) >= setting.lost)
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
        usable = [window.values for window in windows if window.outcome == WindowOutcome.OK]
        return usable[0] if usable else None
