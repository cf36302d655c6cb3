# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Polling of the servo at a steady rate, with detection of faults and outages.

The rate is lower while nothing moves and the tendon is slack. A command, a taut tendon or a
failed read restores the full rate.

The reads also feed the servo's bus watchdog, so that the servo stops by itself if the reads end.
The poll thread runs until `ServoMonitor.close` is called. During an outage it continues to poll,
or re-establishes the connection.
"""

from __future__ import annotations

from collections.abc import Callable
import logging
import math
import threading
import time

from linear_guide_driver.config import REST_AFTER_S, REST_CYCLE_S, TendonActuatorConfig
from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import SilentServoError
from linear_guide_driver.dynamixel.servo import TendonServo
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
)
from linear_guide_driver.types import TendonState
from tactile_ros.refusal import Refusal

FAILED_POLLS = 5
"""Number of consecutive failed polls that count as an outage: about 0.2 s.

A poll fails if the servo does not answer it or refuses it. With a smaller number, pulls ended
without a fault on busy computers, where three answers in a row can be late.
"""

FIRST_BACK_OFF_S, LONGEST_BACK_OFF_S = 0.25, 2.0
"""Pauses [s] before attempts to re-establish a lost connection; each failure doubles the pause."""

RESTORE_S = 10.0
"""Longest duration [s] of an attempt to re-establish the connection: to open the port, to set the
servo up, and to wait until the tendon is at rest."""

REST_POLLS = 4
"""Number of polls at rest during ``watchdog_s``. If two polls in a row are late, the watchdog does
not trip."""

RESTART = 'remove the cause and configure the driver again'
"""Remedy for a servo that reports a fault or has shut down."""

CLOSING_S = 6.0
"""Longest time [s] for which `ServoMonitor.close` waits for the end of the poll thread. If the
thread is setting the servo up, the tendon may take 3 s to come to rest."""

_logger = logging.getLogger(__name__)


class ServoMonitor:
    """The poll thread of one servo.

    Parameters
    ----------
    servo : TendonServo
        The servo.
    config : TendonActuatorConfig
        Rate and timeouts.
    on_poll : callable
        Called in each `cycle` with the bus's lock held. Converts a `ServoState` to a
        `TendonState` and acts on it.
    on_state : callable
        Called on the poll thread with each state.
    on_loss : callable
        Called with a reason at each failure, on the thread that detects it.
    on_trouble : callable
        Called with a reason at each new outage or fault, on the thread that detects it.
    on_cycle : callable
        Called on the poll thread after each poll, with the time by which the next poll may be
        delayed [s]. The time is infinite when the thread ends.
    restore : callable
        Re-establishes a lost connection, or raises.
    is_slack : callable
        Returns True if the tendon is slack and at rest in a state.

    Attributes
    ----------
    state : TendonState or None
        The latest state.
    is_lost : bool
        The port was lost or the torque went off, so the connection must be re-established before
        the next command.
    is_shut_down : bool
        The torque is off because of a fault; only a restart of the servo ends this.
    """

    def __init__(
        self,
        servo: TendonServo,
        config: TendonActuatorConfig,
        on_poll: Callable[[registers.ServoState], TendonState],
        on_state: Callable[[TendonState], None],
        on_loss: Callable[[str], None],
        on_trouble: Callable[[str], None],
        on_cycle: Callable[[float], None],
        restore: Callable[[], None],
        is_slack: Callable[[TendonState], bool],
    ) -> None:
        self._servo, self._config = servo, config
        self._on_poll, self._on_state = on_poll, on_state
        self._on_loss, self._on_trouble, self._restore = on_loss, on_trouble, restore
        self._on_cycle = on_cycle
        self._is_slack = is_slack
        self._rests_at_s = time.monotonic() + REST_AFTER_S
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._polls = 0
        self._failed_polls = 0
        self._back_off_s = FIRST_BACK_OFF_S
        self.state: TendonState | None = None
        self._outage: str | None = None
        self._fault: str | None = None
        self.is_lost = False
        self.is_shut_down = False
        self._thread = threading.Thread(target=self._run, name='tendon poll', daemon=True)

    @property
    def outage(self) -> Refusal | None:
        """Reason why the servo cannot be controlled (no answers, or torque off), or None."""
        if self._outage is None:
            return None
        if self.is_shut_down:
            return Refusal(self._outage, RESTART)
        if self.is_lost:
            return Refusal(self._outage, 'the driver connects again by itself')
        remedy = 'check wiring and power; the driver tries again by itself'
        return Refusal(self._outage, remedy)

    @property
    def fault(self) -> Refusal | None:
        """Fault that the servo reports with the torque on, or None. It prevents tightening."""
        return None if self._fault is None else Refusal(self._fault, RESTART)

    @property
    def trouble(self) -> Refusal | None:
        """The `outage` if there is one, else the `fault` if there is one, else None."""
        return self.outage or self.fault

    @property
    def is_at_rest(self) -> bool:
        """True if the tendon has been slack and at rest for `REST_AFTER_S`."""
        return time.monotonic() >= self._rests_at_s

    @property
    def period_s(self) -> float:
        """Present period of the polls [s]."""
        period_s = 1.0 / self._config.poll_rate_hz
        if self.is_at_rest:
            rest_s = min(self._config.watchdog_s / REST_POLLS, REST_CYCLE_S)
            period_s = max(period_s, rest_s)
        return period_s

    def start(self) -> None:
        """Start the poll thread."""
        self._thread.start()

    def poll_fast(self) -> None:
        """Return to the full rate, because a motion is about to begin."""
        with self._changed:
            self._rests_at_s = time.monotonic() + REST_AFTER_S
            self._changed.notify_all()

    def close(self) -> None:
        """Stop polling, and end all waits in `wait_poll`."""
        with self._changed:
            self._closing.set()
            self._changed.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(CLOSING_S)

    def fail(self, reason: str, *, is_lost: bool = False) -> None:
        """Record an outage. Only the first reason is kept, because later ones follow from it."""
        with self._changed:
            is_new = self._outage is None or (is_lost and not self.is_lost)
            if is_new:
                self._outage = reason
            self.is_lost = self.is_lost or is_lost
            self._changed.notify_all()
        self._on_loss(reason)
        if is_new:
            self.report_trouble(reason)

    def clear(self) -> None:
        """End the outage, unless the connection is lost. Called when the servo answers again."""
        with self._changed:
            if self._outage is not None and not self.is_lost:
                _logger.warning('the servo answers again')
                self._outage = None
                self._changed.notify_all()

    def wait_poll(self, timeout_s: float) -> TendonState | None:
        """Return the state of the next poll, or None after an outage, a timeout or `close`."""
        with self._changed:
            count = self._polls
            self._changed.wait_for(
                lambda: self._polls > count or self._outage or self._closing.is_set(),
                timeout_s,
            )
            return self.state if self._polls > count else None

    def report_trouble(self, reason: str) -> None:
        """Call ``on_trouble`` with a reason; its exceptions are logged and suppressed."""
        self._notify(self._on_trouble, reason)

    def cycle(self) -> TendonState:
        """Read the servo and act on its state. Commands also call this, on their own threads."""
        with self._servo.bus.lock:  # no command is sent between the read and its handling
            return self._take(self._servo.read())

    def poll_once(self) -> float:
        """Read the servo, or re-establish the connection; return the pause that follows [s]."""
        was_lost = self.is_lost
        try:
            if was_lost:
                self._restore()
                self.is_lost, self._back_off_s = False, FIRST_BACK_OFF_S
                self.clear()  # the following poll detects faults that remain
            state = self.cycle()
            self._failed_polls = 0
        except LinearGuideDriverError as error:
            self.poll_fast()
            if was_lost and self.is_lost:
                is_new = isinstance(error, DeviceRefusedError) and str(error) != self._outage
                self._outage = str(error)
                if is_new:
                    self.report_trouble(str(error))
                self._back_off_s = min(2 * self._back_off_s, LONGEST_BACK_OFF_S)
                return self._back_off_s
            is_silent = isinstance(error, SilentServoError)
            if isinstance(error, DeviceConnectionError) and not is_silent:
                self.fail(str(error), is_lost=True)
                return self._back_off_s
            self._failed_polls += 1
            if self._failed_polls < FAILED_POLLS:
                return 0.0
            self.fail(f'the servo {"is silent" if is_silent else "refuses to be read"} ({error})')
        # The poll thread must continue after any error, because it also slackens a taut tendon.
        except Exception as error:
            if self._outage is None:
                _logger.exception('reading the servo failed')
            self.fail(f'reading the servo failed: {error!r}', is_lost=self.is_lost)
        else:
            self._notify(self._on_state, state)
            return 0.0
        self._failed_polls = 0
        # The servo may still receive packets although its answers are lost. No packet is sent
        # until the servo's watchdog has stopped the servo.
        return 2 * self._config.watchdog_s

    # -- inside --------------------------------------------------------------------------

    def _run(self) -> None:
        began_s = time.monotonic() - self.period_s
        while self._wait_until_due(began_s):
            began_s = max(began_s + self.period_s, time.monotonic() - self.period_s)
            pause_s = self.poll_once()
            self._notify(self._on_cycle, pause_s + (RESTORE_S if self.is_lost else 0.0))
            with self._changed:  # a command that succeeds ends the pause
                self._changed.wait_for(lambda: not self._outage or self._closing.is_set(), pause_s)
        self._notify(self._on_cycle, math.inf)

    def _wait_until_due(self, began_s: float) -> bool:
        """Wait until one period after ``began_s`` [s]; return False if the monitor was closed."""
        with self._changed:
            while not self._closing.is_set():
                left_s = began_s + self.period_s - time.monotonic()  # less after `poll_fast`
                if left_s <= 0.0:
                    return True
                self._changed.wait(left_s)
        return False

    def _take(self, servo: registers.ServoState) -> TendonState:
        words = registers.format_hardware_error(servo.hardware_error)
        self.is_shut_down = bool(words) and not servo.is_torque_on
        if self.is_shut_down:
            self.fail(f'the servo has shut down: {words}')
        elif not servo.is_torque_on:
            self.fail("the servo's torque went off, so the zero is lost", is_lost=True)
        elif words and self._fault is None:
            self._fault = f'the servo reports a fault: {words}'
            self._on_loss(self._fault)
            self.report_trouble(self._fault)
        if not words:
            self._fault = None
        state = self._on_poll(servo)
        if servo.is_torque_on:
            self.clear()  # also ends an outage that a command has recorded
        if not self._is_slack(state):
            self.poll_fast()
        with self._changed:
            self.state = state
            self._polls += 1
            self._changed.notify_all()
        return state

    def _notify(self, listener: Callable[..., None], argument: object) -> None:
        try:
            listener(argument)
        except Exception:  # polling must continue, because it feeds the watchdog
            _logger.exception('a listener of the tendon actuator failed')
