# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Blocks of strain samples, as one sensor driver publishes them."""

import itertools

import numpy as np

from tactile_ros.strain import StrainBlock, StrainStatus

PERIOD_NS = 10_000_000
_numbers = itertools.count(0, 1000)
"""Sequence numbers that never decrease, because a decrease would mean a restart."""


def feed(safety, tension_n, now_ns, *, is_saturated=False, age_ns=0):
    """Add a block with a stamp ``age_ns`` before ``now_ns``; see `TendonSafety.add_blocks`."""
    status = StrainStatus.SATURATED if is_saturated else StrainStatus.OK
    values = np.array(tension_n, dtype=float)
    first_ns = now_ns - age_ns - (len(values) - 1) * PERIOD_NS
    block = StrainBlock(first_ns, next(_numbers), PERIOD_NS, values, status=status)
    return safety.add_blocks([block], now_ns, now_ns)
