# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Liveliness of the topics and samples that a motion depends on. No IO and no clock.

A `Watch` tells whether a sign of life is there: a `TopicWatchdog` by the messages of a topic, and
`tactile_ros.health.HeartbeatWatch` by DDS liveliness. `TensionLevel` tells whether the
tension is known and how high it is, `SampleLag` how much later than usual samples arrive. All go
by the monotonic clock: ROS time may be simulated, paused or stepped.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Protocol

_HALF_WINDOW_NS = 5_000_000_000
"""The minimum of the samples' lag is that of the last 5 to 10 s."""


class Watch(Protocol):
    """A sign of life that a motion depends on."""

    @property
    def was_heard(self) -> bool:
        """True once it was there."""

    def format_loss(self, now_ns: int) -> str:
        """Return why nothing may move, with the remedy; empty when it may [monotonic ns]."""


class TopicWatchdog:
    """Liveliness of one topic on the monotonic clock; no IO, thread-safe.

    The topic counts as silent when nothing was heard for ``timeout_s`` [s].
    """

    def __init__(self, topic: str, timeout_s: float) -> None:
        self._topic = topic
        self._timeout_ns = round(timeout_s * 1e9)
        self._heard_at_ns: int | None = None

    @property
    def was_heard(self) -> bool:
        """True once anything was heard."""
        return self._heard_at_ns is not None

    def beat(self, now_ns: int) -> None:
        """Note a message at monotonic time ``now_ns`` [ns]."""
        self._heard_at_ns = now_ns

    def format_loss(self, now_ns: int) -> str:
        """Return a sentence with the remedy while the topic is silent, else nothing [ns]."""
        heard_at_ns = self._heard_at_ns
        if heard_at_ns is None:
            return f'Nothing has been heard on {self._topic} yet; start its node.'
        if now_ns - heard_at_ns <= self._timeout_ns:
            return ''
        return (
            f'Nothing was heard on {self._topic} for {self._timeout_ns / 1e9:g} s; '
            'look after its node.'
        )


def find_loss(watches: Sequence[Watch], now_ns: int) -> str:
    """Return the sentence of the first sign of life that is lost; empty when none is [ns]."""
    for watch in watches:
        if loss := watch.format_loss(now_ns):
            return loss
    return ''


class TensionLevel:
    """Latest block of valid samples; no lock. Those older than ``timeout_s`` do not count [s].

    ``latest_n`` is the last tension [N]: infinite when saturated, None before the first sample.
    ``worst_n`` is the largest magnitude in the latest block [N]: the limit holds for both signs,
    since a sensor may be mounted the other way round.
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_ns = round(timeout_s * 1e9)
        self._arrived_at_ns: int | None = None
        self._age_ns = 0  # at arrival
        self.latest_n: float | None = None
        self.worst_n = 0.0

    def add(
        self, tension_n: Sequence[float], is_saturated: bool, now_ns: int, age_ns: int = 0
    ) -> bool:
        """Take a block as `TendonSafety.add_samples` does; return whether it counts."""
        if not tension_n or not all(map(math.isfinite, tension_n)):
            return False
        self._arrived_at_ns, self._age_ns = now_ns, age_ns
        self.latest_n = math.inf if is_saturated else tension_n[-1]
        self.worst_n = math.inf if is_saturated else max(max(tension_n), -min(tension_n))
        return True

    def forget(self) -> None:
        """Count only samples from now on."""
        self._arrived_at_ns = None

    def is_live(self, now_ns: int) -> bool:
        """Return whether valid samples arrive, and arrive in time [ns]."""
        return self._has_arrived(now_ns + self._age_ns - self._timeout_ns)

    def format_silence(self, now_ns: int) -> str:
        """Return how the samples fail to be live, within a sentence; empty when they are [ns]."""
        if self.is_live(now_ns):
            return ''
        if 2 * self._age_ns > self._timeout_ns and self._has_arrived(now_ns - self._timeout_ns):
            return f'the strain samples arrive {self._age_ns / 1e9:.2f} s late'
        return 'no valid strain sample arrives'

    def is_above(self, limit_n: float, now_ns: int) -> bool:
        """Return whether samples that arrive are above a limit, late ones, too [N, ns]."""
        return self._has_arrived(now_ns - self._timeout_ns) and self.worst_n > limit_n

    def _has_arrived(self, since_ns: int) -> bool:
        return self._arrived_at_ns is not None and self._arrived_at_ns >= since_ns

    def format_above(self, limit_n: float) -> str:
        """Return a sentence that says that the limit is exceeded [N]."""
        return f'The tension, {self.worst_n:.2f} N, is above the limit, {limit_n} N'

    def is_below(self, limit_n: float, now_ns: int) -> bool:
        """Return whether live samples are below a limit [N, ns]."""
        return self.is_live(now_ns) and self.worst_n < limit_n


class SampleLag:
    """Compares a sample's lag, arrival minus stamp, with the minimum of the last seconds.

    Stamps and arrivals need no common clock: only differences of lags count, and a stamp can only
    make a sample older. A stamp that is not later than the one before it tells that the clock was
    set back, or stands: then the minimum begins anew with this sample. After a step that no stamp
    shows, as one during a silence, it is right again after 10 s at the latest.
    """

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._since_ns = 0
        self._present_ns: int | None = None  # minimum since then
        self._before_ns: int | None = None  # minimum of the half window before

    def add(self, stamp_ns: int, arrived_at_ns: int, *, is_step: bool = False) -> int:
        """Take a sample; return how much its lag is above the recent minimum [ns].

        ``stamp_ns`` is by the clock of the sensor, ``arrived_at_ns`` by the monotonic one [ns].
        ``is_step``: the sensor says that its clock was set.
        """
        lag_ns = arrived_at_ns - stamp_ns
        elapsed_ns = arrived_at_ns - self._since_ns
        if is_step or (self._stamp_ns is not None and stamp_ns <= self._stamp_ns):
            self._present_ns = self._before_ns = None
            self._since_ns = arrived_at_ns
        elif elapsed_ns >= _HALF_WINDOW_NS:
            self._before_ns = self._present_ns if elapsed_ns < 2 * _HALF_WINDOW_NS else None
            self._present_ns, self._since_ns = None, arrived_at_ns
        self._stamp_ns = stamp_ns
        self._present_ns = lag_ns if self._present_ns is None else min(self._present_ns, lag_ns)
        lowest_ns = self._present_ns
        if self._before_ns is not None:
            lowest_ns = min(lowest_ns, self._before_ns)
        return lag_ns - lowest_ns
