# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classification results, model information, constants and display names, without ROS.

A test checks that the constants equal those in Classification.msg.
"""

from __future__ import annotations

import dataclasses
from enum import IntEnum

from tactile_features.types import (
    CONTACT_ABDUCTION,
    CONTACT_FLEXION,
    PROTOCOL_STIFFNESS,
    PROTOCOL_TEXTURE,
)

CLASSIFIERS = ('knn', 'svm_linear', 'svm_rbf', 'tree')
"""Classifiers of the paper: three nearest neighbours, support vector machines, decision tree."""

NEIGHBOURS = 3
"""Number of neighbours of the nearest-neighbour classifier."""

ROCKET = 'rocket'
"""Random convolutions with a ridge classifier, for feature sets that are waveforms."""

ALL_CLASSIFIERS = (*CLASSIFIERS, ROCKET)

SCALINGS = ('standard', 'none')
"""``standard``: features have zero mean and unit variance over the training trials. ``none``:
features are unchanged."""

TASKS = (PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS)

CONTACTS = (CONTACT_FLEXION, CONTACT_ABDUCTION)

VOTES = 'votes'
MARGIN = 'margin'
PROBABILITY = 'probability'

UNKNOWN, NO_ANSWER = 'unknown', 'no answer'
"""``unknown`` replaces the label if the window is too novel. ``no answer`` replaces it if the
window has no features or no finite scores."""


class PredictionOutcome(IntEnum):
    """Result of the classification of one window."""

    LABEL = 0
    UNKNOWN = 1
    NO_FEATURES = 2


@dataclasses.dataclass(frozen=True)
class WindowPrediction:
    """Result of one model for one window of features.

    Attributes
    ----------
    label : str
        Predicted label; empty unless ``outcome`` is ``PredictionOutcome.LABEL``.
    reason : str
        One sentence if ``outcome`` is not ``PredictionOutcome.LABEL``; empty otherwise.
    labels, scores : tuple
        The labels, and one score for each of them; a higher score means a more likely label. If
        the window has no features, ``scores`` is empty.
    score_kind : str
        ``votes``, ``margin`` or ``probability``.
    novelty, novelty_threshold : float
        Negative if the model has no novelty measure.
    false_alarm_rate : float
        Fraction of windows of known labels that the threshold may reject [1]; negative if there is
        no threshold.
    window_start_ns, window_end_ns : int
        Stamps of the first and last sample of the window (ROS time) [ns].
    """

    task: str
    trial_id: str
    contact: str
    model_id: str
    simulated: bool
    outcome: PredictionOutcome
    label: str
    reason: str
    labels: tuple[str, ...]
    scores: tuple[float, ...]
    score_kind: str
    novelty: float
    novelty_threshold: float
    window_start_ns: int
    window_end_ns: int
    frame_id: str
    false_alarm_rate: float = -1.0

    @property
    def window_s(self) -> float:
        """Time from the first to the last sample of the window [s]."""
        return (self.window_end_ns - self.window_start_ns) / 1e9


@dataclasses.dataclass(frozen=True)
class ModelInfo:
    """A model that a classifier node has loaded; the fields are the same as in ModelInfo.msg."""

    model_id: str
    path: str
    sha256: str
    task: str
    contact: str
    labels: tuple[str, ...]
    specification_digest: str
    simulated: bool
    contact_filter: str = ''


@dataclasses.dataclass(frozen=True)
class ModelInfos:
    """All models that a classifier node has loaded, and one sentence for each refused file.

    ``stamp_ns`` is the time at which the node was configured (ROS time) [ns].
    """

    models: tuple[ModelInfo, ...]
    refused: tuple[str, ...] = ()
    stamp_ns: int = 0


CLASSIFIER_TITLES = {
    'knn': '3 nearest neighbours',
    'svm_linear': 'SVM, linear kernel',
    'svm_rbf': 'SVM, RBF kernel',
    'tree': 'decision tree',
    'rocket': 'random convolutions, ridge',
}

SCALING_TITLES = {
    'standard': 'scaled (zero mean, unit variance)',
    'none': 'not scaled',
}


def short_scaling(scaling: str) -> str:
    """Return ``scaled`` or ``not scaled``."""
    return SCALING_TITLES[scaling].partition(' (')[0]
