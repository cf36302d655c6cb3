# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classifiers by name: the four classifiers of the paper, and random convolutions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import functools
from typing import Any, ParamSpec, TypeVar
import warnings

import numpy as np
import numpy.typing as npt
from scipy.spatial.distance import cdist
from sklearn.exceptions import ConvergenceWarning
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier
from sklearn.utils.validation import check_is_fitted
from threadpoolctl import threadpool_limits

from tactile_classifier.errors import TooFewTrialsError
from tactile_classifier.estimators.random_convolutions import RandomConvolutionClassifier
from tactile_classifier.types import ALL_CLASSIFIERS, MARGIN, NEIGHBOURS, ROCKET, SCALINGS, VOTES
from tactile_features.estimators import validate_data

DEFAULT_SCALING = {'texture': 'none', 'stiffness': 'standard'}
"""Default scaling of each task.

All texture features are amplitudes in newtons. Their magnitudes carry information: scaling would
give components that contain only noise the same weight as the others. The stiffness features slope
[N/s], intercept [N] and correlation [1] have different units. If they were not scaled, their
weights would depend on the unit of force.
"""

SCORE_KINDS = {
    'knn': VOTES,
    'svm_linear': MARGIN,
    'svm_rbf': MARGIN,
    'tree': VOTES,
    ROCKET: MARGIN,
}
"""Kind of the uncalibrated scores of each classifier; see Classification.msg."""

RANDOM_STATE = 0

MAX_SVM_STEPS = 1_000_000
"""Maximum number of solver steps of an SVM for one pair of labels. Real and simulated recordings
needed at most 58 499 steps. If features are large and classes are not separable, the solver may
never converge."""


class NearestNeighbours(KNeighborsClassifier):  # type: ignore[misc]
    """scikit-learn's nearest-neighbour classifier; `fit` refuses too few trials."""

    def fit(self, X: Any, y: Any) -> NearestNeighbours:  # noqa: N803
        """Fit the classifier; raise TooFewTrialsError for fewer trials than neighbours."""
        super().fit(X, y)
        if self.n_samples_fit_ < self.n_neighbors:
            raise TooFewTrialsError(
                f'{self.n_neighbors} neighbours need at least {self.n_neighbors} training trials, '
                f'not {self.n_samples_fit_}: record more'
            )
        return self

    def predict(self, X: Any) -> npt.NDArray[Any]:  # noqa: N803
        """Return one label for each row; ties are broken in favour of earlier trials.

        A model file breaks ties in the same way. For few trials, the method of scikit-learn takes
        ten times as long.
        """
        check_is_fitted(self)
        rows = validate_data(self, X, reset=False)
        distances = cdist(rows, self._fit_X, 'sqeuclidean')
        nearest = np.argsort(distances, axis=1, kind='stable')[:, : self.n_neighbors]
        votes = self._y[nearest][:, :, np.newaxis] == np.arange(len(self.classes_))
        return np.asarray(self.classes_[votes.sum(axis=1).argmax(axis=1)])


class SupportVectorMachine(SVC):  # type: ignore[misc]
    """scikit-learn's `SVC`; `fit` warns with a remedy if the solver does not converge."""

    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> SupportVectorMachine:  # noqa: N803
        """Fit the machine; warn if the solver has not converged after `MAX_SVM_STEPS`."""
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', ConvergenceWarning)
            super().fit(X, y, sample_weight)
        if self.fit_status_:
            warnings.warn(
                f'the {self.kernel} support vector machine has not converged after '
                f'{self.max_iter:,} steps, so its predictions are unreliable: '
                'use the scaling "standard", or another classifier',
                ConvergenceWarning,
                stacklevel=2,
            )
        return self


def warn_of_labels_never_given(estimator: Pipeline, values: Any) -> None:
    """Warn if a support vector machine never predicts a label, even for its training trials."""
    machine = estimator[-1]
    if not isinstance(machine, SVC):
        return
    never = sorted(set(machine.classes_) - set(estimator.predict(values)))
    if never:
        warnings.warn(
            f'the {machine.kernel} support vector machine never predicts {", ".join(never)}, even '
            'for its training trials. The numbers of trials per label influence it more than the '
            'features: use the scaling "standard", another classifier, or the same number of '
            'trials for each label',
            stacklevel=2,
        )


def default_scaling(task: str, classifier: str) -> str:
    """Return the default scaling of a classifier for a task."""
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
        One of `SCALINGS`; random convolutions only accept ``none``.
    channels : int
        Number of channels. The features of all channels are concatenated.
    parameters : mapping, optional
        Parameters of the classifier, such as ``C``, that replace the defaults of this package.

    Raises
    ------
    ValueError
        If a name is unknown, or the combination is not supported.
    """
    if scaling not in SCALINGS:
        raise ValueError(f'scaling is "{scaling}"; it must be one of {", ".join(SCALINGS)}')
    if classifier == ROCKET and scaling != 'none':
        raise ValueError('random convolutions need an unscaled waveform: use the scaling "none"')
    chosen = dict(parameters or {})
    if isinstance(weights := chosen.get('class_weight'), Mapping):
        # Newer versions of scikit-learn look up the weight of a label such as '1' by its integer.
        numbers = {int(label): w for label, w in weights.items() if str(label).isdecimal()}
        chosen['class_weight'] = {**weights, **numbers}
    machine = _classifier(classifier, channels).set_params(**chosen)
    steps: list[tuple[str, Any]] = [('classify', machine)]
    if scaling == 'standard':
        steps.insert(0, ('scale', StandardScaler()))
    return Pipeline(steps)


def compute_raw_scores(
    estimator: Pipeline, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the uncalibrated scores of windows, shape (windows, labels).

    ``values`` contains the features of the windows, shape (windows, k).
    """
    if hasattr(estimator, 'predict_proba'):
        return np.asarray(estimator.predict_proba(values))
    scores = np.asarray(estimator.decision_function(values))
    # For two labels, scikit-learn returns only one value; it is positive for the second label.
    return np.stack([-scores, scores], axis=1) if scores.ndim == 1 else scores


def _classifier(name: str, channels: int) -> Any:
    if name == 'knn':
        # The leaf size puts all trials into one leaf. The k-d tree then compares all trials in
        # their order. algorithm='brute' is less accurate if features have large offsets.
        return NearestNeighbours(NEIGHBOURS, algorithm='kd_tree', leaf_size=2**31 - 1)
    if name in ('svm_linear', 'svm_rbf'):
        # With break_ties, the label with the largest decision value is always predicted.
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
    """Decorate a function to run linear algebra on one thread.

    OpenBLAS distributes even small matrices over several threads that wait for each other. On two
    busy cores, this took five times as long. On one thread, the results are also identical for any
    number of cores.
    """

    @functools.wraps(function)
    def limited(*args: _Arguments.args, **options: _Arguments.kwargs) -> _Result:
        # threadpoolctl is a dependency of scikit-learn.
        with threadpool_limits(1, user_api='blas'):
            return function(*args, **options)

    return limited
