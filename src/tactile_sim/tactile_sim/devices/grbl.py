# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated Grbl 1.1h controller with one axis."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from tactile_sim.descriptions.description import Guide
from tactile_sim.devices.gcode import Command, GcodeError, Modal, parse_gcode, strip_line
from tactile_sim.physics.motion import plan_legs, plan_ramp, plan_stop, Segment, Trajectory

SOFT_LIMITS, HOMING, HOMING_DIRECTION, HOMING_SLOW, HOMING_FAST, PULL_OFF = 20, 22, 23, 24, 25, 27
REPORT_MASK, STEPS_PER_MM, MAX_RATE, ACCELERATION, TRAVEL = 10, 100, 110, 120, 130

FloatArray = NDArray[np.float64]

_OFFSET_EVERY = {True: 30, False: 10}
_OVERRIDES_EVERY = {True: 20, False: 10}
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LOCK_MESSAGE = b"[MSG:'$H'|'$X' to unlock]\r\n"
PLANNER_BLOCKS = 15
RX_BYTES = 128
LINE_CHARACTERS = 79
RESET_DELAY_S = 0.5
BOOT_S = 1.0
"""Assumed time from power-up until Grbl sends its banner [s]. It includes the boot loader."""

_SOFT_RESET = 0x18


def make_settings(guide: Guide) -> dict[int, float]:
    """Return the settings of a Grbl controller for this guide, which its command ``$$`` lists."""
    return {
        0: 10, 1: 255, 2: 0, 3: 0, 4: 0, 5: 0, 6: 0, 10: 1, 11: 0.010, 12: 0.002, 13: 0,
        20: 1, 21: 0, 22: 1, 23: 1, 24: 100.0, 25: 2000.0, 26: 25, 27: guide.pull_off_m * 1e3,
        30: 1000, 31: 0, 32: 0, 100: 1e-3 / guide.step_m, 110: guide.max_speed_m_s * 6e4,
        120: guide.acceleration_m_s2 * 1e3, 130: guide.travel_m * 1e3,
    }  # fmt: skip


def write_setting(settings: dict[int, float], text: str) -> None:
    """Change a setting, for which ``text`` is ``number=value``.

    Raises `GcodeError` for an unknown setting or an invalid value.
    """
    number, equals, value = text.partition('=')
    if not equals or not number.isdecimal() or int(number) not in settings:
        raise GcodeError(3)
    try:
        setting = float(value)
    except ValueError:
        raise GcodeError(2) from None
    if not math.isfinite(setting):
        raise GcodeError(2)
    if setting < 0.0:
        raise GcodeError(4)
    if int(number) == SOFT_LIMITS and setting and not settings[HOMING]:
        raise GcodeError(10)
    settings[int(number)] = setting
    if int(number) == HOMING and not setting:
        settings[SOFT_LIMITS] = 0


def format_setting(number: int, value: float) -> str:
    """Return the value of a setting with as many decimals as Grbl prints."""
    return f'{value:.3f}' if number in (11, 12, 24, 25, 27) or number >= 100 else f'{value:.0f}'


@dataclass
class _Block:
    target: float
    speed: float
    end_s: float = math.inf


