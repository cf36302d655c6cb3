# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reader of CSV and Parquet files with pyarrow, and conversion of trials to one long table.

The format of a text table is not guessed: options state it, and cells in another format are
errors.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence, Set
import csv
from dataclasses import dataclass, field
import json
from pathlib import Path
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray
import pyarrow
import pyarrow.csv
import pyarrow.parquet

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.files import decode_text
from tactile_analysis.sources.signals import join_columns
from tactile_bags.trial import Trial

MAX_TABLE_BYTES = 2**30
"""Largest file or table that is read [byte]."""

CHECKED_ROWS = 1000
"""Number of rows in which a text column is searched for numbers that were not recognised."""

METADATA_KEY = b'tactile'
"""Key of the metadata entry of a table in which `TrialSet.to_table` stores the rate, as JSON."""

UNIT, ROLE = b'unit', b'role'
"""Keys of the metadata entries of a column."""

_FIRST = ('trial', 'label', 'session_id', 'mounting_id')
"""Columns that come first in a long table, which has one row per sample."""

_UNITS_OF_ENDINGS = (('_mm_s', 'mm/s'), ('_m_s', 'm/s'))
"""Units of columns by the suffix of their names."""

_CODE_BYTES = 8
"""Largest size of a number in NumPy, or of a code in a dictionary-encoded column [byte]."""

_CODED = frozenset(('PLAIN', 'RLE', 'BIT_PACKED', 'PLAIN_DICTIONARY', 'RLE_DICTIONARY'))
"""Text encodings that pyarrow can read as dictionary codes."""

_CHARACTER_BYTES = np.dtype('U1').itemsize

_SEPARATORS = {'comma': ',', 'semicolon': ';', 'tab': '\t', 'space': ' '}
_NUMBERS = {
    mark: re.compile(rf'[+-]?(\d+([{mark}]\d*)?|[{mark}]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)', re.I)
    for mark in '.,'
}
_REMEDY = (
    'state the format of the text with --separator (comma, semicolon, tab, space), --decimal '
    '(. or ,) and --header-rows (lines above the numbers)'
)
_MISREAD = (
    (re.compile(r'[+-]?\d+,\d+([eE][+-]?\d+)?'), 'numbers with a decimal comma'),
    (re.compile(r'[+-]?\d+\.\d+([eE][+-]?\d+)?'), 'numbers with a decimal point'),
    (re.compile(r'(?=.*\d[;\t ])[-+.,;\t\d eE]+'), 'several numbers'),
)
"""Patterns of cells with numbers that were not recognised, each with a description."""


@dataclass(frozen=True)
class Table:
    """The columns of one file, each of shape (rows,), and their metadata from the file.

    In ``columns``, a missing number is NaN, and a missing string is empty. ``times`` names columns
    that are points in time, as integer nanoseconds. ``nested`` names columns that were not read
    because they contain lists or structures. ``values`` names columns that the file declares as
    the signal. ``units`` maps names of columns to units.
    """

    path: Path
    columns: dict[str, NDArray[Any]]
    times: frozenset[str] = field(default_factory=frozenset)
    nested: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    values: tuple[str, ...] = ()
    rate_hz: float | None = None

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def read_table(path: Path, options: SourceOptions = SourceOptions()) -> Table:  # noqa: B008
    """Read a CSV or Parquet file.

    Raises `SourceError` for a file that is damaged, too large, or not a table of the stated
    format.
    """
    nested: tuple[str, ...] = ()
    if path.stat().st_size > MAX_TABLE_BYTES:
        raise SourceError(f'{path} is larger than {MAX_TABLE_BYTES >> 20} MiB; divide it')
    try:
        if path.suffix.lower() == '.parquet':
            found, nested = _read_parquet(path)
        else:
            found = _read_text(path, options)
    except (pyarrow.ArrowException, OSError, UnicodeError, csv.Error) as error:
        sentence = str(error).partition('\n')[0]
        raise SourceError(f'{path} cannot be read as a table: {sentence}') from error
    if len(set(found.column_names)) < len(found.column_names):
        ((name, _),) = Counter(found.column_names).most_common(1)
        raise SourceError(f'{path} has several columns named {name}')
    if not found.num_rows or not found.num_columns:
        raise SourceError(f'{path} has no rows')
    times = {f.name for f in found.schema if pyarrow.types.is_timestamp(f.type)}
    columns = {n: _to_numpy(path, n, found[n]) for n in found.column_names}
    stated = {f.name: f.metadata or {} for f in found.schema}
    rate_hz = _stated_rate_hz(found.schema.metadata)
    units = {n: m[UNIT].decode(errors='replace') for n, m in stated.items() if UNIT in m}
    values = tuple(n for n, metadata in stated.items() if metadata.get(ROLE) == b'value')
    return Table(path, columns, frozenset(times), nested, units, values, rate_hz)


