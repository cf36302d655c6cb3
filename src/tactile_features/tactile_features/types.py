# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Input and output records of the extractor, without ROS.

The constants have the same values as in the messages of ``tactile_msgs``; a test compares them.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

PROTOCOL_TEXTURE = 'texture'
PROTOCOL_STIFFNESS = 'stiffness'
PROTOCOL_SLIP = 'slip'  # only in recordings made before December 2026

CONTACT_FLEXION = 'flexion'
CONTACT_ABDUCTION = 'abduction'

PHASES_STATED = 'stated'

PHASE_APPROACH = 'approach'
PHASE_TOUCH = 'contact'
PHASE_GLIDE = 'glide'
PHASE_HOLD = 'hold'
PHASE_PULL = 'pull'  # only in recordings made before December 2026
PHASE_RELEASE = 'release'
PHASE_RETURN = 'return'
PHASE_DONE = 'done'
PHASE_ABORTED = 'aborted'

SET_TEXTURE_SPECTRUM = 'texture_spectrum'
SET_TEXTURE_SPATIAL = 'texture_spatial'
SET_STIFFNESS_REGRESSION = 'stiffness_regression'


def contacts_agree(first: str, second: str) -> bool:
    """Return True if two contacts are equal or at least one of them is empty (unknown)."""
    return len({first, second} - {''}) < 2


class WindowOutcome(IntEnum):
    """Result of cutting one window."""

    OK = 0
    GAP = 1
    TOO_SHORT = 2
    BAD_SIGNAL = 3
    UNDEFINED = 4
    ABORTED = 5
    BAD_TIME = 6


@dataclass(frozen=True)
class TrialEvent:
    """Start of one phase of a trial; ``stamp_ns`` is on the clock of the samples [ns]."""

    stamp_ns: int
    trial_id: str
    session_id: str
    protocol: str
    contact: str
    object_label: str
    phase: str
    message: str = ''
    glide_speed_m_s: float = 0.0
    simulated: bool = False
    pull_speed_m_s: float = 0.0
    pull_displacement_m: float = 0.0
    detected: bool = False
    mounting_id: str = ''


@dataclass(frozen=True, eq=False)
class FeatureWindow:
    """The features of one window of tension, or the reason why the window has no features.

    Two windows are equal if all fields are equal; ``values`` are compared bit by bit.

    Attributes
    ----------
    values : ndarray of shape (k,)
        The features in the order and units of the `FeatureSpec`; empty if ``outcome`` is not
        ``WindowOutcome.OK``.
    reason : str
        One sentence if ``outcome`` is not ``WindowOutcome.OK``, else an empty string.
    window_start_ns, window_end_ns : int
        Times of the first and the last sample [ns]; start and end of the phase if the window
        has no samples.
    first_sequence, sample_count, interpolated_count : int
        0 if the window has no samples.
    speed_m_s : float
        Sliding speed used to compute the features [m/s]; 0 if they do not depend on it.
    specification_digest : str
        `FeatureSpec.digest` of the specification of the values; empty if unknown.
    stamp_error_s : float
        Bound on the stamp error, the largest of all samples of the window [s]; negative if
        unknown.
    """

    feature_set: str
    feature_set_version: int
    trial_id: str
    contact: str
    simulated: bool
    outcome: WindowOutcome
    reason: str
    values: NDArray[np.float64]
    window_start_ns: int
    window_end_ns: int
    first_sequence: int
    rate_hz: float
    sample_count: int
    interpolated_count: int
    status: int
    frame_id: str
    speed_m_s: float = 0.0
    specification_digest: str = ''
    stamp_error_s: float = -1.0

    @property
    def window_s(self) -> float:
        """Time from the first to the last sample of the window [s]."""
        return (self.window_end_ns - self.window_start_ns) / 1e9

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FeatureWindow):
            return NotImplemented
        return self._as_bits() == other._as_bits()

    __hash__ = None  # type: ignore[assignment]

    def _as_bits(self) -> tuple[object, ...]:
        values = (getattr(self, f.name) for f in dataclasses.fields(self))
        return tuple(v.tobytes() if isinstance(v, np.ndarray) else v for v in values)
