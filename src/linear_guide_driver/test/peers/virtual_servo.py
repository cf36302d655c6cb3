# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A servo and its bus in virtual time: the driver's own code runs on it without threads."""

import threading

from scripted_servo import ServoModel

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import SilentServoError
from linear_guide_driver.errors import DeviceConnectionError, DeviceRefusedError

STEP_NS = 8_000_000
TRANSACTION_NS = 1_000_000


class VirtualTime:
    """Stands in for the module `time` of the modules under test; sleeping lets it pass."""

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


class VirtualBus(ServoModel):
    """Has the methods of `DynamixelBus`; a test plants faults.

    Attributes
    ----------
    fault : str
        Of the next ``faulty`` transactions: silent (not heard), mute (heard, the answer is lost)
        or refused.
    is_plugged : bool
    on_goal : callable
        Called with goal and present position before each goal is written [counts].
    """

    def __init__(self, time):
        super().__init__(time.monotonic)
        self._time = time
        time.on_step = self._turn
        self.lock = threading.RLock()
        self.fault, self.faulty = '', 0
        self.is_plugged = self.is_open = True
        self.on_goal = lambda goal, present: None

    def open(self):
        if not self.is_plugged:
            raise DeviceConnectionError('cannot open the port')
        self.is_open = True

    def close(self):
        self.is_open = False

    def ping(self):
        return self.read(registers.MODEL_NUMBER)

    def read(self, register):
        is_answered = self._hear()
        value = self.get(register.address, register.size, register.is_signed)
        self._answer(is_answered)
        return value

    def read_block(self, block):
        is_answered = self._hear()
        data = bytes(self.table[block.address : block.address + block.size])
        self._answer(is_answered)
        return data

    def write(self, register, value):
        is_answered = self._hear()
        if register == registers.GOAL_POSITION and self.table[64]:
            self.on_goal(value, self.get(132))
        data = value.to_bytes(register.size, 'little', signed=value < 0)
        error = self._write(register.address, data)
        self._answer(is_answered)
        if error:
            raise DeviceRefusedError(f'refused with {error}')

    def write_fresh(self, register, find):
        value = find()
        self.write(register, value)
        return value

    def reboot(self):
        is_answered = self._hear()
        self.put(64, 1, 0)
        self.put(98, 1, 0)
        self.put(70, 1, self.lasting_error)
        self._answer(is_answered)

    # -- inside ------------------------------------------------------------------------

    def _hear(self):
        """Return whether the instruction is answered."""
        self._time.sleep(TRANSACTION_NS / 1e9)
        if not (self.is_plugged and self.is_open):
            self.is_open = False
            raise DeviceConnectionError('the line is lost')
        fault = self.fault if self.faulty else ''
        self.faulty = max(0, self.faulty - 1)
        if fault == 'silent':
            raise SilentServoError('no answer')
        self._heard_s = self._clock()
        if fault == 'refused':
            raise DeviceRefusedError('the instruction could not be carried out')
        return fault != 'mute'

    def _answer(self, is_answered):
        if not is_answered:
            raise SilentServoError('the answer was lost')
