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

"""What goes into the extractor and what comes out, free of ROS.

The constants repeat those of the messages in ``tactile_msgs``; a test keeps them equal.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_features.errors import FeatureError
from tactile_features.spatial import SpatialWindow

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

STATUS_OK = 0
STATUS_HOST_TIME = 1
STATUS_SATURATED = 2
STATUS_STUCK = 4
STATUS_DEVICE_ERROR = 8
STATUS_RESYNCHRONISED = 16
STATUS_RECONNECTED = 32

SET_TEXTURE_SPECTRUM = 'texture_spectrum'
SET_TEXTURE_SPATIAL = 'texture_spatial'
SET_STIFFNESS_REGRESSION = 'stiffness_regression'


MIN_DETECTION_HZ = 20.0
"""Slowest sensor in whose tension phases are found."""

MIN_RUNNING_SAMPLES = 30
"""Fewest samples of a running window: half a second at 60 Hz."""


class Outcome(IntEnum):
    """How the cutting of one window ended."""

    OK = 0
    GAP = 1
    TOO_SHORT = 2
    BAD_SIGNAL = 3
    UNDEFINED = 4
    ABORTED = 5


@dataclass(frozen=True, eq=False)
class StrainBlock:
    """A run of consecutive samples of the tension on one tendon.

    Sample ``i`` has sequence number ``sequence + i`` and time
    ``stamp_ns + i * period_ns``.

    Attributes
    ----------
    stamp_ns : int
        Time of the first sample (ROS time) [ns].
    sequence : int
        Sequence number of the first sample; counts lost samples too.
    period_ns : int
        Time between two samples of this block [ns].
    tension_n : ndarray of shape (n,)
        Tension [N].
    lost_before : int
        Samples known to be lost between the previous block and this one.
    status : int
        STATUS_ bits; they hold for every sample of the block.
    """

    stamp_ns: int
    sequence: int
    period_ns: int
    tension_n: NDArray[np.float64]
    lost_before: int = 0
    status: int = STATUS_OK


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


@dataclass(frozen=True)
class Measure:
    """A physical quantity estimated from one window, or the reason why there is none.

    Attributes
    ----------
    name, unit : str
        Such as ``groove_pitch`` and ``m``.
    value, standard_uncertainty : float
        In ``unit``; both 0 when ``reason`` is not empty.
    reason : str
        One sentence when the quantity is not defined; empty otherwise.
    """

    name: str
    unit: str
    value: float = 0.0
    standard_uncertainty: float = 0.0
    reason: str = ''


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
    running : bool
        The first part of a window that still fills.
    speed_m_s : float
        Sliding speed that the features were computed with; 0: they need none [m/s].
    measures : tuple of Measure
        Physical quantities of the same window.
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
    running: bool = False
    speed_m_s: float = 0.0
    measures: tuple[Measure, ...] = ()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FeatureWindow):
            return NotImplemented
        return self._as_bits() == other._as_bits()

    __hash__ = None  # type: ignore[assignment]

    def _as_bits(self) -> tuple[object, ...]:
        values = (getattr(self, f.name) for f in dataclasses.fields(self))
        return tuple(v.tobytes() if isinstance(v, np.ndarray) else v for v in values)


def _parameter(default: Any, description: str, **metadata: Any) -> Any:
    return field(default=default, metadata={'description': description, **metadata})


@dataclass(frozen=True)
class FeatureConfig:
    """How windows are cut from the phases of a trial.

    Raises
    ------
    FeatureError
        When a value is out of its range or the buffer cannot hold a window.
    """

    rate_hz: float = _parameter(
        60.0, 'nominal sample rate of the tension', unit='Hz', range=(1.0, 20000.0)
    )
    texture_samples: int = _parameter(
        180, 'samples in a texture window', unit='1', range=(2, 1000000)
    )
    texture_crop_start_s: float = _parameter(
        0.6,
        'flat section that is left out at the start of the glide',
        unit='s',
        range=(0.0, 60.0),
    )
    texture_crop_end_s: float = _parameter(
        0.1,
        'a texture window must end this long before the glide does',
        unit='s',
        range=(0.0, 60.0),
    )
    texture_features: str = _parameter(
        SET_TEXTURE_SPECTRUM,
        'features of a glide: amplitudes over a fixed time, or over a stretch of surface at any '
        'sliding speed, which trial events must then state',
        choices=(SET_TEXTURE_SPECTRUM, SET_TEXTURE_SPATIAL),
    )
    spatial_crop_m: float = _parameter(
        0.009,
        'with texture_spatial: path that is left out at the start of the glide',
        unit='m',
        range=(0.0, 2.0),
    )
    spatial_length_m: float = _parameter(
        0.045,
        'with texture_spatial: path over the surface that is one window',
        unit='m',
        range=(0.0001, 2.0),
    )
    spatial_finest_m: float = _parameter(
        0.0005,
        'with texture_spatial: finest scale; samples must not be further apart on the surface',
        unit='m',
        range=(0.00001, 0.5),
    )
    running_samples: tuple[int, ...] = _parameter(
        (),
        'after so many samples of a texture window, features of these are published as running; '
        'rising, 30 or more and fewer than texture_samples',
        unit='1',
        element=int,
    )
    stiffness_settle_s: float = _parameter(
        0.5,
        'dynamic deformation that is left out at the start of the hold',
        unit='s',
        range=(0.0, 60.0),
    )
    stiffness_crop_end_s: float = _parameter(
        0.1, 'what is left out at the end of the hold', unit='s', range=(0.0, 60.0)
    )
    stiffness_min_s: float = _parameter(
        2.0, 'shortest stiffness window', unit='s', range=(0.05, 60.0)
    )
    max_gap_samples: int = _parameter(
        0,
        'longest run of lost samples that is interpolated linearly; 0 rejects any loss',
        unit='1',
        range=(0, 1000),
    )
    buffer_s: float = _parameter(
        120.0,
        'how long samples wait for the events of their trial, and events for samples',
        unit='s',
        range=(1.0, 600.0),
    )
    phases: str = _parameter(
        PHASES_STATED,
        'where the phases of a trial come from: stated by trial events, or found in the tension '
        'of a finger that follows the texture or the stiffness protocol',
        choices=(PHASES_STATED, PROTOCOL_TEXTURE, PROTOCOL_STIFFNESS),
    )
    detected_rise_n: float = _parameter(
        0.2,
        'with phases found in the tension: what it must rise above rest to begin a trial',
        unit='N',
        range=(0.0001, 1e6),
    )
    detected_object_label: str = _parameter(
        '',
        'with phases found in the tension: what lies under the finger, in recordings to train on',
    )
    detected_session_id: str = _parameter(
        '', 'with phases found in the tension: the session, in recordings to train on'
    )
    detected_glide_speed_m_s: float = _parameter(
        0.0,
        'with phases found in the tension: sliding speed of their glides; 0: not known',
        unit='m/s',
        range=(0.0, 1.0),
    )
    detected_pull_speed_m_s: float = _parameter(
        0.0,
        'with phases found in the tension: speed of the tendon in the pull; 0: not known',
        unit='m/s',
        range=(0.0, 1.0),
    )
    detected_contact: str = _parameter(
        '',
        'with phases found in the tension: how the finger touches; empty: not known',
        choices=('', CONTACT_FLEXION, CONTACT_ABDUCTION),
    )
    detected_simulated: bool = _parameter(
        False,
        'with phases found in the tension: it is simulated; marks all that is derived from it',
    )
    measures: bool = _parameter(
        True,
        'estimate physical quantities from each window: pitch of grooves, stiffness, relaxation',
    )
    glide_speed_uncertainty: float = _parameter(
        0.005,
        'relative standard uncertainty of the stated glide speed, for the pitch of the grooves',
        unit='1',
        range=(0.0, 1.0),
    )
    frame_id: str = _parameter('tendon_sensor_link', 'frame of the sensor')

    def __post_init__(self) -> None:
        for item in dataclasses.fields(self):
            self._check_field(item)
        if self.phases != PHASES_STATED and self.rate_hz < MIN_DETECTION_HZ:
            raise FeatureError(
                f'rate_hz is {self.rate_hz:g}; phases are found in a tension of at least '
                f'{MIN_DETECTION_HZ:g} Hz'
            )
        if self.running_samples and self.texture_features == SET_TEXTURE_SPATIAL:
            raise FeatureError(
                f'{SET_TEXTURE_SPATIAL} has no running windows; leave running_samples empty'
            )
        if self.texture_features == SET_TEXTURE_SPATIAL:
            self.spatial_window()
        # A parameter file gives a list, which is no constant.
        object.__setattr__(self, 'running_samples', tuple(self.running_samples))
        counts = (MIN_RUNNING_SAMPLES - 1, *self.running_samples, self.texture_samples)
        if self.running_samples and not all(a < b for a, b in pairwise(counts)):
            raise FeatureError(
                f'running_samples are {list(self.running_samples)}; they must rise from '
                f'{MIN_RUNNING_SAMPLES} or more to fewer than texture_samples, which is '
                f'{self.texture_samples}'
            )
        texture_s = self.texture_crop_start_s + self.texture_samples / self.rate_hz
        stiffness_s = self.stiffness_settle_s + self.stiffness_min_s
        if max(texture_s, stiffness_s) > self.buffer_s:
            raise FeatureError(
                f'buffer_s is {self.buffer_s}, which cannot hold a window that ends '
                f'{max(texture_s, stiffness_s):g} s after its phase began; raise buffer_s'
            )

    def _check_field(self, item: dataclasses.Field[Any]) -> None:
        value = getattr(self, item.name)
        if 'range' in item.metadata:
            low, high = item.metadata['range']
            if not low <= value <= high:
                raise FeatureError(f'{item.name} is {value}; it must lie between {low} and {high}')
        choices = item.metadata.get('choices')
        if choices and value not in choices:
            allowed = ' or '.join(choice or 'empty' for choice in choices)
            raise FeatureError(f'{item.name} is "{value}"; it must be {allowed}')

    def without_detection(self) -> FeatureConfig:
        """Return these parameters as if phases were stated: what windows can share."""
        found: dict[str, Any] = {
            item.name: item.default
            for item in dataclasses.fields(self)
            if item.name.startswith('detected_')
        }
        return dataclasses.replace(self, phases=PHASES_STATED, **found)

    def spatial_window(self) -> SpatialWindow:
        """Return the stretch of surface that is one window of ``texture_spatial``.

        Raises
        ------
        FeatureError
            When the stretch is too short for its finest scale.
        """
        return SpatialWindow(self.spatial_length_m, self.spatial_finest_m)
