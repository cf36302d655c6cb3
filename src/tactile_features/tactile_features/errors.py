# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of this package."""


class FeatureError(Exception):
    """Root of this package's exceptions."""


class ModelFileError(FeatureError):
    """A model file cannot be written, is not one, or does not fit."""


class UndefinedFeatureError(FeatureError):
    """A feature has no value on this window, such as the correlation of a constant.

    Attributes
    ----------
    windows : tuple of int
        Of a batch, the places of all windows without a value; otherwise empty or (0,).
    """

    def __init__(self, message: str, windows: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.windows = windows
