# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time stamps of samples from the clocks of host and device, and detection of missing samples.

A `SampleClock` assigns a time to each sample of one sensor. It drops samples that are duplicate,
late or have an implausible time, and returns the others as runs of consecutive samples (`Run`).
A subclass implements either `place` for single samples or `place_batch` for several samples.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
import math
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainStatus

SECOND_NS = 1_000_000_000
STEP_NS = SECOND_NS
"""If the offset between host and device time rises by more than this [ns], a clock has jumped."""

# Constants of `ClockSkewFilter`. A "minimum" is the smallest difference within about a second.
_HORIZON = 30  # number of stored minima
_LEAST_SAMPLES = 30  # fewest samples for a minimum, so that one of them has a short delay
_MOST_SECONDS = 3  # longest time for a minimum with fewer samples
_FORGET_S = 8.0  # time constant [s] with which the weights of older minima decrease
_FEWEST = 5  # fewest minima from which the slope is estimated
_RECENT = 10  # number of latest minima from which the scatter is estimated
_LARGEST_SLOPE = 0.01  # the clock of a board with a ceramic resonator deviates by up to 0.5 %
_RISE_NS = 50_000_000  # rise of the latest minima above the line that means a clock was set
_CHANGE_NS = 500_000  # added to the error bound, for changes of the drift and periodic bursts


class ClockSkewFilter:
    """Estimate of the offset between host and device clock: a line below all differences.

    The difference "arrival time minus device time" is the offset of the clocks plus the delay of
    the sample, which is never negative. The offset is therefore estimated by a line that bounds
    the differences from below. It is fitted again about once a second.

    The filter stores the smallest difference ("minimum") of each second. If a second has fewer
    than thirty samples, the interval is extended to thirty samples, but to three seconds at most.
    From the latest thirty minima, the lower convex hull is computed. The line is the edge of this
    hull at the mean time of the minima, to which recent minima contribute more. If the latest
    five minima are more than 50 ms above the line, a clock was set, and older minima are dropped.

    Attributes
    ----------
    slope : float
        Slope of the line: host time per device time, minus one. It is limited to ±0.01.
    scatter_ns : int
        Bound on the error of the line [ns]: three times the median distance of the latest ten
        minima above the line (three times the largest distance if there are fewer than ten),
        plus 0.5 ms for errors that the minima do not show. Negative until the slope is known.
    """

    def __init__(self) -> None:
        self.slope = 0.0
        self.scatter_ns = -1
        self._points: deque[tuple[int, int]] = deque(maxlen=_HORIZON)
        self._device_ns = 0  # device time of the point (_device_ns, _difference_ns) of the line
        self._difference_ns = 0
        self._second = 0  # device time at which the present interval began [s]
        self._samples = 0
        self._least = (0, 0)

    def restart(self, device_ns: int, difference_ns: int) -> None:
        """Forget all minima, and begin the line at this point with the slope known so far."""
        self._points.clear()
        self.scatter_ns = -1
        self._device_ns, self._difference_ns = device_ns, difference_ns
        self._begin_least(device_ns, difference_ns)

    def shift(self, step_ns: int) -> None:
        """Shift the line and all minima by ``step_ns``, after the host's clock has been set."""
        self._difference_ns += step_ns
        self._least = (self._least[0], self._least[1] + step_ns)
        self._points = deque(
            ((device_ns, difference_ns + step_ns) for device_ns, difference_ns in self._points),
            maxlen=_HORIZON,
        )

    def at(self, device_ns: int) -> int:
        """Return the estimated offset [ns] at a device time [ns]."""
        return self._difference_ns + round(self.slope * (device_ns - self._device_ns))

    def add(self, device_ns: int, difference_ns: int) -> int:
        """Add the difference of the next sample; return the estimated offset at its time [ns]."""
        seconds = device_ns // SECOND_NS - self._second
        if seconds >= (1 if self._samples >= _LEAST_SAMPLES else _MOST_SECONDS):
            self._points.append(self._least)
            self._fit()
            self._begin_least(device_ns, difference_ns)
        else:
            self._samples += 1
            least_device_ns, least_ns = self._least
            drift_ns = self.slope * (device_ns - least_device_ns)
            if difference_ns - least_ns < drift_ns:
                self._least = (device_ns, difference_ns)
        line_ns = self.at(device_ns)
        if difference_ns >= line_ns:
            return line_ns
        self._difference_ns += difference_ns - line_ns
        return difference_ns

    def _begin_least(self, device_ns: int, difference_ns: int) -> None:
        self._second = device_ns // SECOND_NS
        self._samples = 1
        self._least = (device_ns, difference_ns)

    def _fit(self) -> None:
        points = list(self._points)
        newest = points[-_FEWEST:]
        if len(newest) == _FEWEST and all(y - self.at(x) > _RISE_NS for x, y in newest):
            points = newest
            self._points.clear()
            self._points.extend(newest)
        # Values relative to the newest minimum are small enough for the precision of floats.
        origin_ns, base_ns = points[-1]
        relative = [((x - origin_ns) / 1e9, float(y - base_ns)) for x, y in points]
        if len(points) >= _FEWEST:
            slope = _compute_slope(relative) / 1e9
            self.slope = max(-_LARGEST_SLOPE, min(_LARGEST_SLOPE, slope))
        heights_ns = [y - self.slope * 1e9 * x for x, y in relative]
        lowest_ns = min(heights_ns)
        self._device_ns, self._difference_ns = origin_ns, base_ns + round(lowest_ns)
        if len(points) >= _FEWEST:
            above_ns = sorted(height - lowest_ns for height in heights_ns[-_RECENT:])
            typical = len(above_ns) // 2 if len(points) >= _RECENT else -1
            self.scatter_ns = round(3 * above_ns[typical]) + _CHANGE_NS


