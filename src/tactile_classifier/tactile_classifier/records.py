# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers on windows, facts of models, the node's parameters and titles for people, free of ROS.

The constants repeat those of Classification.msg; a test keeps them equal.
"""

from __future__ import annotations

import dataclasses
from enum import IntEnum

from tactile_features.records import (
    CONTACT_ABDUCTION,
    CONTACT_FLEXION,
    PROTOCOL_STIFFNESS,
    PROTOCOL_TEXTURE,
)
from tactile_ros.configs import parameter

CLASSIFIERS = ('knn', 'svm_linear', 'svm_rbf', 'tree')
"""k nearest neighbours (3, Euclidean), support vector machines, decision tree: the paper's."""

ROCKET = 'rocket'
"""Random convolutions with a ridge classifier: for sets of features that are waveforms."""

ALL_CLASSIFIERS = (*CLASSIFIERS, ROCKET)

SCALINGS = ('standard', 'none')
"""Each feature to zero mean and unit variance over the training trials, or as it is."""

TASKS = (PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS)

CONTACTS = (CONTACT_FLEXION, CONTACT_ABDUCTION)

VOTES = 'votes'
MARGIN = 'margin'
PROBABILITY = 'probability'

UNKNOWN, NO_ANSWER = 'unknown', 'no answer'
"""In place of a label: too novel, and no features or scores."""


class Outcome(IntEnum):
    """Result of the classification of one window."""

    LABEL = 0
    UNKNOWN = 1
    NO_FEATURES = 2


@dataclasses.dataclass(frozen=True)
class ClassificationResult:
    """The answer of one model on one window of features.

    Attributes
    ----------
    label : str
        The answer; empty unless ``outcome`` is ``Outcome.LABEL``.
    reason : str
        One sentence when ``outcome`` is not ``Outcome.LABEL``; empty otherwise.
    labels, scores : tuple
        One score a label, larger is likelier; no scores without features.
    score_kind : str
        ``votes``, ``margin`` or ``probability``.
    novelty, novelty_threshold : float
        Negative: the model has none.
    false_alarm_rate : float
        Share of windows of known labels that the threshold rejects [1]; negative: none.
    window_start_ns, window_end_ns : int
        Times of the window's first and last sample (ROS time) [ns].
    """

    task: str
    trial_id: str
    contact: str
    model_id: str
    simulated: bool
    outcome: Outcome
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
    """One model that a classifier node answers with; the fields are those of ModelInfo.msg."""

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
    """All models that a classifier node answers with, and one sentence for each refused file.

    ``stamp_ns`` is the time of the configuration (ROS time) [ns].
    """

    models: tuple[ModelInfo, ...]
    refused: tuple[str, ...] = ()
    stamp_ns: int = 0


@dataclasses.dataclass(frozen=True)
class ClassifierConfig:
    """Parameters of the classifier node."""

    models: str = parameter('', 'folder with model files (*.npz), or one file; each answers')
    contact: str = parameter(
        '',
        'take models and classify windows of this contact only; empty: of any',
        choices=('', *CONTACTS),
    )
    vision_messages: bool = parameter(
        False,
        'publish vision_msgs/Classification, too; that package must be installed',
    )


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
