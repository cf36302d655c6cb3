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

"""Decides from the measured tension whether the tendon may go on being pulled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum
import math
import threading

from linear_guide_driver.errors import MotionRefusedError


class Verdict(Enum):
    """What the tension says."""

    CONTINUE = 'continue'
    REACHED = 'the stop tension is reached: hold'
    OVER_LIMIT = 'the limit is exceeded: release'
    NO_SAMPLES = 'the sensor is silent: hold'


class TensionGuard:
    """The tension limit of the present contact, against the latest samples.

    No IO and no clock; thread-safe. Samples arrive on one thread while a pull asks
    on another.

    Parameters
    ----------
    limits_n : mapping of str to float
        Limit by contact [N].
    timeout_s : float
        A pull ends when no valid sample came for this long [s].
    is_optional : bool
        True lets pulls without a stop tension go on without samples.
    """

    def __init__(
        self, limits_n: Mapping[str, float], timeout_s: float, is_optional: bool = False
    ) -> None:
        self._is_optional = is_optional
        self._limits_n = dict(limits_n)
        self._timeout_ns = round(timeout_s * 1e9)
        self._lock = threading.Lock()
        # Before the first pull names a contact, the tendon has no business being tight.
        self._limit_n = min(self._limits_n.values())
        self._stop_tension_n = 0.0
        self._needs_samples = False
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

    def live_tension_n(self, now_ns: int) -> float | None:
        """Return the latest tension [N]; None when valid samples do not arrive [ns]."""
        with self._lock:
            return self._tension_n if self._is_alive(now_ns) else None

    @property
    def strictest_contact(self) -> str:
        """The contact with the lowest limit."""
        return min(self._limits_n, key=lambda contact: self._limits_n[contact])

    def begin(
        self,
        contact: str,
        stop_tension_n: float,
        is_release: bool,
        now_ns: int,
        target_tension_n: float = 0.0,
    ) -> None:
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
        target_tension_n : float
            Tension that the pull is to reach and keep [N]; 0: none.

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
            for name, tension_n in (('Stop', stop_tension_n), ('Target', target_tension_n)):
                if not 0.0 <= tension_n <= limit_n:
                    raise MotionRefusedError(
                        f'{name} tension {tension_n} N must be between 0 and the {contact} limit '
                        f'of {limit_n} N.'
                    )
            if stop_tension_n and target_tension_n:
                raise MotionRefusedError(
                    'A pull takes stop_tension_n or target_tension_n; set one of them to 0.'
                )
            alive = self._is_alive(now_ns)
            asks = bool(stop_tension_n or target_tension_n)
            needs_samples = asks or not (is_release or self._is_optional)
            if needs_samples and not alive:
                raise MotionRefusedError(
                    'A pull needs the tendon sensor and no valid strain sample arrives; start the '
                    'sensor' + ('.' if asks else ', or set the parameter unguarded to true.')
                )
            if alive and not is_release and (self._tension_n or 0.0) > limit_n:
                raise MotionRefusedError(
                    f'The tension is {self._tension_n:.2f} N already, above the {contact} limit '
                    f'of {limit_n} N; release the tendon first.'
                )
            self._limit_n = limit_n
            self._stop_tension_n = stop_tension_n
            self._needs_samples = needs_samples
            self._is_release = is_release
            self._is_over = False
            self._verdict = Verdict.CONTINUE

    def end(self) -> None:
        """Forget the stop tension; the limit stays in force."""
        with self._lock:
            self._stop_tension_n = 0.0
            self._needs_samples = False
            self._is_release = False

    def put_back(self, limit_n: float) -> None:
        """Put the limit [N] in force that was before a pull that has not begun after all."""
        with self._lock:
            self._limit_n = limit_n

    def add_samples(self, tension_n: Sequence[float], is_saturated: bool, now_ns: int) -> bool:
        """Take valid samples; return True when the tendon must be released now.

        True comes once for each time the limit is crossed. A sensor that pulls the other
        way round is as dangerous, so the limit holds for both signs.

        Parameters
        ----------
        tension_n : sequence of float
            Oldest first [N].
        is_saturated : bool
            The sensor is at the end of its range: counts as over the limit.
        now_ns : int
            Monotonic time of arrival [ns].
        """
        if not tension_n or not all(map(math.isfinite, tension_n)):
            return False  # no measurement: as good as silence
        highest_n, lowest_n, last_n = max(tension_n), min(tension_n), tension_n[-1]
        with self._lock:
            self._tension_n = math.inf if is_saturated else last_n
            self._sampled_at_ns = now_ns
            if self._is_release:
                return False
            worst_n = math.inf if is_saturated else max(highest_n, -lowest_n)
            was_over, self._is_over = self._is_over, worst_n > self._limit_n
            if self._is_over:
                if not was_over:
                    self._verdict, self._decisive_n = Verdict.OVER_LIMIT, worst_n
                return not was_over
            if self._verdict is Verdict.CONTINUE and 0 < self._stop_tension_n <= highest_n:
                self._verdict, self._decisive_n = Verdict.REACHED, highest_n
            return False

    def check(self, now_ns: int) -> Verdict:
        """Return what the running pull must do, at monotonic time ``now_ns`` [ns]."""
        with self._lock:
            if (
                self._verdict is Verdict.CONTINUE
                and self._needs_samples
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
