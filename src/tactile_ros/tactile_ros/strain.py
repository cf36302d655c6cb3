# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A block of samples of the tension, as it is passed from the sensor's driver to the features.

The record is independent of ROS and mirrors ``tactile_msgs/StrainBlock``.
"""

from __future__ import annotations

from dataclasses import dataclass, KW_ONLY
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray


class StrainStatus(IntFlag):
    """The status bits of a block, equal to the constants of ``tactile_msgs/StrainBlock``."""

    OK = 0
    HOST_TIME = 1
    SATURATED = 2
    STUCK = 4
    DEVICE_ERROR = 8
    RESYNCHRONISED = 16
    RECONNECTED = 32
    RESTARTED = 64
    CLOCK_STEP = 128
    SIMULATED = 256

    def describe(self) -> str:
        """Return the names of the bits, such as ``saturated, stuck``, or ``ok``."""
        return ', '.join(str(bit.name).lower() for bit in StrainStatus if bit & self) or 'ok'


NOT_LIVE = int(StrainStatus.STUCK | StrainStatus.DEVICE_ERROR)
"""Status bits of samples from which nothing about the present tension can be concluded."""

NO_MEASUREMENT = int(NOT_LIVE | StrainStatus.SATURATED)
"""Status bits of samples whose value is not the tension. A saturated value is a lower bound."""


@dataclass(frozen=True, eq=False)
class StrainBlock:
    """A run of consecutive samples of the tension on one tendon.

    Sample ``i`` has sequence number ``sequence + i`` and time ``stamp_ns + i * period_ns``.
    """

    stamp_ns: int  # time of the first sample (ROS time) [ns]
    sequence: int  # number of the first sample; lost samples are numbered, too
    period_ns: int  # nominal time between two samples [ns]
    tension_n: NDArray[np.float64]  # tension [N], shape (samples,)
    _: KW_ONLY
    lost_before: int = 0  # samples known to be lost between the block before and this one
    status: StrainStatus = StrainStatus.OK  # holds for every sample
    stamp_error_s: float = -1.0  # bound on the error of the stamps [s]; negative if unknown
    # Fx, Fy, Fz [N], Tx, Ty, Tz [N m] in the sensor's own axes, shape (samples, 6). None for a
    # sensor with one axis, and after conversion from a message, which does not contain it.
    wrench: NDArray[np.float64] | None = None
