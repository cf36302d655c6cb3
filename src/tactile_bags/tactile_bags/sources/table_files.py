# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables by pyarrow: columns of CSV, Parquet and LabVIEW files; trials as one long table.

The form of a text is stated, never guessed; cells that do not fit it are an error.
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

from tactile_bags.sources.files import decode_text, SourceError, SourceOptions
from tactile_bags.sources.raw_trials import join_columns
from tactile_bags.trial import Trial

MAX_TABLE_BYTES = 2**30
"""Largest file or table that is read [byte]."""

CHECKED_ROWS = 1000
"""Rows of a column of texts that are searched for numbers of another form."""

SEARCHED_LINES = 60
"""Lines of a text that are searched for its likely form, for the sentence of an error."""

METADATA_KEY = b'tactile'
"""Entry of a table's metadata that holds what `Recording.to_table` states, as JSON."""

UNIT, ROLE = b'unit', b'role'
"""Entries of the metadata of a column."""

_FIRST = ('trial', 'label', 'session_id', 'mounting_id')
"""First columns of a long table."""

_UNITS_OF_ENDINGS = (('_mm_s', 'mm/s'), ('_m_s', 'm/s'))
"""Units of columns by how their names end."""

_CODE_BYTES = 8
"""Of a number in NumPy, or of a code into a dictionary, at most [byte]."""

_CODED = frozenset(('PLAIN', 'RLE', 'BIT_PACKED', 'PLAIN_DICTIONARY', 'RLE_DICTIONARY'))
"""Encodings of texts that pyarrow can read as codes into a dictionary."""

_CHARACTER_BYTES = np.dtype('U1').itemsize

_SEPARATORS = {'comma': ',', 'semicolon': ';', 'tab': '\t', 'space': ' '}
_NUMBERS = {
    mark: re.compile(rf'[+-]?(\d+([{mark}]\d*)?|[{mark}]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)', re.I)
    for mark in '.,'
}
_UNITS = frozenset((
    '', 's', 'ms', 'us', 'µs', 'μs', 'ns', 'min', 'Hz', 'N', 'mN', 'kN', 'g', 'kg', 'V', 'mV',
    'µV', 'A', 'mA', 'm', 'mm', 'µm', 'deg', 'rad', '°', '°C', 'C', 'K', '%', 'Pa', 'kPa', 'MPa',
    'bar', 'Nm', 'mNm', 'mm/s', 'm/s', 'counts', 'raw', '1', '-', 'n/a',
))  # fmt: skip
_REMEDY = (
    'state the form of the text with --separator (comma, semicolon, tab, space), --decimal (. or '
    ',) and --header-rows (lines above the numbers)'
)
_MISREAD = (
    (re.compile(r'[+-]?\d+,\d+([eE][+-]?\d+)?'), 'numbers with a decimal comma'),
    (re.compile(r'[+-]?\d+\.\d+([eE][+-]?\d+)?'), 'numbers with a decimal point'),
    (re.compile(r'(?=.*\d[;\t ])[-+.,;\t\d eE]+'), 'several numbers'),
)
"""Texts that are numbers of another form, and what they are."""

_END_OF_HEADER = '***End_of_Header***'


@dataclass(frozen=True)
class TextForm:
    """The form of a text table, and the sample rate that it states [Hz].

    ``names`` are ``column 1`` and so on where none stand in the text. ``first_line`` is the first
    of the data, from 0.
    """

    separator: str
    decimal: str
    names: tuple[str, ...]
    first_line: int
    is_labview: bool = False
    rate_hz: float | None = None


