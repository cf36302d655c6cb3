# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Connection to one Grbl controller: lines and answers, status polling, stops, faults."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
import math
import threading
import time

from linear_guide_driver.config import REST_AFTER_S, REST_CYCLE_S, REST_REPORT_S
from linear_guide_driver.errors import DeviceConnectionError, DeviceRefusedError
from linear_guide_driver.grbl import protocol as grbl
from linear_guide_driver.serial_link import SerialLink, TICK_S

GREETING_S = 0.3
"""Longest time [s] in which a running controller answers ``?``."""

BOOT_S = 2.5
"""Time [s] of the boot loader of a board that is reset when its port is opened."""

RESTART_S = 3.0
"""Longest time [s] from a soft reset to the start-up message (banner) of the controller."""

REPEAT_RESET_S = 0.6
"""Time [s] after which a reset is repeated: Grbl ignores resets for 0.5 s after ALARM:1 and 2."""

IDLE_REPORTS = 2
"""If a line is unanswered, this number of consecutive idle reports means a stalled controller."""

STOP_S = 3.0
"""Longest time [s] from a feed hold until the guide is at rest."""

BRAKING_POLL_S = 0.05

PLANNER_BLOCKS = 15
"""Number of planner blocks of Grbl 1.1, used if the controller does not report it."""

SILENCE_S = 1.0
"""Time [s] without answers to status queries after which the controller counts as lost."""

RESTING = ('Idle', 'Alarm', 'Sleep')
"""States of the controller in which nothing moves."""


