# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Device time to ROS time.

A line arrives some delay after its sample was taken. Most delays are short, some are
long (a busy host, a full buffer), none is negative. So of all differences "arrival minus
device time" the smallest ones are right and the others are late: the lower envelope over
a sliding horizon, short against the drift of the two clocks, is the offset between them.
"""

from __future__ import annotations

from collections import deque
from fractions import Fraction
from typing import NamedTuple

_SECOND_NS = 1_000_000_000
_BUCKETS = 10  # seconds of arrivals in the horizon
_DRIFT = 100e-6  # of a crystal against the host
_SLEW_DIVISOR = 20
_STEP_NS = _SECOND_NS
_LATE_NS = _SECOND_NS // 4
_EARLY_NS = _SECOND_NS
_WRAP_TICKS = 1 << 32


class Instant(NamedTuple):
    """When one sample was taken.

    Attributes
    ----------
    device_ns
        Device time without wraps [ns]; None when the device has no clock.
    stamp_ns
        ROS time [ns]; strictly increasing.
    stamp_error_s
        Bound on the error of the stamp [s]; negative when not known.
    is_restart
        Whether the device's clock started anew: ``device_ns`` does not continue.
    """

    device_ns: int | None
    stamp_ns: int
    stamp_error_s: float
    is_restart: bool = False


class HostClock:
    """Stamps for a device without a clock: the time of arrival, made strictly increasing."""

    late_samples = 0
    outliers = 0

    def __init__(self) -> None:
        self._stamp_ns: int | None = None

    def note_reconnection(self) -> None:
        """Do nothing: arrival times go on as before."""

    def place(self, ticks: int | None, received_at_ns: int) -> Instant:
        """Return when a sample was taken, as far as its arrival tells."""
        stamp_ns = received_at_ns
        if self._stamp_ns is not None:
            stamp_ns = max(stamp_ns, self._stamp_ns + 1)
        self._stamp_ns = stamp_ns
        return Instant(None, stamp_ns, -1.0)


class DeviceClock:
    """Maps the ticks of one device to ROS time.

    stamp = device time + offset. The offset follows the lower envelope of "arrival minus
    device time" over the last ten seconds in which something arrived, by at most 1/20 of
    the device time that passes: two stamps differ by what the device says, within 5 %, and
    never go backwards. Only when the envelope rises by more than 1 s (the host's clock was
    set) the offset steps.

    The stated error is one tick, plus what the offset still lacks of the envelope, plus
    the spread of the envelope over the horizon, plus 100 ppm of drift over the horizon; in
    the first second it is not known. It holds while at least one line of the horizon comes
    with no more than the usual delay, and relative to that delay: the constant part of the
    way from the sensor to the host cannot be seen from this side.

    A tick counter of 32 bits may wrap. A reading up to 0.25 s before the one before it is
    late (or a duplicate) and has no place. One that is further back, or more than 1 s ahead
    of the host, is an outlier and has none either, unless the next one continues it: then
    the device has restarted. After a reconnection one such reading is enough, or one that
    is more than 1 s behind: nothing old survives in the port.

    Parameters
    ----------
    tick_s : float
        Device time of one tick [s].

    Attributes
    ----------
    late_samples, outliers : int
        Readings without a place.
    """

    def __init__(self, tick_s: float) -> None:
        self._tick_s = tick_s
        # As a fraction (0.001 is 1/1000 again), so that days of ticks stay exact.
        tick_ns = Fraction(tick_s).limit_denominator(10**9) * _SECOND_NS
        self._numerator, self._denominator = tick_ns.numerator, tick_ns.denominator
        self.late_samples = 0
        self.outliers = 0
        self._last: Instant | None = None
        self._last_ns = 0  # device time of the last reading
        self._wrapped_ticks = 0
        self._offset_ns = 0
        self._envelope_ns = 0
        self._buckets: deque[tuple[int, int]] = deque()  # (second of arrival, least difference)
        self._outlier: tuple[int, int] | None = None  # (ticks, arrival)
        self._is_reconnected = False

    def note_reconnection(self) -> None:
        """Expect the next reading to be fresh, and perhaps the device to have restarted."""
        self._is_reconnected = True

    def place(self, ticks: int | None, received_at_ns: int) -> Instant | None:
        """Return when a sample was taken, or None when its time fits nowhere.

        Parameters
        ----------
        ticks : int
            Device time of the sample.
        received_at_ns : int
            Host time of its arrival [ns].
        """
        if ticks is None:
            raise ValueError('a device clock needs readings with device time')
        if self._last is None:
            return self._begin(ticks, received_at_ns, is_restart=False)
        expected_ns = received_at_ns - self._envelope_ns
        device_ns = self._to_ns(ticks + self._wrapped_ticks)
        if device_ns < self._last_ns:
            after_wrap_ns = self._to_ns(ticks + self._wrapped_ticks + _WRAP_TICKS)
            if self._last_ns < after_wrap_ns <= expected_ns + _EARLY_NS:
                self._wrapped_ticks += _WRAP_TICKS
                device_ns = after_wrap_ns
        fits = self._last_ns < device_ns <= expected_ns + _EARLY_NS
        if self._is_reconnected and not (fits and expected_ns - device_ns <= _STEP_NS):
            return self._begin(ticks, received_at_ns, is_restart=True)
        if fits:
            return self._continue(device_ns, received_at_ns)
        if self._last_ns - _LATE_NS < device_ns <= self._last_ns:
            self.late_samples += 1
            return None
        if self._continues_outlier(ticks, received_at_ns):
            return self._begin(ticks, received_at_ns, is_restart=True)
        self._outlier = (ticks, received_at_ns)
        self.outliers += 1
        return None

    def _to_ns(self, ticks: int) -> int:
        return ticks * self._numerator // self._denominator

    def _continues_outlier(self, ticks: int, received_at_ns: int) -> bool:
        if self._outlier is None:
            return False
        outlier_ticks, outlier_at_ns = self._outlier
        elapsed_ns = self._to_ns(ticks - outlier_ticks)
        return 0 < elapsed_ns <= received_at_ns - outlier_at_ns + _EARLY_NS

    def _begin(self, ticks: int, received_at_ns: int, *, is_restart: bool) -> Instant:
        device_ns = self._to_ns(ticks)
        self._wrapped_ticks = 0
        self._buckets.clear()
        self._note_difference(received_at_ns - device_ns, received_at_ns)
        self._offset_ns = self._envelope_ns
        if self._last is not None:
            self._offset_ns = max(self._offset_ns, self._last.stamp_ns + 1 - device_ns)
        return self._stamp(device_ns, is_restart=is_restart)

    def _continue(self, device_ns: int, received_at_ns: int) -> Instant:
        self._note_difference(received_at_ns - device_ns, received_at_ns)
        change_ns = self._envelope_ns - self._offset_ns
        if change_ns <= _STEP_NS:
            slew_ns = (device_ns - self._last_ns) // _SLEW_DIVISOR
            change_ns = max(-slew_ns, min(slew_ns, change_ns))
        self._offset_ns += change_ns
        return self._stamp(device_ns, is_restart=False)

    def _note_difference(self, difference_ns: int, received_at_ns: int) -> None:
        """Move the lower envelope: the least difference of each second, then of the horizon."""
        second = received_at_ns // _SECOND_NS
        buckets = self._buckets
        if buckets and buckets[-1][0] == second:
            buckets[-1] = (second, min(buckets[-1][1], difference_ns))
        else:
            buckets.append((second, difference_ns))
            if len(buckets) > _BUCKETS:
                buckets.popleft()
        self._envelope_ns = min(least_ns for _, least_ns in buckets)

    def _stamp(self, device_ns: int, *, is_restart: bool) -> Instant:
        self._last_ns = device_ns
        self._outlier = None
        self._is_reconnected = False
        stamp_ns = device_ns + self._offset_ns
        self._last = Instant(device_ns, stamp_ns, self._compute_error(), is_restart)
        return self._last

    def _compute_error(self) -> float:
        # Without the newest second, which may hold nothing but late lines so far.
        *differences_ns, _ = (least_ns for _, least_ns in self._buckets)
        if not differences_ns:
            return -1.0
        horizon_s = abs(self._buckets[-1][0] - self._buckets[0][0]) + 1
        spread_ns = max(differences_ns) - min(differences_ns)
        lack_ns = abs(self._envelope_ns - self._offset_ns)
        return self._tick_s + _DRIFT * horizon_s + (spread_ns + lack_ns) / 1e9
