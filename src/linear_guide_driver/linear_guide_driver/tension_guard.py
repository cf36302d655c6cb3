# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decides from the measured tension whether the tendon may go on being pulled."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from enum import Enum

from linear_guide_driver.errors import MotionRefusedError


class Verdict(Enum):
    """What the tension says."""

    CONTINUE = 'continue'
    REACHED = 'the stop tension is reached: hold'
    OVER_LIMIT = 'the limit is exceeded: release'
    NO_SAMPLES = 'a stop tension was asked for and the sensor is silent: release'


class TensionGuard:
    """The tension limit of the present contact, against the latest samples.

    No IO and no clock; thread-safe. Samples arrive on one thread while a pull asks
    on another.

    Parameters
    ----------
    limits_n : mapping of str to float
        Limit by contact [N].
    timeout_s : float
        A pull with a stop tension ends when no valid sample came for this long [s].
    """

    def __init__(self, limits_n: Mapping[str, float], timeout_s: float) -> None:
        self._limits_n = dict(limits_n)
        self._timeout_ns = round(timeout_s * 1e9)
        self._lock = threading.Lock()
        # Before the first pull names a contact, the tendon has no business being tight.
        self._limit_n = min(self._limits_n.values())
        self._stop_tension_n = 0.0
        self._tension_n: float | None = None
        self._sampled_at_ns: int | None = None
        self._is_release = False
        self._is_over = False
        self._decisive_n = 0.0
        self._verdict = Verdict.CONTINUE

    @property
    def limit_n(self) -> float:
        """Limit in force [N]."""
        return self._limit_n

    @property
    def tension_n(self) -> float | None:
        """Latest tension [N]; None before the first sample."""
        return self._tension_n

    def is_alive(self, now_ns: int) -> bool:
        """Return whether valid samples arrive, at monotonic time ``now_ns`` [ns]."""
        with self._lock:
            return self._is_alive(now_ns)

    def begin(self, contact: str, stop_tension_n: float, is_release: bool, now_ns: int) -> None:
        """Put the limit of a new pull in force.

        Parameters
        ----------
        contact : str
            A key of the limits.
        stop_tension_n : float
            Tension that ends the pull [N]; 0: none does.
        is_release : bool
            True when the pull only lets tendon out, which is always allowed.
        now_ns : int
            Monotonic time [ns].

        Raises
        ------
        MotionRefusedError
        """
        with self._lock:
            limit_n = self._limits_n.get(contact)
            if limit_n is None:
                raise MotionRefusedError(
                    f'Contact "{contact}" is unknown; it must be one of '
                    f'{", ".join(self._limits_n)}.'
                )
            if not 0.0 <= stop_tension_n <= limit_n:
                raise MotionRefusedError(
                    f'Stop tension {stop_tension_n} N must be between 0 and the {contact} limit '
                    f'of {limit_n} N.'
                )
            alive = self._is_alive(now_ns)
            if stop_tension_n > 0 and not alive:
                raise MotionRefusedError(
                    'A stop tension needs the tendon sensor and no valid strain sample arrives; '
                    'start the sensor or set stop_tension_n to 0.'
                )
            if alive and not is_release and (self._tension_n or 0.0) > limit_n:
                raise MotionRefusedError(
                    f'The tension is {self._tension_n:.2f} N already, above the {contact} limit '
                    f'of {limit_n} N; release the tendon first.'
                )
            self._limit_n = limit_n
            self._stop_tension_n = stop_tension_n
            self._is_release = is_release
            self._is_over = False
            self._verdict = Verdict.CONTINUE

    def end(self) -> None:
        """Forget the stop tension; the limit stays in force."""
        with self._lock:
            self._stop_tension_n = 0.0
            self._is_release = False

    def put_back(self, limit_n: float) -> None:
        """Put the limit [N] in force that was before a pull that has not begun after all."""
        with self._lock:
            self._limit_n = limit_n

    def add_sample(self, tension_n: float, is_saturated: bool, now_ns: int) -> bool:
        """Take a valid sample; return True when the tendon must be released now.

        True comes once for each time the limit is crossed.

        Parameters
        ----------
        tension_n : float
            [N]
        is_saturated : bool
            The sensor is at the end of its range: counts as over the limit.
        now_ns : int
            Monotonic time of arrival [ns].
        """
        with self._lock:
            self._tension_n = float('inf') if is_saturated else tension_n
            self._sampled_at_ns = now_ns
            if self._is_release:
                return False
            was_over, self._is_over = self._is_over, self._tension_n > self._limit_n
            if self._is_over:
                if not was_over:
                    self._verdict, self._decisive_n = Verdict.OVER_LIMIT, self._tension_n
                return not was_over
            if self._verdict is Verdict.CONTINUE and 0 < self._stop_tension_n <= tension_n:
                self._verdict, self._decisive_n = Verdict.REACHED, tension_n
            return False

    def check(self, now_ns: int) -> Verdict:
        """Return what the running pull must do, at monotonic time ``now_ns`` [ns]."""
        with self._lock:
            if (
                self._verdict is Verdict.CONTINUE
                and self._stop_tension_n > 0
                and not self._is_alive(now_ns)
            ):
                self._verdict = Verdict.NO_SAMPLES
            return self._verdict

    def describe(self) -> str:
        """Return the present verdict as a sentence with its numbers."""
        if self._verdict is Verdict.OVER_LIMIT:
            return f'The tension, {self._decisive_n:.2f} N, is above the limit, {self._limit_n} N.'
        if self._verdict is Verdict.NO_SAMPLES:
            return f'No valid strain sample arrived for {self._timeout_ns / 1e9} s.'
        if self._verdict is Verdict.REACHED:
            return f'The tension reached {self._decisive_n:.2f} N.'
        return 'The tension is within its limit.'

    def _is_alive(self, now_ns: int) -> bool:
        return self._sampled_at_ns is not None and now_ns - self._sampled_at_ns <= self._timeout_ns