def _compute_slope(points: list[tuple[float, float]]) -> float:
    """Return the slope of the lower convex hull at the weighted mean of the x values."""
    weights = [math.exp(x / _FORGET_S) for x, _ in points]
    mean = sum(w * x for w, (x, _) in zip(weights, points, strict=True)) / sum(weights)
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2:]
            if (y1 - y0) * (x - x1) < (y - y1) * (x1 - x0):
                break
            hull.pop()
        hull.append((x, y))
    slope = 0.0
    for (x0, y0), (x1, y1) in pairwise(hull):
        slope = (y1 - y0) / (x1 - x0)
        if x1 >= mean:
            break
    return slope


_SLEW_DIVISOR = 20
_LATE_NS = SECOND_NS // 4
_EARLY_NS = SECOND_NS
_WRAP_TICKS = 1 << 32
_MOST_WAITED_NS = 10 * SECOND_NS  # a full buffer of 4096 bytes holds 5 s of lines at 60 Hz
_LEAST_STEP_NS = SECOND_NS // 10
_QUICK_NS = SECOND_NS // 1000
_ATTEMPTS = 3
_RESTART = int(StrainStatus.RECONNECTED | StrainStatus.RESTARTED)
_STEP, _LEAP = int(StrainStatus.CLOCK_STEP), int(StrainStatus.RESYNCHRONISED)


class ArrivalClock:
    """Reads the host's clock, and detects when this clock has been set.

    The host's clock is compared with the monotonic clock, which is never set. If their difference
    changes by more than 0.1 s between two calls of `now_ns`, the host's clock has been set, which
    is called a step. Slower changes are ignored. Not thread-safe.

    Attributes
    ----------
    step_ns : int
        Sum of the steps since the last call of `take_step_ns` [ns].
    """

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self.step_ns = 0
        self._now_ns = now_ns
        self._offset_ns: int | None = None  # host time minus monotonic time
        self._slack_ns = 0

    def now_ns(self) -> int:
        """Return the host's time [ns]. If the clock has been set, add the step to ``step_ns``."""
        for _ in range(_ATTEMPTS):  # repeated if another thread ran between the two readings
            before_ns = time.monotonic_ns()
            now_ns = self._now_ns()
            slack_ns = time.monotonic_ns() - before_ns
            if slack_ns <= _QUICK_NS:
                break
        offset_ns = now_ns - before_ns
        if self._offset_ns is not None:
            change_ns = offset_ns - self._offset_ns
            most_ns = _LEAST_STEP_NS + slack_ns + self._slack_ns
            if not -most_ns <= change_ns <= most_ns:
                self.step_ns += change_ns
        self._offset_ns, self._slack_ns = offset_ns, slack_ns
        return now_ns

    def take_step_ns(self) -> int:
        """Return ``step_ns`` and reset it to 0."""
        step_ns, self.step_ns = self.step_ns, 0
        return step_ns


