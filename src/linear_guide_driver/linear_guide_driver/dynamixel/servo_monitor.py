# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads the servo's state at a steady rate and notices faults at once, whatever it is doing.

The rate falls while nothing moves and the tendon is slack. A command, a taut tendon or a failed
read brings the full rate back.

The reads also feed the servo's bus watchdog: when they end, the servo stops by itself. The thread
ends with the client alone. After an outage it goes on asking, or makes the connection again.
"""

from __future__ import annotations

from collections.abc import Callable
import logging
import math
import threading
import time

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import SilentServoError
from linear_guide_driver.dynamixel.servo import TendonServo
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
)
from linear_guide_driver.records import REST_AFTER_S, TendonActuatorConfig, TendonState
from tactile_ros.refusal import Refusal

FAILED_POLLS = 5
"""Polls in a row that are not answered, or refused, after which it is an outage: about 0.2 s.

Fewer ended pulls on a busy host, where an answer can be late three times in a row.
"""

FIRST_BACK_OFF_S, LONGEST_BACK_OFF_S = 0.25, 2.0
"""Pause before a lost connection is made again; each failure doubles it."""

RESTORE_S = 10.0
"""Longest attempt to make a lost connection again: to open, set up and come to rest."""

REST_POLLS = 4
"""Polls per ``watchdog_s`` at rest: two in a row may come late."""

LONGEST_REST_POLL_S = 0.04
"""Longest period of polls at rest, however long ``watchdog_s`` is."""

RESTART = 'remove the cause and configure the driver again'
"""Remedy of a servo that reports a fault or has shut down."""

CLOSING_S = 6.0
"""Longest wait for the thread: a servo that is just set up comes to rest within three seconds."""

_logger = logging.getLogger(__name__)


class ServoMonitor:
    """The poll thread of one servo.

    ``on_poll`` makes a `TendonState` of a `ServoState` and acts on it, under the bus's lock, in
    each `cycle`. ``is_slack`` tells whether nothing moves in that state and the tendon is slack.
    On the poll thread: ``on_state`` is called with each state. ``on_turn`` is called each time
    that the thread comes round, with how much longer than usual the next time may take [s]:
    infinite when there is none. ``restore`` makes a lost connection again, or raises.

    ``on_loss`` and ``on_trouble`` are called with a reason at each failure, and when an outage or
    a fault is new; on the thread that noticed it.
    """

    def __init__(
        self,
        servo: TendonServo,
        config: TendonActuatorConfig,
        on_poll: Callable[[registers.ServoState], TendonState],
        on_state: Callable[[TendonState], None],
        on_loss: Callable[[str], None],
        on_trouble: Callable[[str], None],
        on_turn: Callable[[float], None],
        restore: Callable[[], None],
        is_slack: Callable[[TendonState], bool],
    ) -> None:
        self._servo, self._config = servo, config
        self._on_poll, self._on_state = on_poll, on_state
        self._on_loss, self._on_trouble, self._restore = on_loss, on_trouble, restore
        self._on_turn = on_turn
        self._is_slack = is_slack
        self._rests_at_s = time.monotonic() + REST_AFTER_S
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._polls = 0
        self._failed_polls = 0
        self._back_off_s = FIRST_BACK_OFF_S
        self.state: TendonState | None = None  # the last one
        self._outage: str | None = None
        self._fault: str | None = None
        self.is_lost = False  # line or torque: the connection is made again before a command
        self.is_shut_down = False  # torque off because of a fault; only a restart ends that
        self._thread = threading.Thread(target=self._run, name='tendon poll', daemon=True)

    @property
    def outage(self) -> Refusal | None:
        """Why no command can be watched: no answers, or the torque is off; None without outage."""
        if self._outage is None:
            return None
        if self.is_shut_down:
            return Refusal(self._outage, RESTART)
        if self.is_lost:
            return Refusal(self._outage, 'the driver connects again by itself')
        remedy = 'the driver asks again by itself; check wiring and power'
        return Refusal(self._outage, remedy)

    @property
    def fault(self) -> Refusal | None:
        """Fault reported with the torque on, or None. The servo must not tighten then."""
        return None if self._fault is None else Refusal(self._fault, RESTART)

    @property
    def trouble(self) -> Refusal | None:
        """The outage or the fault, or None."""
        return self.outage or self.fault

    @property
    def is_at_rest(self) -> bool:
        """True when the tendon has been slack and at rest for `REST_AFTER_S`."""
        return time.monotonic() >= self._rests_at_s

    @property
    def period_s(self) -> float:
        """Period of the polls now [s]."""
        period_s = 1.0 / self._config.poll_rate_hz
        if self.is_at_rest:
            rest_s = min(self._config.watchdog_s / REST_POLLS, LONGEST_REST_POLL_S)
            period_s = max(period_s, rest_s)
        return period_s

    def start(self) -> None:
        """Start to poll."""
        self._thread.start()

    def hurry(self) -> None:
        """Poll at full rate from now on: something is about to move."""
        with self._changed:
            self._rests_at_s = time.monotonic() + REST_AFTER_S
            self._changed.notify_all()

    def close(self) -> None:
        """Poll no more; wakes whoever waits."""
        with self._changed:
            self._closing.set()
            self._changed.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(CLOSING_S)

    def fail(self, reason: str, *, is_lost: bool = False) -> None:
        """Note an outage; the first reason is the cause, what follow are its consequences."""
        with self._changed:
            is_new = self._outage is None or (is_lost and not self.is_lost)
            if is_new:
                self._outage = reason
            self.is_lost = self.is_lost or is_lost
            self._changed.notify_all()
        self._on_loss(reason)
        if is_new:
            self.tell_trouble(reason)

    def clear(self) -> None:
        """Forget the outage if the line is not lost: the servo answers again."""
        with self._changed:
            if self._outage is not None and not self.is_lost:
                _logger.warning('the servo answers again')
                self._outage = None
                self._changed.notify_all()

    def wait_poll(self, timeout_s: float) -> TendonState | None:
        """Return the next state, or None when an outage, the end or the timeout came first [s]."""
        with self._changed:
            count = self._polls
            self._changed.wait_for(
                lambda: self._polls > count or self._outage or self._closing.is_set(),
                timeout_s,
            )
            return self.state if self._polls > count else None

    def tell_trouble(self, reason: str) -> None:
        """Pass a reason on to ``on_trouble``, whose own faults end nothing."""
        self._tell(self._on_trouble, reason)

    def cycle(self) -> TendonState:
        """Read the servo and act on what was read; also for commands, on their threads."""
        with self._servo.bus.lock:  # no command comes between a state and its judgement
            return self._take(self._servo.read())

    def poll_once(self) -> float:
        """Read the servo, or make a lost connection again; return the pause that follows [s]."""
        was_lost = self.is_lost
        try:
            if was_lost:
                self._restore()
                self.is_lost, self._back_off_s = False, FIRST_BACK_OFF_S
                self.clear()  # the poll that follows tells what else is wrong
            state = self.cycle()
            self._failed_polls = 0
        except LinearGuideDriverError as error:
            self.hurry()
            if was_lost and self.is_lost:
                is_new = isinstance(error, DeviceRefusedError) and str(error) != self._outage
                self._outage = str(error)
                if is_new:
                    self.tell_trouble(str(error))
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
        except Exception as error:  # the poll must outlive it: it slackens the tendon
            if self._outage is None:
                _logger.exception('reading the servo failed')
            self.fail(f'reading the servo failed: {error!r}', is_lost=self.is_lost)
        else:
            self._tell(self._on_state, state)
            return 0.0
        self._failed_polls = 0
        # It may still hear us: say nothing until its watchdog has stopped it.
        return 2 * self._config.watchdog_s

    # -- inside --------------------------------------------------------------------------

    def _run(self) -> None:
        began_s = time.monotonic() - self.period_s
        while self._wait_until_due(began_s):
            began_s = max(began_s + self.period_s, time.monotonic() - self.period_s)
            pause_s = self.poll_once()
            self._tell(self._on_turn, pause_s + (RESTORE_S if self.is_lost else 0.0))
            with self._changed:  # a fresh command that is heard ends the pause
                self._changed.wait_for(lambda: not self._outage or self._closing.is_set(), pause_s)
        self._tell(self._on_turn, math.inf)

    def _wait_until_due(self, began_s: float) -> bool:
        """Wait until one period after ``began_s``; return False at the end [s]."""
        with self._changed:
            while not self._closing.is_set():
                left_s = began_s + self.period_s - time.monotonic()  # `hurry` shortens it
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
            self.fail("the servo's torque went off, so the slack reference is lost", is_lost=True)
        elif words and self._fault is None:
            self._fault = f'the servo reports a fault: {words}'
            self._on_loss(self._fault)
            self.tell_trouble(self._fault)
        if not words:
            self._fault = None
        state = self._on_poll(servo)
        if servo.is_torque_on:
            self.clear()  # also what a command has noted meanwhile: it answers
        if not self._is_slack(state):
            self.hurry()
        with self._changed:
            self.state = state
            self._polls += 1
            self._changed.notify_all()
        return state

    def _tell(self, listener: Callable[..., None], what: object) -> None:
        try:
            listener(what)
        except Exception:  # the poll must outlive it: it feeds the watchdog
            _logger.exception('a listener of the tendon actuator failed')
