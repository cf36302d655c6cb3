# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Answers of a model on many recorded trials, as the node would give on each."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.model_file.live_recalibration import RECALIBRATED

SAME_TRIAL = 1e-4
"""Novelty below which a trial is one of the training: its distance to a training trial, against
what is usual between trials of that label. Rounding gives below 1e-6, new trials give above 0.05.
"""


def name_trials(model: TactileModel, values: npt.NDArray[np.float64]) -> npt.NDArray[np.str_]:
    """Return `TactileModel.predict` of full windows."""
    return model.predict(values)


def find_training_trials(
    model: TactileModel, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_] | None:
    """Return which trials the model was trained on; None: its file does not tell.

    A calibrated model measures novelty from its training trials, so these have none. A model
    without novelty, or recalibrated for a session, does not tell.

    Parameters
    ----------
    model : TactileModel
    values : ndarray of shape (trials, k)
    """
    if RECALIBRATED in model.manifest.calibration or not len(values):
        return None
    novelty = model.compute(values).novelty
    return novelty < SAME_TRIAL if len(novelty) else None
