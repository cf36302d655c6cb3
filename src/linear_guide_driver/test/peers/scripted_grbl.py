# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A scripted Grbl 1.1 controller behind a pty: its X axis moves in real time.

The axis moves without acceleration. The planner has room for `BLOCKS` moves; further lines wait
unanswered. A dwell requests a cycle start once, and then waits for the end of all moves.
"""

import re
import time

from pty_peer import PtyPeer

SETTINGS = {
    0: '10', 1: '255', 10: '1', 13: '0', 20: '1', 21: '1', 22: '1', 23: '1', 24: '60.000',
    25: '3000.000', 27: '1.000', 100: '250.000', 110: '6000.000', 120: '500.000', 130: '200.000',
}  # fmt: skip


BLOCKS = 15

DEAF_S = 0.5
"""Time for which Grbl ignores resets after ALARM:1 and 2 [s]."""


class ScriptedGrbl(PtyPeer):
    """Controller that answers like Grbl; a test injects faults by ``replies`` and `say`.

    ``replies`` maps a pattern to bytes. A command line that matches the pattern is answered with
    these bytes and is not executed.
    """

    def __init__(self):
        self.settings = dict(SETTINGS)
        self.replies = {}
        self.lines = []
        self.options = 'V'
        self.is_deaf = False
        self.state = 'Alarm'  # Grbl is locked after power-up if homing is switched on
        self.home_s = 0.05
        self.homed_mm = -199.0  # where a homing cycle ends [mm]
        self.banner = b"\r\nGrbl 1.1h ['$' for help]\r\n"
        self.build = b'[VER:1.1h.20190830:]\r\n[OPT:%s,15,128]\r\nok\r\n'
        self.pause_s = 0.0  # duration of one stop during a move [s]
        self.runs_dry = 0  # number of times that the stepper buffer runs empty while a dwell waits
        self.is_dry = False  # Idle with moves queued, until a cycle start
        self._critical_s = None  # time of an alarm that only a reset ends
        self.real_time = b''  # received real-time bytes, except status queries
        self._mpos = -57.0  # machine position [mm]
        self._moves = []  # (target [mm], speed [mm/s])
        self._moved_s = time.monotonic()
        self._waiting = []  # lines that wait for room in the planner, and the lines after them
        self._due = []  # (time, function)
        self._partial = b''
        super().__init__()

    @property
    def mpos(self):
        return self._mpos

    @property
    def is_moving(self):
        return bool(self._moves)

    def lose_power(self):
        """Restart, which ends all motion and locks the controller."""
        self.say(self.banner + b"[MSG:'$H'|'$X' to unlock]\r\n")
        self._rest(0.0)
        self.state = 'Alarm'

    def raise_alarm(self, code):
        self.say(b'ALARM:%d\r\n' % code)
        self._rest(self.mpos)
        self.state = 'Alarm'
        self._critical_s = time.monotonic() if code in (1, 2) else None

    # -- inside ------------------------------------------------------------------------

    def _rest(self, mpos):
        self._mpos = mpos
        self._moves.clear()
        self._waiting.clear()
        self._due.clear()
        self.is_dry = False

    def _move(self):
        now = time.monotonic()
        left_s, self._moved_s = now - self._moved_s, now
        if self.pause_s:
            time.sleep(self.pause_s)
            self.pause_s, self._moved_s = 0.0, time.monotonic()
        while self._moves and left_s > 0.0 and self.state != 'Hold' and not self.is_dry:
            target, speed = self._moves[0]
            away = abs(target - self._mpos)
            if speed * left_s < away:
                self._mpos += speed * left_s * (1 if target > self._mpos else -1)
                return
            self._mpos = target
            self._moves.pop(0)
            left_s -= away / speed

    def take(self, data):
        for byte in data:
            char = bytes([byte])
            if char in b'?!~\x18\x90':
                self._real_time(char)
            elif char == b'\n':
                self._waiting.append(self._partial.decode())
                self._run_waiting()
                self._partial = b''
            else:
                self._partial += char
        self._move()
        self._run_waiting()
        now = time.monotonic()
        for entry in [e for e in self._due if e[0] <= now]:
            self._due.remove(entry)
            entry[1]()

    def _real_time(self, char):
        if self.is_deaf:
            return
        self._move()
        if char != b'?':
            self.real_time += char
        if self._critical_s is not None:
            if char != b'\x18' or time.monotonic() < self._critical_s + DEAF_S:
                return
            self._critical_s = None
        if char == b'?' and self.state != 'Home':
            if self.state == 'Hold':
                word = 'Hold:0'
            elif self.state == 'Alarm':
                word = 'Alarm'
            else:
                word = 'Run' if self.is_moving and not self.is_dry else 'Idle'
            feed = self._moves[0][1] * 60 if word == 'Run' else 0
            self.say(f'<{word}|MPos:{self.mpos:.3f},0.000,0.000|FS:{feed:.0f},0>\r\n'.encode())
        elif char == b'!' and self.state == 'Idle':
            self._moves.clear()
            self.state = 'Hold'
        elif char == b'~' and self.state == 'Idle':
            self.is_dry = False
        elif char == b'\x18':
            if self.is_moving:
                self.say(b'ALARM:3\r\n')
                self.state = 'Alarm'
            if self.state == 'Home':
                self.say(b'ALARM:6\r\n')
                self.state = 'Alarm'
            self._rest(self.mpos)
            if self.state == 'Hold':
                self.state = 'Idle'
            self.say(self.banner)

    def _run_waiting(self):
        while self._waiting and not (
            len(self._moves) >= BLOCKS
            or self.state == 'Home'
            or self._critical_s is not None
            or (self._waiting[0].startswith('G4') and self._moves)
        ):
            self._line(self._waiting.pop(0))
        dwell_waits = bool(self._waiting) and self._waiting[0].startswith('G4') and self.is_moving
        if self.runs_dry and dwell_waits and self.state == 'Idle' and not self.is_dry:
            self.runs_dry -= 1
            self.is_dry = True

    def _line(self, line):
        self.lines.append(line)
        for pattern, reply in self.replies.items():
            if re.fullmatch(pattern, line):
                self.say(reply)
                return
        if self.is_deaf or self.state == 'Hold':
            return  # data sent during a hold waits
        if line == '$I':
            self.say(self.build % self.options.encode())
        elif line == '$$':
            dump = ''.join(f'${n}={value}\r\n' for n, value in self.settings.items())
            self.say(dump.encode() + b'ok\r\n')
        elif line == '$H':
            self.state = 'Home'
            self._due.append((time.monotonic() + self.home_s, self._homed))
        elif self.state == 'Alarm':
            self.say(b'error:9\r\n')
        elif match := re.search(r'G1 X(-?[\d.]+) F([\d.]+)', line):
            was_moving = self.is_moving
            self._moves.append((float(match[1]), float(match[2]) / 60))
            self.say(b'ok\r\n')
            if not was_moving:  # Grbl still reports Idle after the first ok
                self.say(b'<Idle|MPos:%.3f,0,0|FS:0,0>\r\n' % self.mpos)
        else:
            self.say(b'ok\r\n')

    def _homed(self):
        self._rest(self.homed_mm)
        self.state = 'Idle'
        self.say(b'ok\r\n')
