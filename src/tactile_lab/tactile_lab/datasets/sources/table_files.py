# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads CSV and Parquet files as columns, by pyarrow."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Set
import csv
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_lab.datasets.sources.questions import LAYOUT, SourceError
from tactile_lab.datasets.sources.text_dialect import find_dialect

MAX_TABLE_BYTES = 2**30
"""Largest file or table that is read [byte]."""

_CODE_BYTES = 8
"""Of a number in NumPy, or of a code into a dictionary, at most [byte]."""

_CODED = frozenset(('PLAIN', 'RLE', 'BIT_PACKED', 'PLAIN_DICTIONARY', 'RLE_DICTIONARY'))
"""Encodings of texts that pyarrow can read as codes into a dictionary."""

_CHARACTER_BYTES = np.dtype('U1').itemsize


@dataclass(frozen=True)
class Table:
    """The columns of one file.

    Attributes
    ----------
    columns : dict of str to ndarray of shape (rows,)
        Numbers, booleans or strings; a missing number is not a number, a missing string empty.
    times : frozenset of str
        Columns of points in time, as integer nanoseconds.
    is_named : bool
        Whether the names of the columns stand in the file.
    nested : tuple of str
        Columns that were not read: they hold lists or structures.
    """

    path: Path
    columns: dict[str, NDArray[Any]]
    times: frozenset[str] = field(default_factory=frozenset)
    is_named: bool = True
    nested: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def load_pyarrow() -> Any:
    """Return pyarrow with its readers.

    Raises
    ------
    SourceError
        When it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.csv
        import pyarrow.parquet
    except ImportError as error:
        raise SourceError(
            'CSV and Parquet files are read and written by pyarrow, which is not installed: '
            'pip install pyarrow'
        ) from error
    return pyarrow


def read_table(path: Path) -> Table:
    """Read a CSV or Parquet file.

    Raises
    ------
    SourceError
        When it is no table, too large or damaged.
    """
    pyarrow = load_pyarrow()
    nested: tuple[str, ...] = ()
    if path.stat().st_size > MAX_TABLE_BYTES:
        raise SourceError(f'{path} is larger than {MAX_TABLE_BYTES >> 20} MiB; divide it')
    try:
        if path.suffix.lower() == '.parquet':
            (found, nested), is_named = _read_parquet(path, pyarrow), True
        else:
            found, is_named = _read_text(path, pyarrow)
    except (pyarrow.ArrowException, OSError, UnicodeError, csv.Error) as error:
        sentence = str(error).partition('\n')[0]
        raise SourceError(f'{path} cannot be read as a table: {sentence}') from error
    if len(set(found.column_names)) < len(found.column_names):
        ((name, _),) = Counter(found.column_names).most_common(1)
        raise SourceError(f'{path} has several columns of one name: {name}')
    if not found.num_rows:
        raise SourceError(f'{path} has no rows')
    times = {f.name for f in found.schema if pyarrow.types.is_timestamp(f.type)}
    columns = {n: _to_numpy(path, n, found[n], pyarrow) for n in found.column_names}
    return Table(path, columns, frozenset(times), is_named, nested)


def _read_parquet(path: Path, pyarrow: Any) -> tuple[Any, tuple[str, ...]]:
    """Return the columns of one value a row, and the names of the others.

    What they take in memory is known from the file's metadata, before anything is read. Runs and
    codes of a dictionary pack values without limit, so the packed size says nothing.
    """
    types = pyarrow.types
    with pyarrow.parquet.ParquetFile(path) as file:
        kinds = {f.name: _value_type(f.type, types) for f in file.schema_arrow}
        flat = {name: kind for name, kind in kinds.items() if not types.is_nested(kind)}
        if not flat:
            raise SourceError(f'{path} has lists in every column; write a row for each sample')
        # Read as codes into a dictionary, a text takes no more than it does in the file.
        as_codes = {name for name, kind in flat.items() if _is_text(kind, types)}
        chunks = [c for c in _column_chunks(file.metadata) if c.path_in_schema in flat]
        as_codes -= {c.path_in_schema for c in chunks if not _CODED.issuperset(c.encodings)}
        size = sum(
            _decoded_bytes(chunk, flat[chunk.path_in_schema], as_codes, types) for chunk in chunks
        )
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


def _decoded_bytes(chunk: Any, kind: Any, as_codes: Set[str], types: Any) -> int:
    """Return what a part of a column takes in memory at most [byte]."""
    packed, count = chunk.total_uncompressed_size, chunk.num_values
    if chunk.path_in_schema in as_codes or types.is_null(kind):
        return int(packed + count * _CODE_BYTES)
    if _is_text(kind, types):  # in an encoding in which a text may repeat the one before
        return int(packed * count + count * _CODE_BYTES)
    return int(packed + count * max(_CODE_BYTES, kind.bit_width // 8))


def _value_type(kind: Any, types: Any) -> Any:
    return kind.value_type if types.is_dictionary(kind) else kind


def _is_text(kind: Any, types: Any) -> bool:
    tests = (types.is_string, types.is_large_string, types.is_binary, types.is_large_binary)
    return any(is_it(kind) for is_it in tests)


def _read_text(path: Path, pyarrow: Any) -> tuple[Any, bool]:
    text = decode_text(path.read_bytes())
    lines = text.splitlines(keepends=True)
    dialect = find_dialect(lines)
    if dialect is None:
        raise SourceError(f'{path} holds no table of numbers\n{LAYOUT}')
    data = ''.join(lines[dialect.first_line :]).encode()
    found = pyarrow.csv.read_csv(
        pyarrow.BufferReader(data),
        read_options=pyarrow.csv.ReadOptions(column_names=list(dialect.names), use_threads=False),
        parse_options=pyarrow.csv.ParseOptions(delimiter=dialect.separator),
        convert_options=pyarrow.csv.ConvertOptions(
            decimal_point=dialect.decimal, strings_can_be_null=False
        ),
    )
    return found, dialect.is_named


def decode_text(data: bytes) -> str:
    """Return the text of a file: UTF-8 or UTF-16 by its mark, otherwise Latin-1."""
    if data[:2] in (b'\xff\xfe', b'\xfe\xff'):
        return data.decode('utf-16')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError:
        return data.decode('latin-1')


def _to_numpy(path: Path, name: str, column: Any, pyarrow: Any) -> NDArray[Any]:
    """Return a column as numbers, booleans or strings."""
    types, kind = pyarrow.types, column.type
    if types.is_dictionary(kind) and not _is_text(kind.value_type, types):
        column = column.cast(kind.value_type)
        kind = column.type
    if types.is_timestamp(kind):
        column = column.cast(pyarrow.timestamp('ns'), safe=False).cast(pyarrow.int64())
    elif types.is_decimal(kind) or types.is_duration(kind) or types.is_float16(kind):
        column = column.cast(pyarrow.float64(), safe=False)
    elif types.is_boolean(kind) and column.null_count:
        column = column.cast(pyarrow.string())
    if types.is_dictionary(column.type) or _is_text(column.type, types):
        return _texts_to_numpy(path, name, column, pyarrow)
    values = column.to_numpy()
    if values.dtype.kind in 'fiub':
        return np.asarray(values)
    return np.array(['' if value is None else str(value) for value in values.tolist()], dtype=str)


def _texts_to_numpy(path: Path, name: str, column: Any, pyarrow: Any) -> NDArray[Any]:
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
