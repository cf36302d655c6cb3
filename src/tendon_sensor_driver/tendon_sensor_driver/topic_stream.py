# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads the tension from messages of a topic, and handles their stamps, rate and gaps."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from itertools import pairwise
import math
import statistics
from typing import Any, NamedTuple

import numpy as np

from tactile_ros.message_classes import time_from_msg
from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.clock import Batch, Instant, SampleClock
from tendon_sensor_driver.config import AXES, NORM, TendonSensorConfig
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.strain_stream import Stream


class ReadingError(TendonSensorError):
    """A message does not contain a tension."""


class TopicReading(NamedTuple):
    """The tension in one message."""

    stamp_ns: int | None  # stamp of the header [ns]; None without a header or if the stamp is zero
    tension_n: float  # tension after scaling [N]; not finite if the value in the message is not
    # Fx, Fy, Fz [N], Tx, Ty, Tz [N m] in the axes of the message. It is None if the message is a
    # single value, or if the tension is the magnitude of the force.
    wrench: list[float] | None = None


def read_wrench_stamped(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``geometry_msgs/WrenchStamped``."""
    reading = read_wrench(message.wrench, config)
    return reading._replace(stamp_ns=_read_stamp(message))


def read_wrench(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``geometry_msgs/Wrench``.

    Raises
    ------
    ReadingError
        If the configuration names a joint. In ``TOPIC:NAME``, a name that is not an axis counts
        as a joint.
    """
    if config.joint:
        axes = ', '.join([*AXES, NORM])
        raise ReadingError(
            f'a wrench has no axis and no joint "{config.joint}"; its axes are {axes}'
        )
    force, torque = message.force, message.torque
    wrench = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    if config.axis == NORM:
        return TopicReading(None, config.scale * math.hypot(*wrench[:3]))
    return TopicReading(None, config.scale * wrench[AXES.index(config.axis)], wrench)


def read_value(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``std_msgs/Float64`` or ``std_msgs/Float32``.

    Raises
    ------
    ReadingError
        If the configuration names a joint.
    """
    if config.joint:
        raise ReadingError(
            f'the message is a single number and has no joint "{config.joint}"; remove "joint"'
        )
    return TopicReading(None, config.scale * float(message.data))


def read_joint_state(message: Any, config: TendonSensorConfig) -> TopicReading:
    """Return the reading of a ``sensor_msgs/JointState``: the effort of one joint.

    Raises
    ------
    ReadingError
        If the joint is not in the message or has no effort.
    """
    names = list(message.name)
    joint = config.joint or (names[0] if len(names) == 1 else '')
    if joint not in names:
        known = ', '.join(names) or 'none'
        if joint:
            raise ReadingError(f'there is no joint {joint}, only {known}; set "joint"')
        raise ReadingError(
            f'the message has {len(names)} joints ({known}); set "joint" to one of them'
        )
    index = names.index(joint)
    if index >= len(message.effort):
        raise ReadingError(
            f'the joint {joint} has no effort; let its driver or joint_state_broadcaster publish '
            'the effort'
        )
    return TopicReading(_read_stamp(message), config.scale * float(message.effort[index]))


READERS: dict[str, Callable[[Any, TendonSensorConfig], TopicReading]] = {
    'geometry_msgs/msg/WrenchStamped': read_wrench_stamped,
    'geometry_msgs/msg/Wrench': read_wrench,
    'std_msgs/msg/Float64': read_value,
    'std_msgs/msg/Float32': read_value,
    'sensor_msgs/msg/JointState': read_joint_state,
}
"""Function that reads the tension from a message, for each supported message type."""


def _read_stamp(message: Any) -> int | None:
    return time_from_msg(message.header.stamp) or None


_SECOND_NS = 1_000_000_000
_LATE_NS = _SECOND_NS // 4
_STEP_NS = _SECOND_NS // 10
_RECENT_NS = 10 * _SECOND_NS  # duration in which the shortest delay is searched
_MEMORY = 64  # number of samples to which the grid is fitted
_LARGEST_DETUNING = 0.05  # largest deviation from the nominal period, as a fraction of it
_MOST_MISSING = 1.1  # largest ratio of all samples, including missing ones, to received samples

_LONGEST_IRREGULAR = 3  # longest step of an irregular stamp; see `StampClock` [periods]

MEASURE_NS = 2 * _SECOND_NS
"""Duration of one measurement of the rate [ns]."""

FEWEST_MEASURED = 10
"""Smallest number of messages from which a rate is measured."""


class StampGrid:
    """Counts the periods between stamps of a periodic signal, of which some can be missing.

    The expected times of the stamps form a grid with a constant period. It follows the latest
    stamps (about 64) by means of an alpha-beta filter, and its period stays within 5 % of the
    nominal period. The count is right if the stamps deviate from the grid by less than half a
    period.

    Parameters
    ----------
    period_ns : float
        Nominal period [ns].
    stamp_ns : int
        First stamp [ns].
    """

    def __init__(self, period_ns: float, stamp_ns: int) -> None:
        self._nominal_ns = self._period_ns = period_ns
        self._fitted = 1
        self._expected_ns = stamp_ns  # time of the last sample on the grid

    def advance(self, stamp_ns: int) -> int:
        """Add the next stamp [ns]; return the number of periods since the last stamp."""
        steps = max(1, round((stamp_ns - self._expected_ns) / self._period_ns))
        off_ns = stamp_ns - self._expected_ns - steps * self._period_ns
        # With these gains, the filter is a least-squares fit of a line to the latest n stamps.
        n = self._fitted = min(self._fitted + 1, _MEMORY)
        gain = 2 * (2 * n - 1) / (n * (n + 1))
        self._expected_ns += round(steps * self._period_ns + gain * off_ns)
        most_ns = _LARGEST_DETUNING * self._nominal_ns
        period_ns = self._period_ns + 6 / (n * (n + 1)) * off_ns / steps
        self._period_ns = min(
            max(period_ns, self._nominal_ns - most_ns), self._nominal_ns + most_ns
        )
        return steps


class StampClock(SampleClock):
    """Assigns times to the messages of a topic, from their headers or from their arrival.

    A stamp in a header is used unchanged. The bound on its error is the shortest delay from stamp
    to arrival in the last ten seconds (its magnitude), because the clock of the publisher can
    deviate from the clock of this host by this amount.

    Missing samples are counted with a `StampGrid`. ``device_ns`` of an `Instant` is the number of
    counted periods times the nominal period.

    On a busy computer, a publisher may stamp and send a message late, so that a stamp seems to be
    missing. If the middleware's sequence numbers are consecutive, no message is missing. A step
    of two or three periods is then counted as an irregular stamp and not as missing samples. A
    longer step is a pause of the publisher, whose samples count as missing. If the middleware
    provides no sequence numbers, a step of two or three periods counts both as an irregular stamp
    and as missing samples.

    Three kinds of samples are dropped:

    - A duplicate has the same stamp as the sample before it.
    - A late sample has a stamp that is up to 0.25 s earlier.
    - An outlier has an even earlier stamp, or a stamp that jumps forward. A jump means that the
      stamps advance by over 0.1 s more than the times of arrival, so that the delay is more than
      0.1 s shorter than the shortest delay.

    If two outliers in a row agree with each other, the clock of the publisher was set. The number
    of samples that are missing across this step is unknown.

    A sample without a stamp gets the time of its arrival, whose error is unknown. Missing samples
    are then counted by the middleware's sequence numbers, if there are any.

    Attributes
    ----------
    steps : int
        Number of times that the publisher's clock was set.
    irregular_stamps : int
        Number of irregular stamps, as described above.
    repeats : int
        Number of duplicates in a row up to the latest sample.
    number : int or None
        Sequence number of the message that is placed next.
    """

    def __init__(self, period_ns: int) -> None:
        super().__init__(period_ns)
        self.steps = self.irregular_stamps = self.repeats = 0
        self.number: int | None = None
        self._delays_ns: list[int] = []  # shortest delays in the last two spans of 5 s each
        self._span_ns = 0  # time of arrival at which the newer of these spans began
        self._received_ns = 0  # time of arrival of the last sample with a stamp
        self._last: Instant | None = None
        self._has_stamps = False
        self._last_number: int | None = None
        self._closed = 0  # number of periods not counted because of irregular stamps
        self._index = 0
        self._grid = StampGrid(period_ns, 0)

    @property
    def least_delay_ns(self) -> int | None:
        """Shortest delay from stamp to arrival in the last 10 s [ns]; None without stamps."""
        return min(self._delays_ns, default=None)

    def note_reconnection(self) -> None:
        # Each publisher has its own sequence numbers.
        self._last_number = None

    def note_step(self, step_ns: int) -> None:
        super().note_step(step_ns)
        self._delays_ns = [delay_ns + step_ns for delay_ns in self._delays_ns]
        self._span_ns += step_ns
        self._received_ns += step_ns
        if self._last is not None and not self._has_stamps:
            self._last = self._last._replace(stamp_ns=self._last.stamp_ns + step_ns)

    def place(self, ticks: int | None, received_at_ns: int) -> Instant | None:
        # ``ticks`` is the stamp of the header [ns].
        before, self._last_number = self._last_number, self.number
        repeats, self.repeats = self.repeats, 0
        if ticks is None:
            return self._place_by_arrival(received_at_ns, before)
        is_next = before is not None and self.number == before + 1
        if self._last is None:
            return self._begin(ticks, received_at_ns, is_step=False)
        if not self._has_stamps:
            return self._begin(ticks, received_at_ns, is_step=True)
        elapsed_ns = ticks - self._last.stamp_ns
        if -_LATE_NS < elapsed_ns <= 0:
            self._drop_old(-elapsed_ns)
            self.repeats = 0 if elapsed_ns else repeats + 1
            if elapsed_ns and self._closed:  # this sample explains an irregular stamp
                self._closed -= 1
                self._index += 1
            return None
        if elapsed_ns > 0 and not self._leaps(ticks, elapsed_ns, received_at_ns):
            return self._continue(ticks, received_at_ns, is_next=is_next)
        if self._continues_outlier(ticks, received_at_ns, _STEP_NS):
            self.steps += 1
            return self._begin(ticks, received_at_ns, is_step=True)
        return None

    def _place_by_arrival(self, received_at_ns: int, before: int | None) -> Instant:
        is_step, number = self._has_stamps, self.number
        self._has_stamps = False
        if number is not None and before is not None and not is_step:
            # The number decreases if there are two publishers; then no sample is missing.
            self._index += max(1, number - before)
        else:
            self._index += 1
        stamp_ns = received_at_ns
        if self._last is not None and not is_step:
            stamp_ns = max(stamp_ns, self._last.stamp_ns + 1)
        device_ns = self._index * self.period_ns
        self._last = Instant(device_ns, stamp_ns, -1.0, is_step=is_step)
        return self._last

    def _leaps(self, ticks: int, elapsed_ns: int, received_at_ns: int) -> bool:
        least_ns = self.least_delay_ns or 0
        return (
            received_at_ns - ticks < least_ns - _STEP_NS
            and elapsed_ns > received_at_ns - self._received_ns + _STEP_NS
        )

    def _begin(self, ticks: int, received_at_ns: int, *, is_step: bool) -> Instant:
        self._has_stamps = True
        self._delays_ns = []
        self._note_delay(ticks, received_at_ns)
        self._index += 1
        self._grid = StampGrid(self.period_ns, ticks)
        return self._stamp(ticks, is_step=is_step)

    def _continue(self, ticks: int, received_at_ns: int, *, is_next: bool) -> Instant:
        self._note_delay(ticks, received_at_ns)
        steps = self._grid.advance(ticks)
        if 1 < steps <= _LONGEST_IRREGULAR and (is_next or self.number is None):
            self.irregular_stamps += 1
            if is_next:
                self._closed += steps - 1
                steps = 1
        self._index += steps
        return self._stamp(ticks, is_step=False)

    def _stamp(self, ticks: int, *, is_step: bool) -> Instant:
        error_s = abs(self.least_delay_ns or 0) / 1e9
        self._outlier = None
        self._last = Instant(self._index * self.period_ns, ticks, error_s, is_step=is_step)
        return self._last

    def _note_delay(self, ticks: int, received_at_ns: int) -> None:
        delay_ns = received_at_ns - ticks
        self._received_ns = received_at_ns
        if not self._delays_ns or received_at_ns - self._span_ns >= _RECENT_NS // 2:
            self._delays_ns = [*self._delays_ns[-1:], delay_ns]
            self._span_ns = received_at_ns
        self._delays_ns[-1] = min(self._delays_ns[-1], delay_ns)


class RateMeter:
    """Measures the rate of a topic every two seconds.

    If the messages have stamps, the rate is measured with a `StampGrid`, and is correct even if up
    to 10 % of the messages are lost. Otherwise, the arriving messages are counted.

    Attributes
    ----------
    rate_hz : float
        Measured rate [Hz]; 0 until it is known.
    """

    def __init__(self) -> None:
        self.rate_hz = 0.0
        self._times_ns: list[int] = []
        self._has_stamps = True

    def add(self, stamp_ns: int | None, received_at_ns: int) -> bool:
        """Add the stamp and arrival of a message [ns]; return True at the end of a measurement."""
        has_stamp = stamp_ns is not None
        time_ns = received_at_ns if stamp_ns is None else stamp_ns
        times_ns = self._times_ns
        if times_ns and (has_stamp != self._has_stamps or time_ns <= times_ns[-1] - MEASURE_NS):
            times_ns.clear()  # the new time is from another clock, or the clock was set back
        self._has_stamps = has_stamp
        times_ns.append(time_ns)
        if len(times_ns) < FEWEST_MEASURED or abs(time_ns - times_ns[0]) < MEASURE_NS:
            return False
        self.rate_hz = measure_rate_hz(times_ns, is_regular=has_stamp) or self.rate_hz
        self._times_ns = [time_ns]
        return self.rate_hz > 0.0


def measure_rate_hz(times_ns: list[int], *, is_regular: bool) -> float:
    """Return the rate of samples [Hz], or 0 if it cannot be measured.

    Parameters
    ----------
    times_ns : list of int
        Times of the samples in order of arrival [ns].
    is_regular : bool
        True if the times are stamps. The rate is then correct if up to 10 % of the samples are
        missing and stamps deviate by up to 0.2 periods. With deviations of 0.3 periods, 2 to 4 %
        of the rates were wrong by more than 0.5 % (1500 simulated cases). False if the times are
        times of arrival, which are irregular. Then the samples are only counted.
    """
    span_ns = times_ns[-1] - times_ns[0]
    counted_hz = (len(times_ns) - 1) * 1e9 / span_ns if span_ns > 0 else 0.0
    rising = [times_ns[0]]
    for time_ns in times_ns:
        if time_ns > rising[-1]:
            rising.append(time_ns)
    if not is_regular or len(rising) < 2:
        return counted_hz
    grid = StampGrid(statistics.median(b - a for a, b in pairwise(rising)), rising[0])
    rate_hz = sum(map(grid.advance, rising[1:])) * 1e9 / (rising[-1] - rising[0])
    # The grid is wrong if the median is too short, as for a publisher that pauses and then sends
    # several messages in quick succession.
    return rate_hz if rate_hz < _MOST_MISSING * counted_hz else counted_hz


LARGEST_TENSION_N = 1e9
"""Largest plausible tension [N]. Larger values are treated like non-finite values."""


class TopicStream:
    """Converts the readings of one topic into blocks.

    A non-finite value becomes NaN with the status ``DEVICE_ERROR``. If ``rate_hz`` is 0, the
    rate is measured first, and the readings until then are dropped.

    Attributes
    ----------
    meter : RateMeter
        Continuous measurement of the rate.
    readings : int
        Number of readings, including those dropped before the rate was known.
    is_value_finite : bool
        Whether the newest value was finite.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._config = config
        self.meter = RateMeter()
        self.readings = 0
        self.is_value_finite = True
        self.clock: StampClock | None = None
        self.samples: Stream[StampClock] | None = None
        if config.rate_hz:
            self._begin(config)

    def _begin(self, config: TendonSensorConfig) -> None:
        self._config = config
        self.clock = StampClock(config.period_ns)
        self.samples = Stream(config, self.clock)

    @property
    def rate_hz(self) -> float:
        """Nominal rate [Hz]; 0 until it has been measured."""
        return self._config.rate_hz

    def add(
        self, reading: TopicReading, received_at_ns: int, number: int | None = None
    ) -> list[StrainBlock]:
        """Add one reading; return the blocks that it completes.

        Parameters
        ----------
        reading : TopicReading
            Reading of one message.
        received_at_ns : int
            Host time of arrival [ns].
        number : int or None
            The middleware's sequence number, consecutive for one publisher.
        """
        self.readings += 1
        stamp_ns = reading.stamp_ns if self._config.topic_stamps == 'header' else None
        is_measured = self.meter.add(stamp_ns, received_at_ns)
        if self.samples is None or self.clock is None:
            if is_measured:
                self._begin(dataclasses.replace(self._config, rate_hz=self.meter.rate_hz))
            return []
        status = StrainStatus.OK if stamp_ns is not None else StrainStatus.HOST_TIME
        tension_n = reading.tension_n + self._config.offset_n
        self.is_value_finite = abs(tension_n) <= LARGEST_TENSION_N
        if not self.is_value_finite:
            tension_n = math.nan
            status |= StrainStatus.DEVICE_ERROR
        self.clock.number = number
        return self.samples.add(
            Batch(
                received_at_ns,
                np.array([tension_n]),
                None if stamp_ns is None else (stamp_ns,),
                None if reading.wrench is None else np.array([reading.wrench]),
                np.array([int(status)], dtype=np.uint32),
            )
        )

    def note_reconnection(self) -> None:
        """Record that a publisher was found again after there was none."""
        if self.samples is not None:
            self.samples.note_reconnection()

    def note_clock_step(self, step_ns: int) -> None:
        """Record that the host's clock was set by ``step_ns`` before the next reading."""
        if self.samples is not None:
            self.samples.note_clock_step(step_ns)

    def flush(self) -> list[StrainBlock]:
        """End the unfinished block. Return a list of this block, or an empty list."""
        return [] if self.samples is None else self.samples.flush()