class Instant(NamedTuple):
    """The time of one sample."""

    device_ns: int | None  # device time without wraps [ns]; None if the device has no clock
    stamp_ns: int  # ROS time [ns]; strictly increasing
    stamp_error_s: float  # bound on the error of the stamp [s]; negative if not known
    is_restart: bool = False  # the device's clock restarted, so ``device_ns`` is discontinuous
    is_step: bool = False  # the stamp jumps because the host's clock was set
    # The stamp jumps although the host's clock was not set, as after a pause of device or link.
    is_leap: bool = False


class Batch(NamedTuple):
    """Samples that were read together, in order of arrival."""

    # Host time at which the sample with the index ``timed`` arrived [ns].
    received_at_ns: int
    tension_n: NDArray[np.float64]  # tension [N], float64, shape (samples,)
    # Device time or counter of each sample; None for a device without a clock.
    ticks: NDArray[np.uint32] | Sequence[int] | None = None
    # Fx, Fy, Fz [N], Tx, Ty, Tz [N m], float64, shape (samples, 6)
    wrench: NDArray[np.float64] | None = None
    # Bits of `StrainStatus` as reported by the device, uint32, shape (samples,)
    status: NDArray[np.uint32] | None = None
    timed: int = 0  # index of the sample that arrived at ``received_at_ns``
    # Numbers that the sensor gives the records since its stream started, uint32, shape (samples,)
    records: NDArray[np.uint32] | None = None


class Run(NamedTuple):
    """Consecutive samples of a batch without a gap between them."""

    samples: slice | NDArray[np.intp]  # index of the samples in the batch, oldest first
    stamp_ns: int  # ROS time of the first sample [ns]; the others follow by the period
    stamp_error_s: float  # bound on the error of the stamps [s]; negative if not known
    lost: int = 0  # number of samples missing before the first one
    event: int = 0  # bits of `StrainStatus`: restart, clock step or jump before the first sample


class SampleClock:
    """Base class of the clocks, which assign times to the samples of one sensor.

    The number of missing samples between two samples is the difference of their device times in
    whole periods, minus one. Errors do not accumulate, because only neighbouring samples are
    compared. If the rate of the device deviates by 100 ppm, a gap of several thousand samples is
    still counted exactly.

    Attributes
    ----------
    period_ns : int
        Nominal time between two samples [ns].
    duplicates, late_samples, outliers : int
        Numbers of samples dropped because they were received twice, after a newer sample, or
        with an implausible time.
    restarts : int
        Number of times that the device's clock restarted.
    """

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.duplicates = self.late_samples = self.outliers = self.restarts = 0
        self._outlier: tuple[int, int] | None = None  # device time, arrival [ns]
        self._device_ns: int | None = None  # device time of the newest accepted sample

    def note_reconnection(self) -> None:
        """Record that the link was lost and re-established before the next sample."""

    def note_step(self, step_ns: int) -> None:
        """Record that the host's clock was set by ``step_ns`` before the next sample."""
        if self._outlier is not None:
            self._outlier = (self._outlier[0], self._outlier[1] + step_ns)

    def note_newest(self, ticks: int | None, received_at_ns: int) -> None:
        """Record the newest of several samples that arrived together, before they are placed.

        The newest sample has waited in the port for the shortest time. Its time of arrival is
        therefore the best first estimate of the offset between host and device clock.
        """

    def place_batch(self, batch: Batch) -> list[Run]:
        """Assign times to the samples of a batch; return the accepted samples as runs."""
        runs = []
        ticks = batch.ticks
        for i in range(len(batch.tension_n)):
            instant = self.place(None if ticks is None else int(ticks[i]), batch.received_at_ns)
            if instant is None:
                continue
            event = instant.is_restart * _RESTART
            event |= instant.is_step * _STEP | instant.is_leap * _LEAP
            lost = self._count_lost(instant)
            runs.append(Run(slice(i, i + 1), instant.stamp_ns, instant.stamp_error_s, lost, event))
        return runs

    def place(self, ticks: int | None, received_at_ns: int) -> Instant | None:
        """Return the time of a sample, or None if the sample is dropped.

        Parameters
        ----------
        ticks : int or None
            Device time of the sample in ticks; None for a device without a clock.
        received_at_ns : int
            Host time of arrival [ns].
        """
        raise NotImplementedError

    def _count_lost(self, instant: Instant) -> int:
        before_ns, self._device_ns = self._device_ns, instant.device_ns
        if before_ns is None or self._device_ns is None or instant.is_restart:
            return 0
        elapsed_ns = self._device_ns - before_ns
        periods = (2 * elapsed_ns + self.period_ns) // (2 * self.period_ns)
        return periods - 1 if periods > 1 else 0

    def _drop_old(self, behind_ns: int) -> None:
        """Count a sample that is not newer than the newest one as duplicate or late."""
        if behind_ns:
            self.late_samples += 1
        else:
            self.duplicates += 1

    def _continues_outlier(self, time_ns: int, received_at_ns: int, slack_ns: int) -> bool:
        """Return True if this sample confirms the previous outlier; else count it as an outlier.

        If two outliers in a row agree with each other, the clock of the device or of the publisher
        was restarted or set.
        """
        before, self._outlier = self._outlier, (time_ns, received_at_ns)
        if before is not None and 0 < time_ns - before[0] <= received_at_ns - before[1] + slack_ns:
            return True
        self.outliers += 1
        return False


