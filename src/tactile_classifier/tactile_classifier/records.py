# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the classifier says of a window, and the node's parameters, free of ROS.

The constants repeat those of Classification.msg; a test keeps them equal.
"""

from __future__ import annotations

import dataclasses
from enum import IntEnum
from typing import Any

from tactile_features.config import FeatureConfig
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

UNKNOWN, NO_ANSWER = '(unknown)', '(no answer)'
"""In a column of answers, in place of a label: too novel, and no features or scores."""


class Outcome(IntEnum):
    """How the classification of one window ended."""

    LABEL = 0
    UNKNOWN = 1
    NO_FEATURES = 2


@dataclasses.dataclass(frozen=True)
class ClassificationResult:
    """What one model says of one window of features.

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
    partial, decided : bool
        An answer on the first part of a window, and whether the stopping rule holds.
    error_rate : float
        Share of wrong answers that the stopping rule allows [1]; negative: no rule.
    recalibration_trials : int
        Known trials of the session that the model was recalibrated with [1]; 0: none.
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
    partial: bool = False
    decided: bool = True
    error_rate: float = -1.0
    recalibration_trials: int = 0


def _feature_parameter(name: str) -> Any:
    """Return the field of that name in FeatureConfig, so that both nodes read one YAML."""
    source = FeatureConfig.__dataclass_fields__[name]
    return dataclasses.field(default=source.default, metadata=source.metadata)


@dataclasses.dataclass(frozen=True)
class ClassifierConfig:
    """Which model, and which features the feature node sends.

    The feature parameters must be those of the feature node: a model that was
    trained on others is refused.
    """

    model: str = parameter('', 'path of the model file')
    task: str = parameter(
        'texture',
        'what the model must have been trained for',
        choices=TASKS,
    )
    contact: str = parameter(
        '',
        'classify windows of this contact only; empty: of any',
        choices=('', *CONTACTS),
    )
    recalibration_trials: int = parameter(
        0,
        'number of trials at the start of each session to recalibrate with, whose object_label '
        'is stated and known to the model; 0: do not, otherwise 5 or more',
        unit='1',
        range=(0, 1000),
    )
    vision_messages: bool = parameter(
        False,
        'publish vision_msgs/Classification, too; that package must be installed',
    )
    rate_hz: float = _feature_parameter('rate_hz')
    texture_samples: int = _feature_parameter('texture_samples')
    texture_crop_start_s: float = _feature_parameter('texture_crop_start_s')
    texture_features: str = _feature_parameter('texture_features')
    spectrum_detrend: str = _feature_parameter('spectrum_detrend')
    spectrum_window: str = _feature_parameter('spectrum_window')
    spatial_crop_m: float = _feature_parameter('spatial_crop_m')
    spatial_length_m: float = _feature_parameter('spatial_length_m')
    spatial_finest_m: float = _feature_parameter('spatial_finest_m')
    stiffness_features: str = _feature_parameter('stiffness_features')
    stiffness_settle_s: float = _feature_parameter('stiffness_settle_s')
    stiffness_samples: int = _feature_parameter('stiffness_samples')
    stiffness_crop_end_s: float = _feature_parameter('stiffness_crop_end_s')
    max_gap_samples: int = _feature_parameter('max_gap_samples')

    def feature_config(self) -> FeatureConfig:
        """Return the feature node's configuration as far as a model depends on it."""
        shared = FeatureConfig.__dataclass_fields__.keys() & self.__dataclass_fields__.keys()
        values = {name: getattr(self, name) for name in shared}
        # No model depends on the buffer, and this one allows every window.
        return FeatureConfig(**values, buffer_s=600.0)

    def takes_contact(self, contact: str) -> bool:
        """Return whether a contact is the wanted one, or one of the two is not stated."""
        return len({self.contact, contact} - {''}) < 2
