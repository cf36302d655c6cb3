# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One pull of the tendon as it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from linear_guide_driver.errors import MotionRefusedError


class Pull(NamedTuple):
    """One pull that is asked for.

    Attributes
    ----------
    displacement_m : float
        Where it ends at the latest [m].
    contact : str
        Key of the limits.
    stop_tension_n : float
        Tension that ends it [N]; 0: none.
    is_homing : bool
        Whether it looks for the zero.
    """

    displacement_m: float
    contact: str = 'flexion'
    stop_tension_n: float = 0.0
    is_homing: bool = False

    @property
    def lets_out(self) -> bool:
        """Whether it lets the tendon out to slack, and no further in than it is."""
        return self.displacement_m <= 0.0 and not self.is_homing


def check_pull(pull: Pull, limits_n: Mapping[str, float]) -> float:
    """Return the tension limit of a pull's contact [N].

    Raises
    ------
    MotionRefusedError
        When the contact is unknown or a tension is out of range.
    """
    limit_n = limits_n.get(pull.contact)
    if limit_n is None:
        raise MotionRefusedError(
            f'Contact "{pull.contact}" is unknown; it must be one of {", ".join(limits_n)}.'
        )
    if not 0.0 <= pull.stop_tension_n <= limit_n:
        raise MotionRefusedError(
            f'Stop tension {pull.stop_tension_n} N must be between 0 and the {pull.contact} limit '
            f'of {limit_n} N.'
        )
    return limit_n


def check_reach(displacement_m: float, max_displacement_m: float) -> None:
    """Refuse a displacement that the actuator must not wind to.

    Raises
    ------
    MotionRefusedError
    """
    if not 0.0 <= displacement_m <= max_displacement_m:
        raise MotionRefusedError(
            f'Displacement {displacement_m} m must be between 0 and max_displacement_m, '
            f'{max_displacement_m} m.'
        )
