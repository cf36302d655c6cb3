# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of this package."""


class FeatureError(Exception):
    """Base class of this package's exceptions."""


class ModelFileError(FeatureError):
    """A model file cannot be written or read, is invalid, or does not fit the configuration."""


class UndefinedFeatureError(FeatureError):
    """A feature is undefined for a window, for example the correlation of a constant tension.

    Attributes
    ----------
    windows : tuple of int
        For a batch, the indices of all windows whose feature is undefined. For a single window,
        empty or (0,).
    """

    def __init__(self, message: str, windows: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.windows = windows
