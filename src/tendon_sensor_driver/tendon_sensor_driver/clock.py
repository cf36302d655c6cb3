# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The time of samples: clocks of hosts and devices, and what is missing between two samples.

A `SampleClock` gives the samples of one sensor their place: it drops what has none, and returns
`Run` of consecutive samples. Clocks that look at one sample at a time implement `place`; a clock
of whole batches overrides `place_batch`.
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
"""A larger rise of the difference is treated as a clock step, not as a delay [ns]."""

_HORIZON = 30  # least differences that are kept
_LEAST_SAMPLES = 30  # for one least difference, so that it is likely to be a short delay
_MOST_SECONDS = 3  # however few samples come
_FORGET_S = 8.0  # weight of the past, against a drift that changes
_FEWEST = 5  # least differences that tell a slope
_RECENT = 10  # least differences that tell the scatter
_LARGEST_SLOPE = 0.01  # a ceramic resonator is off by 0.5 %
_RISE_NS = 50_000_000  # of all of the last few: the host's clock was set
_CHANGE_NS = 500_000  # a drift that changes by 10 ppm, bursts that beat with the samples


class ClockSkewFilter:
    """A lower bound of the differences, linear in time, refitted once a second.

    Differences are kept as the least one of each second, or of thirty samples or three
    seconds of a slow device. The line goes along the lower convex hull of the last thirty of
    them, by the edge under their mean time, which is weighted towards the present. Where the
    last five lie more than 50 ms above the line, a clock was set and what is older is
    forgotten.

    Attributes
    ----------
    slope : float
        Drift: host time per device time, less one [1]; within 0.01.
    scatter_ns : int
        How far the line may be off [ns]: three times the median (the largest, of fewer than
        ten) of how far the least differences of the last seconds lie above it, and 0.5 ms for
        what bursts and a changing drift hide. Negative: not known, for the slope is not yet.
    """

    def __init__(self) -> None:
        self.slope = 0.0
        self.scatter_ns = -1
        self._points: deque[tuple[int, int]] = deque(maxlen=_HORIZON)
        self._device_ns = 0  # a point of the line
        self._difference_ns = 0
        self._second = 0  # of the least difference under construction
        self._samples = 0
        self._least = (0, 0)

    def restart(self, device_ns: int, difference_ns: int) -> None:
        """Begin again with one point. The slope stays, because the crystals are the same."""
        self._points.clear()
        self.scatter_ns = -1
        self._device_ns, self._difference_ns = device_ns, difference_ns
        self._begin_least(device_ns, difference_ns)

    def shift(self, step_ns: int) -> None:
        """Move line and differences up by a step of the host's clock [ns]."""
        self._difference_ns += step_ns
        self._least = (self._least[0], self._least[1] + step_ns)
        self._points = deque(
            ((device_ns, difference_ns + step_ns) for device_ns, difference_ns in self._points),
            maxlen=_HORIZON,
        )

    def at(self, device_ns: int) -> int:
        """Return the line's difference at a device time [ns]."""
        return self._difference_ns + round(self.slope * (device_ns - self._device_ns))

    def add(self, device_ns: int, difference_ns: int) -> int:
        """Take a newer sample's difference; return that of the line there, then [ns]."""
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
        # Relative to the newest point, in which floats are exact enough.
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
    """Return the slope of the lower hull's edge under the weighted mean of the abscissae."""
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
    """The host's time [ns], whose steps are told by the monotonic clock.

    The host's clock may be set back or forward at any moment, the monotonic clock never. When
    the difference of the two changes by more than 0.1 s from one reading to the next, the
    host's clock was stepped. A slow change is drift, as of a simulated time. ``step_ns`` is the
    sum of the steps since `take_step_ns` [ns]. Its methods belong to one thread.
    """

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self.step_ns = 0
        self._now_ns = now_ns
        self._offset_ns: int | None = None  # host's time less monotonic time
        self._slack_ns = 0

    def now_ns(self) -> int:
        """Return the host's time; note whether it was stepped since the last call [ns]."""
        for _ in range(_ATTEMPTS):  # other threads may run between two looks at the clocks
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
        """Return `step_ns` and set it to 0."""
        step_ns, self.step_ns = self.step_ns, 0
        return step_ns