class Planner:
    """Plans the motion of one axis through a queue of moves.

    The axis is initially at rest. ``held`` is True during a feed hold.
    """

    def __init__(self, position: float) -> None:
        self.acceleration = 1.0
        self._blocks: deque[_Block] = deque()
        self._trajectory = Trajectory(position, [], position)
        self.held = False

    @property
    def queued(self) -> int:
        """Number of moves in the queue, including the move that is being executed."""
        return len(self._blocks)

    @property
    def end_s(self) -> float:
        """Time at which the planned motion ends [s]; in the past while the axis is at rest."""
        return self._trajectory.end_s

    @property
    def next_end_s(self) -> float:
        """Time at which the first move in the queue ends [s].

        Infinite if the queue is empty, and during a feed hold.
        """
        return self._blocks[0].end_s if self._blocks else math.inf

    @property
    def target(self) -> float:
        """Position at which the axis will be after all moves in the queue."""
        return self._blocks[-1].target if self._blocks else self._trajectory.target

    def state_at(self, time_s: float) -> tuple[float, float]:
        """Return position and velocity at a time [s]."""
        return self._trajectory.state_at(time_s)

    def positions_at(self, times_s: FloatArray) -> FloatArray:
        """Return positions at increasing times; each is exactly equal to the one of `state_at`."""
        return self._trajectory.states_at(times_s)[0]

    def settle(self, time_s: float) -> None:
        """Remove the moves from the queue that have ended at ``time_s``."""
        while self._blocks and self._blocks[0].end_s <= time_s:
            self._blocks.popleft()

    def append(self, time_s: float, target: float, speed: float) -> None:
        """Append a move to the queue; a move without motion is ignored."""
        self.settle(time_s)
        if abs(target - self.target) < 1e-9:
            return
        self._blocks.append(_Block(target, speed))
        if not self.held:
            self._replan(time_s)

    def run(self, time_s: float, segments: list[Segment], target: float) -> None:
        """Replace the queue by a motion that was planned elsewhere, such as homing."""
        self.place(self.state_at(time_s)[0])
        self._trajectory = Trajectory(self.state_at(time_s)[0], segments, target)

    def hold(self, time_s: float) -> None:
        """Begin a feed hold: the axis brakes to rest, and the queue is kept."""
        self.settle(time_s)
        position, velocity = self.state_at(time_s)
        stop = plan_stop(time_s, position, velocity, self.acceleration)
        self._trajectory = Trajectory(position, stop, stop[-1].end_position if stop else position)
        self.held = True
        for block in self._blocks:
            block.end_s = math.inf

    def resume(self, time_s: float) -> None:
        """End a feed hold and continue with the queue."""
        self.held = False
        self._replan(time_s)

    def drop_queue(self) -> None:
        """Discard the queue and end a feed hold; the axis must be at rest."""
        self._blocks.clear()
        self.held = False

    def place(self, position: float) -> None:
        """Stop immediately at ``position``, with an empty queue."""
        self.drop_queue()
        self._trajectory = Trajectory(position, [], position)

    def _replan(self, time_s: float) -> None:
        position, velocity = self.state_at(time_s)
        blocks = list(self._blocks)
        if not blocks:
            self._trajectory = Trajectory(position, [], position)
            return
        targets = [position] + [b.target for b in blocks]
        lengths = [b - a for a, b in pairwise(targets)]
        # For each block (move), compute the highest speed at its end from which the axis can still
        # stop at the end of the last block. The loop begins with the last block.
        exits = [0.0] * len(blocks)
        for i in range(len(blocks) - 2, -1, -1):
            if lengths[i] * lengths[i + 1] > 0.0:
                reachable = math.sqrt(
                    exits[i + 1] ** 2 + 2 * self.acceleration * abs(lengths[i + 1])
                )
                exits[i] = min(blocks[i].speed, blocks[i + 1].speed, reachable)
        segments: list[Segment] = []
        entry, start_s = abs(velocity), time_s
        for block, length, fastest in zip(blocks, lengths, exits, strict=True):
            reachable = math.sqrt(entry**2 + 2 * self.acceleration * abs(length))
            leave = min(fastest, reachable)
            ramp = plan_ramp(
                start_s,
                block.target - length,
                block.target,
                block.speed,
                self.acceleration,
                entry,
                leave,
            )
            segments += ramp
            entry = leave
            start_s = block.end_s = ramp[-1].end_s if ramp else start_s
        self._trajectory = Trajectory(position, segments, blocks[-1].target)


class StatusReporter:
    """Encodes the status reports of Grbl. Some reports include the work offset or overrides."""

    def __init__(self) -> None:
        self._offset_countdown = 0
        self._overrides_countdown = 0

    def encode(
        self, state: str, mpos_mm: float, velocity_mm_s: float, free: tuple[int, int], mask: int
    ) -> bytes:
        """Return the next status report for a state such as ``Idle`` or ``Hold:0``.

        ``free`` is the number of free planner blocks and of free bytes in the receive buffer.
        ``mask`` is the value of Grbl's setting 10. With bit 0, the report contains the machine
        position instead of the work position. With bit 1, it contains ``free``.
        """
        fields = [state, f'{"MPos" if mask & 1 else "WPos"}:{mpos_mm:.3f},0.000,0.000']
        if mask & 2:
            fields.append(f'Bf:{free[0]},{free[1]}')
        fields.append(f'FS:{abs(velocity_mm_s) * 60:.0f},0')
        busy = state.split(':')[0] in ('Run', 'Hold')
        if self._offset_countdown > 0:
            self._offset_countdown -= 1
        else:
            self._offset_countdown = _OFFSET_EVERY[busy] - 1
            self._overrides_countdown = max(self._overrides_countdown, 1)
            fields.append('WCO:0.000,0.000,0.000')
        if self._overrides_countdown > 0:
            self._overrides_countdown -= 1
        else:
            self._overrides_countdown = _OVERRIDES_EVERY[busy] - 1
            fields.append('Ov:100,100,100')
        return f'<{"|".join(fields)}>\r\n'.encode()


