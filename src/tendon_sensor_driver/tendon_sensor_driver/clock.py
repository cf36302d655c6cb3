# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stamps of samples from host and device clocks, and the number of missing samples.

A `SampleClock` assigns a time to each sample of one sensor. It drops duplicate and late samples
and those with an implausible time, and returns the others as `Run` of consecutive samples. A
clock that handles one sample at a time implements `place`; one that handles whole batches
overrides `place_batch`.
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
"""A rise of the time difference above this is treated as a clock step, not as a delay [ns]."""

_HORIZON = 30  # number of stored minima
_LEAST_SAMPLES = 30  # samples per minimum, so that it is likely to contain a short delay
_MOST_SECONDS = 3  # longest time for one minimum, for devices with few samples per second
_FORGET_S = 8.0  # time constant of the weights, to follow a changing drift
_FEWEST = 5  # fewest minima for an estimate of the slope
_RECENT = 10  # latest minima, from which the scatter is estimated
_LARGEST_SLOPE = 0.01  # a ceramic resonator deviates by 0.5 %
_RISE_NS = 50_000_000  # if all of the latest minima rise by more, the host's clock was set
_CHANGE_NS = 500_000  # allowance for a drift that changes by 10 ppm and for periodic bursts


class ClockSkewFilter:
    """Linear lower bound of "arrival time minus device time", refitted once a second.

    A delay only ever increases this difference, so its lower bound follows the clocks. The
    filter stores the smallest difference of each second. If a second has fewer than thirty
    samples, the interval is extended to thirty samples, but to three seconds at most. The line is
    an edge of the lower convex hull of the latest thirty minima: the edge at their mean time, in
    which recent minima have a higher weight. If the latest five minima are more than 50 ms above
    the line, a clock was set, and older minima are dropped.

    Attributes
    ----------
    slope : float
        Drift: host time per device time, minus one [1]; within ±0.01.
    scatter_ns : int
        Bound on the error of the line [ns]: three times the median distance of the latest ten
        minima above the line (three times the largest distance if there are fewer than ten),
        plus 0.5 ms for errors that are not visible here. Negative until the slope is known.
    """

    def __init__(self) -> None:
        self.slope = 0.0
        self.scatter_ns = -1
        self._points: deque[tuple[int, int]] = deque(maxlen=_HORIZON)
        self._device_ns = 0  # device time of a point of the line [ns]; its value is _difference_ns
        self._difference_ns = 0
        self._second = 0  # device time of the present minimum [s]
        self._samples = 0
        self._least = (0, 0)

    def restart(self, device_ns: int, difference_ns: int) -> None:
        """Restart from one point. The slope is kept, because the oscillators are the same."""
        self._points.clear()
        self.scatter_ns = -1
        self._device_ns, self._difference_ns = device_ns, difference_ns
        self._begin_least(device_ns, difference_ns)

    def shift(self, step_ns: int) -> None:
        """Shift the line and the minima by a step of the host's clock [ns]."""
        self._difference_ns += step_ns
        self._least = (self._least[0], self._least[1] + step_ns)
        self._points = deque(
            ((device_ns, difference_ns + step_ns) for device_ns, difference_ns in self._points),
            maxlen=_HORIZON,
        )

    def at(self, device_ns: int) -> int:
        """Return the value of the line at a device time [ns]."""
        return self._difference_ns + round(self.slope * (device_ns - self._device_ns))

    def add(self, device_ns: int, difference_ns: int) -> int:
        """Add the difference of a newer sample; return the line's value at its time [ns]."""
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
        # Times are relative to the newest point, so that the precision of floats is sufficient.
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
    """Return the slope of the lower hull's edge below the weighted mean of the x values."""
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
_MOST_WAITED_NS = 10 * SECOND_NS  # 4096 bytes of a port are 5 s of lines at 60 Hz
_LEAST_STEP_NS = SECOND_NS // 10
_QUICK_NS = SECOND_NS // 1000
_ATTEMPTS = 3
_RESTART = int(StrainStatus.RECONNECTED | StrainStatus.RESTARTED)
_STEP, _LEAP = int(StrainStatus.CLOCK_STEP), int(StrainStatus.RESYNCHRONISED)


class ArrivalClock:
    """The host's clock, with detection of clock steps by means of the monotonic clock.

    The host's clock may be set at any moment, the monotonic clock never. A change of their
    difference by more than 0.1 s between two calls of `now_ns` is a step of the host's clock. A
    slow change is drift, as with simulated time. Not thread-safe.

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
        """Return the host's time [ns]; add a step since the last call to ``step_ns``."""
        for _ in range(_ATTEMPTS):  # other threads may run between reading the two clocks
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
    # The stamp jumps without a step of the host's clock: the device or the link paused.
    is_leap: bool = False


class Batch(NamedTuple):
    """Samples that were read together, in order of arrival."""

    # Host time at which sample number ``timed`` arrived [ns]; the others arrived close to it.
    received_at_ns: int
    tension_n: NDArray[np.float64]  # tension [N], float64, shape (samples,)
    # Device time or counter of each sample; None for a device without a clock.
    ticks: NDArray[np.uint32] | Sequence[int] | None = None
    # Fx, Fy, Fz [N], Tx, Ty, Tz [N m], float64, shape (samples, 6)
    wrench: NDArray[np.float64] | None = None
    # Bits of `StrainStatus` as reported by the device, uint32, shape (samples,)
    status: NDArray[np.uint32] | None = None
    timed: int = 0  # index of the sample whose time of arrival is known
    # Record numbers, counted from the start of the link's session, uint32, shape (samples,)
    records: NDArray[np.uint32] | None = None


