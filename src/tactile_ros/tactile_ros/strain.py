# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The record of a block of tension samples, which the sensor's driver passes to other stages.

It has the fields of the message ``tactile_msgs/StrainBlock``, but does not need ROS.
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
"""Status bits of samples that contain no information about the present tension."""

NO_MEASUREMENT = int(NOT_LIVE | StrainStatus.SATURATED)
"""Status bits of samples whose value is not the tension. For a saturated sensor, the tension is at
least as large as the value."""


@dataclass(frozen=True, eq=False)
class StrainBlock:
    """A run of consecutive samples of the tension on one tendon.

    Sample ``i`` has sequence number ``sequence + i`` and time ``stamp_ns + i * period_ns``.
    """

    stamp_ns: int  # time of the first sample (ROS time) [ns]
    sequence: int  # number of the first sample; lost samples are counted, too
    period_ns: int  # nominal time between two samples [ns]
    tension_n: NDArray[np.float64]  # tension [N], shape (samples,)
    _: KW_ONLY
    lost_before: int = 0  # number of samples that were lost before this block, if known
    status: StrainStatus = StrainStatus.OK  # applies to every sample of the block
    stamp_error_s: float = -1.0  # bound on the error of the stamps [s]; negative if unknown
    # Forces [N] and torques [N m] along the sensor's axes x, y and z; shape (samples, 6). None for
    # a sensor with one axis, and after conversion from a message, which has no such field.
    wrench: NDArray[np.float64] | None = None
