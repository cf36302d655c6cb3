# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""The four classifiers of the paper, by name, each with or without scaling."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier

from tactile_classifier.records import CLASSIFIERS, MARGIN, SCALINGS, VOTES

__all__ = [
    'CLASSIFIERS',
    'DEFAULT_SCALING',
    'SCALINGS',
    'SCALING_REASONS',
    'SCORE_KINDS',
    'build_estimator',
    'compute_raw_scores',
]

DEFAULT_SCALING = {'texture': 'none', 'stiffness': 'standard'}
"""The scaling of a task when none is asked for; `SCALING_REASONS` says why."""

SCALING_REASONS = {
    'texture': (
        'all texture features are amplitudes in newtons: their sizes are information, and '
        'scaling would give components that hold only noise the weight of the others'
    ),
    'stiffness': (
        'slope [N/s], intercept [N] and correlation [1] are in different units: without '
        'scaling the unit of force would decide which of them counts'
    ),
}

SCORE_KINDS = {'knn': VOTES, 'svm_linear': MARGIN, 'svm_rbf': MARGIN, 'tree': VOTES}
"""What the scores of each classifier are before calibration; see Classification.msg."""

RANDOM_STATE = 0


def build_estimator(classifier: str, scaling: str) -> Pipeline:
    """Return an unfitted pipeline of scaling and classifier.

    Parameters
    ----------
    classifier : str
        One of `CLASSIFIERS`.
    scaling : str
        One of `SCALINGS`.

    Raises
    ------
    ValueError
        When a name is not known.
    """
    if scaling not in SCALINGS:
        raise ValueError(f'scaling is "{scaling}"; it must be one of {", ".join(SCALINGS)}')
    steps: list[tuple[str, Any]] = [('classify', _classifier(classifier))]
    if scaling == 'standard':
        steps.insert(0, ('scale', StandardScaler()))
    return Pipeline(steps)


def compute_raw_scores(
    estimator: Pipeline, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return one score a label, before calibration, of windows of shape (windows, k)."""
    if hasattr(estimator, 'predict_proba'):
        return np.asarray(estimator.predict_proba(values))
    scores = np.asarray(estimator.decision_function(values))
    # Of two labels, scikit-learn gives one value, positive for the second.
    return np.stack([-scores, scores], axis=1) if scores.ndim == 1 else scores


def _classifier(name: str) -> Any:
    if name == 'knn':
        # The tree search subtracts coordinates; 'brute' would expand the square, lose
        # digits for near copies and so order neighbours unlike the model file does.
        return KNeighborsClassifier(n_neighbors=3, metric='euclidean', algorithm='kd_tree')
    if name in ('svm_linear', 'svm_rbf'):
        # break_ties: the label is the one with the largest decision value, always.
        return SVC(kernel=name.removeprefix('svm_'), break_ties=True, random_state=RANDOM_STATE)
    if name == 'tree':
        return DecisionTreeClassifier(random_state=RANDOM_STATE)
    raise ValueError(f'classifier is "{name}"; it must be one of {", ".join(CLASSIFIERS)}')
