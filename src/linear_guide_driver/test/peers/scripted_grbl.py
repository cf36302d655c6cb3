# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""A scripted Grbl 1.1 controller behind a pty: its X axis moves in real time."""

import os
import re
import select
import threading
import time
import tty

SETTINGS = {
    0: '10', 1: '255', 10: '1', 13: '0', 20: '1', 21: '1', 22: '1', 23: '1', 24: '60.000',
    25: '3000.000', 27: '1.000', 110: '6000.000', 120: '500.000', 130: '200.000',
}  # fmt: skip


class ScriptedGrbl:
    """Answers as Grbl does; a test plants faults through ``replies`` and `say`.

    ``replies`` maps a pattern of a command line to the bytes that are said instead
    of carrying the line out.
    """

    def __init__(self):
        self.settings = dict(SETTINGS)
        self.replies = {}
        self.lines = []
        self.options = 'V'
        self.is_deaf = False
        self.state = 'Alarm'  # locked after power-up, as with homing switched on
        self.home_s = 0.05
        self._from = self._to = -57.0  # machine position [mm]
        self._speed = 0.0  # [mm/s]
        self._began_s = 0.0
        self._held = False
        self._due = []  # (time, function)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def say(self, data):
        os.write(self._master, data)

    def close(self):
        """Unplug. Harmless when called twice."""
        master, self._master = self._master, -1
        if master >= 0:
            os.close(self._slave)
            self._thread.join(1.0) if threading.current_thread() is not self._thread else None
            os.close(master)

    @property
    def mpos(self):
        if self._speed == 0.0:
            return self._to
        gone = self._speed * (time.monotonic() - self._began_s)
        if gone >= abs(self._to - self._from):
            return self._to
        return self._from + (gone if self._to > self._from else -gone)

    @property
    def is_moving(self):
        return self._speed > 0.0 and self.mpos != self._to

    def lose_power(self):
        """Restart in the middle of whatever it does."""
        self.say(b"\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n")
        self._rest(0.0)
        self.state = 'Alarm'

    def raise_alarm(self, code):
        self.say(b'ALARM:%d\r\n' % code)
        self._rest(self.mpos)
        self.state = 'Alarm'

    # -- inside ------------------------------------------------------------------------

    def _rest(self, mpos):
        self._from = self._to = mpos
        self._speed = 0.0
        self._due.clear()

    def _serve(self):
        buffer = b''
        try:
            while self._master >= 0:
                ready, _, _ = select.select([self._master], [], [], 0.005)
                if ready:
                    for byte in os.read(self._master, 1024):
                        char = bytes([byte])
                        if char in b'?!~\x18':
                            self._real_time(char)
                        elif char == b'\n':
                            self._line(buffer.decode())
                            buffer = b''
                        else:
                            buffer += char
                now = time.monotonic()
                for entry in [e for e in self._due if e[0] <= now]:
                    self._due.remove(entry)
                    entry[1]()
        except (OSError, ValueError):
            pass

    def _real_time(self, char):
        if self.is_deaf:
            return
        if char == b'?' and self.state != 'Home':
            if self.state == 'Hold':
                word = 'Hold:0'
            elif self.state == 'Alarm':
                word = 'Alarm'
            else:
                word = 'Run' if self.is_moving else 'Idle'
            feed = self._speed * 60 if self.is_moving else 0
            self.say(f'<{word}|MPos:{self.mpos:.3f},0.000,0.000|FS:{feed:.0f},0>\r\n'.encode())
        elif char == b'!' and self.state == 'Idle':
            self._rest(self.mpos)
            self.state = 'Hold'
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
            self.say(b"\r\nGrbl 1.1h ['$' for help]\r\n")

    def _line(self, line):
        self.lines.append(line)
        for pattern, reply in self.replies.items():
            if re.fullmatch(pattern, line):
                self.say(reply)
                return
        if self.is_deaf or self.state == 'Hold':
            return  # what is sent into a hold waits there
        if line == '$I':
            self.say(f'[VER:1.1h.20190830:]\r\n[OPT:{self.options},15,128]\r\nok\r\n'.encode())
        elif line == '$$':
            dump = ''.join(f'${n}={value}\r\n' for n, value in self.settings.items())
            self.say(dump.encode() + b'ok\r\n')
        elif line == '$H':
            self.state = 'Home'
            self._due.append((time.monotonic() + self.home_s, self._homed))
        elif self.state == 'Alarm':
            self.say(b'error:9\r\n')
        elif line.startswith('G4'):
            self._when_at_rest(lambda: self.say(b'ok\r\n'))
        elif match := re.search(r'G1 X(-?[\d.]+) F([\d.]+)', line):
            self._from, self._to = self.mpos, float(match[1])
            self._speed, self._began_s = float(match[2]) / 60, time.monotonic()
            self.say(b'ok\r\n<Idle|MPos:%.3f,0,0|FS:0,0>\r\n' % self._from)  # the Idle race
        else:
            self.say(b'ok\r\n')

    def _homed(self):
        self._rest(-199.0)
        self.state = 'Idle'
        self.say(b'ok\r\n')

    def _when_at_rest(self, do):
        def look():
            if self.is_moving:
                self._due.append((time.monotonic() + 0.005, look))
            else:
                do()

        look()
