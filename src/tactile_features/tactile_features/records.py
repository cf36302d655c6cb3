# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records that go into the extractor and come out of it, free of ROS.

The constants repeat those of the messages in ``tactile_msgs``; a test keeps them equal.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

PROTOCOL_TEXTURE = 'texture'
PROTOCOL_STIFFNESS = 'stiffness'
PROTOCOL_SLIP = 'slip'

CONTACT_FLEXION = 'flexion'
CONTACT_ABDUCTION = 'abduction'

PHASES_STATED = 'stated'

PHASE_APPROACH = 'approach'
PHASE_CONTACT = 'contact'
PHASE_GLIDE = 'glide'
PHASE_HOLD = 'hold'
PHASE_PULL = 'pull'
PHASE_RELEASE = 'release'
PHASE_RETURN = 'return'
PHASE_DONE = 'done'
PHASE_ABORTED = 'aborted'

SET_TEXTURE_SPECTRUM = 'texture_spectrum'
SET_TEXTURE_SPATIAL = 'texture_spatial'
SET_STIFFNESS_REGRESSION = 'stiffness_regression'


def contacts_agree(first: str, second: str) -> bool:
    """Return whether two contacts are the same, or one of the two is not stated."""
    return len({first, second} - {''}) < 2


class Outcome(IntEnum):
    """Result of the cutting of one window."""

    OK = 0
    GAP = 1
    TOO_SHORT = 2
    BAD_SIGNAL = 3
    UNDEFINED = 4
    ABORTED = 5
    BAD_TIME = 6


@dataclass(frozen=True)
class TrialEvent:
    """The start of one phase of a trial, at ``stamp_ns`` on the samples' clock."""

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
    """The features of one window of tension, or the reason why there are none.

    Two windows are equal when every field is, ``values`` bit for bit.

    Attributes
    ----------
    values : ndarray of shape (k,)
        The features in the order and units of the set's `FeatureSpec`; empty when
        ``outcome`` is not ``Outcome.OK``.
    reason : str
        One sentence when ``outcome`` is not ``Outcome.OK``; empty otherwise.
    window_start_ns, window_end_ns : int
        Times of the first and the last sample; start and end of the phase when no
        sample belongs to the window [ns].
    first_sequence, sample_count, interpolated_count : int
        0 when no sample belongs to the window.
    speed_m_s : float
        Sliding speed that the features were computed with; 0: they need none [m/s].
    specification_digest : str
        `FeatureSpec.digest` of the specification that made the values; empty: not known.
    stamp_error_s : float
        Largest bound on the error of its samples' stamps [s]; negative: not known.
    """

    feature_set: str
    feature_set_version: int
    trial_id: str
    contact: str
    simulated: bool
    outcome: Outcome
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
