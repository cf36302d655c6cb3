# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A Dynamixel XM430 behind a pty: Protocol 2.0 written from the e-Manual, not from the SDK."""

import os
import select
import struct
import threading
import time
import tty

VELOCITY_UNIT_COUNTS_S = 0.229 / 60 * 4096


def compute_crc(data):
    """CRC-16 with polynomial 0x8005, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class ScriptedServo:
    """Turns at the profile velocity; holds its watchdog; a test plants faults."""

    def __init__(self):
        self.table = bytearray(147)
        self.put(0, 2, 1020)
        self.put(6, 1, 45)
        self.put(7, 1, 1)
        self.put(11, 1, 3)
        self.put(31, 1, 80)
        self.put(38, 2, 1193)
        self.put(44, 4, 200)
        self.put(68, 1, 2)
        self.put(132, 4, 2048)
        self.put(144, 2, 121)
        self.put(146, 1, 31)
        self.writes = []
        self.packets = 0  # heard so far
        self.is_silent = False
        self.lasting_error = 0  # the hardware error that a restart does not end
        self._silent_until_s = 0.0
        self.is_mute = False  # hears, but its answers are lost
        self.lose = lambda address: False  # whether the packet for this register is lost
        self.lost_answers = 0  # how many of the next answers are lost
        self.late_s = 0.0  # how late the next answer is
        self.owed = b''  # the data of an answer to an earlier question, which comes first
        self.trips_before = None  # register before whose next write the watchdog trips
        self.stuck_at = None  # counts beyond which the load does not yield
        self._part = 0.0  # of a count, turned already
        self._heard_s = self._turned_s = time.monotonic()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def put(self, address, size, value):
        self.table[address : address + size] = value.to_bytes(size, 'little', signed=value < 0)

    def get(self, address, size=4, signed=True):
        return int.from_bytes(self.table[address : address + size], 'little', signed=signed)

    @property
    def position(self):
        """Of the shaft, whatever the homing offset [counts]."""
        return self.get(132) - self.get(20)

    def turn_to(self, counts):
        """Turn the shaft."""
        self.put(132, 4, counts + self.get(20))

    @property
    def goal(self):
        """The goal position, as one of the shaft [counts]."""
        return self.get(116) - self.get(20)

    def close(self):
        """Unplug. Harmless when called twice."""
        master, self._master = self._master, -1
        if master >= 0:
            os.close(self._slave)
            self._thread.join(1.0)
            os.close(master)

    def shut_down(self, hardware_error):
        self.put(70, 1, hardware_error)
        self.put(64, 1, 0)

    # -- inside ------------------------------------------------------------------------

    def _serve(self):
        buffer = b''
        try:
            while self._master >= 0:
                ready, _, _ = select.select([self._master], [], [], 0.002)
                if ready:
                    buffer += os.read(self._master, 1024)
                self._turn()
                while len(buffer) >= 7 and len(buffer) >= 7 + buffer[5] + 256 * buffer[6]:
                    end = 7 + buffer[5] + 256 * buffer[6]
                    self._packet(buffer[:end])
                    buffer = buffer[end:]
        except (OSError, ValueError):
            pass

    def _turn(self):
        now, before = time.monotonic(), self._turned_s
        self._turned_s = now
        watchdog = self.get(98, 1, signed=False)
        if self.table[64] and 1 <= watchdog <= 127 and now - self._heard_s > watchdog * 0.02:
            self.put(98, 1, 255)
        velocity = 0
        if self.table[64] and self.table[98] != 255:
            left = self.get(116) - self.get(132)
            self._part += self.get(112) * VELOCITY_UNIT_COUNTS_S * (now - before)
            step, self._part = int(self._part), self._part % 1.0
            step = min(step, abs(left)) * (1 if left > 0 else -1)
            if self.stuck_at is not None and self.position + step > self.stuck_at:
                step = self.stuck_at - self.position
            is_held_up = self.stuck_at is not None and left > 0 and self.position >= self.stuck_at
            velocity = 0 if is_held_up else self.get(112) * ((left > 0) - (left < 0))
            self.put(132, 4, self.get(132) + step)
        self.put(128, 4, velocity)

    def _packet(self, packet):
        assert packet[:4] == b'\xff\xff\xfd\x00'
        assert struct.unpack('<H', packet[-2:])[0] == compute_crc(packet[:-2])
        if packet[4] != self.table[7] or self.is_silent:
            return
        if time.monotonic() < self._silent_until_s:
            return
        if packet[7] in (2, 3) and self.lose(struct.unpack('<H', packet[8:10])[0]):
            return
        self._heard_s = time.monotonic()
        self.packets += 1
        instruction, parameters = (
            packet[7],
            packet[8:-2].replace(b'\xff\xff\xfd\xfd', b'\xff\xff\xfd'),
        )
        if instruction == 1:
            self._answer(0, bytes(self.table[0:2]) + bytes(self.table[6:7]))
        elif instruction == 2:
            address, size = struct.unpack('<HH', parameters)
            self._answer(0, bytes(self.table[address : address + size]))
        elif instruction == 3:
            address, data = struct.unpack('<H', parameters[:2])[0], parameters[2:]
            self._answer(self._write(address, data))
        elif instruction == 8:
            self._answer(0)
            self.put(64, 1, 0)
            self.put(98, 1, 0)
            self.put(70, 1, self.lasting_error)
            self._silent_until_s = time.monotonic() + 0.3
        else:
            self._answer(2)

    def _write(self, address, data):
        value = int.from_bytes(data, 'little', signed=True)
        if address < 64 and self.table[64]:
            return 7
        if address == self.trips_before:
            self.trips_before = None
            self.put(98, 1, 255)
        if address in (102, 112, 116) and self.table[98] == 255:
            return 4
        if address == 102 and value > self.get(38, 2):
            return 6
        if address == 20:
            self.put(132, 4, self.get(132) + value - self.get(20))
        self.writes.append((address, value))
        self.table[address : address + len(data)] = data
        return 0

    def _answer(self, error, data=b''):
        if self.is_mute:
            return
        if self.owed:
            owed, self.owed = self.owed, b''
            self._answer(0, owed)
        if self.lost_answers:
            self.lost_answers -= 1
            return
        alert = 0x80 if self.table[70] else 0
        body = bytes([0x55, error | alert]) + data
        body = body.replace(b'\xff\xff\xfd', b'\xff\xff\xfd\xfd')
        packet = (
            b'\xff\xff\xfd\x00' + bytes([self.table[7]]) + struct.pack('<H', len(body) + 2) + body
        )
        late_s, self.late_s = self.late_s, 0.0
        time.sleep(late_s)
        os.write(self._master, packet + struct.pack('<H', compute_crc(packet)))
