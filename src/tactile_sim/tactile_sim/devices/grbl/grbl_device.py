# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A one-axis Grbl 1.1h controller: bytes in, bytes out, told the time."""

from __future__ import annotations

from collections import deque
import math

from tactile_sim.descriptions.description import Guide
from tactile_sim.devices.grbl import settings as setting
from tactile_sim.devices.grbl.gcode import Command, GcodeError, Modal, parse_gcode, strip_line
from tactile_sim.devices.grbl.planner import Planner
from tactile_sim.devices.grbl.report import StatusReporter
from tactile_sim.physics.motion import plan_legs

BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LOCK_MESSAGE = b"[MSG:'$H'|'$X' to unlock]\r\n"
PLANNER_BLOCKS = 15
RX_BYTES = 128
LINE_CHARACTERS = 79
RESET_DELAY_S = 0.5
BOOT_S = 1.0
"""From power to the banner, with the boot loader; assumed."""

_SOFT_RESET = 0x18


class GrblDevice:
    """The controller and its carriage.

    The carriage's place on the rail and the controller's idea of it (MPos) are two things:
    they are tied together by homing alone. The planner works in the carriage's coordinate,
    0 at the negative end [mm].

    Parameters
    ----------
    guide
        The description.
    """

    def __init__(self, guide: Guide) -> None:
        self.settings = setting.make_settings(guide)
        self._travel_mm = guide.travel_m * 1e3
        self._planner = Planner(guide.power_up_m * 1e3)
        self._zero_mm = guide.power_up_m * 1e3  # carriage coordinate of MPos 0
        self._now_s = 0.0
        self._output = bytearray()
        self._alarmed = bool(self.settings[setting.HOMING])
        self._start()

    def _start(self) -> None:
        self._modal = Modal()
        self._line = bytearray()
        self._lines: deque[tuple[str, int]] = deque()  # text, bytes that it takes in the buffer
        self._line_bytes = 0
        self._homing = False
        self._critical = 0  # alarm code that only a reset ends
        self._dwell_end_s: float | None = None
        self._soft_limit_hit = False
        self._reset_at_s: float | None = None
        self._stalls = self._has_stalled = False
        self._message_at_s: float | None = None
        self._reporter = StatusReporter()
        self._output += BANNER + (LOCK_MESSAGE if self._alarmed else b'')

    # ---- the world's side ---------------------------------------------------------------

    def position_m(self, now_s: float) -> float:
        """Where the carriage is on the rail [m]; call with rising times."""
        self._advance(now_s)
        return self._on_rail(self._planner.state_at(now_s)[0]) * 1e-3

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes from the line and return what it answers at once."""
        self._advance(now_s)
        for byte in data:
            self._take_byte(byte)
            self._advance(now_s)
        return self.poll(now_s)

    def poll(self, now_s: float) -> bytes:
        """Return what it has to say by ``now_s``."""
        self._advance(now_s)
        sent, self._output = bytes(self._output), bytearray()
        return sent

    def restart(self, now_s: float) -> None:
        """Lose power for a moment: the motor stops dead, and the counter starts at 0."""
        self._stop_dead(now_s)
        self._zero_mm = self._planner.state_at(now_s)[0]
        self._alarmed = bool(self.settings[setting.HOMING])
        self._start()
        self._output.clear()  # what it was about to say is lost as well
        self._reset_at_s = now_s + BOOT_S

    def trip_limit(self, now_s: float) -> None:
        """Close the limit switch, by contact or by interference: alarm 1."""
        self._stop_dead(now_s)
        self._homing = self._soft_limit_hit = False
        self._dwell_end_s = None
        self._raise_alarm(1)

    def stall(self, now_s: float) -> None:
        """Let the stepper run dry while the next dwell waits: idle, with moves queued.

        A dwell requests a cycle start once, before it waits for the end of all motion.
        """
        self._advance(now_s)
        self._stalls = True
        self._run_lines()

    def _stop_dead(self, now_s: float) -> None:
        self._advance(now_s)
        self._planner.place(self._on_rail(self._planner.state_at(now_s)[0]))

    # ---- time ---------------------------------------------------------------------------

    def _advance(self, now_s: float) -> None:
        """Let events happen at their own times, in order, up to ``now_s``."""
        while (event_s := self._next_event_s()) <= now_s:
            self._now_s = max(self._now_s, event_s)
            self._handle_event()
        self._now_s = max(self._now_s, now_s)

    def _next_event_s(self) -> float:
        times = [self._reset_at_s, self._message_at_s, self._dwell_end_s]
        if self._homing or self._soft_limit_hit:
            times.append(max(self._planner.end_s, self._now_s))
        else:
            times.append(self._planner.next_end_s)
        return min((t for t in times if t is not None), default=math.inf)

    def _handle_event(self) -> None:
        now = self._now_s
        if self._reset_at_s is not None and self._reset_at_s <= now:
            self._start()
        elif self._message_at_s is not None and self._message_at_s <= now:
            self._message_at_s = None
            self._output += b'[MSG:Reset to continue]\r\n'
        elif self._dwell_end_s is not None and self._dwell_end_s <= now:
            self._dwell_end_s = None
            self._say_ok()
        else:
            self._planner.settle(now)
            if self._planner.end_s <= now:
                self._on_rest()
        self._run_lines()

    def _on_rest(self) -> None:
        position = self._planner.state_at(self._now_s)[0]
        if self._on_rail(position) != position:
            # Steps into the end of the rail are lost: the counter went on, the carriage did not.
            self._zero_mm += self._on_rail(position) - position
            self._planner.place(self._on_rail(position))
        if self._homing:
            self._homing = self._alarmed = False
            negative = bool(int(self.settings[setting.HOMING_DIRECTION]) & 1)
            pull_off = self.settings[setting.PULL_OFF]
            mpos = -self.settings[setting.TRAVEL] + pull_off if negative else -pull_off
            self._zero_mm = self._planner.state_at(self._now_s)[0] - mpos
            self._say_ok()
        if self._soft_limit_hit:
            self._soft_limit_hit = False
            self._planner.drop_queue()
            self._raise_alarm(2)

    def _on_rail(self, position_mm: float) -> float:
        return min(max(position_mm, 0.0), self._travel_mm)

    # ---- bytes --------------------------------------------------------------------------

    def _take_byte(self, byte: int) -> None:
        if byte == _SOFT_RESET:
            self._reset()
        elif self._reset_at_s is not None or self._critical:
            return
        elif byte == ord('?'):
            if not self._homing:
                self._report()
        elif byte == ord('!'):
            if self._planner.queued and not self._planner.held:
                self._planner.hold(self._now_s)
            self._has_stalled = False
        elif byte == ord('~'):
            if self._planner.held and not self._soft_limit_hit:
                self._planner.resume(self._now_s)
                self._has_stalled = False
        elif byte < 0x80:
            self._take_character(byte)

    @property
    def _rx_bytes(self) -> int:
        return self._line_bytes + sum(size for _, size in self._lines)

    def _take_character(self, byte: int) -> None:
        if self._rx_bytes >= RX_BYTES:
            return  # a real AVR drops what does not fit, without a word
        self._line_bytes += 1
        if byte not in b'\r\n':
            self._line.append(byte)
            return
        self._lines.append((strip_line(self._line.decode('ascii')), self._line_bytes))
        self._line.clear()
        self._line_bytes = 0
        self._run_lines()

    def _run_lines(self) -> None:
        """Do the lines that have come, as long as nothing makes them wait."""
        while self._lines and not self._waiting():
            line, _ = self._lines.popleft()
            try:
                replied = self._run_line(line)
            except GcodeError as error:
                self._output += f'error:{error.code}\r\n'.encode()
            else:
                if replied:
                    self._say_ok()
        dwell_waits = bool(self._lines) and 'G4' in self._lines[0][0] and self._planner.queued
        if self._stalls and dwell_waits and not self._planner.held:
            self._stalls, self._has_stalled = False, True
            self._planner.hold(self._now_s)

    def _waiting(self) -> bool:
        return bool(
            self._homing
            or self._critical
            or self._soft_limit_hit
            or self._dwell_end_s is not None
            or self._reset_at_s is not None
            or self._planner.queued >= PLANNER_BLOCKS
            or ('G4' in self._lines[0][0] and self._planner.queued)
        )

    def _run_line(self, line: str) -> bool:
        """Do one line; False if its ``ok`` comes later."""
        if not line:
            return True
        if len(line) > LINE_CHARACTERS:
            raise GcodeError(11)
        if line.startswith('$'):
            return self._run_system(line)
        if self._alarmed:
            raise GcodeError(9)
        command = parse_gcode(line, self._modal, self._mpos(self._planner.target))
        if command.dwell_s is not None:
            self._dwell_end_s = self._now_s + command.dwell_s
            return False
        if command.target_mm is None:
            return True
        if self.settings[setting.SOFT_LIMITS] and not self._within_travel(command.target_mm):
            # Grbl stops what moves before it raises the alarm, and owes this line its ok.
            self._soft_limit_hit = True
            self._planner.hold(self._now_s)
            return False
        self._queue(command)
        return True

    def _run_system(self, line: str) -> bool:
        if line == '$X':
            if self._alarmed:
                self._alarmed = False
                self._output += b'[MSG:Caution: Unlocked]\r\n'
        elif self._planner.queued:
            raise GcodeError(8)
        elif line == '$$':
            for number, value in self.settings.items():
                text = setting.format_setting(number, value)
                self._output += f'${number}={text}\r\n'.encode()
        elif line == '$I':
            self._output += b'[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\n'
        elif line == '$H':
            if not self.settings[setting.HOMING]:
                raise GcodeError(5)
            self._home()
            return False
        else:
            setting.write_setting(self.settings, line[1:])
        return True

    # ---- motion -------------------------------------------------------------------------

    def _mpos(self, carriage_mm: float) -> float:
        return carriage_mm - self._zero_mm

    def _within_travel(self, mpos_mm: float) -> bool:
        return -self.settings[setting.TRAVEL] - 1e-9 <= mpos_mm <= 1e-9

    def _queue(self, command: Command) -> None:
        fastest = self.settings[setting.MAX_RATE]
        feed = min(command.feed_mm_min or fastest, fastest)
        self._planner.acceleration = self.settings[setting.ACCELERATION]
        steps = self.settings[setting.STEPS_PER_MM]
        target = round((command.target_mm or 0.0) * steps) / steps + self._zero_mm
        self._planner.append(self._now_s, target, feed / 60)

    def _home(self) -> None:
        self._homing = True
        negative = bool(int(self.settings[setting.HOMING_DIRECTION]) & 1)
        switch = 0.0 if negative else self._travel_mm
        pull_off = self.settings[setting.PULL_OFF]
        clear = switch + (pull_off if negative else -pull_off)
        here = self._planner.state_at(self._now_s)[0]
        fast, slow = (self.settings[n] / 60 for n in (setting.HOMING_FAST, setting.HOMING_SLOW))
        legs = [(switch, fast), (clear, fast), (switch, slow), (clear, slow)]
        segments = plan_legs(self._now_s, here, legs, self.settings[setting.ACCELERATION])
        self._planner.run(self._now_s, segments, clear)

    def _reset(self) -> None:
        position, velocity = self._planner.state_at(self._now_s)
        self._planner.place(self._on_rail(position))
        if self._reset_at_s is not None or self._message_at_s is not None:
            return  # for RESET_DELAY_S after alarm 1 or 2, Grbl swallows it
        if self._homing or velocity != 0.0:
            # The motor stops dead and loses steps: the position is not to be trusted.
            self._raise_alarm(6 if self._homing else 3)
            self._reset_at_s = self._now_s + RESET_DELAY_S
            return
        if self._critical == 2:
            self._say_ok()
        self._start()

    def _raise_alarm(self, code: int) -> None:
        self._alarmed = True
        self._output += f'ALARM:{code}\r\n'.encode()
        if code in (1, 2):
            self._critical = code
            self._message_at_s = self._now_s + RESET_DELAY_S

    # ---- replies ------------------------------------------------------------------------

    def _say_ok(self) -> None:
        self._output += b'ok\r\n'

    def _state(self) -> str:
        velocity = self._planner.state_at(self._now_s)[1]
        if self._alarmed:
            return 'Alarm'
        if self._has_stalled and not velocity:
            return 'Idle'
        if self._planner.held and not self._has_stalled:
            return 'Hold:1' if velocity else 'Hold:0'
        return 'Run' if self._planner.queued else 'Idle'

    def _report(self) -> None:
        carriage, velocity = self._planner.state_at(self._now_s)
        steps = self.settings[setting.STEPS_PER_MM]
        mpos_mm = round(self._mpos(carriage) * steps) / steps + 0.0
        free = PLANNER_BLOCKS - self._planner.queued, RX_BYTES - self._rx_bytes
        mask = int(self.settings[setting.REPORT_MASK])
        self._output += self._reporter.encode(self._state(), mpos_mm, velocity, free, mask)
