# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Choice between calibrated probabilities and raw scores for a model file.

A calibration map that was fitted to one of two unlike sessions can be worse in the other than
no map. docs/results.md has the measurements behind the rule.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from tactile_classifier.records import MARGIN

FLOOR = 1e-3
"""A smaller stated probability of the true label counts as this much: votes may state 0."""

Matrix = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclasses.dataclass(frozen=True)
class ScoreChoice:
    """Held-out log losses of raw scores and of calibrated probabilities.

    Attributes
    ----------
    log_loss_raw, log_loss_calibrated : float
        Mean over sessions of the mean log loss of their trials, in natural units [1].
    margin : float
        What the calibrated log loss must exceed the raw one by before raw scores are kept [1].
    keeps_raw : bool
    """

    log_loss_raw: float
    log_loss_calibrated: float
    margin: float
    keeps_raw: bool

    @classmethod
    def compare(
        cls,
        raw: Matrix,
        calibrated: Matrix,
        true: Indices,
        session: Indices | None,
        score_kind: str,
    ) -> ScoreChoice:
        """Compare held-out probabilities, session by session.

        The margin is the larger of two: the standard error of the mean difference over sessions,
        and what one further miss at a stated certainty would add to the raw loss. With two
        sessions, a mean above its standard error means that calibration is worse in both.

        Raw scores are kept with two sessions alone. The map in the file is fitted to all
        sessions, each one that is compared to all but one: from three sessions on the comparison
        says little of the map in the file. Votes are always calibrated: they state certainties,
        and each miss in a new session would be one at certainty.

        Parameters
        ----------
        raw, calibrated : ndarray of shape (trials, labels)
            Probabilities of held-out trials. The map behind the calibrated ones was fitted to
            other sessions.
        true : ndarray of int, shape (trials,)
            Column of the true label.
        session : ndarray of int, shape (trials,), or None
            Session of each trial; None where single trials were held out.
        score_kind : str
            What the raw scores are; see Classification.msg.
        """
        group = np.zeros(len(true), dtype=np.intp) if session is None else session
        losses = [
            np.array([compute_log_loss(each, true, group == i) for i in np.unique(group)])
            for each in (raw, calibrated)
        ]
        worse = losses[1] - losses[0]
        miss = -np.log(FLOOR) / (len(true) + 1)
        error = worse.std(ddof=1) / np.sqrt(len(worse)) if len(worse) > 1 else 0.0
        margin = float(max(error, miss))
        return cls(
            log_loss_raw=float(losses[0].mean()),
            log_loss_calibrated=float(losses[1].mean()),
            margin=margin,
            keeps_raw=score_kind == MARGIN and len(worse) == 2 and bool(worse.mean() > margin),
        )


def compute_log_loss(
    probabilities: Matrix, true: Indices, chosen: npt.NDArray[np.bool_] | slice = slice(None)
) -> float:
    """Return the mean of ``-log(probability of the true label)``, at most ``-log(FLOOR)``."""
    stated = probabilities[np.arange(len(true)), true][chosen]
    return float(-np.log(np.maximum(stated, FLOOR)).mean())
