# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of data, evaluation and model files."""

from tactile_features.errors import ModelFileError as ModelFileError  # features read files, too


class ClassifierError(Exception):
    """Root of the package's errors; the message is a sentence for the user."""


class DatasetError(ClassifierError):
    """The trials cannot be used as they are."""


class TooFewTrialsError(DatasetError, ValueError):
    """There are too few trials for what was asked; more recordings are the remedy.

    A `ValueError` too, which is what scikit-learn's callers expect of an estimator.
    """


class EvaluationError(ClassifierError):
    """The trials do not allow the split that was asked for."""
