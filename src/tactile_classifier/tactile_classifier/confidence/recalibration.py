# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Effects of sessions on features and novelty, learned from a training with several sessions."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.calibration import GroupFolds
from tactile_classifier.confidence.novelty import NoveltyMeasure
from tactile_classifier.confidence.session_statistics import SessionStatistics, TINY, TRIALS
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.estimators.classifiers import RANDOM_STATE

_DRAWS = 8  # of known trials in each session of the training

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


def fit_session_statistics(
    table: FeatureTable, folds: GroupFolds, metric: str, false_alarm_rate: float
) -> SessionStatistics | None:
    """Return the statistics of a training, or None where it has no sessions.

    Each held-out session is recalibrated with `TRIALS` of its own trials, several times. The
    threshold is the quantile of its other trials' novelties, pooled over all, that rejects a share
    ``false_alarm_rate`` of known trials, on average over sessions [1]. ``metric`` is that of the
    model's `NoveltyMeasure`.
    """
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
        *_fit_offsets(values, label, folds.session),
        weight=weight,
        centre=centre,
        log_threshold=quantile,
    )


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