class GrblConnection:
    """Connection that sends lines, counts their answers and detects faults.

    Only one thread at a time may call its methods. A fault (alarm, restart, silence, lost port)
    ends the running command and every later one until `reset`. Methods raise
    `DeviceConnectionError` after a fault or if the controller does not answer in time, and
    `DeviceRefusedError` if it refuses a line.

    Parameters
    ----------
    port : str
        Name of the serial port.
    baud : int
        Speed [bit/s].
    poll_rate_hz : float
        Rate of status queries after `start_polling` [Hz]. While the guide is at rest and all
        lines are answered, the period is at least `REST_REPORT_S`.
    on_report : callable
        Called on the reader thread with each `StatusReport`.
    on_fault : callable
        Called on the reader thread with the reason when the position is lost.
    on_cycle : callable
        Called in each cycle of the reader thread, at least every `REST_CYCLE_S`.
    """

    def __init__(
        self,
        port: str,
        baud: int,
        poll_rate_hz: float,
        *,
        on_report: Callable[[grbl.StatusReport], None],
        on_fault: Callable[[str], None],
        on_cycle: Callable[[], None] = lambda: None,
    ) -> None:
        self._name = f'{port} at {baud} baud'
        self._on_report, self._on_fault, self._on_cycle = on_report, on_fault, on_cycle
        self._poll_period_s = 1.0 / poll_rate_hz
        self._decoder = grbl.GrblDecoder()
        self._changed = threading.Condition()
        self._unanswered: deque[bytes] = deque()
        self._refusal: str | None = None
        self._report: grbl.StatusReport | None = None
        self._reports = 0
        self._idle_reports = 0  # consecutive idle reports while lines are unanswered
        self._banners = 0
        self._expects_banner = True
        self._settings: dict[int, str] = {}
        self._fault: str | None = None
        self._is_quiet = True  # no answers to status queries are expected
        self._heard_at_s = self._polled_at_s = time.monotonic()
        self._rests_at_s = math.inf  # time from which on status queries are less frequent
        self.is_lost = False
        self.identification = ''
        self.options = ''
        self.planner_blocks = PLANNER_BLOCKS
        self.is_hal = False
        self._link = SerialLink(
            port, baud, on_bytes=self._on_bytes, on_tick=self._poll, on_lost=self._on_lost
        )

    @property
    def garbage_lines(self) -> int:
        return self._decoder.garbage_lines

    def open(self) -> None:
        """Find the controller, bring it to rest and reset it."""
        self._link.start()
        self._link.write(grbl.STATUS_QUERY)
        self._wait(lambda: bool(self._reports or self._banners), GREETING_S)
        if not self._reports:
            self._wait(lambda: self._banners > 0, BOOT_S)
        if self._report is not None and self._report.state not in ('Idle', 'Alarm'):
            self.hold_and_reset()  # it executes the motion of another program
        else:
            self.reset()
        self._send(grbl.READ_BUILD_INFO)

    def start_polling(self) -> None:
        """Start to query the status periodically."""
        self._heard_at_s = time.monotonic()
        self._is_quiet = False

    def close(self) -> None:
        self._link.close()

    def read_settings(self) -> dict[int, str]:
        """Return the settings of the controller by number, as answered to ``$$``."""
        self._settings.clear()
        self._send(grbl.READ_SETTINGS)
        return dict(self._settings)

    def stream(
        self, lines: Iterable[bytes], timeout_s: float, *, answers_status: bool = True
    ) -> Generator[None, None, None]:
        """Send lines as fast as the controller accepts them, until the last one is answered.

        Closing the generator ends the sending.

        Parameters
        ----------
        lines : iterable of bytes
            Lines to send.
        timeout_s : float
            Timeout for all lines [s].
        answers_status : bool
            False for a command during which Grbl does not answer status queries.

        Yields
        ------
        None
            Before each line, after each answer, and about fifty times a second while waiting.
        """
        with self._changed:
            self._unanswered.clear()
            self._idle_reports = 0
            self._refusal = None
            was_quiet = self._is_quiet
            self._is_quiet = was_quiet or not answers_status
            self._rests_at_s = math.inf
        deadline_s = time.monotonic() + timeout_s

        def wait(most_bytes: int) -> Iterator[None]:
            is_over = False
            while not is_over:
                is_over = self._wait(
                    lambda: bool(self._refusal or self._fault)
                    or sum(map(len, self._unanswered)) <= most_bytes,
                    TICK_S,
                )
                yield
                if self._fault:
                    raise DeviceConnectionError(self._fault)
                if self._refusal:
                    raise DeviceRefusedError(self._refusal)
                if not is_over and time.monotonic() > deadline_s:
                    raise DeviceConnectionError(self._format_lateness(timeout_s))

        try:
            for line in lines:
                yield from wait(grbl.RECEIVE_BYTES - len(line))
                with self._changed:
                    self._unanswered.append(line)
                self._link.write(line)
            yield from wait(0)
        finally:
            with self._changed:
                self._unanswered.clear()
                self._heard_at_s = time.monotonic()
                self._rests_at_s = self._heard_at_s + REST_AFTER_S
                self._is_quiet = was_quiet

    def wait_report(self, timeout_s: float) -> grbl.StatusReport:
        """Query the status and return the next report; fail after ``timeout_s`` [s]."""
        count = self._reports
        self._link.write(grbl.STATUS_QUERY)
        self._wait(lambda: self._reports > count or bool(self._fault), timeout_s)
        if self._fault:
            raise DeviceConnectionError(self._fault)
        if self._report is None or self._reports == count:
            raise DeviceConnectionError(f'no status report within {timeout_s} s')
        return self._report

    def reset_override(self) -> None:
        """Reset the feed override, which a pendant may have changed, to 100 %."""
        self._link.write(grbl.FEED_OVERRIDE_RESET)

    def hold(self) -> None:
        """Brake immediately. May be called on any thread; the reader reports a lost port."""
        with suppress(DeviceConnectionError):
            self._link.write(grbl.FEED_HOLD)

    @property
    def has_stalled(self) -> bool:
        """True if the controller is repeatedly idle while a line is unanswered.

        A dwell in Grbl requests a cycle start once, then waits for the end of all motion. If the
        stepper buffer runs empty at that moment, Grbl becomes idle with moves in its queue and
        waits for ever.
        """
        return self._idle_reports >= IDLE_REPORTS

    def start_cycle(self) -> None:
        """Let a stalled controller continue. A feed hold would also end."""
        self._idle_reports = 0
        self._link.write(grbl.CYCLE_START)

    def reset(self) -> None:
        """Restart the controller and clear its faults."""
        with self._changed:
            self._expects_banner = True
            count = self._banners
        try:
            self._reset_until(lambda: self._banners > count or self.is_lost)
        finally:
            with self._changed:
                self._expects_banner = False
        with self._changed:
            if self.is_lost:
                raise DeviceConnectionError(self._fault)
            self._fault = None

    def hold_and_reset(self) -> None:
        """Brake, wait for rest, then drop all planned motion by a reset.

        A reset during a motion would lose the position, so the reset waits for Hold:0.
        """
        self._link.write(grbl.FEED_HOLD)
        deadline_s = time.monotonic() + STOP_S
        idle_reports = 0
        while time.monotonic() < deadline_s:
            state = self.wait_report(STOP_S)
            if state.state == 'Hold' and state.substate in (0, None):
                break
            # At rest, Grbl answers a feed hold by Hold:0, but grblHAL ignores it and stays Idle.
            # Three Idle reports are needed, because the first may be older than the feed hold.
            idle_reports += state.state == 'Idle'
            if idle_reports > 2 or state.state == 'Alarm':
                break
            self._wait(lambda: bool(self._fault), BRAKING_POLL_S)
        self.reset()

    # -- inside ------------------------------------------------------------------------

    def _reset_until(self, is_done: Callable[[], bool]) -> None:
        """Send resets until the banner arrives or the port is lost."""
        deadline_s = time.monotonic() + RESTART_S
        resets = 0
        while resets == 0 or not self._wait(is_done, min(REPEAT_RESET_S, RESTART_S)):
            if time.monotonic() > deadline_s:
                raise DeviceConnectionError(
                    f'no Grbl answers on {self._name}; check port, baud and power'
                )
            self._link.write(grbl.SOFT_RESET)
            resets += 1
        if resets > 1:  # wait until the banners of all resets have arrived
            count = self._reports
            self._link.write(grbl.STATUS_QUERY)
            self._wait(lambda: self._reports > count or self.is_lost, REPEAT_RESET_S)

    def _wait(self, is_done: Callable[[], bool], timeout_s: float) -> bool:
        with self._changed:
            return self._changed.wait_for(is_done, timeout_s)

    def _send(self, line: bytes) -> None:
        for _ in self.stream([line], RESTART_S):
            pass

    def _format_lateness(self, timeout_s: float) -> str:
        line = self._unanswered[0].decode().strip() if self._unanswered else 'the last line'
        state = 'nothing' if self._report is None else self._report.state
        return f'"{line}" was not answered within {timeout_s:.1f} s; the last status was {state}'

    def _on_bytes(self, data: bytes) -> None:
        for event in self._decoder.feed(data):
            if isinstance(event, grbl.StatusReport):
                self._on_report(event)
            with self._changed:
                self._take(event)
                self._changed.notify_all()

    def _take(self, event: grbl.Event) -> None:
        if isinstance(event, grbl.StatusReport):
            self._report = event
            self._reports += 1
            is_idle = event.state == 'Idle' and bool(self._unanswered)
            self._idle_reports = self._idle_reports + 1 if is_idle else 0
            self._heard_at_s = time.monotonic()
            if event.state not in RESTING:
                self._rests_at_s = max(self._rests_at_s, self._heard_at_s + REST_AFTER_S)
        elif isinstance(event, grbl.Alarm):
            self._fail(f'the controller reported {event}')
        elif isinstance(event, grbl.Banner):
            self._banners += 1
            self.is_hal = event.is_hal
            self._unanswered.clear()
            self._idle_reports = 0
            if not self._expects_banner:
                self._fail('the controller restarted by itself')
        elif isinstance(event, grbl.Setting):
            self._settings[event.number] = event.value
        elif isinstance(event, grbl.Message):
            kind, _, text = event.text.partition(':')
            if kind == 'VER':
                name = 'grblHAL' if self.is_hal else 'Grbl'
                self.identification = f'{name} {text.rstrip(":")}'
            elif kind == 'OPT':
                self.options, *sizes = text.split(',')
                if sizes and sizes[0].isdecimal():
                    self.planner_blocks = int(sizes[0])
        elif self._unanswered:
            line = self._unanswered.popleft()
            self._idle_reports = 0
            if isinstance(event, grbl.Error) and not self._refusal:
                self._refusal = f'the controller refused "{line.decode().strip()}" with {event}'

    def _fail(self, reason: str) -> None:
        self._fault = self._fault or reason
        self._on_fault(reason)

    def _poll(self) -> float:
        """Query the status if a query is due; return the longest time until the next call [s]."""
        self._on_cycle()
        now_s = time.monotonic()
        period_s, tick_s = self._poll_period_s, TICK_S
        if now_s >= self._rests_at_s:
            period_s, tick_s = max(period_s, REST_REPORT_S), REST_CYCLE_S
        if self._is_quiet or now_s - self._polled_at_s < period_s:
            return tick_s
        self._polled_at_s = now_s
        self._link.write(grbl.STATUS_QUERY)
        # A controller locked by an alarm does not answer, but this fault is known already.
        if now_s - self._heard_at_s > SILENCE_S and not self._fault:
            with self._changed:
                self._fail(f'the controller has been silent for {SILENCE_S} s')
                self._changed.notify_all()
        return tick_s

    def _on_lost(self, reason: str) -> None:
        with self._changed:
            self.is_lost = True
            self._fail(reason)
            self._changed.notify_all()
