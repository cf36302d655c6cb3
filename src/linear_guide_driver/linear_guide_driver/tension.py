# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tension on the tendon: its value, its age, and whether it is reliable.

`TensionSource` is the only place that assesses the samples of ``tendon_sensor/strain``. The
samples are reliable while all of these conditions hold:

- Exactly one node publishes them.
- They arrive in time and are valid.
- The tare is confirmed: since the start of the sensor's driver or device, and since the last
  change of the tare, the sensor has read a still, slack tendon.
- The motor current of a pull does not indicate a much higher tension.

Unreliable samples are used for one purpose: a reading above the limit slackens the tendon.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
import threading

from linear_guide_driver.config import TendonActuatorConfig
from tactile_ros.refusal import Refusal
from tactile_ros.strain import NOT_LIVE, StrainBlock, StrainStatus

__all__ = ['SampleLag', 'TensionSource', 'find_limit_warnings']

_HALF_WINDOW_NS = 5_000_000_000
"""Half of the window [ns] in which `SampleLag` finds the smallest lag: the last 5 to 10 s."""

STILL_NS = 500_000_000
"""Time [ns] for which a slack tendon must read less than ``taut_tension_n`` to confirm a tare.
Samples arrive later than positions, so a shorter time proves nothing."""

RIVAL_NS = 3_000_000_000
"""If the sequence numbers decrease twice within this time [ns], there are two publishers."""

MISMATCH_NS = 100_000_000
"""If motor current and sensor disagree for this time [ns], the tension is not reliable.

Shorter differences are usual, because a servo that starts to move needs more current for a short
time, and samples arrive later than currents."""

CURRENT_RESERVE = 1.5
"""The current limit of a contact should suffice for this multiple of its tension limit. The sensor
then ends a pull before the servo stalls."""

_SATURATED = int(StrainStatus.SATURATED)
_RESTARTED = int(StrainStatus.RESTARTED)
_CLOCK_STEP = int(StrainStatus.CLOCK_STEP)


def find_limit_warnings(config: TendonActuatorConfig) -> list[str]:
    """Return a warning for each limit that the sensor or the motor current cannot enforce."""
    warnings = []
    if not config.saturation_n:
        warnings.append(
            'The range of the tendon sensor is not known. A sensor that saturates below a tension '
            'limit cannot enforce it; set saturation_n, here and in the sensor driver.'
        )
    for contact, limit_n in config.limits_n.items():
        if 0.0 < config.saturation_n <= limit_n:
            warnings.append(
                f'The tendon sensor saturates at {config.saturation_n:g} N (saturation_n), which '
                f'is not above {contact}_limit_n, {limit_n:g} N. In {contact}, the tendon is '
                f'therefore slackened at {config.saturation_n:g} N.'
            )
        current_a = config.currents_a[contact]
        needed_a = config.to_current_a(limit_n)
        if current_a < needed_a:
            warnings.append(
                f'{contact}_current_a, {current_a:g} A, is too low for {contact}_limit_n, '
                f'{limit_n:g} N, which needs {needed_a:.3f} A. A {contact} pull may stall; set '
                f'{config.to_current_a(CURRENT_RESERVE * limit_n):.3f} A, or lower the limit.'
            )
    return warnings


