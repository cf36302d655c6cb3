# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What can go wrong with data, evaluation and model files."""


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


class ModelFileError(ClassifierError):
    """A model file cannot be written, is not one, or does not fit."""
