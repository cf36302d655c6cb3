# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Load-cell lines in ASCII: bytes in any chunking to readings, and back.

    line   := column (separator column)*        ends in CR, LF or both
    column := word | number | name? number unit?

Columns are separated by ``,``, ``;``, a tab or spaces; separators may trail. Which columns count
is configured. A sign that blanks part from its number belongs to it: ``-   12.34``. This covers
SparkFun's OpenScale, the usual HX711 sketches and scale indicators such as ``ST,GS,+  12.34 kg``
(A&D, CAS) or ``S D     12.34 g`` (Mettler SICS), whose status words alternate.

The format has no checksum: a digit that changes on the wire cannot be seen. What can
be seen is refused, with a reason and its remedy:

- a line that is cut, or two lines that melted into one: the number of columns changes;
- a number that is no plain finite decimal;
- words before the value that are not the usual ones (a banner);
- a word after the value that is not the configured unit: ``12.34 mN`` is not 12.34 N;
- a comma that may be a decimal mark or a separator, unless ``decimal_mark`` says which;
- an overload, an underload or an error that the device reports.
"""

from __future__ import annotations

import math
import re

from tendon_sensor_driver.records import Reading, TendonSensorConfig

MAX_LINE_BYTES = 256
"""A longer line is dropped: no load cell sends one, and the memory stays bounded."""

MAX_VALUE = 1e15
"""A larger value is refused: no load cell counts that far, and no later product overflows."""

SIMULATED = b'SIMULATED'
"""A column after the value with which a simulated load cell says that it is one."""

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
"""The parameter ``unit`` by the word in a line."""

_STATE_LETTERS = (b'N', b'G')  # before a value: net, gross
_STABILITY = frozenset((b'ST', b'US', b'S', b'D'))  # stable or not; they alternate
_FAULTS = frozenset(
    form.encode()
    for word in ('OVERLOAD', 'UNDERLOAD', 'OVERFLOW', 'UNDERFLOW', 'ERROR')
    for form in (word, word.title(), word.lower())
) | {b'OL', b'UL', b'OF', b'UF', b'OVER', b'UNDER', b'ERR'}
_FAULT_LINES = (b'S +', b'S -')  # of Mettler SICS: overload, underload

_NUMBER = rb'[+-]?(?:\d+%(mark)s?\d*|%(mark)s\d+)(?:[eE][+-]?\d+)?'
# Patterns, because float() and int() take more: '1_0', 'infinity', digits of other scripts.
_POINT, _COMMA = (_NUMBER % {b'mark': mark} for mark in (rb'\.', b','))
_NAMED = rb'([A-Za-z_]*[:=])?(%s)([A-Za-z]*)'  # 'Weight:' and '12.3g' written together
_split_columns = re.compile(rb'[ \t]*[,;][ \t]*|[ \t]+').split
# Where a comma is the decimal mark, it separates columns unless digits are on both sides.
_split_at_other_commas = re.compile(rb'[ \t]*(?:;|(?<!\d),|,(?!\d))[ \t]*|[ \t]+').split
_join_sign = re.compile(rb'(?<![^ \t,;])([+-]) +(?=[\d.,])').sub
_find_digit = re.compile(rb'\d').search
_find_letter = re.compile(rb'[A-Za-z%\x80-\xff]').search  # % is a unit, too
# A decimal comma, commas between thousands, or points between thousands and a decimal comma.
_match_comma_number = re.compile(
    _NAMED
    % (
        rb'[+-]?(?:\d*(?:,\d+)+(?:[eE][+-]?\d+)?'
        rb'|[1-9]\d{0,2}(?:,\d{3})+\.\d*'
        rb'|[1-9]\d{0,2}(?:\.\d{3})+,\d*)'
    )
).fullmatch

_FEW_COLUMNS = 'it has too few columns: check value_column and time_column'
_NO_TIME = 'its time_column holds no device time: check time_column and time_decimals'
_NO_NUMBER = 'its value_column holds no number: check value_column and decimal_mark'
_UNUSUAL = 'its columns or words are not those of the lines before: is it cut, or a banner?'
_AMBIGUOUS = (
    'its comma may be a decimal mark or separate columns: set decimal_mark to "," or "."; '
    'commas between thousands cannot be read'
)
_FAULT = 'the device reports an overload or an error: unload it, then see its manual'
_TOO_LONG = 'it is too long: check the baud'

_Shape = tuple[int, tuple[bytes, ...]]


def split_line(line: bytes, decimal_mark: str = 'auto') -> list[bytes]:
    """Return the columns of a line without its end."""
    line = line.strip(b' \t')
    if b'+ ' in line or b'- ' in line:
        line = _join_sign(rb'\1', line)
    return _split_at_other_commas(line) if decimal_mark == ',' else _split_columns(line)


def _is_word(column: bytes) -> bool:
    return column != SIMULATED and bool(_find_letter(column))


def describe_line(line: bytes) -> str:
    r"""Return a line as printable text; other bytes as ``\xff``."""
    return ''.join(chr(b) if 0x20 <= b < 0x7F else f'\\x{b:02x}' for b in line)


class LineDecoder:
    """Incremental decoder of load-cell lines. No IO, no clock.

    The first line after the start and after `reset` is dropped without being
    counted: its beginning may be missing.

    Parameters
    ----------
    config : TendonSensorConfig
        Says which columns hold the value and the time, the unit and the decimal mark.

    Attributes
    ----------
    bytes, lines, readings, rejected_lines : int
        Counters; see `tendon_sensor_driver.records.Health`.
    last_rejected : bytes
        The last rejected line, or the start of it.
    last_reason : str
        The reason of its rejection, and a remedy.
    last_byte : bytes
        The last byte since the start or `reset`, empty before the first.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._value_column = config.value_column
        self._time_column = config.time_column
        self._last_column = max(config.value_column, config.time_column)
        decimals = config.time_decimals
        self._is_auto = config.decimal_mark == 'auto'
        self._has_comma = config.decimal_mark == ','
        self._split = _split_at_other_commas if self._has_comma else _split_columns
        mark = b',' if self._has_comma else rb'\.'
        ticks = rb'\d{1,19}'
        if decimals:
            ticks = rb'\d{1,%d}%s\d{%d}' % (19 - decimals, mark, decimals)
        self._match_ticks = re.compile(ticks).fullmatch
        number = _COMMA if self._has_comma else _POINT
        self._match_number = re.compile(number).fullmatch
        self._match_named = re.compile(_NAMED % number).fullmatch
        self._unit = config.unit
        self._units = frozenset(_UNIT_NAMES[config.unit])
        self._other_units = frozenset(UNITS) - self._units - frozenset(_STATE_LETTERS)
        self.bytes = 0
        self.lines = 0
        self.readings = 0
        self.rejected_lines = 0
        self.last_rejected = b''
        self.last_reason = ''
        # Number of columns and words before the value in a line of this device; None: not
        # known yet. And in the line before, when they were others.
        self._shape: _Shape | None = None
        self._odd_shape: _Shape | None = None
        self.last_byte = b''
        self.reset()

    @property
    def unfinished(self) -> bytes:
        """The line that has not ended yet; at most `MAX_LINE_BYTES`."""
        return self._rest

    def reset(self) -> None:
        """Forget the unfinished line: the bytes that follow do not continue it."""
        self._rest = b''
        self._skip_line = True
        self._has_dropped = False
        self.last_byte = b''

    def feed(self, data: bytes, received_at_ns: int) -> list[Reading]:
        """Return the readings that ``data`` completes.

        Parameters
        ----------
        data : bytes
            The next bytes of the stream, any number of them.
        received_at_ns : int
            When they were received [ns].
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
            decoded = self._decode_line(line)
            if isinstance(decoded, str):
                self._reject(line, _FAULT if line in _FAULT_LINES else decoded)
                continue
            ticks, value, is_simulated = decoded
            readings.append(Reading(ticks, value, received_at_ns, self._has_dropped, is_simulated))
            self._has_dropped = False
        self.readings += len(readings)
        self.lines += len(readings)
        if self._skip_line:
            rest = b''
        elif len(rest) > MAX_LINE_BYTES:
            self._reject(rest, _TOO_LONG)
            self._skip_line = True
            rest = b''
        self._rest = rest
        return readings

    def _decode_line(self, line: bytes) -> tuple[int | None, float, bool] | str:
        """Return device time, value and whether it is simulated; or the reason of a refusal."""
        if b'+ ' in line or b'- ' in line:
            line = _join_sign(rb'\1', line)
        columns = self._split(line)
        if not _FAULTS.isdisjoint(columns):
            return _FAULT
        if len(columns) <= self._last_column:
            return _FEW_COLUMNS
        ticks = None
        if self._time_column >= 0:
            text = columns[self._time_column]
            if not self._match_ticks(text):
                return _NO_TIME
            ticks = int(text.replace(b',' if self._has_comma else b'.', b''))
        text = columns[self._value_column]
        words = [w for w in columns[: self._value_column] if w and not _find_digit(w)]
        unit = b''
        if not self._match_number(text):
            named = self._match_named(text)
            if not named:
                return _NO_NUMBER
            name, text, unit = named.groups()
            words += [name or b'', unit]
        after_value = self._value_column + 1
        after = b''
        if after_value < len(columns):
            after = columns[after_value]
            if self._is_auto and after[:1].isdigit() and self._is_ambiguous(line):
                return _AMBIGUOUS
        if unit:
            if unit not in self._units:
                return self._refuse_word(unit)
        elif after_value < len(columns) and after not in self._units:
            for column in columns[after_value:]:
                if self._match_number(column):
                    break  # the value of something else
                if column in self._other_units or (column is after and _is_word(after)):
                    return self._refuse_word(column)
        value = float(text.replace(b',', b'.') if self._has_comma else text)
        if not math.fabs(value) <= MAX_VALUE:
            return _NO_NUMBER
        shape = len(columns), tuple(words)
        if shape != self._shape:
            for word in words:
                if word.strip(b'[]():=') in self._other_units:
                    return self._refuse_word(word)
            shape = len(columns), tuple(b'' if word in _STABILITY else word for word in words)
        if not self._is_usual(shape):
            return _UNUSUAL
        return ticks, value, SIMULATED in columns

    def _refuse_word(self, word: bytes) -> str:
        word = word.strip(b'[]():=')
        if word in UNITS:
            return (
                f'its unit is {word.decode()}, and "unit" is {self._unit}: '
                f'set unit to {UNITS[word]}'
            )
        return (
            f'the word "{describe_line(word)}" after the value is no unit that is known here: let '
            f'the device send {self._unit}, or no word'
        )

    def _is_ambiguous(self, line: bytes) -> bool:
        """Tell whether the value would be another one, were a comma a decimal mark."""
        if b',' not in line:
            return False
        others = _split_at_other_commas(line)
        if len(others) <= self._last_column:
            return False
        return bool(_match_comma_number(others[self._value_column]))

    def _is_usual(self, shape: _Shape) -> bool:
        # A cut or melted line differs once, and so does a banner that looks like a reading;
        # a device that was set up anew differs for good.
        is_plain_start = self._shape is None and not shape[1]
        if shape == self._shape or shape == self._odd_shape or is_plain_start:
            self._shape = shape
            self._odd_shape = None
            return True
        self._odd_shape = shape
        return False

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
    r"""Return one line as an OpenScale writes it, such as ``b'1204,0.53000,kg,\r\n'``.

    Parameters
    ----------
    device_ticks : int or None
        Device time; None leaves the column out.
    value : float
        In ``unit``.
    unit : str
        That of the parameter; lbf is written ``lbs``.
    decimals : int
        Digits after the point.
    is_simulated : bool
        Add the column `SIMULATED`.

    Raises
    ------
    ValueError
        When ``value`` is not finite.
    """
    if not math.isfinite(value):
        raise ValueError(f'a reading must be a finite number, not {value}')
    time = '' if device_ticks is None else f'{device_ticks},'
    mark = f'{SIMULATED.decode()},' if is_simulated else ''
    name = _UNIT_NAMES[unit][0].decode()
    return f'{time}{value:.{decimals}f},{name},{mark}\r\n'.encode('ascii')
