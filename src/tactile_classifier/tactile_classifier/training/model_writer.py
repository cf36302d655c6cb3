# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Write a trained classifier to a model file, and compare its labels with scikit-learn."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators.classifiers import on_one_thread, RANDOM_STATE
from tactile_classifier.estimators.random_convolutions import RandomConvolutionClassifier
from tactile_classifier.model_file.manifest import refuse_reserved
from tactile_classifier.model_file.model import TactileModel
from tactile_classifier.model_file.prediction import (
    Classifier,
    Convolutions,
    LinearMachine,
    Neighbours,
    Predictor,
    RadialMachine,
    Scaling,
    Tree,
)
from tactile_classifier.model_file.storage import pack_model
from tactile_classifier.training.trainer import Trained
from tactile_ros.files import replace_file

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline
    from sklearn.svm import SVC

POINTS_NEAR_BORDERS = 1_000
"""Number of points near decision boundaries at which labels are compared."""

BISECTIONS = 4
"""Number of bisections between two trials. The distance of the resulting point from the boundary
is at most 1/16 of the distance of the trials."""

ROUNDING = 1e-9
"""Largest relative margin of distances or decision values at which a label may differ from that of
scikit-learn. With such a margin, the label depends on rounding errors."""

Matrix = npt.NDArray[np.float64]


def write_model(path: str | Path, trained: Trained) -> TactileModel:
    """Write a model file; return the model, loaded from the written bytes.

    Before that, the labels of the model are compared with those of scikit-learn, at all training
    trials and at points near decision boundaries.

    Parameters
    ----------
    path : str or Path
        Path of the model file. An existing file is replaced atomically when the model is complete.
    trained : Trained
        Result of `train`.

    Raises
    ------
    ModelFileError
        If a label differs by more than rounding, or the file cannot be written.
    """
    try:
        data = pack_trained(trained)
        model = TactileModel(data, str(Path(path).absolute()))
        check_labels(model.predictor, trained.estimator, trained.values)
    except ModelFileError as error:
        raise ModelFileError(f'model {path} is not written: {error}') from error
    try:
        replace_file(Path(path), data)
    except OSError as error:
        raise ModelFileError(f'cannot write model {path}: {error.strerror}') from error
    return model


def pack_trained(trained: Trained) -> bytes:
    """Return the bytes of the model file; raise ModelFileError when a label is reserved."""
    _check_names(trained)
    return pack_model(trained.manifest, make_predictor(trained))


def _check_names(trained: Trained) -> None:
    labels = trained.manifest.labels
    if list(trained.estimator.classes_) != list(labels):
        raise ModelFileError('the labels of manifest and estimator differ')
    refuse_reserved(labels)


@on_one_thread
def check_labels(predictor: Predictor, estimator: Pipeline, values: Matrix) -> None:
    """Raise ModelFileError if predicted labels differ between predictor and estimator.

    Labels are compared at the training trials, ``values``, shape (trials, k), and at points near
    decision boundaries. A label may differ only if its margin is at most `ROUNDING`.
    """
    near = _find_points_near_borders(predictor, values)
    for rows, name in ((values, 'training trials'), (near, 'points near boundaries')):
        answers = predictor.compute_raw_scores(rows).argmax(axis=1)
        differs = estimator.classes_[answers] != estimator.predict(rows)
        for i in np.flatnonzero(differs):
            margin = predictor.classifier.find_margin(predictor.scale(rows[i]))
            if margin > ROUNDING:
                raise ModelFileError(
                    f'the labels of {np.count_nonzero(differs)} of {len(rows)} {name} differ from '
                    f'scikit-learn, first at index {i} with a margin of {margin:.1e}: report this '
                    'as a bug, and choose another classifier'
                )


def _find_points_near_borders(predictor: Predictor, values: Matrix) -> Matrix:
    """Return points near decision boundaries between training trials, shape (points, k)."""
    rng = np.random.default_rng(RANDOM_STATE)
    answers = predictor.compute_raw_scores(values).argmax(axis=1)
    first, second = rng.integers(len(values), size=(2, 20 * POINTS_NEAR_BORDERS))
    # Pairs with different predictions come first; others are used only if there are too few.
    order = np.argsort(answers[first] == answers[second], kind='stable')[:POINTS_NEAR_BORDERS]
    low, high = values[first[order]], values[second[order]]
    of_low = answers[first[order]]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        answers = predictor.compute_raw_scores(middle).argmax(axis=1)
        is_low = (answers == of_low)[:, np.newaxis]
        low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
    return np.asarray(low + rng.random((len(low), 1)) * (high - low))


def make_predictor(trained: Trained) -> Predictor:
    """Return the fitted parts as a `Predictor`."""
    scaling = None
    if 'scale' in trained.estimator.named_steps:
        scaler = trained.estimator.named_steps['scale']
        scaling = Scaling(scaler.mean_, scaler.scale_)
    classifier = _take_classifier(trained.estimator[-1])
    return Predictor(classifier, scaling, trained.calibration, trained.novelty)


def _take_classifier(estimator: Any) -> Classifier:
    labels = len(estimator.classes_)
    if isinstance(estimator, RandomConvolutionClassifier):
        return _take_convolutions(estimator)
    if hasattr(estimator, 'tree_'):
        tree = estimator.tree_
        arrays = tree.feature, tree.threshold, tree.children_left, tree.children_right
        return Tree(*arrays, tree.value[:, 0])
    if hasattr(estimator, 'n_neighbors'):
        return Neighbours(estimator._fit_X, np.eye(labels)[estimator._y])  # noqa: SLF001
    if estimator.kernel == 'linear':
        return LinearMachine(estimator.coef_, estimator.intercept_)
    weights = _take_pair_weights(estimator)
    gamma = np.array(estimator._gamma)  # noqa: SLF001
    return RadialMachine(estimator.support_vectors_, weights, estimator.intercept_, gamma)


def _take_pair_weights(machine: SVC) -> Matrix:
    """Return the weight of each support vector in each pair of labels, shape (pairs, vectors).

    libsvm stores, for each support vector, one weight for each other label.
    """
    labels, dual = len(machine.classes_), machine.dual_coef_
    if labels == 2:
        return np.asarray(dual)
    owner = np.repeat(np.arange(labels), machine.n_support_)
    return np.stack(
        [
            np.where(owner == i, dual[j - 1], 0.0) + np.where(owner == j, dual[i], 0.0)
            for i, j in zip(*np.triu_indices(labels, 1), strict=True)
        ]
    )


def _take_convolutions(estimator: RandomConvolutionClassifier) -> Convolutions:
    sets = estimator.convolutions_
    return Convolutions(
        references=estimator.references_,
        dilations=sets[0].dilations,
        counts=sets[0].counts,
        biases=np.stack([each.biases for each in sets]),
        sources=np.stack([each.sources for each in sets]),
        coefficients=estimator.coef_,
        intercept=estimator.intercept_,
        samples=np.array(sets[0].samples),
    )
