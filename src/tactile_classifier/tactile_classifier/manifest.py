# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a model file says of itself, as JSON inside the ONNX file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from tactile_classifier.errors import ModelFileError
from tactile_classifier.records import (
    CLASSIFIERS,
    CONTACTS,
    MARGIN,
    PROBABILITY,
    SCALINGS,
    TASKS,
    VOTES,
)
from tactile_features.errors import FeatureError
from tactile_features.spec import FeatureSpec

FORMAT_VERSION = 1


@dataclasses.dataclass(frozen=True)
class Manifest:
    """What a model is, what it takes and where it came from.

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
        See `tactile_classifier.estimators`.
    simulated : bool
        True when any of the training trials was simulated.
    training_sha256 : str
        Digest of the training table, see `FeatureTable.compute_sha256`.
    trials : int
        How many trials it was trained on.
    versions : mapping of str to str
        Library versions.
    cross_validation : mapping
        ``mean``, ``spread``, ``spread_of`` and ``split``; empty when not evaluated.
    created : str
        When it was trained (ISO 8601, UTC).
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

    def to_json(self) -> str:
        """Return the manifest as JSON text."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        fields['spec'] = self.spec.to_dict()
        return json.dumps({'format_version': FORMAT_VERSION, **fields}, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> Manifest:
        """Return the manifest that `to_json` wrote.

        Raises
        ------
        ModelFileError
            When the text is not a manifest or of a newer format.
        """
        try:
            fields = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ModelFileError(f'its manifest is not JSON: {error}') from error
        version = fields.pop('format_version', None) if isinstance(fields, dict) else None
        if not isinstance(version, int) or isinstance(version, bool) or version < 1:
            raise ModelFileError('its manifest states no format version')
        if version > FORMAT_VERSION:
            raise ModelFileError(
                f'it has format version {version}, this software reads up to {FORMAT_VERSION}: '
                'update the software or train the model again'
            )
        _check_types(fields)
        try:
            fields['spec'] = FeatureSpec.from_dict(fields['spec'])
        except FeatureError as error:
            raise ModelFileError(f'its manifest is damaged: {error}') from error
        fields['labels'] = tuple(fields['labels'])
        manifest = cls(**fields)
        manifest._check()
        return manifest

    def _check(self) -> None:
        if TASKS.get(self.spec.feature_set) != self.task:
            raise ModelFileError(
                f'its task "{self.task}" does not go with its feature set '
                f'"{self.spec.feature_set}"'
            )
        if len(self.labels) < 2 or len(set(self.labels)) < len(self.labels) or '' in self.labels:
            raise ModelFileError('its labels are not two or more different names')
        for name, value, choices in (
            ('contact', self.contact, ('', *CONTACTS)),
            ('score_kind', self.score_kind, (VOTES, MARGIN, PROBABILITY)),
            ('classifier', self.classifier, CLASSIFIERS),
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
}


def _check_types(fields: dict[str, Any]) -> None:
    for name, expected in _TYPES.items():
        if type(fields.get(name)) is not expected:
            raise ModelFileError(f'its manifest has no valid entry "{name}"')
    if not all(type(label) is str for label in fields['labels']):
        raise ModelFileError('its manifest has no valid entry "labels"')
    unknown = sorted(set(fields) - set(_TYPES))
    if unknown:
        raise ModelFileError(f'its manifest has the unknown entry "{unknown[0]}"')
