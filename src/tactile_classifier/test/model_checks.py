# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of a model file that apply to every classifier, and changes of its contents."""

import numpy as np

from tactile_classifier.estimators.classifiers import compute_raw_scores
from tactile_classifier.model_file.model import load_model
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.types import NO_ANSWER, UNKNOWN
from tactile_features.model_container import open_container, pack_container


def check_model(trained, path, values, atol=1e-12):
    """Write a model file, and compare the model with the trained parts.

    The labels must equal those of scikit-learn, and scores and novelty those of the trained parts.
    A window must have the same result alone, in a batch, and after the file is loaded again.
    """
    model = write_model(path, trained)
    raw = compute_raw_scores(trained.estimator, values)
    calibration = trained.calibration
    expected = raw if calibration is None else calibration.compute(raw)
    found = model.compute(values)
    np.testing.assert_allclose(found.scores, expected, atol=atol, rtol=0)
    named = np.array(model.labels)[found.answer]
    np.testing.assert_array_equal(named, trained.estimator.predict(values))
    if calibration is not None:
        np.testing.assert_allclose(found.scores.sum(axis=1), 1.0, rtol=1e-12)
    is_unknown = np.zeros(len(values), dtype=bool)
    if trained.novelty is not None:
        np.testing.assert_allclose(found.novelty, trained.novelty.compute(values), rtol=1e-9)
        is_unknown = found.novelty > model.manifest.confidence.novelty_threshold
    answers = model.predict_or_unknown(values)
    np.testing.assert_array_equal(model.predict(values), named)
    np.testing.assert_array_equal(answers, np.where(is_unknown, UNKNOWN, named))
    assert set(answers) <= {*model.labels, UNKNOWN, NO_ANSWER}
    alone = np.concatenate([model.compute(row[np.newaxis]).scores for row in values[:9]])
    np.testing.assert_allclose(alone, found.scores[:9], atol=1e-12, rtol=0)
    again = load_model(path)
    assert again.manifest == model.manifest
    assert again.predict_or_unknown(values).tolist() == answers.tolist()
    assert again.predict_or_unknown(values[:0]).shape == (0,)
    return model


def change_file(path, arrays=(), **entries):
    """Return a model file with changed arrays and entries; an array that is None is removed."""
    manifest, old = open_container(path.read_bytes())
    new = {**old, **dict(arrays)}
    kept = {name: array for name, array in new.items() if array is not None}
    return pack_container({**manifest, **entries}, kept)
