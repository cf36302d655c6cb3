# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The manifest of a model file: facts about the model, as JSON inside the ONNX file."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import math
from typing import Any, TypeVar

from tactile_classifier.errors import ModelFileError
from tactile_classifier.records import (
    ALL_CLASSIFIERS,
    MARGIN,
    PROBABILITY,
    SCALINGS,
    VOTES,
)
from tactile_features.model_contract import (
    check_version,
    DIGEST,
    FORMAT_VERSION,
    parse_wanted,
)
from tactile_features.spec import FeatureSpec


@dataclasses.dataclass(frozen=True)
class Stage:
    """Thresholds of the answers on one length of window.

    Attributes
    ----------
    sample_count : int
        Samples in the window; 0: the full window.
    novelty_threshold : float
        Novelty above which the answer is "unknown" [1]; negative: there is no novelty.
    stop_threshold : float
        Probability of the answer from which one need not wait for more samples [1];
        negative: never.
    calibration_error_before, calibration_error_after : float
        Expected calibration error on held-out trials [1]; negative: not calibrated.
    accuracy : float
        On the same held-out trials [1]; negative: not calibrated.
    """

    sample_count: int = 0
    novelty_threshold: float = -1.0
    stop_threshold: float = -1.0
    calibration_error_before: float = -1.0
    calibration_error_after: float = -1.0
    accuracy: float = -1.0


FULL_WINDOW = Stage()
"""A full window without novelty and calibration."""


@dataclasses.dataclass(frozen=True)
class TrainingTrials:
    """Conditions under which the training trials were recorded.

    Attributes
    ----------
    sessions, mountings : int
        How many different ones the trials name; 0: they name none.
    speeds : int
        How many different sliding speeds they state.
    slowest_m_s, fastest_m_s : float
        Of these [m/s]; negative: none is stated.
    simulated : int
        How many of the trials were simulated.
    """

    sessions: int = 0
    mountings: int = 0
    speeds: int = 0
    slowest_m_s: float = -1.0
    fastest_m_s: float = -1.0
    simulated: int = 0


