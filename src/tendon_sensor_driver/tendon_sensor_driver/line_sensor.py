# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Load cells that write lines of text: the decoder of the lines, and the client."""

from __future__ import annotations

import math
import re
import time

from tendon_sensor_driver.client import (
    find_serial_number,
    LinkClient,
    NowNs,
    OnBlock,
    SerialTransport,
)
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.strain_stream import StrainStream
from tendon_sensor_driver.types import LineReading, SensorHealth

MAX_LINE_BYTES = 256
"""Largest length of a line. Longer lines are dropped, because no load cell sends them."""

MAX_VALUE = 1e15
"""Largest value in a line. Lines with larger values are rejected."""

SIMULATED = b'SIMULATED'
"""Text of the column that a simulated load cell adds to its lines."""

_UNIT_NAMES = {
    'kg': (b'kg', b'Kg', b'KG', b'kgf'),
    'g': (b'g', b'G', b'gf'),
    't': (b't',),
    'N': (b'N',),
    'mN': (b'mN',),
    'kN': (b'kN', b'KN'),
    'lbf': (b'lbs', b'lb', b'lbf', b'LB', b'LBS'),
    'oz': (b'oz', b'OZ', b'ozf'),
}
UNITS = {name: unit for unit, names in _UNIT_NAMES.items() for name in names}
"""Value of the parameter ``unit`` for each spelling of a unit in lines."""

_BRACKETS = b'[]():='  # characters that can enclose a unit
_STATE_LETTERS = (b'N', b'G')  # not units before a value, but "net" and "gross"
_STABILITY = frozenset((b'ST', b'US', b'S', b'D'))  # words for stable and unstable values
_FAULTS = frozenset(
    form.encode()
    for word in ('OVERLOAD', 'UNDERLOAD', 'OVERFLOW', 'UNDERFLOW', 'ERROR')
    for form in (word, word.title(), word.lower())
) | {b'OL', b'UL', b'OF', b'UF', b'OVER', b'UNDER', b'ERR'}
_FAULT_LINES = (b'S +', b'S -')  # overload and underload in Mettler SICS

_NUMBER = rb'[+-]?(?:\d+%(mark)s?\d*|%(mark)s\d+)(?:[eE][+-]?\d+)?'
# Numbers are matched first, because float() and int() also accept '1_0' or 'infinity'.
_POINT, _COMMA = (_NUMBER % {b'mark': mark} for mark in (rb'\.', b','))
_NAMED = rb'([A-Za-z_]*[:=])?(%s)([A-Za-z]*)'  # such as 'Weight:12.3g'
_split_columns = re.compile(rb'[ \t]*[,;][ \t]*|[ \t]+').split
# If the decimal mark is the comma, a comma between two digits belongs to a number. Other commas
# separate columns.
_split_at_other_commas = re.compile(rb'[ \t]*(?:;|(?<!\d),|,(?!\d))[ \t]*|[ \t]+').split
# ',5' may be 0.5 or an empty column, and '-,5' may be -0.5 or a column with a sign.
_find_bare_comma = re.compile(rb'(?:^|[ \t,;:=+-]),\d').search
_join_sign = re.compile(rb'(?<![^ \t,;])([+-]) +(?=[\d.,])').sub
_find_digit = re.compile(rb'\d').search
_find_letter = re.compile(rb'[A-Za-z%\x80-\xff]').search  # '%' may be a unit
_begins_number = re.compile(rb'[+-]?[.,]?\d').match

_FEW_COLUMNS = 'it has too few columns: check value_column and time_column'
_NO_TIME = 'its time_column holds no device time: check time_column and time_decimals'
_NO_NUMBER = 'its value_column holds no number: check value_column and decimal_mark'
_UNUSUAL = (
    'its columns or words differ from the previous lines: check whether lines are incomplete or '
    'mixed with text'
)
_OTHER_COUNT = (
    'it has {} columns, but line_columns is {}: check whether lines are incomplete or a '
    'number contains a comma'
)
_NUMBER_BESIDE = (
    'the number {} is next to its value: if the comma is a decimal mark, set decimal_mark to ","; '
    'if the number is another column, set line_columns to the number of columns in a line; '
    'thousands separators are not supported'
)
_SIGN_BESIDE = (
    'the sign of its value is in a column of its own: let the device send the sign directly in '
    'front of the digits'
)
_FAULT = 'the device reports an overload or an error: unload it, then see its manual'
_TOO_LONG = 'it is too long: check the baud'

_Shape = tuple[int, tuple[bytes, ...]]


class _RefusedLineError(Exception):
    """A line is rejected. The message contains the reason and a remedy."""