@dataclass(frozen=True)
class Table:
    """The columns of one file, each of shape (rows,), and what it states of them.

    In ``columns``, a missing number is not a number, and a missing string empty. ``times`` names
    those that are points in time, as integer nanoseconds, ``nested`` those that were not read
    because they hold lists or structures, ``values`` those that the file states to be the signal.
    ``units`` are by column.
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
    """Read a CSV, LabVIEW or Parquet file.

    One that is no table of the stated form, too large or damaged is a `SourceError`.
    """
    nested: tuple[str, ...] = ()
    if path.stat().st_size > MAX_TABLE_BYTES:
        raise SourceError(f'{path} is larger than {MAX_TABLE_BYTES >> 20} MiB; divide it')
    form: TextForm | None = None
    try:
        if path.suffix.lower() == '.parquet':
            found, nested = _read_parquet(path)
        else:
            found, form = _read_text(path, options)
    except (pyarrow.ArrowException, OSError, UnicodeError, csv.Error) as error:
        sentence = str(error).partition('\n')[0]
        raise SourceError(f'{path} cannot be read as a table: {sentence}') from error
    if len(set(found.column_names)) < len(found.column_names):
        ((name, _),) = Counter(found.column_names).most_common(1)
        raise SourceError(f'{path} has several columns of one name: {name}')
    if not found.num_rows or not found.num_columns:
        raise SourceError(f'{path} has no rows')
    times = {f.name for f in found.schema if pyarrow.types.is_timestamp(f.type)}
    columns = {n: _to_numpy(path, n, found[n]) for n in found.column_names}
    stated = {f.name: f.metadata or {} for f in found.schema}
    rate_hz = form.rate_hz if form else _stated_rate_hz(found.schema.metadata)
    units = {n: m[UNIT].decode(errors='replace') for n, m in stated.items() if UNIT in m}
    values = tuple(n for n, metadata in stated.items() if metadata.get(ROLE) == b'value')
    return Table(path, columns, frozenset(times), nested, units, values, rate_hz)


def _stated_rate_hz(metadata: Any) -> float | None:
    """Return the sample rate in the metadata of a table that `Recording.to_table` made."""
    try:
        rate_hz = float(json.loads((metadata or {}).get(METADATA_KEY, b'{}'))['rate_hz'])
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None
    return rate_hz if 0.0 < rate_hz < float('inf') else None


def _read_parquet(path: Path) -> tuple[pyarrow.Table, tuple[str, ...]]:
    """Return the columns of one value a row, and the names of the others.

    What they take in memory is known from the file's metadata, before anything is read. Runs and
    codes of a dictionary pack values without limit, so the packed size says nothing.
    """
    with pyarrow.parquet.ParquetFile(path) as file:
        kinds = {f.name: _value_type(f.type) for f in file.schema_arrow}
        flat = {name: kind for name, kind in kinds.items() if not pyarrow.types.is_nested(kind)}
        if not flat:
            raise SourceError(f'{path} has lists in every column; write a row for each sample')
        # Read as codes into a dictionary, a text takes no more than it does in the file.
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
    """Yield the metadata of each part of each column."""
    for i in range(metadata.num_row_groups):
        group = metadata.row_group(i)
        yield from map(group.column, range(group.num_columns))


def _decoded_bytes(chunk: Any, kind: Any, as_codes: Set[str]) -> int:
    """Return what a part of a column takes in memory at most [byte]."""
    packed, count = chunk.total_uncompressed_size, chunk.num_values
    if chunk.path_in_schema in as_codes or pyarrow.types.is_null(kind):
        return int(packed + count * _CODE_BYTES)
    if _is_text(kind):  # in an encoding in which a text may repeat the one before
        return int(packed * count + count * _CODE_BYTES)
    return int(packed + count * max(_CODE_BYTES, kind.bit_width // 8))


def _value_type(kind: Any) -> Any:
    return kind.value_type if pyarrow.types.is_dictionary(kind) else kind


def _is_text(kind: Any) -> bool:
    return _is_any(kind, 'string', 'large_string', 'binary', 'large_binary')


def _is_any(kind: Any, *names: str) -> bool:
    return any(getattr(pyarrow.types, f'is_{name}')(kind) for name in names)


def _read_text(path: Path, options: SourceOptions) -> tuple[pyarrow.Table, TextForm]:
    text = decode_text(path.read_bytes())
    lines = text.splitlines(keepends=True)
    form = options.header_rows is None and find_labview_form(path, lines)
    form = form or _stated_form(path, lines, options)
    rows = lines[form.first_line :]
    if form.is_labview:  # a remark may follow the numbers
        cells = (line.rstrip('\r\n').split(form.separator) for line in rows if line.strip())
        rows = [form.separator.join(row[: len(form.names)]) + '\n' for row in cells]
    try:
        found = pyarrow.csv.read_csv(
            pyarrow.BufferReader(''.join(rows).encode()),
            read_options=pyarrow.csv.ReadOptions(column_names=list(form.names), use_threads=False),
            parse_options=pyarrow.csv.ParseOptions(delimiter=form.separator),
            convert_options=pyarrow.csv.ConvertOptions(
                decimal_point=form.decimal, strings_can_be_null=False
            ),
        )
    except pyarrow.ArrowException as error:
        sentence = str(error).partition('\n')[0]
        raise SourceError(
            f'{path} cannot be read as a table: {sentence}; {_remedy(lines)}'
        ) from error
    if form.is_labview:  # an empty column of times
        empty = [f.name for f in found.schema if pyarrow.types.is_null(f.type)]
        found = found.drop_columns(empty)
    for name in found.column_names:
        _check_cells(path, name, found[name], _remedy(lines))
    return found, form


def _remedy(lines: Sequence[str]) -> str:
    """Return the options that state a form, and the one that the first lines suggest."""
    best: tuple[int, int, str] = (0, 0, '')
    for name, separator in _SEPARATORS.items():
        for decimal in '.,':
            rows = [
                [cell.strip() for cell in line.strip().split(separator)]
                for line in lines[:SEARCHED_LINES]
            ]
            numbers = [
                len(row) if all(map(_NUMBERS[decimal].fullmatch, row)) else 0 for row in rows
            ]
            width = max(numbers, default=0)
            count = numbers.count(width)
            if decimal != separator and width > 1 and (count, width) > best[:2]:
                above = numbers.index(width)
                text = f'--separator {name} --decimal {decimal} --header-rows {above}'
                best = (count, width, text)
    return _REMEDY + (f'; likely is {best[2]}' if best[2] else '')


def _check_cells(path: Path, name: str, column: Any, remedy: str) -> None:
    """Refuse a column of texts of which each is a number, or several, of another form."""
    if not _is_text(column.type):
        return
    cells = [cell.strip() for cell in column.slice(0, CHECKED_ROWS).to_pylist() if cell.strip()]
    for pattern, found in _MISREAD if cells else ():
        if all(pattern.fullmatch(cell) for cell in cells):
            raise SourceError(
                f'{path}: column "{name}" holds {found}, as in "{cells[0][:40]}"; {remedy}'
            )


def _stated_form(path: Path, lines: Sequence[str], options: SourceOptions) -> TextForm:
    """Return the form that the options state, with the names that stand in the text."""
    usual = '\t' if path.suffix.lower() == '.tsv' else ','
    separator = _SEPARATORS.get(options.separator, options.separator) or usual
    decimal = options.decimal or '.'
    if len(separator) != 1 or decimal not in ('.', ',') or decimal == separator:
        raise SourceError(
            f'--separator "{options.separator}" and --decimal "{decimal}" do not go together: '
            f'a separator is one character or one of {", ".join(_SEPARATORS)}, a decimal mark is '
            '. or , and another than the separator'
        )
    count = 1 if options.header_rows is None else options.header_rows
    above = [
        [cell.strip() for cell in row]
        for row in csv.reader((line.lstrip('#% ') for line in lines[:count]), delimiter=separator)
    ]
    above = [row for row in above if any(row)]
    if not count:
        first = next((line for line in lines if line.strip()), '')
        width = len(next(csv.reader([first], delimiter=separator), []))
        names = tuple(f'column {i + 1}' for i in range(width))
        return TextForm(separator, decimal, names, 0)
    if not above:
        raise SourceError(
            f'{path}: there are no names of columns in its first line; {_remedy(lines)}'
        )
    row = above[-1]
    if len(above) > 1 and len(above[-2]) == len(row) and _UNITS.issuperset(_strip(row)):
        row = [
            f'{name} [{unit}]' if unit else name
            for name, unit in zip(above[-2], _strip(row), strict=True)
        ]
    number = _NUMBERS[decimal]
    if all(number.fullmatch(cell) for cell in row):
        raise SourceError(
            f'{path}: line {count} holds numbers, and should hold the names of the columns; '
            f'{_remedy(lines)}'
        )
    return TextForm(separator, decimal, tuple(row), count)


def _strip(units: Sequence[str]) -> list[str]:
    return [unit.strip('[]()') for unit in units]


def find_labview_form(path: Path, lines: Sequence[str]) -> TextForm | None:
    """Return the form that the header of a LabVIEW measurement file states; None: it has none.

    Source: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)".
    """
    ends = [i for i, line in enumerate(lines) if line.strip() == _END_OF_HEADER]
    if not ends:
        return None
    if not lines[0].startswith('LabVIEW Measurement') or len(ends) > 2:
        problem = (
            f'it has {len(ends) - 1} segments; save each in a file of its own'
            if len(ends) > 2
            else f'it has {_END_OF_HEADER} and does not begin as a LabVIEW measurement; {_REMEDY}'
        )
        raise SourceError(f'{path}: {problem}')
    tab = '\t' if '\t' in ''.join(lines[: ends[0]]) else ','
    tags = {}
    for line in lines[: ends[-1]]:
        tag, _, value = line.strip('\r\n').partition(tab)
        tags[tag.strip()] = value
    separator = ',' if tags.get('Separator', '').strip().lower() == 'comma' else '\t'
    # A comma between columns leaves a point alone for numbers; version 1 has no such tag.
    decimal = tags.get('Decimal_Separator', '').strip(' \t') or '.'
    decimal = '.' if separator == ',' else decimal
    if tags.get('X_Dimension', 'Time').split(tab)[0].strip() not in ('Time', ''):
        raise SourceError(f'{path}: its X_Dimension is {tags["X_Dimension"]}, not Time')
    at = ends[-1] + 1
    cells = lines[at].strip('\r\n').split(separator) if at < len(lines) else []
    row = [cell.strip() for cell in cells]
    row = row[: row.index('Comment')] if 'Comment' in row else row
    if not any(row) or _NUMBERS[decimal].fullmatch(row[0]):
        raise SourceError(f'{path}: below {_END_OF_HEADER} there are no names; {_REMEDY}')
    units = [unit.strip() for unit in tags.get('Y_Unit_Label', '').split(separator)]
    names: list[str] = []
    for cell in row:
        name, channel = cell or 'unnamed', sum(name != 'time_s' for name in names)
        if cell == 'X_Value':
            name = 'time_s'
        elif channel < len(units) and units[channel]:
            name = f'{name} [{units[channel]}]'
        if name == 'time_s' and name in names:
            raise SourceError(
                f'{path}: each channel has times of its own (X_Columns Multi); save it with one '
                'column of times'
            )
        again = sum(other.partition(' #')[0] == name for other in names)
        names.append(f'{name} #{again + 1}' if again else name)
    steps = [float(t.replace(',', '.')) for t in tags.get('Delta_X', '').split() if t]
    period_s = steps[0] if steps and tags.get('X_Columns', '').strip() == 'No' else 0.0
    rate_hz = 1.0 / period_s if period_s > 0.0 else None
    return TextForm(separator, decimal, tuple(names), at + 1, is_labview=True, rate_hz=rate_hz)


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
    """Return a column of texts; NumPy makes each as wide as the longest."""
    if not pyarrow.types.is_dictionary(column.type):
        column = column.dictionary_encode()
    codes = column.unify_dictionaries().combine_chunks()
    codes = codes.chunk(0) if isinstance(codes, pyarrow.ChunkedArray) else codes
    known = ['' if value is None else str(value) for value in codes.dictionary.to_pylist()]
    longest = max(map(len, known), default=0)
    if longest * len(codes) * _CHARACTER_BYTES > MAX_TABLE_BYTES:
        raise SourceError(
            f'{path}: column {name} has a text of {longest} characters, and {len(codes)} rows as '
            'wide as that are too large; leave the column out'
        )
    rows = codes.indices.fill_null(len(known)).to_numpy()
    return np.asarray(np.array([*known, ''])[rows])


def build_long_table(trials: Sequence[tuple[Trial, str]], rate_hz: float | None) -> pyarrow.Table:
    """Return the table of some trials, each with its name; see `Recording.to_table`."""
    if not trials:
        raise SourceError('no trial counts, so there is nothing to write')
    signals = [trial.signal for trial, _ in trials]
    channels = {signal.channels for signal in signals}
    if len(channels) > 1:
        raise SourceError(f'the trials have different channels: {sorted(channels)[:2]}')
    if any(signal.time_s is None for signal in signals):
        raise SourceError(
            'the recordings have no times, so the sample rate is not known: --rate-hz'
        )
    counts = [signal.values.shape[1] for signal in signals]
    known = join_columns([({**t.columns, 'label': t.label}, name) for t, name in trials])
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
