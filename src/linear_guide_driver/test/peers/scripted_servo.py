# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated Dynamixel XM430 behind a pty. It implements Protocol 2.0 without the SDK."""

import struct
import termios
import time

from pty_peer import PtyPeer

VELOCITY_UNIT_COUNTS_S = 0.229 / 60 * 4096

STALL_S = 0.05
"""If the thread of this servo runs later than this [s], the computer was busy. A real servo would
have received packets of its driver in the meantime, so the watchdog does not count this time."""

TABLE = (
    (0, 2, 1020), (6, 1, 45), (7, 1, 1), (11, 1, 3), (31, 1, 80), (38, 2, 1193), (44, 4, 200),
    (68, 1, 2), (132, 4, 2048), (144, 2, 121), (146, 1, 31),
    (220, 4, 250 | 251 << 16),
)  # fmt: skip
"""Address, size and value of the registers that are initially not zero."""


RUN = ((108, 4), (112, 4), (116, 4))
"""Address and size of the adjacent registers that the driver may write in one packet."""


def find_fields(address, size):
    """Return address and size of each register in a packet."""
    if size <= 4:
        return [(address, size)]
    return [field for field in RUN if address <= field[0] < address + size]


def compute_crc(data):
    """Return the CRC-16 of ``data`` with the polynomial 0x8005."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class ServoModel:
    """Registers and shaft of a servo, which turns at the profile velocity and has a bus watchdog.

    Parameters
    ----------
    clock : callable
        Returns the time [s].
    """

    def __init__(self, clock=time.monotonic):
        self._clock = clock
        self.table = bytearray(224)
        for address, size, value in TABLE:
            self.put(address, size, value)
        self.writes = []
        self.lasting_error = 0  # hardware error that remains after a restart
        self.trips_before = None  # the watchdog trips before the next write of this register
        self.stuck_at = None  # position [counts] at which the load stops the shaft
        self._part = 0.0  # fraction of a count that the shaft has turned
        self._heard_s = self._turned_s = clock()

    def put(self, address, size, value):
        self.table[address : address + size] = value.to_bytes(size, 'little', signed=value < 0)

    def get(self, address, size=4, signed=True):
        return int.from_bytes(self.table[address : address + size], 'little', signed=signed)

    @property
    def position(self):
        """Position of the shaft [counts], independent of the homing offset."""
        return self.get(132) - self.get(20)

    def turn_to(self, counts):
        """Turn the shaft."""
        self.put(132, 4, counts + self.get(20))

    @property
    def goal(self):
        """Goal position of the shaft [counts], independent of the homing offset."""
        return self.get(116) - self.get(20)

    def leave_as_a_driver(self, zero, position):
        """Hold a position of the shaft [counts] with a tripped watchdog, as a dead driver does."""
        for address, size, value in ((20, 4, -zero), (11, 1, 5), (64, 1, 1), (98, 1, 255)):
            self.put(address, size, value)
        for address, size, value in ((102, 2, 112), (112, 4, 42), (116, 4, position - zero)):
            self.put(address, size, value)
        self.put(132, 4, position - zero)

    def shut_down(self, hardware_error):
        self.put(70, 1, hardware_error)
        self.put(64, 1, 0)

    def lose_power(self):
        """Lose all registers except the EEPROM, and the count of whole turns."""
        counts = self.position
        self.put(64, 160, 0)
        for address, size, value in TABLE:
            if address >= 64:
                self.put(address, size, value)
        self.turn_to(counts % 4096)

    # -- inside ------------------------------------------------------------------------

    def _turn(self):
        now, before = self._clock(), self._turned_s
        self._turned_s = now
        self._heard_s += max(0.0, now - before - STALL_S)
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

    def _write(self, address, data):
        """Write all registers of a packet, or none; return the error of the answer."""
        fields = find_fields(address, len(data))
        if address < 64 and self.table[64]:
            return 7
        if self.trips_before in {field for field, _ in fields}:
            self.trips_before = None
            self.put(98, 1, 255)
        values = []
        for field, size in fields:
            part = data[field - address : field - address + size]
            value = int.from_bytes(part, 'little', signed=True)
            if field in (102, 112, 116) and self.table[98] == 255:
                return 4
            if field == 102 and value > self.get(38, 2):
                return 6
            values.append((field, size, value))
        for field, size, value in values:
            if field == 20:
                self.put(132, 4, self.get(132) + value - self.get(20))
            if field == 11 and value != self.table[11]:
                self.put(102, 2, self.get(38, 2))
                self.put(108, 8, 0)
            self.writes.append((field, value))
            self.put(field, size, value)
        return 0


class ScriptedServo(ServoModel, PtyPeer):
    """Servo that answers packets; a test injects faults."""

    def __init__(self):
        ServoModel.__init__(self)
        self.packets = 0  # number of received packets
        self.is_silent = False
        self._silent_until_s = 0.0
        self.is_mute = False  # packets are received, but the answers are lost
        # Called for each packet with the address that it reads, or of its last written register.
        # If it returns True, the packet is lost.
        self.lose = lambda address: False
        self.status_error = 0  # error with which every instruction is refused
        self.lost_answers = 0  # number of next answers that are lost
        self.late_s = 0.0  # delay of the next answer [s]
        self.owed = b''  # data of a late answer to an earlier request, which is sent first
        self._partial = b''
        PtyPeer.__init__(self)

    def stop_flow(self, is_stopped):
        """Block writing to the port, or allow it again."""
        termios.tcflow(self._slave, termios.TCOOFF if is_stopped else termios.TCOON)

    # -- inside ------------------------------------------------------------------------

    def take(self, data):
        self._partial += data
        self._turn()
        while len(buffer := self._partial) >= 7:
            end = 7 + buffer[5] + 256 * buffer[6]
            if len(buffer) < end:
                break
            self._packet(buffer[:end])
            self._partial = buffer[end:]

    def _packet(self, packet):
        assert packet[:4] == b'\xff\xff\xfd\x00'
        assert struct.unpack('<H', packet[-2:])[0] == compute_crc(packet[:-2])
        if packet[4] != self.table[7] or self.is_silent:
            return
        if time.monotonic() < self._silent_until_s:
            return
        if packet[7] == 3 and self.lose(find_fields(packet[8], len(packet) - 12)[-1][0]):
            return
        if packet[7] == 2 and self.lose(packet[8]):
            return
        self._heard_s = time.monotonic()
        self.packets += 1
        if self.status_error:
            self._answer(self.status_error)
            return
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
        self.say(packet + struct.pack('<H', compute_crc(packet)))