class Instant(NamedTuple):
    """When one sample was taken."""

    device_ns: int | None  # device time without wraps [ns]; None when the device has no clock
    stamp_ns: int  # ROS time [ns]; strictly increasing
    stamp_error_s: float  # bound on the error of the stamp [s]; negative when not known
    is_restart: bool = False  # the device's clock started anew: `device_ns` does not continue
    is_step: bool = False  # the stamp leaps because the host's clock was set
    # The stamp leaps though the host's clock was not set, as far as the monotonic clock tells:
    # the device or the line stood still.
    is_leap: bool = False


class Batch(NamedTuple):
    """Samples that were read together, in the order of their arrival."""

    # Host time of the arrival of the sample ``timed`` [ns]; the others came at about that time.
    received_at_ns: int
    tension_n: NDArray[np.float64]  # tension [N], float64, shape (samples,)
    # Device time or counter of each sample; None for a device without a clock.
    ticks: NDArray[np.uint32] | Sequence[int] | None = None
    # Fx, Fy, Fz [N], Tx, Ty, Tz [N m], float64, shape (samples, 6)
    wrench: NDArray[np.float64] | None = None
    # Bits of `StrainStatus` by the device, uint32, shape (samples,)
    status: NDArray[np.uint32] | None = None
    timed: int = 0  # index of the sample whose arrival is known
    # Numbers of the records in this session of the link, uint32, shape (samples,)
    records: NDArray[np.uint32] | None = None


class Run(NamedTuple):
    """Consecutive samples of a batch, nothing missing between them."""

    samples: slice | NDArray[np.intp]  # which samples of the batch, oldest first
    stamp_ns: int  # ROS time of the first [ns]; the others follow by the clock's period
    stamp_error_s: float  # bound on the error of the stamps [s]; negative when not known
    lost: int = 0  # samples missing before the first
    event: int = 0  # bits of `StrainStatus`: restart, clock step or leap before the first


