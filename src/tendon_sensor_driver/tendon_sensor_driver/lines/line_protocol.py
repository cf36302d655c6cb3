# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Load-cell lines in ASCII: bytes in any chunking to readings, and back.

A line holds columns separated by ``,``, ``;``, a tab or spaces, and ends in CR,
LF or both; separators may trail. Which columns count is configured; the others may
hold anything. The value may carry a name before it and a unit behind it, with or without a
space: ``Weight:12.3g``. This covers SparkFun's OpenScale and the usual HX711 sketches.

The format has no checksum: a digit that changes on the wire cannot be seen. What can
be seen is refused: a line that is cut, two lines that melted into one (the number of
columns changes), a unit that is not the configured one, a number that is no plain
finite decimal, a line whose words before the value are not the usual ones (a banner).
"""

from __future__ import annotations

import math
import re

from tendon_sensor_driver.records import Reading, TendonSensorConfig

MAX_LINE_BYTES = 256
"""A longer line is dropped: no load cell sends one, and the memory stays bounded."""

MAX_VALUE = 1e15
"""A larger value is refused: no load cell counts that far, and no later product overflows."""

_split_columns = re.compile(rb'[ \t]*[,;][ \t]*|[ \t]+').split
# Patterns, because float() and int() take more: '1_0', 'infinity', digits of other scripts.
_match_number = re.compile(rb'[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?').fullmatch
_find_digit = re.compile(rb'\d').search
# 'Weight:' and '12.3g' written together.
_match_named = re.compile(
    rb'([A-Za-z_]*[:=])?([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)([A-Za-z]*)'
).fullmatch

_UNIT_NAMES = {
    'kg': (b'kg', b'Kg', b'KG'),
    'g': (b'g',),
    'N': (b'N',),
    'lbf': (b'lbs', b'lb', b'lbf'),
}

_Shape = tuple[int, tuple[bytes, ...]]


class LineDecoder:
    """Incremental decoder of load-cell lines. No IO, no clock.

    The first line after the start and after `reset` is dropped without being
    counted: its beginning may be missing.

    Parameters
    ----------
    config : TendonSensorConfig
        Says which columns hold the value and the time, and the unit.

    Attributes
    ----------
    bytes, lines, readings, rejected_lines : int
        Counters; see `tendon_sensor_driver.records.Health`.
    last_rejected : bytes
        The last rejected line, or the start of it.
    last_byte : bytes
        The last byte since the start or `reset`, empty before the first.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._value_column = config.value_column
        self._time_column = config.time_column
        self._last_column = max(config.value_column, config.time_column)
        decimals = config.time_decimals
        ticks = rb'\d{1,19}' if not decimals else rb'\d{1,%d}\.\d{%d}' % (19 - decimals, decimals)
        self._match_ticks = re.compile(ticks).fullmatch
        self._units = frozenset(_UNIT_NAMES[config.unit])
        self._other_units = frozenset(
            name for unit, names in _UNIT_NAMES.items() if unit != config.unit for name in names
        )
        self.bytes = 0
        self.lines = 0
        self.readings = 0
        self.rejected_lines = 0
        self.last_rejected = b''
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
                self._reject(line)
                continue
            line = line.strip(b' \t')
            if not line:
                continue
            decoded = self._decode_line(line)
            if decoded is None:
                self._reject(line)
                continue
            ticks, value = decoded
            readings.append(Reading(ticks, value, received_at_ns, self._has_dropped))
            self._has_dropped = False
        self.readings += len(readings)
        self.lines += len(readings)
        if self._skip_line:
            rest = b''
        elif len(rest) > MAX_LINE_BYTES:
            self._reject(rest)
            self._skip_line = True
            rest = b''
        self._rest = rest
        return readings

    def _decode_line(self, line: bytes) -> tuple[int | None, float] | None:
        columns = _split_columns(line)
        if len(columns) <= self._last_column:
            return None
        ticks = None
        if self._time_column >= 0:
            text = columns[self._time_column]
            if not self._match_ticks(text):
                return None
            ticks = int(text.replace(b'.', b''))
        text = columns[self._value_column]
        words = tuple(
            word for word in columns[: self._value_column] if word and not _find_digit(word)
        )
        if not _match_number(text):
            named = _match_named(text)
            if not named or (named[3] and named[3] not in self._units):
                return None
            words += (named[1] or b'', named[3])
            text = named[2]
        value = float(text)
        if not math.fabs(value) <= MAX_VALUE:
            return None
        after_value = self._value_column + 1
        if after_value < len(columns) and columns[after_value] in self._other_units:
            return None
        if not self._is_usual((len(columns), words)):
            return None
        return ticks, value

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

    def _reject(self, line: bytes) -> None:
        self.lines += 1
        self.rejected_lines += 1
        self.last_rejected = line[:80]
        self._has_dropped = True


def encode_reading(
    device_ticks: int | None, value: float, unit: str = 'kg', decimals: int = 5
) -> bytes:
    r"""Return one line as an OpenScale writes it, such as ``b'1204,0.53000,kg,\r\n'``.

    Parameters
    ----------
    device_ticks : int or None
        Device time; None leaves the column out.
    value : float
        In ``unit``.
    unit : str
        kg, g, N or lbf (written ``lbs``).
    decimals : int
        Digits after the point.

    Raises
    ------
    ValueError
        When ``value`` is not finite.
    """
    if not math.isfinite(value):
        raise ValueError(f'a reading must be a finite number, not {value}')
    time = '' if device_ticks is None else f'{device_ticks},'
    return f'{time}{value:.{decimals}f},{_UNIT_NAMES[unit][0].decode()},\r\n'.encode('ascii')