class HostClock(SampleClock):
    """Assigns the time of arrival to samples without device time; stamps always increase."""

    def __init__(self, period_ns: int) -> None:
        super().__init__(period_ns)
        self._stamp_ns: int | None = None

    def note_step(self, step_ns: int) -> None:
        if self._stamp_ns is not None:
            self._stamp_ns += step_ns

    def place(self, ticks: int | None, received_at_ns: int) -> Instant:
        stamp_ns = received_at_ns
        if self._stamp_ns is not None:
            stamp_ns = max(stamp_ns, self._stamp_ns + 1)
        self._stamp_ns = stamp_ns
        return Instant(None, stamp_ns, -1.0)


class DeviceClock(SampleClock):
    """Converts the device time of samples to ROS time.

    The stamp of a sample is its device time plus an offset, which follows the offset that
    `ClockSkewFilter` estimates. The used offset changes by at most 1/20 of the elapsed device
    time. Therefore, the difference of two stamps equals the difference of their device times
    within 6 %, and stamps never decrease. There are two exceptions. `note_step` shifts the offset
    immediately when the host's clock was set. If the estimated offset rises by more than 1 s
    without such a step, the clock of the device has paused, and the stamps jump forward.

    The stated error of a stamp is the sum of one tick, the distance of the offset from the
    estimated offset, and the error of the estimate. It is unknown during the first five seconds.
    It does not include the constant part of the delay from sensor to host, which cannot be
    measured here.

    The first samples can wait in the port until the reading thread starts. Therefore, the first
    offset is taken from the newest of them, which has waited for the shortest time.

    The device time can be a 32-bit counter that wraps. Samples are dropped if they are duplicates
    (same device time as the sample before), late (up to 0.25 s older) or outliers (even older, or
    more than 1 s ahead of the host). If two outliers in a row agree, the device has restarted.
    After a reconnection, the port contains no old data. The device has then restarted if already
    the first sample would be an outlier, or if it is more than 1 s behind the host.

    Parameters
    ----------
    tick_s : float
        Device time of one tick [s].
    period_ns : int
        Nominal time between two samples [ns].
    """

    def __init__(self, tick_s: float, period_ns: int) -> None:
        super().__init__(period_ns)
        self._tick_s = tick_s
        # The tick is stored as an exact fraction, so that errors of rounding do not add up.
        tick_ns = Fraction(tick_s).limit_denominator(10**9) * SECOND_NS
        self._numerator, self._denominator = tick_ns.numerator, tick_ns.denominator
        self._skew = ClockSkewFilter()
        self._last: Instant | None = None
        self._last_ns = 0  # device time of the last sample
        self._wrapped_ticks = 0
        self._offset_ns = self._line_ns = 0  # used and estimated offset at the last sample
        self._first_offset_ns: int | None = None  # from `note_newest`
        self._is_reconnected = False

    def note_reconnection(self) -> None:
        # The next sample shows whether the device has restarted; see the class.
        self._is_reconnected = True

    def note_step(self, step_ns: int) -> None:
        super().note_step(step_ns)
        self._skew.shift(step_ns)
        self._offset_ns += step_ns
        self._line_ns += step_ns
        if self._last is not None:
            self._last = self._last._replace(stamp_ns=self._last.stamp_ns + step_ns)

    def note_newest(self, ticks: int | None, received_at_ns: int) -> None:
        if self._last is None and ticks is not None:
            self._first_offset_ns = received_at_ns - self._to_ns(ticks)

    def place(self, ticks: int | None, received_at_ns: int) -> Instant | None:
        if ticks is None:
            raise ValueError('a device clock needs samples with a device time')
        if self._last is None:
            return self._begin(ticks, received_at_ns, is_restart=False)
        expected_ns = received_at_ns - self._line_ns
        device_ns = self._to_ns(ticks + self._wrapped_ticks)
        if device_ns < self._last_ns:
            after_wrap_ns = self._to_ns(ticks + self._wrapped_ticks + _WRAP_TICKS)
            if self._last_ns < after_wrap_ns <= expected_ns + _EARLY_NS:
                self._wrapped_ticks += _WRAP_TICKS
                device_ns = after_wrap_ns
        fits = self._last_ns < device_ns <= expected_ns + _EARLY_NS
        if self._is_reconnected and not (fits and expected_ns - device_ns <= STEP_NS):
            return self._begin(ticks, received_at_ns, is_restart=True)
        if fits:
            return self._continue(device_ns, received_at_ns)
        if self._last_ns - _LATE_NS < device_ns <= self._last_ns:
            self._drop_old(self._last_ns - device_ns)
            return None
        if self._continues_outlier(self._to_ns(ticks), received_at_ns, _EARLY_NS):
            return self._begin(ticks, received_at_ns, is_restart=True)
        return None

    def _to_ns(self, ticks: int) -> int:
        return ticks * self._numerator // self._denominator

    def _begin(self, ticks: int, received_at_ns: int, *, is_restart: bool) -> Instant:
        device_ns = self._to_ns(ticks)
        self._wrapped_ticks = 0
        self.restarts += is_restart
        offset_ns = received_at_ns - device_ns
        newest_ns = self._first_offset_ns if self._last is None else None
        if newest_ns is not None and 0 < offset_ns - newest_ns < _MOST_WAITED_NS:
            offset_ns = newest_ns
        self._skew.restart(device_ns, offset_ns)
        self._line_ns = offset_ns
        if self._last is not None:
            offset_ns = max(offset_ns, self._last.stamp_ns + 1 - device_ns)
        self._offset_ns = offset_ns
        return self._stamp(device_ns, 0, is_restart=is_restart)

    def _continue(self, device_ns: int, received_at_ns: int) -> Instant:
        offset_ns = self._line_ns = self._skew.add(device_ns, received_at_ns - device_ns)
        away_ns = self._offset_ns - self._skew.at(self._last_ns)
        lack_ns = 0
        if away_ns >= -STEP_NS:  # otherwise the stamps jump to the estimated offset
            lack_ns = max(abs(away_ns) - (device_ns - self._last_ns) // _SLEW_DIVISOR, 0)
            offset_ns += lack_ns if away_ns > 0 else -lack_ns
        is_leap = offset_ns - self._offset_ns > STEP_NS
        self._offset_ns = offset_ns
        return self._stamp(device_ns, lack_ns, is_restart=False, is_leap=is_leap)

    def _stamp(
        self, device_ns: int, lack_ns: int, *, is_restart: bool, is_leap: bool = False
    ) -> Instant:
        """Return the time of a sample.

        ``lack_ns`` is the distance of the used offset from the estimated offset [ns].
        """
        stamp_ns = device_ns + self._offset_ns
        if self._last is not None and stamp_ns <= self._last.stamp_ns:
            stamp_ns = self._last.stamp_ns + 1  # only needed if a tick is a few nanoseconds
        self._last_ns = device_ns
        self._outlier = None
        self._is_reconnected = False
        scatter_ns = self._skew.scatter_ns
        error_s = self._tick_s + (scatter_ns + lack_ns) / 1e9 if scatter_ns >= 0 else -1.0
        self._last = Instant(device_ns, stamp_ns, error_s, is_restart, is_leap=is_leap)
        return self._last
