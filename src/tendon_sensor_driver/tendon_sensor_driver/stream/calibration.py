# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
