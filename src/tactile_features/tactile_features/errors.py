# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What goes wrong in this package."""


class FeatureError(Exception):
    """Root of this package's exceptions."""


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
