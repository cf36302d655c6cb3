# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exceptions for datasets, evaluation and model files."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from tactile_features.errors import ModelFileError as ModelFileError  # re-exported


class ClassifierError(Exception):
    """Base class of the exceptions of this package; the message is a sentence for the user."""


class DatasetError(ClassifierError, ValueError):
    """The trials cannot be used as they are. A `ValueError`, as scikit-learn expects."""


class NoFeaturesError(DatasetError):
    """Some trials have no features; ``reasons`` maps their indices to the reasons."""

    def __init__(self, message: str, reasons: Mapping[int, str]) -> None:
        super().__init__(message)
        self.reasons = reasons


class TooFewTrialsError(DatasetError):
    """There are too few trials; the user must record more."""


class EvaluationError(ClassifierError, ValueError):
    """The requested split is impossible with these trials."""


@contextmanager
def refuse_damage(what: str) -> Iterator[None]:
    """Raise `ModelFileError` if an entry of a model file is missing or has a wrong type."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise ModelFileError(f'{what} damaged: {error!r}') from error