class TensionSource:
    """Tension on the tendon from the blocks of one topic; no IO and no clock, thread-safe.

    All times are monotonic [ns]. A tension is live if it is not older than ``guard_timeout_s``.

    Attributes
    ----------
    latest_n : float or None
        Latest valid tension [N]: infinite if saturated, None before the first sample.
    worst_n : float
        Largest magnitude in the latest blocks [N]. A limit applies to both signs, because a
        sensor may be mounted the other way round.
    tare_epoch : int
        Number of events after which the tare may have changed.
    """

    def __init__(self, config: TendonActuatorConfig) -> None:
        self._config = config
        self._timeout_ns = round(config.guard_timeout_s * 1e9)
        self._lock = threading.RLock()
        self.latest_n: float | None = None
        self.worst_n = 0.0
        self._heard_at_ns: int | None = None  # arrival of the last samples, valid or not
        self._live_at_ns: int | None = None  # arrival of the last samples valid and in time
        self._lag = SampleLag()
        # Age of the last block at its arrival [ns]: the larger of its age by `SampleLag` and its
        # age by the clock of the stamps.
        self._age_ns = 0
        # Age of that block by the clock of the stamps [ns]; negative for a stamp in the future.
        self._clock_age_ns = 0
        self._next_sequence: int | None = None
        self._went_back_at_ns: int | None = None  # last decrease of the sequence numbers
        self._rivals_at_ns: int | None = None
        self._publishers: dict[bytes, str] = {}
        self._had_publishers = False
        self.tare_epoch = 0
        self._is_tare_confirmed = False
        self._tare_doubt = 'no still reading of a slack tendon has confirmed it yet'
        self._tare_stamp_ns: int | None = None
        self._still_since_ns: int | None = None
        self._mismatch_since_ns: int | None = None
        self._mismatch: tuple[float, float] = 0.0, 0.0  # motor current [A], sensor's reading [N]

    # -- input -----------------------------------------------------------------------------

    def add(
        self, blocks: Sequence[StrainBlock], now_ns: int, clock_ns: int | None = None
    ) -> float | None:
        """Add the blocks that have just arrived; return their highest valid tension [N], or None.

        A block that shows a restart of the sensor or of its driver makes the tare doubtful.

        Parameters
        ----------
        blocks : sequence of StrainBlock
            Oldest first. The largest magnitude of all samples and the age of the newest block
            are used.
        now_ns : int
            Time of arrival [ns].
        clock_ns : int, optional
            Time of arrival on the clock of the stamps [ns]; None if stamps have no valid age, as
            with simulated time.
        """
        with self._lock:
            samples: list[float] = []
            is_saturated = is_valid = is_fresh = False
            for block in blocks:
                status = int(block.status)
                self._follow(block, status, now_ns)
                if status & NOT_LIVE and not status & _SATURATED:
                    continue
                values = [float(value) for value in block.tension_n]
                finite = [value for value in values if math.isfinite(value)]
                samples += finite
                is_saturated = is_saturated or self._is_saturated(status, finite)
                if values and len(finite) == len(values):
                    is_valid = True
                    is_fresh = self._judge_age(block, status, now_ns, clock_ns)
            return self._take(samples, is_saturated, is_valid, is_fresh, now_ns)

    def set_publishers(self, publishers: Mapping[bytes, str]) -> None:
        """Set the publishers of the samples: a mapping from endpoint GID to full node name.

        A publisher that joins after the first makes the tare doubtful.
        """
        with self._lock:
            new = [name for key, name in publishers.items() if key not in self._publishers]
            if new and self._had_publishers:
                self._doubt_tare(f'{new[0]} has started to publish tendon_sensor/strain')
            self._publishers = dict(publishers)
            self._had_publishers = self._had_publishers or bool(publishers)

    def note_tare(self, stamp_ns: int) -> None:
        """Record the tare that the sensor driver publishes; ``stamp_ns`` [ns] identifies it.

        A change makes the tare doubtful.
        """
        with self._lock:
            if self._tare_stamp_ns is not None and stamp_ns != self._tare_stamp_ns:
                self._doubt_tare('the tare was set or cleared')
            self._tare_stamp_ns = stamp_ns

    def add_current(self, current_a: float | None, now_ns: int) -> None:
        """Add the motor current [A] of a tightening pull; None while no pull tightens."""
        with self._lock:
            config = self._config
            sensed_n = self.worst_n if self.is_live(now_ns) else math.inf
            pulled_n = -math.inf if current_a is None else config.to_tension_n(current_a)
            if current_a is None or pulled_n - sensed_n <= (config.current_mismatch_n or math.inf):
                self._mismatch_since_ns = None
                return
            if self._mismatch_since_ns is None:
                self._mismatch_since_ns = now_ns
            self._mismatch = current_a, sensed_n

    def judge_tare(self, is_slack: bool, now_ns: int) -> None:
        """Confirm the tare once the reading of a slack tendon is low for `STILL_NS`.

        ``is_slack`` is True if the tendon is slack according to a known zero.
        """
        with self._lock:
            if self._is_tare_confirmed:
                return
            if not (is_slack and self.is_below(self._config.taut_tension_n, now_ns)):
                self._still_since_ns = None
            elif self._still_since_ns is None:
                self._still_since_ns = now_ns
            elif now_ns - self._still_since_ns >= STILL_NS:
                self.confirm_tare()

    def confirm_tare(self) -> None:
        """Confirm the tare: the reading fits a tendon that is slack or at the zero of a homing."""
        self._is_tare_confirmed = True

    def forget(self) -> None:
        """Discard the samples received so far."""
        self._heard_at_ns = self._live_at_ns = None

    # -- queries ---------------------------------------------------------------------------

    def live_n(self, now_ns: int) -> float | None:
        """Return the latest tension [N], or None if it is too old."""
        return self.latest_n if self.is_live(now_ns) else None

    def is_live(self, now_ns: int) -> bool:
        """Return True if valid samples arrive in time."""
        live_at_ns = self._live_at_ns
        return live_at_ns is not None and now_ns + self._age_ns - live_at_ns <= self._timeout_ns

    def is_above(self, limit_n: float, now_ns: int) -> bool:
        """Return True if recently received samples, late ones included, exceed a limit [N]."""
        return self._is_recent(self._heard_at_ns, now_ns) and self.worst_n > limit_n

    def is_below(self, limit_n: float, now_ns: int) -> bool:
        """Return True if live samples are below a limit [N]."""
        return self.is_live(now_ns) and self.worst_n < limit_n

    def reads_slack(self, limit_n: float, now_ns: int) -> bool:
        """Return True if live samples below a limit [N] show that the tendon is slack.

        Return False after a change of the tare until the new tare is confirmed.
        """
        is_same_tare = self._is_tare_confirmed or not self.tare_epoch
        return is_same_tare and self.is_below(limit_n, now_ns)

    def find_loss(self, now_ns: int, homing_epoch: int | None = None) -> Refusal | None:
        """Return why the tension is not reliable now, or None.

        ``homing_epoch`` is the ``tare_epoch`` at the start of a homing. Homing does not need a
        confirmed tare, because it slackens the tendon first.
        """
        with self._lock:
            return (
                self._find_rivals(now_ns)
                or self._find_silence(now_ns)
                or self._find_mismatch(now_ns)
                or (None if homing_epoch == self.tare_epoch else self._find_tare_doubt())
            )

    def format_above(self, limit_n: float) -> str:
        """Return a clause that states the tension and the exceeded limit [N]."""
        return f'The tension, {self.worst_n:.2f} N, is above the limit, {limit_n} N'

    # -- inside: samples -------------------------------------------------------------------

    def _is_saturated(self, status: int, samples: Sequence[float]) -> bool:
        highest_n = self._config.saturation_n or math.inf
        return bool(status & _SATURATED) or any(abs(value) >= highest_n for value in samples)

    def _take(
        self,
        samples: Sequence[float],
        is_saturated: bool,
        is_valid: bool,
        is_fresh: bool,
        now_ns: int,
    ) -> float | None:
        if not samples and not is_saturated:
            return None
        worst_n = math.inf if is_saturated else max(max(samples), -min(samples))
        if worst_n >= self._config.taut_tension_n:
            self._still_since_ns = None
        if is_valid or is_saturated:
            self.latest_n = math.inf if is_saturated else samples[-1]
        elif self._is_recent(self._heard_at_ns, now_ns):
            # A block with invalid samples does not prove that the tension has fallen.
            worst_n = max(worst_n, self.worst_n)
        self.worst_n, self._heard_at_ns = worst_n, now_ns
        if (is_valid and is_fresh) or is_saturated:
            self._live_at_ns = now_ns
        if not is_valid and not is_saturated:
            return None
        return max(samples, default=math.inf)

    def _judge_age(
        self, block: StrainBlock, status: int, now_ns: int, clock_ns: int | None
    ) -> bool:
        """Store the age of a block at its arrival; return True if the block can be live.

        A stamp may be wrong for a short time, for example after the clock was set and before the
        sensor's driver has noticed. Such a block is not live, but earlier blocks stay live.
        """
        if clock_ns is None:
            self._age_ns = self._clock_age_ns = 0
            return True
        stamp_ns = block.stamp_ns + (len(block.tension_n) - 1) * block.period_ns
        self._age_ns = self._lag.add(stamp_ns, now_ns, is_step=bool(status & _CLOCK_STEP))
        self._clock_age_ns = 0
        if not self._config.shares_sensor_clock:
            return True
        self._clock_age_ns = clock_ns - stamp_ns
        if abs(self._clock_age_ns) > self._timeout_ns:
            return False
        self._age_ns = max(self._age_ns, self._clock_age_ns)
        return True

    def _is_recent(self, then_ns: int | None, now_ns: int) -> bool:
        return then_ns is not None and now_ns - then_ns <= self._timeout_ns

    # -- inside: origin and tare -----------------------------------------------------------

    def _follow(self, block: StrainBlock, status: int, now_ns: int) -> None:
        """Doubt the tare if a block shows a restarted sensor or driver, or a second driver."""
        expected, self._next_sequence = (
            self._next_sequence,
            block.sequence + len(block.tension_n),
        )
        if expected is not None and block.sequence < expected:
            last_ns, self._went_back_at_ns = self._went_back_at_ns, now_ns
            if last_ns is not None and now_ns - last_ns <= RIVAL_NS:
                self._rivals_at_ns = now_ns
            self._doubt_tare(
                'the sequence numbers of the samples have decreased, as after a restart of the '
                'sensor driver'
            )
        elif expected is not None and status & _RESTARTED:
            self._doubt_tare('the sensor has restarted, or may have restarted')

    def _doubt_tare(self, reason: str) -> None:
        self.tare_epoch += 1
        self._is_tare_confirmed, self._tare_doubt = False, reason
        self._still_since_ns = None

    def _find_rivals(self, now_ns: int) -> Refusal | None:
        names = sorted(self._publishers.values())
        is_mixed = self._rivals_at_ns is not None and now_ns - self._rivals_at_ns <= RIVAL_NS
        if len(set(names)) < 2 and not (is_mixed and len(names) != 1):
            return None
        return Refusal(
            f'Two nodes publish tendon_sensor/strain ({", ".join(names) or "names unknown"})',
            'stop one of them, or start it in another namespace or with another ROS_DOMAIN_ID',
        )

    def _find_silence(self, now_ns: int) -> Refusal | None:
        if self.is_live(now_ns):
            return None
        remedy = 'start the tendon sensor, and check its diagnostics'
        if not self._is_recent(self._heard_at_ns, now_ns):
            return Refusal('No valid strain sample arrives', remedy)
        clock_age_s = self._clock_age_ns / 1e9
        if abs(self._clock_age_ns) > self._timeout_ns:
            old = f'{clock_age_s:.2f} s late according to their stamps'
            ahead = f'with stamps {-clock_age_s:.2f} s in the future'
            return Refusal(
                f'The strain samples arrive {old if clock_age_s > 0 else ahead}',
                f'{remedy}; if it runs on another computer, synchronise the clocks or set '
                'shares_sensor_clock to false',
            )
        if 2 * self._age_ns > self._timeout_ns:
            return Refusal(f'The strain samples arrive {self._age_ns / 1e9:.2f} s late', remedy)
        return Refusal('No valid strain sample arrives', remedy)

    def _find_mismatch(self, now_ns: int) -> Refusal | None:
        since_ns = self._mismatch_since_ns
        if since_ns is None or now_ns - since_ns < MISMATCH_NS:
            return None
        current_a, sensed_n = self._mismatch
        pulled_n = self._config.to_tension_n(current_a)
        return Refusal(
            f'The servo pulls with {current_a:.3f} A, or {pulled_n:.1f} N, but the sensor reads '
            f'{sensed_n:.2f} N',
            'check the diagnostics of the tendon sensor; if they show no error, measure '
            'friction_current_a again',
        )

    def _find_tare_doubt(self) -> Refusal | None:
        if self._is_tare_confirmed:
            return None
        reading = 'unknown' if self.latest_n is None else f'{self.latest_n:.2f} N'
        return Refusal(
            f'The tare of the tendon sensor is not confirmed: {self._tare_doubt} (present '
            f'reading: {reading})',
            'slacken the tendon; the tare is confirmed when the sensor reads less than '
            f'{self._config.taut_tension_n:g} N for {STILL_NS / 1e9:g} s. If it reads more, tare '
            'the sensor; if the zero of the tendon is unknown, home the tendon',
        )