class GrblDevice:
    """A Grbl controller and the carriage that it moves.

    The controller does not know the true position of the carriage on the rail. The difference
    between this position and the controller's coordinate (MPos) is known only after homing. The
    planner uses the true position, which is 0 at the negative end of the rail [mm].
    """

    def __init__(self, guide: Guide) -> None:
        self.settings = make_settings(guide)
        self._travel_mm = guide.travel_m * 1e3
        self._planner = Planner(guide.power_up_m * 1e3)
        self._zero_mm = guide.power_up_m * 1e3  # true position of the carriage at MPos 0
        self._now_s = 0.0
        self._output = bytearray()
        self._alarmed = bool(self.settings[HOMING])
        self._start()

    def _start(self) -> None:
        self._modal = Modal()
        self._line = bytearray()
        self._lines: deque[tuple[str, int]] = deque()  # line, its number of bytes
        self._line_bytes = 0
        self._homing = False
        self._critical = 0  # code of an alarm that only a reset can end
        self._dwell_end_s: float | None = None
        self._soft_limit_hit = False
        self._reset_at_s: float | None = None
        self._stalls = self._has_stalled = False
        self._message_at_s: float | None = None
        self._reporter = StatusReporter()
        self._output += BANNER + (LOCK_MESSAGE if self._alarmed else b'')

    # ---- physics ------------------------------------------------------------------------

    def position_m(self, now_s: float) -> float:
        """Return the position of the carriage on the rail [m]; ``now_s`` must not decrease."""
        self._advance(now_s)
        return self._on_rail(self._planner.state_at(now_s)[0]) * 1e-3

    def positions_m(self, times_s: FloatArray) -> FloatArray:
        """Return positions of the carriage at increasing times [m].

        They are exactly equal to the results of `position_m`. The result has at least one
        position. It ends before the next event, because events can change the motion.
        """
        self._advance(float(times_s[0]))
        count = int(np.searchsorted(times_s, self._next_event_s()))
        on_rail = np.clip(self._planner.positions_at(times_s[:count]), 0.0, self._travel_mm)
        return np.asarray(on_rail * 1e-3)

    @property
    def rests_until_s(self) -> float:
        """Time until which the carriage will not move [s]; minus infinity while it moves.

        A received command can move it earlier.
        """
        return self._next_event_s() if self._planner.end_s <= self._now_s else -math.inf

    @property
    def due_s(self) -> float:
        """Time from which `poll` can return bytes even if nothing is received before [s]."""
        return -math.inf if self._output else self._next_event_s()

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Receive bytes from the serial line; return the bytes that are sent immediately."""
        self._advance(now_s)
        for byte in data:
            self._take_byte(byte)
            self._advance(now_s)
        return self.poll(now_s)

    def poll(self, now_s: float) -> bytes:
        """Return the bytes that the controller has sent between the last call and ``now_s``."""
        self._advance(now_s)
        sent, self._output = bytes(self._output), bytearray()
        return sent

    def restart(self, now_s: float) -> None:
        """Simulate a short interruption of the power supply.

        The motor stops immediately, and the present position becomes MPos 0.
        """
        self._stop_dead(now_s)
        self._zero_mm = self._planner.state_at(now_s)[0]
        self._alarmed = bool(self.settings[HOMING])
        self._start()
        self._output.clear()  # output that was not sent is lost
        self._reset_at_s = now_s + BOOT_S

    def trip_limit(self, now_s: float) -> None:
        """Simulate a signal of the limit switch, which stops the motor and raises alarm 1."""
        self._stop_dead(now_s)
        self._homing = self._soft_limit_hit = False
        self._dwell_end_s = None
        self._raise_alarm(1)

    def stall(self, now_s: float) -> None:
        """Simulate a fault of Grbl: its stepper buffer is empty during the next wait for a dwell.

        The motion then stops, although moves are queued. Grbl does not continue by itself, because
        it requests the execution of queued moves only once, before it waits for their end.
        """
        self._advance(now_s)
        self._stalls = True
        self._run_lines()

    def _stop_dead(self, now_s: float) -> None:
        self._advance(now_s)
        self._planner.place(self._on_rail(self._planner.state_at(now_s)[0]))

    # ---- time ---------------------------------------------------------------------------

    def _advance(self, now_s: float) -> None:
        """Process all events until ``now_s`` [s] in the order of their times."""
        while (event_s := self._next_event_s()) <= now_s:
            self._now_s = max(self._now_s, event_s)
            self._handle_event()
        self._now_s = max(self._now_s, now_s)

    def _next_event_s(self) -> float:
        if self._homing or self._soft_limit_hit:
            event_s = max(self._planner.end_s, self._now_s)
        else:
            event_s = self._planner.next_end_s
        for other_s in (self._reset_at_s, self._message_at_s, self._dwell_end_s):
            if other_s is not None and other_s < event_s:
                event_s = other_s
        return event_s

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
            # The carriage has reached an end of the rail. The controller has counted further
            # steps in MPos, but the carriage did not move.
            self._zero_mm += self._on_rail(position) - position
            self._planner.place(self._on_rail(position))
        if self._homing:
            self._homing = self._alarmed = False
            negative = bool(int(self.settings[HOMING_DIRECTION]) & 1)
            pull_off = self.settings[PULL_OFF]
            mpos = -self.settings[TRAVEL] + pull_off if negative else -pull_off
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
            return  # a real controller, too, loses bytes that do not fit into its buffer
        self._line_bytes += 1
        if byte not in b'\r\n':
            self._line.append(byte)
            return
        self._lines.append((strip_line(self._line.decode('ascii')), self._line_bytes))
        self._line.clear()
        self._line_bytes = 0
        self._run_lines()

    def _run_lines(self) -> None:
        """Execute received lines, until a line must wait for the end of another command."""
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
        """Execute one line; return False if ``ok`` is sent later, after its execution."""
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
        if self.settings[SOFT_LIMITS] and not self._within_travel(command.target_mm):
            # Grbl first brakes to rest, and then raises the alarm. It sends the ``ok`` of this
            # line after the next reset.
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
                text = format_setting(number, value)
                self._output += f'${number}={text}\r\n'.encode()
        elif line == '$I':
            self._output += b'[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\n'
        elif line == '$H':
            if not self.settings[HOMING]:
                raise GcodeError(5)
            self._home()
            return False
        else:
            write_setting(self.settings, line[1:])
        return True

    # ---- motion -------------------------------------------------------------------------

    def _mpos(self, carriage_mm: float) -> float:
        return carriage_mm - self._zero_mm

    def _within_travel(self, mpos_mm: float) -> bool:
        return -self.settings[TRAVEL] - 1e-9 <= mpos_mm <= 1e-9

    def _queue(self, command: Command) -> None:
        fastest = self.settings[MAX_RATE]
        feed = min(command.feed_mm_min or fastest, fastest)
        self._planner.acceleration = self.settings[ACCELERATION]
        steps = self.settings[STEPS_PER_MM]
        target = round((command.target_mm or 0.0) * steps) / steps + self._zero_mm
        self._planner.append(self._now_s, target, feed / 60)

    def _home(self) -> None:
        self._homing = True
        negative = bool(int(self.settings[HOMING_DIRECTION]) & 1)
        switch = 0.0 if negative else self._travel_mm
        pull_off = self.settings[PULL_OFF]
        clear = switch + (pull_off if negative else -pull_off)
        here = self._planner.state_at(self._now_s)[0]
        fast, slow = (self.settings[n] / 60 for n in (HOMING_FAST, HOMING_SLOW))
        legs = [(switch, fast), (clear, fast), (switch, slow), (clear, slow)]
        segments = plan_legs(self._now_s, here, legs, self.settings[ACCELERATION])
        self._planner.run(self._now_s, segments, clear)

    def _reset(self) -> None:
        position, velocity = self._planner.state_at(self._now_s)
        self._planner.place(self._on_rail(position))
        if self._reset_at_s is not None or self._message_at_s is not None:
            return  # Grbl ignores a reset for a moment after a reset or an alarm
        if self._homing or velocity != 0.0:
            # The motor stops immediately and can lose steps, so the position is not reliable.
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
        steps = self.settings[STEPS_PER_MM]
        mpos_mm = round(self._mpos(carriage) * steps) / steps + 0.0
        free = PLANNER_BLOCKS - self._planner.queued, RX_BYTES - self._rx_bytes
        mask = int(self.settings[REPORT_MASK])
        self._output += self._reporter.encode(self._state(), mpos_mm, velocity, free, mask)
