# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Titles of classifiers, scalings and features for people."""

from __future__ import annotations

from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.spec import FeatureSpec

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


def describe_features(spec: FeatureSpec) -> str:
    """Return which feature set it is, with its options."""
    found = find_feature_set(spec.feature_set)
    options = [name for name in (found.options if found else ()) if name in spec.parameters]
    stated = [f'{name} {spec.parameters[name]}' for name in options]
    return f'features: {", ".join([spec.feature_set, *stated])}'
