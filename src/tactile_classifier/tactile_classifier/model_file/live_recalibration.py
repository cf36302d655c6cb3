# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A model that the first known trials of each session correct, while they come."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.session_statistics import SessionStatistics, TRIALS
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.inference import Correction, TactileModel
from tactile_classifier.records import ClassificationResult
from tactile_features.records import FeatureWindow
from tactile_features.records import Outcome as FeatureOutcome

STATISTICS, RECALIBRATED = 'session_statistics', 'recalibrated'
"""Entries of a manifest's ``calibration``."""

Matrix = npt.NDArray[np.float64]


@dataclasses.dataclass
class _Session:
    """Known trials of one session so far, and their correction."""

    session_id: str
    values: list[Matrix] = dataclasses.field(default_factory=list)
    labels: list[int] = dataclasses.field(default_factory=list)
    correction: Correction | None = None


class LiveRecalibration:
    """Answers with a model, recalibrated by the first known trials of each session.

    A trial is known when its window states an ``object_label`` that the model knows. It is
    answered first, and counts for the windows after it. Once there are enough, the correction
    stays until a window states another ``session_id``. The answers are those of the file that
    `recalibrate` would write for the same trials, to the last bit.

    Full windows and each length of partial windows count by themselves, because they arrive
    on topics of their own. So the answers depend on the order of each topic alone, and a replay
    repeats them. The model and its file stay as they are.

    Parameters
    ----------
    model : TactileModel
    trials : int
        Known trials to wait for, `TRIALS` or more; 0: answer with the model as it is.

    Raises
    ------
    ModelFileError
        When the model cannot be recalibrated, or ``trials`` are too few.
    """

    def __init__(self, model: TactileModel, trials: int) -> None:
        check_trials(trials)
        self.model = model
        self._trials = trials
        self._statistics = read_statistics(model) if trials else {}
        self._sessions: dict[int, _Session] = {}

    def classify(self, window: FeatureWindow) -> ClassificationResult:
        """Return the answer on a window that the model accepts, and learn from it."""
        if not self._trials:
            return self.model.classify_window(window)
        stage = window.sample_count if window.partial else 0
        session = self._sessions.get(stage)
        if session is None or session.session_id != window.session_id:
            session = self._sessions[stage] = _Session(window.session_id)
        answer = self.model.classify_window(window, session.correction)
        if session.correction is None and self._is_known(window):
            session.values.append(window.values)
            session.labels.append(self.model.labels.index(window.object_label))
            if len(session.values) == self._trials:
                session.correction = self._correct(stage, session)
        return answer

    def _is_known(self, window: FeatureWindow) -> bool:
        return (
            window.object_label in self.model.labels
            and window.outcome == FeatureOutcome.OK
            and not self.model.format_mismatch(window)
            and bool(np.isfinite(window.values).all())
        )

    def _correct(self, stage: int, session: _Session) -> Correction:
        offset, threshold = correct(
            self.model,
            self._statistics[stage],
            stage,
            np.array(session.values),
            np.array(session.labels),
        )
        return Correction(offset, threshold, len(session.values))


def check_trials(trials: int) -> None:
    """Raise ModelFileError when so few known trials cannot recalibrate a model."""
    if 0 < trials < TRIALS:
        raise ModelFileError(
            f'recalibration_trials is {trials}; it must be 0 or at least {TRIALS}'
        )


def read_statistics(model: TactileModel) -> dict[int, SessionStatistics]:
    """Return the statistics of sessions in a model's file, by samples of its stages.

    Raises
    ------
    ModelFileError
        When it was recalibrated already, states nothing, or is damaged.
    """
    manifest = model.manifest
    if RECALIBRATED in manifest.calibration:
        raise ModelFileError(
            f'model {model.model_id} is recalibrated: take the model that it came from, '
            f'{manifest.calibration[RECALIBRATED].get("model_id")}'
        )
    if STATISTICS not in manifest.calibration:
        raise ModelFileError(
            f'model {model.model_id} states nothing of sessions: train it on two sessions or more'
        )
    entries = manifest.calibration[STATISTICS]
    if not isinstance(entries, list) or len(entries) != len(manifest.stages):
        raise ModelFileError('its statistics of sessions are not one entry a stage')
    return {
        stage.sample_count: SessionStatistics.from_dict(
            entry, len(model.labels), len(manifest.spec.names)
        )
        for stage, entry in zip(manifest.stages, entries, strict=True)
    }


def correct(
    model: TactileModel,
    statistics: SessionStatistics,
    sample_count: int,
    values: Matrix,
    label: npt.NDArray[np.intp],
) -> tuple[Matrix, float]:
    """Return `SessionStatistics.recalibrate` by the model's novelty of so many samples."""
    return statistics.recalibrate(
        values, label, lambda moved: model.compute(moved, sample_count).novelty
    )