@dataclasses.dataclass(frozen=True)
class Manifest:
    """Facts about a model: its answers, its features and its origin.

    Attributes
    ----------
    task, contact : str
        ``contact`` is empty when the model was trained on both or on neither.
    spec : FeatureSpec
        The features that it takes.
    labels : tuple of str
        What it can answer, in the order of its scores.
    score_kind : str
        See Classification.msg.
    classifier, scaling : str
        See `tactile_classifier.estimators.classifiers`.
    simulated : bool
        True when any of the training trials was simulated.
    training_sha256 : str
        Digest of the training table, see `FeatureTable.compute_sha256`.
    trials : int
        How many trials it was trained on.
    versions : mapping of str to str
        Library versions.
    cross_validation : mapping
        ``mean``, ``spread``, ``spread_of`` and ``split``; empty when not evaluated. ``choice``:
        by which features and classifier were chosen (`FeatureChoice.summarise`), where so.
    created : str
        When it was trained (ISO 8601, UTC).
    stages : tuple of Stage
        The full window, then the partial ones by rising sample count.
    calibration : mapping
        ``split``, ``groups`` and ``trials`` of the held-out trials behind the thresholds and
        probabilities, and ``session_share``, the share of new sessions in which the thresholds
        hold (negative: there were no sessions), or ``reason`` why there are none. With
        sessions also ``session_statistics``, one entry a stage, for `recalibrate`; and
        ``recalibrated``, what `recalibrate` took and found. ``held_out_novelty``: for each stage
        the novelties of held-out trials, by session. ``scores``: which were ``kept``,
        ``raw`` or ``calibrated``, and the log losses behind the choice (`ScoreChoice`).
        ``unlearned``: rejection of labels left out in turn (`UnlearnedLabels`).
    false_alarm_rate : float
        Share of windows of known labels that the thresholds reject [1]; negative: no
        thresholds.
    stop_error_rate : float
        Share of wrong answers among those given early [1]; negative: no partial windows.
    training : TrainingTrials
    """

    task: str
    contact: str
    spec: FeatureSpec
    labels: tuple[str, ...]
    score_kind: str
    classifier: str
    scaling: str
    simulated: bool
    training_sha256: str
    trials: int
    versions: Mapping[str, str]
    cross_validation: Mapping[str, Any]
    created: str
    stages: tuple[Stage, ...] = (FULL_WINDOW,)
    calibration: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    false_alarm_rate: float = -1.0
    stop_error_rate: float = -1.0
    training: TrainingTrials = TrainingTrials()

    @property
    def partial_samples(self) -> tuple[int, ...]:
        """Sample counts of the partial windows that the model answers."""
        return tuple(stage.sample_count for stage in self.stages[1:])

    def to_dict(self) -> dict[str, Any]:
        """Return the manifest as what JSON can hold."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        fields['spec'] = self.spec.to_dict()
        fields['labels'] = list(self.labels)
        fields['stages'] = [dataclasses.asdict(stage) for stage in self.stages]
        fields['training'] = dataclasses.asdict(self.training)
        return {'format_version': FORMAT_VERSION, DIGEST: self.spec.digest, **fields}

    @classmethod
    def from_dict(cls, entries: Mapping[str, Any]) -> Manifest:
        """Return the manifest that `to_dict` gave.

        Raises
        ------
        ModelFileError
            When the entries are not those of a manifest of this format.
        """
        fields = check_version(entries)
        _check_types(fields)
        fields['spec'] = parse_wanted(fields).spec
        del fields[DIGEST]
        fields['labels'] = tuple(fields['labels'])
        fields['stages'] = tuple(_read_entry('stages', e, Stage()) for e in fields['stages'])
        fields['training'] = _read_entry('training', fields['training'], TrainingTrials())
        manifest = cls(**fields)
        manifest._check()
        return manifest

    def _check(self) -> None:
        if len(self.labels) < 2 or len(set(self.labels)) < len(self.labels) or '' in self.labels:
            raise ModelFileError('its labels are not two or more different names')
        for name, value, choices in (
            ('score_kind', self.score_kind, (VOTES, MARGIN, PROBABILITY)),
            ('classifier', self.classifier, ALL_CLASSIFIERS),
            ('scaling', self.scaling, SCALINGS),
        ):
            if value not in choices:
                raise ModelFileError(
                    f'its {name} is "{value}"; it must be one of {", ".join(choices)}'
                )


_TYPES: dict[str, type] = {
    'task': str,
    'contact': str,
    'spec': dict,
    DIGEST: str,
    'labels': list,
    'score_kind': str,
    'classifier': str,
    'scaling': str,
    'simulated': bool,
    'training_sha256': str,
    'trials': int,
    'versions': dict,
    'cross_validation': dict,
    'created': str,
    'stages': list,
    'calibration': dict,
    'false_alarm_rate': float,
    'stop_error_rate': float,
    'training': dict,
}

_Entry = TypeVar('_Entry', Stage, TrainingTrials)


def _read_entry(name: str, entry: Any, absent: _Entry) -> _Entry:
    """Return an entry of numbers with the fields and types of another, none below -1."""
    defaults = dataclasses.asdict(absent)
    if not isinstance(entry, dict) or set(entry) != set(defaults):
        raise ModelFileError(f'its manifest has no valid entry "{name}"')
    for key, value in entry.items():
        if type(value) is not type(defaults[key]) or not -1 <= value < math.inf:
            raise ModelFileError(f'its manifest has no valid entry "{key}" in "{name}"')
    return type(absent)(**entry)


def _check_types(fields: dict[str, Any]) -> None:
    for name, expected in _TYPES.items():
        if type(fields.get(name)) is not expected:
            raise ModelFileError(f'its manifest has no valid entry "{name}"')
    if not all(-1 <= fields[name] <= 1 for name in ('false_alarm_rate', 'stop_error_rate')):
        raise ModelFileError('its manifest has a rate that is not between 0 and 1')
    if not all(type(label) is str for label in fields['labels']):
        raise ModelFileError('its manifest has no valid entry "labels"')
    unknown = sorted(set(fields) - set(_TYPES))
    if unknown:
        raise ModelFileError(f'its manifest has the unknown entry "{unknown[0]}"')
