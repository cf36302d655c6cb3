# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Load-cell lines in ASCII: bytes in any chunking to readings, and back.

A line holds columns separated by ``,``, ``;``, a tab or spaces, and ends in CR,
LF or both; separators may trail. Which columns count is configured; the others may
hold anything. This covers SparkFun's OpenScale and the usual HX711 sketches.

The format has no checksum: a digit that changes on the wire cannot be seen. What can
be seen is refused: a line that is cut, two lines that melted into one (the number of
columns changes), a unit that is not the configured one, a number that is no plain
finite decimal.
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
_match_ticks = re.compile(rb'\d{1,19}').fullmatch

_UNIT_NAMES = {
    'kg': (b'kg', b'Kg', b'KG'),
    'g': (b'g',),
    'N': (b'N',),
    'lbf': (b'lbs', b'lb', b'lbf'),
}


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
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._value_column = config.value_column
        self._time_column = config.time_column
        self._last_column = max(config.value_column, config.time_column)
        self._other_units = frozenset(
            name for unit, names in _UNIT_NAMES.items() if unit != config.unit for name in names
        )
        self.bytes = 0
        self.lines = 0
        self.readings = 0
        self.rejected_lines = 0
        self.last_rejected = b''
        self._columns = 0  # in a line of this device; 0: not known yet
        self._odd_columns = 0  # in the line before, when it had another number of them
        self.reset()

    def reset(self) -> None:
        """Forget the unfinished line: the bytes that follow do not continue it."""
        self._rest = b''
        self._skip_line = True
        self._has_dropped = False

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
            if not _match_ticks(text):
                return None
            ticks = int(text)
        text = columns[self._value_column]
        if not _match_number(text):
            return None
        value = float(text)
        if not math.fabs(value) <= MAX_VALUE:
            return None
        if not self._has_usual_shape(columns):
            return None
        return ticks, value

    def _has_usual_shape(self, columns: list[bytes]) -> bool:
        after_value = self._value_column + 1
        if after_value < len(columns) and columns[after_value] in self._other_units:
            return False
        count = len(columns)
        if count == self._columns:
            self._odd_columns = 0
            return True
        # A cut or melted line differs once; a device that was set up anew differs for good.
        if self._columns and count != self._odd_columns:
            self._odd_columns = count
            return False
        self._columns = count
        self._odd_columns = 0
        return True

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