class SampleLag:
    """Compares the lag of a sample (arrival minus stamp) with its minimum over the last seconds.

    Stamps and arrivals need no common clock, because only differences of lags are used. A stamp
    that is not later than the stamp before it means that the clock was set back or is stopped;
    the minimum then restarts with this sample. After an undetected clock step, for example during
    a silence, the minimum is correct again after 10 s at the latest.
    """

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._since_ns = 0
        self._present_ns: int | None = None  # minimum since `_since_ns`
        self._before_ns: int | None = None  # minimum of the previous half window

    def add(self, stamp_ns: int, arrived_at_ns: int, *, is_step: bool = False) -> int:
        """Add a sample; return the excess of its lag over the recent minimum [ns].

        Parameters
        ----------
        stamp_ns : int
            Stamp on the clock of the sensor [ns].
        arrived_at_ns : int
            Time of arrival on the monotonic clock [ns].
        is_step : bool
            The sensor reports that its clock was set.
        """
        lag_ns = arrived_at_ns - stamp_ns
        if is_step or (self._stamp_ns is not None and stamp_ns <= self._stamp_ns):
            self._present_ns = self._before_ns = None
            self._since_ns = arrived_at_ns
        elif arrived_at_ns - self._since_ns >= _HALF_WINDOW_NS:
            # The previous minimum is kept even after a long pause, so that samples that have
            # waited in a full queue are recognised as old.
            self._before_ns = self._present_ns
            self._present_ns, self._since_ns = None, arrived_at_ns
        self._stamp_ns = stamp_ns
        self._present_ns = lag_ns if self._present_ns is None else min(self._present_ns, lag_ns)
        lowest_ns = self._present_ns
        if self._before_ns is not None:
            lowest_ns = min(lowest_ns, self._before_ns)
        return lag_ns - lowest_ns
