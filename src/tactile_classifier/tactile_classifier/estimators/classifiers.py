# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The four classifiers of the paper and random convolutions, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import functools
from typing import Any, ParamSpec, TypeVar
import warnings

import numpy as np
import numpy.typing as npt
from sklearn.exceptions import ConvergenceWarning
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier
from threadpoolctl import threadpool_limits

from tactile_classifier.errors import TooFewTrialsError
from tactile_classifier.estimators.random_convolutions import RandomConvolutionClassifier
from tactile_classifier.records import (
    ALL_CLASSIFIERS,
    MARGIN,
    ROCKET,
    SCALINGS,
    VOTES,
)

DEFAULT_SCALING = {'texture': 'none', 'stiffness': 'standard'}
"""The scaling of a task when none is asked for.

All texture features are amplitudes in newtons: their sizes are information, and scaling would give
components that hold only noise the weight of the others. Of stiffness, slope [N/s], intercept [N]
and correlation [1] are in different units: without scaling the unit of force would decide which of
them counts.
"""

SCORE_KINDS = {
    'knn': VOTES,
    'svm_linear': MARGIN,
    'svm_rbf': MARGIN,
    'tree': VOTES,
    ROCKET: MARGIN,
}
"""Kind of the scores of each classifier before calibration; see Classification.msg."""

NEIGHBOURS = 3

RANDOM_STATE = 0

MAX_SVM_STEPS = 1_000_000
"""Steps of an SVM's solver for one pair of labels. The most that any of our recordings,
real or simulated, scaled or not, has needed is 58 499; large features that no border parts
could take any number."""


class NearestNeighbours(KNeighborsClassifier):  # type: ignore[misc]
    """scikit-learn's classifier of three neighbours, which refuses fewer trials when fitted."""

    def fit(self, X: Any, y: Any) -> NearestNeighbours:  # noqa: N803
        """Fit; raise TooFewTrialsError when there are fewer trials than neighbours."""
        super().fit(X, y)
        if self.n_samples_fit_ < self.n_neighbors:
            raise TooFewTrialsError(
                f'{self.n_neighbors} neighbours are asked of {self.n_samples_fit_} training '
                'trials: record more'
            )
        return self


class SupportVectorMachine(SVC):  # type: ignore[misc]
    """scikit-learn's `SVC`, which says in our words when its answers are not to be relied on."""

    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> SupportVectorMachine:  # noqa: N803
        """Fit; warn when `MAX_SVM_STEPS` were not enough."""
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', ConvergenceWarning)
            super().fit(X, y, sample_weight)
        if self.fit_status_:
            warnings.warn(
                f'the {self.kernel} support vector machine was stopped after {self.max_iter:,} '
                'steps, before it had converged: its answers depend on where it stopped; '
                'use the scaling "standard", or another classifier',
                ConvergenceWarning,
                stacklevel=2,
            )
        return self


def warn_of_labels_never_given(estimator: Pipeline, values: Any) -> None:
    """Warn when a support vector machine never gives a label, not even to its training trials."""
    machine = estimator[-1]
    if not isinstance(machine, SVC):
        return
    never = sorted(set(machine.classes_) - set(estimator.predict(values)))
    if never:
        warnings.warn(
            f'the {machine.kernel} support vector machine never answers {", ".join(never)}, not '
            'even to its training trials: the number of trials of each label counts more for it '
            'than the features; use the scaling "standard", another classifier, or equally many '
            'trials of each label',
            stacklevel=2,
        )


def default_scaling(task: str, classifier: str) -> str:
    """Return the scaling when none is asked for."""
    return 'none' if classifier == ROCKET else DEFAULT_SCALING[task]


def build_estimator(
    classifier: str,
    scaling: str,
    channels: int = 1,
    parameters: Mapping[str, Any] | None = None,
) -> Pipeline:
    """Return an unfitted pipeline of scaling and classifier.

    Parameters
    ----------
    classifier : str
        One of `ALL_CLASSIFIERS`.
    scaling : str
        One of `SCALINGS`; random convolutions take ``none`` alone.
    channels : int
        The features are those of so many channels, one after another.
    parameters : mapping, optional
        Parameters of the classifier that replace ours, such as ``C``.

    Raises
    ------
    ValueError
        When a name is not known, or the two do not go together.
    """
    if scaling not in SCALINGS:
        raise ValueError(f'scaling is "{scaling}"; it must be one of {", ".join(SCALINGS)}')
    if classifier == ROCKET and scaling != 'none':
        raise ValueError('random convolutions take a waveform as it is: use the scaling "none"')
    machine = _classifier(classifier, channels).set_params(**(parameters or {}))
    steps: list[tuple[str, Any]] = [('classify', machine)]
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


def _classifier(name: str, channels: int) -> Any:
    if name == 'knn':
        # A tree of one leaf: distances are sums of squared differences, compared in the order of
        # the trials. With algorithm='brute' large offsets cost digits.
        return NearestNeighbours(NEIGHBOURS, algorithm='kd_tree', leaf_size=2**31 - 1)
    if name in ('svm_linear', 'svm_rbf'):
        # break_ties: the label is the one with the largest decision value, always.
        return SupportVectorMachine(
            kernel=name.removeprefix('svm_'),
            break_ties=True,
            max_iter=MAX_SVM_STEPS,
            random_state=RANDOM_STATE,
        )
    if name == 'tree':
        return DecisionTreeClassifier(random_state=RANDOM_STATE)
    if name == ROCKET:
        return RandomConvolutionClassifier(channels, RANDOM_STATE)
    raise ValueError(f'classifier is "{name}"; it must be one of {", ".join(ALL_CLASSIFIERS)}')


_Arguments = ParamSpec('_Arguments')
_Result = TypeVar('_Result')


def on_one_thread(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Decorate a function so that linear algebra keeps to one thread while it runs.

    Matrices are small here. OpenBLAS shares even these out among threads, which wait for each
    other: on two busy cores that took five times as long. One thread also gives the same bits
    whatever the number of cores.
    """

    @functools.wraps(function)
    def limited(*args: _Arguments.args, **options: _Arguments.kwargs) -> _Result:
        # scikit-learn requires threadpoolctl, so it is there wherever that is.
        with threadpool_limits(1, user_api='blas'):
            return function(*args, **options)

    return limited