class SampleClock:
    """Base class of the clocks of sensors.

    The samples lost before one are the device time since the one before, in whole periods,
    less one. Only neighbours are compared, so ticks coarser than the period's fraction and a
    device rate a little off the nominal one never add up to a false gap; a gap of some thousand
    samples is still counted exactly at 100 ppm.

    ``period_ns`` is the nominal time between two samples [ns]. ``duplicates``, ``late_samples``
    and ``outliers`` count the samples without a place, ``restarts`` the times that the device's
    clock began anew.
    """

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.duplicates = self.late_samples = self.outliers = self.restarts = 0
        self._outlier: tuple[int, int] | None = None  # its own time, arrival [ns]
        self._device_ns: int | None = None  # of the newest sample that has a place

    def note_reconnection(self) -> None:
        """Note that the link was lost and came back before the next sample."""

    def note_step(self, step_ns: int) -> None:
        """Follow the host's clock, which was set by this before the next sample [ns]."""
        if self._outlier is not None:
            self._outlier = (self._outlier[0], self._outlier[1] + step_ns)

    def note_newest(self, ticks: int | None, received_at_ns: int) -> None:
        """Note the newest of several samples that arrive as one, before the first; see `place`."""

    def place_batch(self, batch: Batch) -> list[Run]:
        """Return the samples that have a place in time, as runs."""
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
        """Return when a sample was taken, or None when its time fits nowhere.

        ``ticks`` is its device time, None without a clock; it arrived at ``received_at_ns`` [ns].
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
        """Count a sample that is so far behind the newest one, or is that one again."""
        if behind_ns:
            self.late_samples += 1
        else:
            self.duplicates += 1

    def _continues_outlier(self, time_ns: int, received_at_ns: int, slack_ns: int) -> bool:
        """Tell whether a sample follows the outlier before it; if not, it is one itself."""
        before, self._outlier = self._outlier, (time_ns, received_at_ns)
        if before is not None and 0 < time_ns - before[0] <= received_at_ns - before[1] + slack_ns:
            return True
        self.outliers += 1
        return False


class HostClock(SampleClock):
    """Stamps for a device without a clock: the time of arrival, made strictly increasing."""

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

    stamp = device time + offset. The offset follows the line under "arrival minus device
    time" (`ClockSkewFilter`), which knows the drift, by at most 1/20 of the device time that
    passes: two stamps differ by what the device says, within 6 %, and never go backwards.
    A step of the host's clock that `note_step` tells moves line and stamps at once. A rise of the
    line that nobody told comes from the device, whose clock stood still. It moves the stamps when
    the line has come more than 1 s above them.

    The stated error is one tick, plus what the offset still lacks of the line, plus how far
    the line may be off; in the first five seconds it is not known. It is relative to the shortest
    delay: the constant part of the way from the sensor to the host cannot be seen from here.

    The first samples may have waited in the port until the host's thread ran. The newest of them
    waited least, and gives the first offset.

    A tick counter of 32 bits may wrap. A reading with the device time of the one before is
    a duplicate, one up to 0.25 s before it is late; both have no place. One that is further
    back, or more than 1 s ahead of the host, is an outlier and has none either, unless the
    next one continues it: then the device has restarted. After a reconnection one such
    reading is enough, or one that is more than 1 s behind: nothing old survives in the port.

    ``tick_s`` is the device time of one tick [s].
    """

    def __init__(self, tick_s: float, period_ns: int) -> None:
        super().__init__(period_ns)
        self._tick_s = tick_s
        # As a fraction (0.001 is 1/1000 again), so that days of ticks stay exact.
        tick_ns = Fraction(tick_s).limit_denominator(10**9) * SECOND_NS
        self._numerator, self._denominator = tick_ns.numerator, tick_ns.denominator
        self._skew = ClockSkewFilter()
        self._last: Instant | None = None
        self._last_ns = 0  # device time of the last reading
        self._wrapped_ticks = 0
        self._offset_ns = self._line_ns = 0  # of the stamps and of the line, at the last reading
        self._first_offset_ns: int | None = None  # of the newest of the first readings
        self._is_reconnected = False

    def note_reconnection(self) -> None:
        # The next reading is fresh; perhaps the device has restarted.
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
            raise ValueError('a device clock needs readings with device time')
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
        if away_ns >= -STEP_NS:  # else the stamps leap to the line
            lack_ns = max(abs(away_ns) - (device_ns - self._last_ns) // _SLEW_DIVISOR, 0)
            offset_ns += lack_ns if away_ns > 0 else -lack_ns
        is_leap = offset_ns - self._offset_ns > STEP_NS
        self._offset_ns = offset_ns
        return self._stamp(device_ns, lack_ns, is_restart=False, is_leap=is_leap)

    def _stamp(
        self, device_ns: int, lack_ns: int, *, is_restart: bool, is_leap: bool = False
    ) -> Instant:
        """Return the instant of a device time whose offset lacks so much of the line [ns]."""
        stamp_ns = device_ns + self._offset_ns
        if self._last is not None and stamp_ns <= self._last.stamp_ns:
            stamp_ns = self._last.stamp_ns + 1  # ticks of single nanoseconds
        self._last_ns = device_ns
        self._outlier = None
        self._is_reconnected = False
        scatter_ns = self._skew.scatter_ns
        error_s = self._tick_s + (scatter_ns + lack_ns) / 1e9 if scatter_ns >= 0 else -1.0
        self._last = Instant(device_ns, stamp_ns, error_s, is_restart, is_leap=is_leap)
        return self._last
