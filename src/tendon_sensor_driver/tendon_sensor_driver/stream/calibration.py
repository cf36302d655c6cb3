# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Device values to newtons."""

from __future__ import annotations

STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard acceleration of free fall, exact by definition (CGPM 1901)."""

NEWTONS = {
    'kg': STANDARD_GRAVITY_M_S2,
    'g': 0.00980665,
    'N': 1.0,
    'lbf': 4.4482216152605,  # 0.45359237 kg at standard gravity, exact
}


class Calibration:
    """A linear calibration: newtons = value * scale * (newtons in one unit) + offset.

    Parameters
    ----------
    unit : str
        A key of `NEWTONS`.
    scale : float
        Factor on the value, such as -1 to turn its sign.
    offset_n : float
        Added to the product [N].
    """

    def __init__(self, unit: str, scale: float = 1.0, offset_n: float = 0.0) -> None:
        self._factor = NEWTONS[unit] * scale
        self._offset_n = offset_n

    def to_newtons(self, value: float) -> float:
        """Return the tension [N] of one device value."""
        return value * self._factor + self._offset_n