def _stated_rate_hz(metadata: Any) -> float | None:
    """Return the sample rate in the metadata of a table from `TrialSet.to_table`, or None."""
    try:
        rate_hz = float(json.loads((metadata or {}).get(METADATA_KEY, b'{}'))['rate_hz'])
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None
    return rate_hz if 0.0 < rate_hz < float('inf') else None


def _read_parquet(path: Path) -> tuple[pyarrow.Table, tuple[str, ...]]:
    """Return the columns with one value per row, and the names of the other columns.

    Run-length and dictionary encoding compress without limit, so a small file can need any amount
    of memory. The amount is therefore computed from the file's metadata before the data are read.
    """
    with pyarrow.parquet.ParquetFile(path) as file:
        kinds = {f.name: _value_type(f.type) for f in file.schema_arrow}
        flat = {name: kind for name, kind in kinds.items() if not pyarrow.types.is_nested(kind)}
        if not flat:
            raise SourceError(f'{path} has lists in every column; write one row per sample')
        # Texts that are read as dictionary codes need no more memory than in the file.
        as_codes = {name for name, kind in flat.items() if _is_text(kind)}
        chunks = [c for c in _column_chunks(file.metadata) if c.path_in_schema in flat]
        as_codes -= {c.path_in_schema for c in chunks if not _CODED.issuperset(c.encodings)}
        size = sum(_decoded_bytes(chunk, flat[chunk.path_in_schema], as_codes) for chunk in chunks)
    if size > MAX_TABLE_BYTES:
        raise SourceError(f'{path} unpacks to up to {size >> 20} MiB; divide it')
    with pyarrow.parquet.ParquetFile(path, read_dictionary=sorted(as_codes)) as file:
        found = file.read(columns=list(flat), use_threads=False)
    return found, tuple(name for name in kinds if name not in flat)


def _column_chunks(metadata: Any) -> Iterator[Any]:
    """Yield the metadata of each column chunk of a Parquet file."""
    for i in range(metadata.num_row_groups):
        group = metadata.row_group(i)
        yield from map(group.column, range(group.num_columns))


