# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of data, evaluation and model files."""

from collections.abc import Iterator
from contextlib import contextmanager

from tactile_features.errors import ModelFileError as ModelFileError  # features read files, too


class ClassifierError(Exception):
    """Root of the package's errors; the message is a sentence for the user."""


class DatasetError(ClassifierError, ValueError):
    """The trials cannot be used as they are. A `ValueError`, as scikit-learn expects it."""


class TooFewTrialsError(DatasetError):
    """There are too few trials for what was asked; more recordings are the remedy."""


class EvaluationError(ClassifierError, ValueError):
    """The trials do not allow the split that was asked for."""


@contextmanager
def refuse_damage(what: str) -> Iterator[None]:
    """Raise `ModelFileError` where an entry of a model file is missing or of another type."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise ModelFileError(f'{what} damaged: {error!r}') from error
