# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The serial line of an ATI Digital F/T: questions and answers, then the stream."""

from __future__ import annotations

from contextlib import suppress
import time

from tendon_sensor_driver.ati.digital_ft_protocol import (
    ACCEPTED,
    ADDRESS,
    CALIBRATION_REGISTER,
    CALIBRATION_REGISTERS,
    CALIBRATION_STEP,
    decode_calibration,
    DigitalCalibration,
    GAINS_REGISTER,
    GAUGE_REGISTERS,
    JAM,
    LOCK_DATA,
    LOCK_STORAGE,
    START_DATA,
    START_STREAM,
    STATUS_REGISTER,
    UNLOCK_DATA,
)
from tendon_sensor_driver.ati.modbus import (
    decode_frame,
    decode_read,
    decode_write,
    encode_frame,
    encode_read,
    encode_write,
    ModbusError,
    MOST_REGISTERS,
)
from tendon_sensor_driver.errors import LinkError
from tendon_sensor_driver.transport import SerialTransport

READ_TIMEOUT_S = 0.25
_ANSWER_TIMEOUT_S = 0.3
_QUIET_S = 0.05
_TRIES = 4


class DigitalFtLink:
    """A Digital F/T on a serial port, from construction to `close`.

    8 data bits, even parity, 1 stop bit. The check of a record does not see the highest bit of a
    byte, parity does. While it streams it answers no questions; so everything begins with stopping
    a stream that another run may have left.

    Parameters
    ----------
    port : str
        Name of the device.
    baud : int
        Its speed: 1250000, 115200 or 19200.

    Raises
    ------
    LinkError
        By every method, when the port cannot be opened or has gone, and when the device does not
        answer, refuses or has not what is asked for.
    """

    def __init__(self, port: str, baud: int) -> None:
        self._name = port
        self._transport = SerialTransport(port, baud, has_parity=True)
        self._rest = b''  # what came behind an answer

    def read(self) -> bytes:
        """Return what has arrived, or nothing after 0.25 s without any."""
        rest, self._rest = self._rest, b''
        return rest or self._transport.read(READ_TIMEOUT_S)

    def close(self) -> None:
        """Stop the stream and close the port."""
        with suppress(LinkError):
            self._transport.write(JAM)
        self._transport.close()

    def stop_stream(self) -> None:
        """Make the device listen again, whatever it does."""
        for _ in range(_TRIES):
            self._transport.write(JAM)
            if self._is_quiet():
                return
        raise LinkError(
            f'the device at {self._name} does not stop sending; connect one Digital F/T alone'
        )

    def read_status(self) -> int:
        """Return the status word."""
        return self._read_registers(STATUS_REGISTER, 1)[0]

    def read_calibration(self, slot: int) -> DigitalCalibration:
        """Return the calibration in a slot, 1 to 16."""
        first = CALIBRATION_REGISTER + CALIBRATION_STEP * (slot - 1)
        values: tuple[int, ...] = ()
        while len(values) < CALIBRATION_REGISTERS:
            count = min(MOST_REGISTERS, CALIBRATION_REGISTERS - len(values))
            values += self._read_registers(first + len(values), count)
        return decode_calibration(values)

    def set_gauges(self, settings: tuple[int, ...]) -> None:
        """Make the gains and offsets of a calibration the active ones, if they are not."""
        if self._read_registers(GAINS_REGISTER, GAUGE_REGISTERS) == settings:
            return
        self._command(LOCK_STORAGE, UNLOCK_DATA)
        frame = self._ask(encode_write(ADDRESS, GAINS_REGISTER, settings), 8)
        try:
            decode_write(frame, ADDRESS, GAINS_REGISTER, len(settings))
        finally:
            self._command(LOCK_STORAGE, LOCK_DATA)

    def start_stream(self) -> None:
        """Start the stream."""
        self._command(START_STREAM, START_DATA)

    def _command(self, function: int, data: bytes) -> None:
        frame = self._ask(encode_frame(ADDRESS, function, data), 5)
        answer = decode_frame(frame, ADDRESS, function)
        if answer != ACCEPTED:
            raise LinkError(f'the Digital F/T refuses function {function} with {answer.hex()}')

    def _read_registers(self, first: int, count: int) -> tuple[int, ...]:
        reason: Exception | None = None
        for _ in range(_TRIES):
            frame = self._ask(encode_read(ADDRESS, first, count), 5 + 2 * count)
            try:
                return decode_read(frame, ADDRESS, count)
            except ModbusError as error:
                reason = error
                self._is_quiet()
        raise LinkError(
            f'no answer from a Digital F/T at {self._name}: {reason}; check power, wiring and '
            'the parameter "baud" (1250000 as delivered)'
        ) from reason

    def _ask(self, request: bytes, size: int) -> bytes:
        self._transport.write(request)
        deadline_s = time.monotonic() + _ANSWER_TIMEOUT_S
        answer = b''
        while len(answer) < size and (left_s := deadline_s - time.monotonic()) > 0:
            answer += self._transport.read(left_s)
        self._rest = answer[size:]
        return answer[:size]

    def _is_quiet(self) -> bool:
        """Drop what arrives until nothing does; whether that was soon."""
        deadline_s = time.monotonic() + 10 * _QUIET_S
        self._rest = b''
        while time.monotonic() < deadline_s:
            if not self._transport.read(_QUIET_S):
                return True
        return False