class Run(NamedTuple):
    """Consecutive samples of a batch without a gap between them."""

    samples: slice | NDArray[np.intp]  # index of the samples in the batch, oldest first
    stamp_ns: int  # ROS time of the first sample [ns]; the others follow at the clock's period
    stamp_error_s: float  # bound on the error of the stamps [s]; negative if not known
    lost: int = 0  # number of samples missing before the first one
    event: int = 0  # bits of `StrainStatus`: restart, clock step or jump before the first sample


class SampleClock:
    """Base class of the clocks, which assign times to the samples of one sensor.

    The number of missing samples is the device time between two neighbouring samples in whole
    periods, minus one. Only neighbours are compared. Therefore, coarse ticks or a small deviation
    of the device's rate do not add up to a false gap. If the rate deviates by 100 ppm, a gap of
    several thousand samples is still counted exactly.

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
        self._outlier: tuple[int, int] | None = None  # sample time, time of arrival [ns]
        self._device_ns: int | None = None  # device time of the newest accepted sample

    def note_reconnection(self) -> None:
        """Record that the link was lost and re-established before the next sample."""

    def note_step(self, step_ns: int) -> None:
        """Follow a step of the host's clock [ns] that occurred before the next sample."""
        if self._outlier is not None:
            self._outlier = (self._outlier[0], self._outlier[1] + step_ns)

    def note_newest(self, ticks: int | None, received_at_ns: int) -> None:
        """Announce the newest of several samples that arrived together, before `place`.

        The newest sample has waited for the shortest time in the port, so its arrival gives the
        best first estimate of the clock's offset.
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
        """Count a sample that is this far [ns] behind the newest one; 0 is a duplicate."""
        if behind_ns:
            self.late_samples += 1
        else:
            self.duplicates += 1

    def _continues_outlier(self, time_ns: int, received_at_ns: int, slack_ns: int) -> bool:
        """Return True if this sample confirms the previous outlier; else count it as an outlier.

        Two consistent samples in a row mean that the clock behind them was restarted or set.
        """
        before, self._outlier = self._outlier, (time_ns, received_at_ns)
        if before is not None and 0 < time_ns - before[0] <= received_at_ns - before[1] + slack_ns:
            return True
        self.outliers += 1
        return False


class HostClock(SampleClock):
    """Clock of a device without a clock: stamps are times of arrival, strictly increasing."""

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
    """Maps the ticks of one device to ROS time.

    stamp = device time + offset. The offset follows the lower bound of "arrival time minus
    device time" (`ClockSkewFilter`), by at most 1/20 of the elapsed device time. Thus the
    difference of two stamps equals the difference of their device times within 6 %, and stamps
    never decrease. A step of the host's clock, announced by `note_step`, shifts bound and stamps
    immediately. An unannounced upward jump of the bound means that the device clock paused. The
    stamps follow it when the bound is more than 1 s above them.

    The stated error is the sum of one tick, the distance between offset and bound, and the error
    of the bound. It is unknown during the first five seconds. It does not include the constant
    part of the delay from the sensor to the host, which cannot be measured here.

    The first samples may have waited in the port until the reading thread started. The newest of
    them has waited for the shortest time and gives the first offset.

    A 32-bit tick counter may wrap. Samples whose device time does not increase are dropped: a
    duplicate has the device time of the sample before it, a late sample is up to 0.25 s older. A
    sample that is even older, or more than 1 s ahead of the host, is an outlier and is dropped,
    too. If the next sample is consistent with the outlier, the device has restarted. After a
    reconnection, no old data survive in the port. A single sample of this kind, or a sample that
    is more than 1 s behind the host, then means that the device has restarted.

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
        # The tick is stored as a fraction (0.001 becomes 1/1000), so that the time stays exact
        # over days.
        tick_ns = Fraction(tick_s).limit_denominator(10**9) * SECOND_NS
        self._numerator, self._denominator = tick_ns.numerator, tick_ns.denominator
        self._skew = ClockSkewFilter()
        self._last: Instant | None = None
        self._last_ns = 0  # device time of the last sample
        self._wrapped_ticks = 0
        self._offset_ns = self._line_ns = 0  # offset and lower bound at the last sample
        self._first_offset_ns: int | None = None  # offset of the newest of the first samples
        self._is_reconnected = False

    def note_reconnection(self) -> None:
        # The next sample is recent, and the device may have restarted.
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
        if away_ns >= -STEP_NS:  # otherwise the stamps jump to the lower bound
            lack_ns = max(abs(away_ns) - (device_ns - self._last_ns) // _SLEW_DIVISOR, 0)
            offset_ns += lack_ns if away_ns > 0 else -lack_ns
        is_leap = offset_ns - self._offset_ns > STEP_NS
        self._offset_ns = offset_ns
        return self._stamp(device_ns, lack_ns, is_restart=False, is_leap=is_leap)

    def _stamp(
        self, device_ns: int, lack_ns: int, *, is_restart: bool, is_leap: bool = False
    ) -> Instant:
        """Return the time of a sample; ``lack_ns`` is the distance from offset to bound [ns]."""
        stamp_ns = device_ns + self._offset_ns
        if self._last is not None and stamp_ns <= self._last.stamp_ns:
            stamp_ns = self._last.stamp_ns + 1  # possible if a tick is only a few nanoseconds
        self._last_ns = device_ns
        self._outlier = None
        self._is_reconnected = False
        scatter_ns = self._skew.scatter_ns
        error_s = self._tick_s + (scatter_ns + lack_ns) / 1e9 if scatter_ns >= 0 else -1.0
        self._last = Instant(device_ns, stamp_ns, error_s, is_restart, is_leap=is_leap)
        return self._last
