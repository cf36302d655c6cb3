# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recalibration: effects of sessions on features and novelty, mended by a few known trials.

Without scikit-learn until a training is fitted: the classifier node takes it, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
import math
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import ModelFileError, refuse_damage, TooFewTrialsError

if TYPE_CHECKING:
    from tactile_classifier.confidence.calibration import GroupFolds
    from tactile_classifier.datasets.dataset import FeatureTable

TRIALS = 5
"""Known trials of a new session that are needed, and that training draws for a trial run."""

TINY = 1e-12
"""So that a trial of novelty 0, a copy of a training trial, has a logarithm."""

_DRAWS = 8  # of known trials in each session of the training

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


class Correction(NamedTuple):
    """Offset of a session's features, shape (k,), and its threshold of novelty.

    ``trials`` counts the known trials behind them.
    """

    offset: Matrix
    novelty_threshold: float
    trials: int


@dataclasses.dataclass(frozen=True, eq=False)
class SessionStatistics:
    """Effects of sessions on features and novelty, and how far known trials mend them.

    ``means``, shape (labels, k), are the mean features of each label over the training. ``share``,
    shape (k,), is the part of the mean deviation of `TRIALS` known trials from these that is the
    session's: its variance over that plus the variance of the mean (empirical Bayes) [1].
    ``weight`` is that of the known trials' mean log novelty in the threshold, by least squares
    [1]; ``centre`` the mean of that in training sessions, and ``log_threshold`` the logarithm of
    the threshold there.
    """

    means: Matrix
    share: Matrix
    weight: float
    centre: float
    log_threshold: float

    def recalibrate(
        self, values: Matrix, label: Indices, compute_novelty: Callable[[Matrix], Matrix]
    ) -> Correction:
        """Return the correction of a session.

        Known trials have features of shape (trials, k) and the position of each label among the
        model's; ``compute_novelty`` is the model's. Raises TooFewTrialsError for fewer than
        `TRIALS`.
        """
        if len(values) < TRIALS:
            raise TooFewTrialsError(
                f'{len(values)} known trials cannot recalibrate a model; {TRIALS} are needed'
            )
        offset = self.share * (values - self.means[label]).mean(axis=0)
        known = float(np.log(compute_novelty(values - offset) + TINY).mean())
        threshold = math.exp(self.log_threshold + self.weight * (known - self.centre))
        return Correction(offset, threshold, len(values))

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics as what JSON can hold, without loss."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any], labels: int, features: int) -> SessionStatistics:
        """Return what `to_dict` gave; raise ModelFileError where it is damaged or does not fit."""
        with refuse_damage('its statistics of sessions are'):
            means, share = (np.array(entry[name], dtype=np.float64) for name in ('means', 'share'))
            rest = [float(entry[name]) for name in ('weight', 'centre', 'log_threshold')]
        fits = means.shape == (labels, features) and share.shape == (features,)
        if not fits or not all(np.isfinite(item).all() for item in (means, share, rest)):
            raise ModelFileError('its statistics of sessions do not fit its labels and features')
        return cls(means, share, *rest)


def fit_session_statistics(
    table: FeatureTable, folds: GroupFolds, metric: str, false_alarm_rate: float
) -> SessionStatistics | None:
    """Return the statistics of a training, or None where it has no sessions.

    Each held-out session is recalibrated with `TRIALS` of its own trials, several times. The
    threshold rejects a share ``false_alarm_rate`` of its other trials, on average over sessions
    [1]. ``metric`` is that of the model's `NoveltyMeasure`.
    """
    from tactile_classifier.confidence.novelty import NoveltyMeasure
    from tactile_classifier.estimators.classifiers import RANDOM_STATE

    if folds.session is None:
        return None
    values, label = table.values, np.unique(table.labels, return_inverse=True)[1]
    generator = np.random.default_rng(RANDOM_STATE)
    runs: list[tuple[float, Matrix]] = []
    for fold in np.unique(folds.fold):
        inside = folds.fold != fold
        means, share = _fit_offsets(values[inside], label[inside], folds.session[inside])
        measure = NoveltyMeasure.fit(
            values[inside], table.labels[inside], folds.fold[inside], metric
        )
        for session in np.unique(folds.session[~inside]):
            (trials,) = np.nonzero(folds.session == session)
            if len(trials) <= TRIALS:
                continue
            for _ in range(_DRAWS):
                mixed = generator.permutation(trials)
                known = mixed[:TRIALS]
                offset = share * (values[known] - means[label[known]]).mean(axis=0)
                novelty = np.log(measure.compute(values[mixed] - offset) + TINY)
                runs.append((float(novelty[:TRIALS].mean()), novelty[TRIALS:]))
    if not runs:
        return None
    known_mean = np.array([mean for mean, _ in runs])
    others = np.array([novelty.mean() for _, novelty in runs])
    centre, spread = float(known_mean.mean()), float(known_mean.var())
    slope = np.mean((known_mean - centre) * (others - others.mean())) / max(spread, TINY)
    weight = float(np.clip(slope, 0.0, 1.0))
    left = np.concatenate([novelty - weight * (mean - centre) for mean, novelty in runs])
    quantile = float(np.quantile(left, 1.0 - false_alarm_rate))
    return SessionStatistics(
        *_fit_offsets(values, label, folds.session), weight, centre, log_threshold=quantile
    )


def _fit_offsets(values: Matrix, label: Indices, session: Indices) -> tuple[Matrix, Matrix]:
    """Return the labels' means, 0 of absent ones, and the share that is the session's."""
    counts = np.bincount(label)
    means = np.zeros((len(counts), values.shape[1]))
    np.add.at(means, label, values)
    means /= np.maximum(counts, 1)[:, np.newaxis]
    residuals = values - means[label]
    sessions = np.unique(session)
    of_session = np.array([residuals[session == i].mean(axis=0) for i in sessions])
    within = residuals - of_session[np.searchsorted(sessions, session)]
    variance = (within**2).sum(axis=0) / max(len(values) - len(sessions), 1)
    between = of_session.var(axis=0, ddof=1) if len(sessions) > 1 else np.zeros(len(variance))
    between = np.maximum(between - variance * len(sessions) / len(values), 0.0)
    total = between + variance / TRIALS
    return means, np.divide(between, total, out=np.zeros_like(total), where=total > 0.0)