def split_line(line: bytes, decimal_mark: str = '.') -> list[bytes]:
    """Return the columns of a line without line ending."""
    line = line.strip(b' \t')
    if b'+ ' in line or b'- ' in line:
        line = _join_sign(rb'\1', line)
    return _split_at_other_commas(line) if decimal_mark == ',' else _split_columns(line)


def _is_word(column: bytes) -> bool:
    return column != SIMULATED and bool(_find_letter(column))


def format_line(line: bytes) -> str:
    r"""Return a line as text, in which non-printable bytes are written like ``\xff``."""
    return ''.join(chr(b) if 0x20 <= b < 0x7F else f'\\x{b:02x}' for b in line)


class LineDecoder:
    """Decodes a stream of bytes from a load cell into readings.

    The first line after the start and after `reset` is dropped and not counted, because its
    beginning may be missing.

    Attributes
    ----------
    bytes, lines, readings, rejected_lines : int
        Counters; see `tendon_sensor_driver.types.SensorHealth`.
    last_rejected : bytes
        The last rejected line, or the start of it.
    last_reason : str or None
        Reason for the last rejection, with a remedy; None if no line was rejected.
    last_byte : bytes
        The last received byte; empty if there is none since the start or `reset`.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._value_column = config.value_column
        self._time_column = config.time_column
        self._last_column = max(config.value_column, config.time_column)
        decimals = config.time_decimals
        self._line_columns = config.line_columns
        self._has_comma = config.decimal_mark == ','
        self._split = _split_at_other_commas if self._has_comma else _split_columns
        self._mark = b',' if self._has_comma else b'.'
        self._has_time_mark = decimals > 0
        ticks = rb'\d{1,19}'
        if decimals:
            ticks = rb'\d{1,%d}%s\d{%d}' % (19 - decimals, re.escape(self._mark), decimals)
        self._match_ticks = re.compile(ticks).fullmatch
        number = _COMMA if self._has_comma else _POINT
        self._match_number = re.compile(number).fullmatch
        self._match_named = re.compile(_NAMED % number).fullmatch
        self._unit = config.unit
        self._units = frozenset(_UNIT_NAMES[config.unit])
        self._other_units = frozenset(UNITS) - self._units
        self.bytes = 0
        self.lines = 0
        self.readings = 0
        self.rejected_lines = 0
        self.last_rejected = b''
        self.last_reason: str | None = None
        # The shape of a line is its number of columns and the words before its value. _shape is
        # the usual shape, and _odd_shape the shape of the previous line if it was unusual.
        self._shape: _Shape | None = None
        self._odd_shape: _Shape | None = None
        self.last_byte = b''
        self.reset()

    def reset(self) -> None:
        """Drop the unfinished line, because the next bytes do not continue it."""
        self._rest = b''
        self._skip_line = True
        self._has_dropped = False
        self.last_byte = b''

    def feed(self, data: bytes, received_at_ns: int) -> list[LineReading]:
        """Decode the next bytes of the stream; return the readings that they complete.

        Parameters
        ----------
        data : bytes
            The next bytes, of any number; a line can be split between several calls.
        received_at_ns : int
            Host time at which they were received [ns].
        """
        self.bytes += len(data)
        self.last_byte = data[-1:] or self.last_byte
        *lines, rest = (self._rest + data).replace(b'\r', b'\n').split(b'\n')
        if lines and self._skip_line:
            self._skip_line = False
            del lines[0]
        readings = []
        for line in lines:
            if len(line) > MAX_LINE_BYTES:
                self._reject(line, _TOO_LONG)
                continue
            line = line.strip(b' \t')
            if not line:
                continue
            try:
                readings.append(self._decode_line(line, received_at_ns))
            except _RefusedLineError as refusal:
                self._reject(line, str(refusal))
            else:
                self._has_dropped = False
        count = len(readings)
        self.readings += count
        self.lines += count
        if self._skip_line:
            rest = b''
        elif len(rest) > MAX_LINE_BYTES:
            self._reject(rest, _TOO_LONG)
            self._skip_line = True
            rest = b''
        self._rest = rest
        return readings

    def _decode_line(self, line: bytes, received_at_ns: int) -> LineReading:
        plain = _join_sign(rb'\1', line) if b'+ ' in line or b'- ' in line else line
        if self._has_comma and _find_bare_comma(plain):
            raise _RefusedLineError(_NO_NUMBER)
        columns = self._split(plain)
        if line in _FAULT_LINES or not _FAULTS.isdisjoint(columns):
            raise _RefusedLineError(_FAULT)
        count = len(columns)
        if count <= self._last_column:
            raise _RefusedLineError(_FEW_COLUMNS)
        self._check_count(columns)
        ticks = None
        if self._time_column >= 0:
            text = columns[self._time_column]
            if not self._match_ticks(text):
                raise _RefusedLineError(_NO_TIME)
            ticks = int(text.replace(self._mark, b'') if self._has_time_mark else text)
        words = [w for w in columns[: self._value_column] if w and not _find_digit(w)]
        text = columns[self._value_column]
        if words and words[-1] == b'-' and columns[self._value_column - 1] == b'-':
            raise _RefusedLineError(_SIGN_BESIDE)
        unit = b''
        if not self._match_number(text):
            named = self._match_named(text)
            if not named:
                raise _RefusedLineError(_NO_NUMBER)
            name, text, unit = named.groups()
            words += [name or b'', unit]
        after = columns[self._value_column + 1 :]
        if after and after[0] not in self._units and not unit:
            self._check_after(after)
        if unit and unit not in self._units:
            raise self._refuse_word(unit)
        value = float(text.replace(b',', b'.') if self._has_comma else text)
        if not -MAX_VALUE <= value <= MAX_VALUE:
            raise _RefusedLineError(_NO_NUMBER)
        shape = count, tuple(words)
        if shape == self._shape:
            self._odd_shape = None
        else:
            self._check_shape(*shape)
        return LineReading(ticks, value, received_at_ns, self._has_dropped, SIMULATED in columns)

    def _check_count(self, columns: list[bytes]) -> None:
        """Reject a line whose value may be only a part of a number that contains a comma.

        A line must have ``line_columns`` columns. If that is 0, no number except for the time can
        be next to the value.
        """
        if self._line_columns:
            count = len(columns) - (not columns[-1])  # a separator at the end begins no column
            if count != self._line_columns:
                raise _RefusedLineError(_OTHER_COUNT.format(count, self._line_columns))
            return
        for place in (self._value_column - 1, self._value_column + 1):
            is_other = 0 <= place < len(columns) and place != self._time_column
            if is_other and _begins_number(columns[place]):
                raise _RefusedLineError(_NUMBER_BESIDE.format(format_line(columns[place])))

    def _check_after(self, columns: list[bytes]) -> None:
        """Reject a line with another unit, or with an unknown word, after its value."""
        for number, column in enumerate(columns):
            if self._match_number(column) or column.strip(_BRACKETS) in self._units:
                break  # this is the right unit, or another number begins
            if column in self._other_units or (number == 0 and _is_word(column)):
                raise self._refuse_word(column)

    def _check_shape(self, count: int, words: tuple[bytes, ...]) -> None:
        """Reject a line whose number of columns, or words before the value, are unusual.

        An incomplete line, two joined lines or a text can look like a reading. However, if the
        next line has the same new shape, the settings of the device have been changed, and the
        line is accepted.
        """
        for word in words:
            if word not in _STATE_LETTERS and word.strip(_BRACKETS) in self._other_units:
                raise self._refuse_word(word)
        shape = count, tuple(b'' if word in _STABILITY else word for word in words)
        is_plain_start = self._shape is None and not words
        if shape in (self._shape, self._odd_shape) or is_plain_start:
            self._shape, self._odd_shape = shape, None
            return
        self._odd_shape = shape
        raise _RefusedLineError(_UNUSUAL)

    def _refuse_word(self, word: bytes) -> _RefusedLineError:
        word = word.strip(_BRACKETS)
        if word in UNITS:
            return _RefusedLineError(
                f'its unit is {word.decode()}, but the parameter "unit" is {self._unit}: set '
                f'unit to {UNITS[word]}'
            )
        return _RefusedLineError(
            f'the word "{format_line(word)}" after the value is not a known unit: let the device '
            f'send {self._unit} or no unit'
        )

    def _reject(self, line: bytes, reason: str) -> None:
        self.lines += 1
        self.rejected_lines += 1
        self.last_rejected = line[:80]
        self.last_reason = reason
        self._has_dropped = True


def encode_reading(
    device_ticks: int | None,
    value: float,
    unit: str = 'kg',
    decimals: int = 5,
    *,
    is_simulated: bool = False,
) -> bytes:
    r"""Return one line in the format of an OpenScale, such as ``b'1204,0.53000,kg,\r\n'``.

    Parameters
    ----------
    device_ticks : int or None
        Device time in ticks; None omits the column.
    value : float
        Value in ``unit``.
    unit : str
        A key of `NEWTONS`; lbf is written as ``lbs``.
    decimals : int
        Number of digits after the decimal point.
    is_simulated : bool
        Append the column `SIMULATED`.

    Raises
    ------
    ValueError
        If ``value`` is not finite.
    """
    if not math.isfinite(value):
        raise ValueError(f'a reading must be a finite number, not {value}')
    time = '' if device_ticks is None else f'{device_ticks},'
    mark = f'{SIMULATED.decode()},' if is_simulated else ''
    name = _UNIT_NAMES[unit][0].decode()
    return f'{time}{value:.{decimals}f},{name},{mark}\r\n'.encode('ascii')


LONGEST_DELIVERY_NS = 250_000_000
"""If ``on_block`` runs for longer than this [ns], received bytes can be lost."""

_DROP_S = 0.05
_LONGEST_READ_S = 0.1  # short, because `close` waits for the end of a read
_BURST_READINGS = 3
_MENU_PROMPT = b'>'


class TendonSensorClient(LinkClient[SerialTransport]):
    """Client of a load cell that writes lines to a serial port.

    One thread reads, decodes and calls ``on_block``. Bytes that arrive while ``on_block`` runs
    are read late. If ``on_block`` runs for more than 0.25 s, these bytes are dropped, because the
    buffer of the kernel may have lost some of them. Such an overrun is counted, and the dropped
    samples are counted as lost.

    If a board is silent, it may be an OpenScale whose settings menu is open. The client then
    sends a carriage return, which makes the menu print its prompt. It has no effect on a board
    that measures. If the prompt arrives, the client sends ``x``, which closes the menu.

    ``identity`` is the serial number of the USB adapter. See `SensorClient` for the parameters.
    """

    _stream: StrainStream

    def __init__(self, config: TendonSensorConfig, on_block: OnBlock, now_ns: NowNs) -> None:
        super().__init__(config, on_block, now_ns)
        self._decoder = LineDecoder(config)
        self._stream = StrainStream(config)
        self._silence_ns = round(config.silence_s * 1e9)
        self._silent_at_ns = 0  # monotonic time after which a sensor without data counts as silent
        self._delivered_in_ns = 0
        self._overruns = 0
        self._bursts = 0

    def health(self) -> SensorHealth:
        decoder = self._decoder
        return self._make_health(
            self._stream,
            bytes=decoder.bytes,
            lines=decoder.lines,
            readings=decoder.readings,
            rejected_lines=decoder.rejected_lines,
            bursts=self._bursts,
            overruns=self._overruns,
            last_rejected=format_line(decoder.last_rejected),
            last_reason=decoder.last_reason,
        )

    # -- the client's thread -----------------------------------------------------------

    def _connect(self) -> SerialTransport:
        link = SerialTransport(self._config.port, self._config.baud)
        self._silent_at_ns = time.monotonic_ns() + self._silence_ns
        self.identity = find_serial_number(self._config.port)
        if self._has_started:
            self._is_connected = True
            self._reconnects += 1
            self._decoder.reset()
            self._stream.note_reconnection()
        return link

    def _read(self, link: SerialTransport) -> None:
        if self._delivered_in_ns > LONGEST_DELIVERY_NS:
            self._drop_input(link)
        data = link.read(min(self._config.silence_s, _LONGEST_READ_S))
        if not data:
            now_ns = time.monotonic_ns()
            if now_ns >= self._silent_at_ns:
                self._silent_at_ns = now_ns + self._silence_ns
                self._deliver(self._stream.flush())
                self._leave_menu(link)
            return
        received_at_ns = self._arrivals.now_ns()
        if self._arrivals.step_ns:
            self._stream.note_clock_step(self._arrivals.take_step_ns())
        began_ns = time.monotonic_ns()
        self._silent_at_ns = began_ns + self._silence_ns
        readings = self._decoder.feed(data, received_at_ns)
        if readings:
            self._note_samples(began_ns)
        if len(readings) > 1:
            self._bursts += len(readings) >= _BURST_READINGS
            self._stream.clock.note_newest(readings[-1].device_ticks, received_at_ns)
        for reading in readings:
            self._deliver(self._stream.add_reading(reading))
        self._delivered_in_ns = time.monotonic_ns() - began_ns

    def _drop_input(self, link: SerialTransport) -> None:
        """Drop all waiting bytes, because bytes between them may be missing."""
        end_s = time.monotonic() + _DROP_S
        while time.monotonic() < end_s:
            link.read(_DROP_S)
        self._decoder.reset()
        self._stream.note_dropped_bytes()
        self._delivered_in_ns = 0
        self._overruns += 1

    def _leave_menu(self, link: SerialTransport) -> None:
        last = self._decoder.last_byte
        if not self._config.leave_menu or self._stop.is_set():
            return
        if last == _MENU_PROMPT:
            link.write(b'x')
        elif not last:
            link.write(b'\r')
