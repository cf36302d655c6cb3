# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names of the classifier nodes in recordings of 0.1, and titles for people."""

from __future__ import annotations

from tactile_classifier.records import CONTACTS, TASKS
from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.spec import FeatureSpec
from tactile_ros.errors import TactileError

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


def classifier_name(task: str, contact: str) -> str:
    """Return the node name of the classifier for a task and a kind of contact.

    Without a contact: of one that takes windows of any.
    """
    return '_'.join(part for part in (task, contact, 'classifier') if part)


_NAMES = {
    classifier_name(task, contact): (task, contact)
    for task in TASKS
    for contact in (*CONTACTS, '')
}


def all_classifier_names() -> tuple[str, ...]:
    """Return the node names of the classifiers for every task and contact."""
    return tuple(_NAMES)


def parse_classifier_name(name: str) -> tuple[str, str]:
    """Return task and contact from a node name made by `classifier_name`.

    Raises
    ------
    TactileError
        The name is none of `all_classifier_names`.
    """
    if name not in _NAMES:
        raise TactileError(
            f'"{name}" does not name a classifier; it must be one of {", ".join(_NAMES)}'
        )
    return _NAMES[name]


def short_scaling(scaling: str) -> str:
    """Return ``scaled`` or ``not scaled``."""
    return SCALING_TITLES[scaling].partition(' (')[0]


def describe_features(spec: FeatureSpec) -> str:
    """Return which feature set it is, with its options."""
    found = find_feature_set(spec.feature_set)
    options = [name for name in (found.options if found else ()) if name in spec.parameters]
    stated = [f'{name} {spec.parameters[name]}' for name in options]
    return f'features: {", ".join([spec.feature_set, *stated])}'
