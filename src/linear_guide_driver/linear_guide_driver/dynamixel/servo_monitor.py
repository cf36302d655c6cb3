# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads the servo's state at a steady rate and notices faults at once, whatever it is doing.

The reads also feed the servo's bus watchdog: when they end, the servo stops by itself.
"""

from __future__ import annotations

from collections.abc import Callable
import logging
import threading
import time

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import DynamixelBus, SilentServoError
from linear_guide_driver.errors import DeviceRefusedError, LinearGuideDriverError
from linear_guide_driver.records import TendonActuatorConfig, TendonState

SILENT_POLLS = 5
"""Polls in a row without an answer after which the servo counts as silent: about 0.2 s.

Fewer ended pulls on a busy host, where an answer can be late three times in a row.
"""

REFUSED_POLLS = 3
"""Polls in a row that the servo refuses after which the driver gives up."""

_logger = logging.getLogger(__name__)


def describe_watchdog(config: TendonActuatorConfig) -> str:
    """Say that the servo's bus watchdog has acted."""
    return f"The servo's watchdog has stopped it after {config.watchdog_s} s of silence"


class ServoMonitor:
    """The poll thread of one servo.

    Parameters
    ----------
    on_poll : callable
        Makes a `TendonState` of a `ServoState` and acts on it, under the bus's lock.
    on_state : callable
        Called with each state, on the poll thread.
    on_trouble : callable
        Called with a reason when a fault is new, on the thread that noticed it.

    Attributes
    ----------
    state : TendonState or None
        The last state; None before the first poll.
    trouble : str
        The fault that has ended motion; empty when there is none.
    needs_connect : bool
        Whether the fault has cost the servo's settings or its reference.
    """

    def __init__(
        self,
        bus: DynamixelBus,
        config: TendonActuatorConfig,
        on_poll: Callable[[registers.ServoState], TendonState],
        on_state: Callable[[TendonState], None],
        on_trouble: Callable[[str], None],
    ) -> None:
        self._bus, self._config = bus, config
        self._on_poll, self._on_state, self._on_trouble = on_poll, on_state, on_trouble
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._polls = 0
        self.state: TendonState | None = None
        self.trouble = ''
        self.needs_connect = False
        self._thread = threading.Thread(target=self._poll, name='tendon poll', daemon=True)

    @property
    def is_reading(self) -> bool:
        """Whether states may still come: it is not closed, and there is no fault."""
        return not (self.trouble or self._closing.is_set())

    def start(self) -> None:
        """Start to poll."""
        self._thread.start()

    def close(self) -> None:
        """Poll no more; wakes whoever waits."""
        with self._changed:
            self._closing.set()
            self._changed.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(2.0)

    def fail(self, reason: str, needs_connect: bool = False) -> None:
        """Note a fault; the first one is the cause, what follows are its consequences."""
        with self._changed:
            is_new = not self.trouble
            self.trouble = self.trouble or reason
            self.needs_connect = self.needs_connect or needs_connect
            self._changed.notify_all()
        if is_new:
            self._tell(self._on_trouble, reason)

    def clear(self) -> None:
        """Forget the fault: the servo answers again."""
        with self._changed:
            self.trouble = ''
            self._changed.notify_all()

    def wait_poll(self, timeout_s: float) -> TendonState | None:
        """Return the next state, or None when a fault, the end or the timeout came first [s]."""
        with self._changed:
            count = self._polls
            self._changed.wait_for(
                lambda: self._polls > count or bool(self.trouble) or self._closing.is_set(),
                timeout_s,
            )
            return self.state if self._polls > count else None

    # -- inside --------------------------------------------------------------------------

    def _poll(self) -> None:
        period_s = 1.0 / self._config.poll_rate_hz
        due_s = time.monotonic()
        silent_polls = refused_polls = 0
        while not self._closing.wait(max(0.0, due_s - time.monotonic())):
            due_s = max(due_s + period_s, time.monotonic())
            state = None
            try:
                with self._bus.lock:  # no command comes between a state and its judgement
                    block = self._bus.read_block(registers.STATE_BLOCK)
                    state = self._take(registers.decode_state(block))
                silent_polls = refused_polls = 0
            except SilentServoError as error:
                silent_polls += 1
                if silent_polls == SILENT_POLLS:
                    self.fail(f'the servo is silent ({error})')
                    silent_polls = 0
                    # It may still hear us: say nothing until its watchdog has stopped it,
                    # or until a fresh command has been heard.
                    with self._changed:
                        self._changed.wait_for(
                            lambda: not self.trouble or self._closing.is_set(),
                            2 * self._config.watchdog_s,
                        )
            except LinearGuideDriverError as error:
                # One damaged packet makes the servo refuse a question; several are a fault.
                refused_polls += 1
                if refused_polls < REFUSED_POLLS and isinstance(error, DeviceRefusedError):
                    continue
                self.fail(str(error), needs_connect=True)
                return
            except Exception as error:  # nobody reads on, and no order is carried out
                self.fail(f'reading the servo failed: {error!r}', needs_connect=True)
                raise
            if state is not None:
                self._tell(self._on_state, state)

    def tell_trouble(self, reason: str) -> None:
        """Pass a reason on to ``on_trouble``, whose own faults end nothing."""
        self._tell(self._on_trouble, reason)

    def _take(self, servo: registers.ServoState) -> TendonState:
        if servo.hardware_error:
            words = registers.describe_hardware_error(servo.hardware_error)
            self.fail(f'the servo has shut down: {words}', needs_connect=True)
        elif not servo.is_torque_on:
            self.fail(
                "the servo's torque went off, so the slack reference is lost", needs_connect=True
            )
        elif self.trouble and not self.needs_connect:
            self.clear()  # it answers again
        state = self._on_poll(servo)
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
