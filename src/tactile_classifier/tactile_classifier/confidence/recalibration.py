# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A few known trials at the start of a session: offset of its features, threshold of novelty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.calibration import Deal
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError, TooFewTrialsError
from tactile_classifier.estimators.classifiers import RANDOM_STATE

TRIALS = 5
"""Known trials of a new session that are needed, and that training draws for a trial run."""

_DRAWS = 8  # of known trials in each session of the training

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclasses.dataclass(frozen=True, eq=False)
class SessionStatistics:
    """What sessions do to features and novelty, and how far known trials mend it.

    Attributes
    ----------
    means : ndarray of shape (labels, k)
        Mean features of each label over the training, in the order of the labels.
    share : ndarray of shape (k,)
        Part of the mean deviation of `TRIALS` known trials from their labels' means that is taken
        for the session's: its variance over that plus the variance of the mean (empirical
        Bayes, one factor a feature) [1].
    weight : float
        Of the known trials' mean log novelty in the threshold, by least squares [1].
    centre : float
        Mean of that in training sessions.
    log_threshold : float
        Logarithm of the threshold where the known trials lie at ``centre``.
    """

    means: Matrix
    share: Matrix
    weight: float
    centre: float
    log_threshold: float

    @classmethod
    def fit(
        cls, table: FeatureTable, dealt: Deal, metric: str, false_alarm_rate: float
    ) -> SessionStatistics | None:
        """Return the statistics of a training, or None where it has no sessions.

        Each held-out session is recalibrated with `TRIALS` of its own trials, several times. The
        threshold is the quantile of its other trials' novelties, pooled over all.

        Parameters
        ----------
        table : FeatureTable
        dealt : Deal
        metric : str
            That of the model's `NoveltyMeasure`.
        false_alarm_rate : float
            Share of known trials that may be turned away, on average over sessions [1].
        """
        if dealt.session is None:
            return None
        values, label = table.values, np.unique(table.labels, return_inverse=True)[1]
        generator = np.random.default_rng(RANDOM_STATE)
        runs: list[tuple[float, Matrix]] = []
        for part in np.unique(dealt.fold):
            inside = dealt.fold != part
            means, share = _fit_offsets(values[inside], label[inside], dealt.session[inside])
            measure = NoveltyMeasure.fit(
                values[inside], table.labels[inside], dealt.fold[inside], metric
            )
            for session in np.unique(dealt.session[~inside]):
                (trials,) = np.nonzero(dealt.session == session)
                if len(trials) <= TRIALS:
                    continue
                for _ in range(_DRAWS):
                    mixed = generator.permutation(trials)
                    known = mixed[:TRIALS]
                    offset = share * (values[known] - means[label[known]]).mean(axis=0)
                    novelty = np.log(measure.compute(values[mixed] - offset) + _TINY)
                    runs.append((float(novelty[:TRIALS].mean()), novelty[TRIALS:]))
        if not runs:
            return None
        known_mean = np.array([mean for mean, _ in runs])
        others = np.array([novelty.mean() for _, novelty in runs])
        centre, spread = float(known_mean.mean()), float(known_mean.var())
        slope = np.mean((known_mean - centre) * (others - others.mean())) / max(spread, _TINY)
        weight = float(np.clip(slope, 0.0, 1.0))
        left = np.concatenate([novelty - weight * (mean - centre) for mean, novelty in runs])
        quantile = float(np.quantile(left, 1.0 - false_alarm_rate))
        return cls(
            *_fit_offsets(values, label, dealt.session),
            weight=weight,
            centre=centre,
            log_threshold=quantile,
        )

    def recalibrate(
        self, values: Matrix, label: Indices, compute_novelty: Callable[[Matrix], Matrix]
    ) -> tuple[Matrix, float]:
        """Return the session's offset of the features, and its novelty threshold.

        Parameters
        ----------
        values : ndarray of shape (trials, k)
            Of known trials of the session.
        label : ndarray of int, shape (trials,)
            Position of each label among the model's.
        compute_novelty : callable
            The model's novelty of features.

        Raises
        ------
        TooFewTrialsError
            When there are fewer than `TRIALS`.
        """
        if len(values) < TRIALS:
            raise TooFewTrialsError(
                f'{len(values)} known trials cannot recalibrate a model; {TRIALS} are needed'
            )
        offset = self.share * (values - self.means[label]).mean(axis=0)
        known = float(np.log(compute_novelty(values - offset) + _TINY).mean())
        return offset, math.exp(self.log_threshold + self.weight * (known - self.centre))

    def to_dict(self) -> dict[str, Any]:
        """Return the statistics as what JSON can hold, without loss."""
        return {
            'means': self.means.tolist(),
            'share': self.share.tolist(),
            'weight': self.weight,
            'centre': self.centre,
            'log_threshold': self.log_threshold,
        }

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any], labels: int, features: int) -> SessionStatistics:
        """Return what `to_dict` gave.

        Raises
        ------
        ModelFileError
            When a number is missing or not finite, or a shape does not fit.
        """
        try:
            means, share = (np.array(entry[name], dtype=np.float64) for name in ('means', 'share'))
            rest = [float(entry[name]) for name in ('weight', 'centre', 'log_threshold')]
        except (KeyError, TypeError, ValueError) as error:
            raise ModelFileError(f'its statistics of sessions are damaged: {error}') from error
        fits = means.shape == (labels, features) and share.shape == (features,)
        if not fits or not all(np.isfinite(item).all() for item in (means, share, rest)):
            raise ModelFileError('its statistics of sessions do not fit its labels and features')
        return cls(means, share, *rest)


_TINY = 1e-12
"""So that a trial of novelty 0, a copy of a training trial, has a logarithm."""


def _fit_offsets(values: Matrix, label: Indices, session: Indices) -> tuple[Matrix, Matrix]:
    """Return the labels' means, and the share of a deviation that is the session's.

    Labels that do not occur have a mean of 0.
    """
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
