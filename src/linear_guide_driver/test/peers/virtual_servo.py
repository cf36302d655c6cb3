# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A servo and its bus in virtual time: the driver's own code runs on it without threads."""

from collections import deque
import threading
from types import SimpleNamespace

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, Protocol2PacketHandler
from scripted_servo import ServoModel
import serial

from linear_guide_driver.dynamixel.bus import DynamixelBus

STEP_NS = 8_000_000
EXCHANGE_NS = 1_000_000
"""Duration of a request and its answer [ns]."""

TIMEOUT_NS = 36_000_000
"""Time for which the SDK waits for an answer at 1 Mbaud [ns]: about twice its latency timer."""

LATE_NS = 70_000_000
"""Delay of a late answer [ns], which therefore arrives after the next request."""


class VirtualTime:
    """Replaces the module `time` of the modules under test; sleeping advances the time."""

    def __init__(self):
        self.now_ns = 0
        self.on_step = lambda: None

    def monotonic_ns(self):
        return self.now_ns

    time_ns = monotonic_ns

    def monotonic(self):
        return self.now_ns / 1e9

    def sleep(self, duration_s):
        end_ns = self.now_ns + round(duration_s * 1e9)
        while self.now_ns < end_ns:
            self.now_ns = min(self.now_ns + STEP_NS, end_ns)
            self.on_step()


class VirtualServo(ServoModel):
    """A servo in virtual time. Without power, it loses its count of whole turns.

    Attributes
    ----------
    lost_counts : int
        Sum of the changes of its position register by losses of the power [counts].
    """

    def __init__(self, time, first_count):
        super().__init__(time.monotonic)
        self.lost_counts = 0
        self.turn_to(first_count)

    def lose_power(self, *, is_torque_on=False):
        """Interrupt the power. If ``is_torque_on``, the servo then switches its torque on."""
        before = self.position
        super().lose_power()
        self.put(102, 2, self.get(38, 2))
        self.put(116, 4, self.get(132))
        self.put(64, 1, int(is_torque_on))
        self.lost_counts += before - self.position

    def answer(self, instruction, parameters):
        """Execute an instruction; return error and data of its answer."""
        self._heard_s = self._clock()
        if instruction == 1:
            return 0, bytes(self.table[0:2]) + bytes(self.table[6:7])
        if instruction == 8:
            self.put(64, 1, 0)
            self.put(98, 1, 0)
            self.put(70, 1, self.lasting_error)
            return 0, b''
        address = int.from_bytes(parameters[:2], 'little')
        if instruction == 2:
            size = int.from_bytes(parameters[2:4], 'little')
            return 0, bytes(self.table[address : address + size])
        return self._write(address, parameters[2:]), b''

    def turn(self):
        self._turn()


class VirtualLine:
    """Serial line between driver and servo; a test injects faults.

    Attributes
    ----------
    faults : deque of str
        One fault for each of the next exchanges. ``fine``: no fault. ``silent``: the request is
        lost. ``mute``: the answer is lost. ``refused``: the servo refuses the request. ``late``:
        the answer arrives after the next request. ``doubled``: the servo receives the request
        twice, and the second answer arrives after the next request.
    is_plugged : bool
    on_heard : callable
        Called with instruction and parameters before the servo executes an instruction.
    """

    def __init__(self, time, servo):
        self.time, self.servo = time, servo
        self.faults = deque()
        self.is_plugged = True
        # Number of times that the cable was plugged in. A port that was opened before the last
        # time is lost.
        self.plugs = 0
        self.on_heard = lambda instruction, parameters: None
        self._late = deque()  # late answers and their times of arrival

    def unplug(self):
        self.is_plugged = False

    def plug_in(self):
        self.plugs += not self.is_plugged
        self.is_plugged = True

    def exchange(self, opened, instruction, parameters):
        """Return error and data of the first answer, or None."""
        if not self.is_plugged or opened != self.plugs:
            raise serial.SerialException('the line is lost')
        fault = self.faults.popleft() if self.faults else 'fine'
        # Bytes received before the request are dropped.
        answers = deque(answer for answer, at_ns in self._late if at_ns > self.time.now_ns)
        self._late.clear()
        if fault != 'silent':
            self.on_heard(instruction, parameters)
            answer = (1, b'') if fault == 'refused' else self.servo.answer(instruction, parameters)
            if fault == 'doubled':
                self.on_heard(instruction, parameters)
                late = self.servo.answer(instruction, parameters)
                self._late.append((late, self.time.now_ns + LATE_NS))
            if fault == 'late':
                self._late.append((answer, self.time.now_ns + LATE_NS))
            elif fault != 'mute':
                answers.append(answer)
        self.time.sleep((EXCHANGE_NS if answers else TIMEOUT_NS) / 1e9)
        # Further answers are dropped before the next request.
        return answers[0] if answers else None


class VirtualBus(DynamixelBus):
    """The driver's bus on a `VirtualLine`."""

    def __init__(self, line):
        self._line = line
        self.name = self._name = 'the virtual servo'
        self._id, self._baud = 1, 1_000_000
        self._reads = 0
        self.lock = threading.RLock()
        self._packets = _VirtualPackets(line)
        self._port = _VirtualPort(line)
        self.open()


class _VirtualPort:
    def __init__(self, line):
        self._line, self.opened = line, 0
        self.ser = SimpleNamespace(is_open=False, reset_input_buffer=lambda: None)

    def setBaudRate(self, _):  # noqa: N802 (of the SDK)
        if not self._line.is_plugged:
            raise serial.SerialException('cannot open the port')
        self.ser.is_open, self.opened = True, self._line.plugs
        return True

    def closePort(self):  # noqa: N802 (of the SDK)
        self.ser.is_open = False

    def getPortName(self):  # noqa: N802 (of the SDK)
        return 'virtual'


class _VirtualPackets(Protocol2PacketHandler):
    def __init__(self, line):
        super().__init__()
        self._line = line

    def txRxPacket(self, port, packet):  # noqa: N802 (of the SDK)
        size = packet[5] + 256 * packet[6] - 3
        answer = self._line.exchange(port.opened, packet[7], bytes(packet[8 : 8 + size]))
        if answer is None:
            return None, COMM_RX_TIMEOUT, 0
        error, data = answer
        length = len(data) + 4
        head = [0xFF, 0xFF, 0xFD, 0, 1, length & 0xFF, length >> 8, 0x55, error]
        return [*head, *data, 0, 0], COMM_SUCCESS, error