def _decoded_bytes(chunk: Any, kind: Any, as_codes: Set[str]) -> int:
    """Return the largest amount of memory that a column chunk can need after decoding [byte]."""
    packed, count = chunk.total_uncompressed_size, chunk.num_values
    if chunk.path_in_schema in as_codes or pyarrow.types.is_null(kind):
        return int(packed + count * _CODE_BYTES)
    if _is_text(kind):
        # Delta encoding stores only the difference between a text and the previous text.
        return int(packed * count + count * _CODE_BYTES)
    return int(packed + count * max(_CODE_BYTES, kind.bit_width // 8))


def _value_type(kind: Any) -> Any:
    return kind.value_type if pyarrow.types.is_dictionary(kind) else kind


def _is_text(kind: Any) -> bool:
    return _is_any(kind, 'string', 'large_string', 'binary', 'large_binary')


def _is_any(kind: Any, *names: str) -> bool:
    return any(getattr(pyarrow.types, f'is_{name}')(kind) for name in names)


def _read_text(path: Path, options: SourceOptions) -> pyarrow.Table:
    lines = decode_text(path.read_bytes()).splitlines(keepends=True)
    separator, decimal = _read_form(path, options)
    count = 1 if options.header_rows is None else options.header_rows
    names = _read_names(path, lines, separator, decimal, count)
    _check_quotes(path, lines[count:], separator)
    try:
        found = pyarrow.csv.read_csv(
            pyarrow.BufferReader(''.join(lines[count:]).encode()),
            read_options=pyarrow.csv.ReadOptions(column_names=names, use_threads=False),
            parse_options=pyarrow.csv.ParseOptions(delimiter=separator),
            convert_options=pyarrow.csv.ConvertOptions(
                decimal_point=decimal, strings_can_be_null=False
            ),
        )
    except pyarrow.ArrowException as error:
        sentence = str(error).partition('\n')[0]
        raise SourceError(f'{path} cannot be read as a table: {sentence}; {_REMEDY}') from error
    for name in found.column_names:
        _check_cells(path, name, found[name])
    return found


def _check_quotes(path: Path, lines: Sequence[str], separator: str) -> None:
    """Refuse text after a closing quotation mark, because pyarrow would read ``"1"5`` as 15."""
    if not any('"' in line for line in lines):
        return
    reader = csv.reader(lines, delimiter=separator, strict=True)
    try:
        for _ in reader:
            pass
    except csv.Error as error:
        raise SourceError(f'{path}: line {reader.line_num} of its data: {error}') from error


def _check_cells(path: Path, name: str, column: Any) -> None:
    """Refuse a text column if all cells contain numbers in another format than stated."""
    if not _is_text(column.type):
        return
    cells = [cell.strip() for cell in column.slice(0, CHECKED_ROWS).to_pylist() if cell.strip()]
    for pattern, found in _MISREAD if cells else ():
        if all(pattern.fullmatch(cell) for cell in cells):
            raise SourceError(
                f'{path}: column "{name}" contains {found}, as in "{cells[0][:40]}"; {_REMEDY}'
            )


def _read_form(path: Path, options: SourceOptions) -> tuple[str, str]:
    """Return the separator and the decimal mark that the options state, or the defaults."""
    usual = '\t' if path.suffix.lower() == '.tsv' else ','
    separator = _SEPARATORS.get(options.separator, options.separator) or usual
    decimal = options.decimal or '.'
    if len(separator) != 1 or decimal not in ('.', ',') or decimal == separator:
        raise SourceError(
            f'--separator "{options.separator}" and --decimal "{decimal}" cannot be combined: '
            f'a separator is one character or one of {", ".join(_SEPARATORS)}, a decimal mark is '
            '. or , and must differ from the separator'
        )
    return separator, decimal


def _read_names(
    path: Path, lines: Sequence[str], separator: str, decimal: str, count: int
) -> list[str]:
    """Return the column names in line ``count``; if it is 0, ``column 1``, ``column 2``, ..."""
    if not count:
        first = next((line for line in lines if line.strip()), '')
        width = len(next(csv.reader([first], delimiter=separator), []))
        return [f'column {i + 1}' for i in range(width)]
    last = (line.lstrip('#% ') for line in lines[count - 1 : count])
    names = [cell.strip() for cell in next(csv.reader(last, delimiter=separator), [])]
    if not any(names):
        raise SourceError(f'{path}: line {count} has no column names; {_REMEDY}')
    if all(_NUMBERS[decimal].fullmatch(name) for name in names):
        raise SourceError(
            f'{path}: line {count} contains numbers instead of column names; {_REMEDY}'
        )
    return names


def _to_numpy(path: Path, name: str, column: Any) -> NDArray[Any]:
    """Return a column as numbers, booleans or strings."""
    kind = column.type
    if pyarrow.types.is_dictionary(kind) and not _is_text(kind.value_type):
        column = column.cast(kind.value_type)
        kind = column.type
    if pyarrow.types.is_timestamp(kind):
        column = column.cast(pyarrow.timestamp('ns'), safe=False).cast(pyarrow.int64())
    elif _is_any(kind, 'decimal', 'duration', 'float16'):
        column = column.cast(pyarrow.float64(), safe=False)
    elif pyarrow.types.is_boolean(kind) and column.null_count:
        column = column.cast(pyarrow.string())
    if pyarrow.types.is_dictionary(column.type) or _is_text(column.type):
        return _texts_to_numpy(path, name, column)
    values = column.to_numpy()
    if values.dtype.kind in 'fiub':
        return np.asarray(values)
    return np.array(['' if value is None else str(value) for value in values.tolist()], dtype=str)


def _texts_to_numpy(path: Path, name: str, column: Any) -> NDArray[Any]:
    """Return a column of texts as an array.

    Raises SourceError if the array is too large: each text needs as much memory as the longest.
    """
    if not pyarrow.types.is_dictionary(column.type):
        column = column.dictionary_encode()
    codes = column.unify_dictionaries().combine_chunks()
    codes = codes.chunk(0) if isinstance(codes, pyarrow.ChunkedArray) else codes
    known = ['' if value is None else str(value) for value in codes.dictionary.to_pylist()]
    longest = max(map(len, known), default=0)
    if longest * len(codes) * _CHARACTER_BYTES > MAX_TABLE_BYTES:
        raise SourceError(
            f'{path}: column {name} has a text of {longest} characters, which needs too much '
            f'memory for {len(codes)} rows; remove the column'
        )
    rows = codes.indices.fill_null(len(known)).to_numpy()
    return np.asarray(np.array([*known, ''])[rows])


def build_long_table(trials: Sequence[tuple[Trial, str]], rate_hz: float | None) -> pyarrow.Table:
    """Return a long table of pairs of a trial and its name; see `TrialSet.to_table`."""
    if not trials:
        raise SourceError('no trial is included, so there is nothing to write')
    signals = [trial.signal for trial, _ in trials]
    channels = {signal.channels for signal in signals}
    if len(channels) > 1:
        raise SourceError(f'the trials have different channels: {sorted(channels)[:2]}')
    if any(signal.time_s is None for signal in signals):
        raise SourceError('the recordings have no times, so the sample rate is unknown: --rate-hz')
    counts = [signal.values.shape[1] for signal in signals]
    known = join_columns(trials)
    names = [*(n for n in _FIRST if n in known), *(n for n in known if n not in _FIRST)]
    of_trial = [n for n in names if n in _FIRST]
    others = [n for n in names if n not in _FIRST]
    fields: list[pyarrow.Field] = []
    columns: list[Any] = []

    def add(name: str, column: Any, metadata: dict[bytes, bytes] | None = None) -> None:
        fields.append(pyarrow.field(name, column.type, metadata=metadata))
        columns.append(column)

    def repeat(name: str) -> Any:
        column = pyarrow.array(known[name].tolist()).dictionary_encode()
        rows = np.repeat(np.arange(len(trials)), counts)
        if not pyarrow.types.is_string(column.type.value_type):
            return column.dictionary_decode().take(pyarrow.array(rows))
        return pyarrow.DictionaryArray.from_arrays(
            column.indices.take(pyarrow.array(rows)), column.dictionary
        )

    for name in of_trial:
        add(name, repeat(name))
    add('time_s', pyarrow.array(np.concatenate([s.time_s for s in signals])), {UNIT: b's'})
    for i, channel in enumerate(signals[0].channels):
        name = f'{channel}_signal' if channel in (*known, 'time_s') else channel
        unit = signals[0].unit
        values = np.concatenate([signal.values[i] for signal in signals])
        stated = {ROLE: b'value', **({UNIT: unit.encode()} if unit else {})}
        add(name, pyarrow.array(values), stated)
    for name in others:
        unit = next((unit for end, unit in _UNITS_OF_ENDINGS if name.endswith(end)), '')
        add(name, repeat(name), {UNIT: unit.encode()} if unit else None)
    stated_rate = {} if rate_hz is None else {'rate_hz': rate_hz}
    metadata = {METADATA_KEY: json.dumps(stated_rate).encode()}
    return pyarrow.table(columns, schema=pyarrow.schema(fields, metadata=metadata))
