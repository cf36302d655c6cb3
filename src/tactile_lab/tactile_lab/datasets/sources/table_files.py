# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reads CSV and Parquet files as columns, by pyarrow."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_lab.datasets.sources.questions import LAYOUT, SourceError
from tactile_lab.datasets.sources.text_dialect import find_dialect

MAX_TABLE_BYTES = 2**30
"""Largest file or table that is read [byte]."""


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
    """

    path: Path
    columns: dict[str, NDArray[Any]]
    times: frozenset[str] = field(default_factory=frozenset)
    is_named: bool = True

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
    if path.stat().st_size > MAX_TABLE_BYTES:
        raise SourceError(f'{path} is larger than {MAX_TABLE_BYTES >> 20} MiB; divide it')
    try:
        if path.suffix.lower() == '.parquet':
            found, is_named = _read_parquet(path, pyarrow), True
        else:
            found, is_named = _read_text(path, pyarrow)
    except (pyarrow.ArrowException, OSError, UnicodeError) as error:
        sentence = str(error).partition('\n')[0]
        raise SourceError(f'{path} cannot be read as a table: {sentence}') from error
    if len(set(found.column_names)) < len(found.column_names):
        ((name, _),) = Counter(found.column_names).most_common(1)
        raise SourceError(f'{path} has several columns of one name: {name}')
    if not found.num_rows:
        raise SourceError(f'{path} has no rows')
    times = {f.name for f in found.schema if pyarrow.types.is_timestamp(f.type)}
    columns = {name: _to_numpy(found[name], pyarrow) for name in found.column_names}
    return Table(path, columns, frozenset(times), is_named)


def _read_parquet(path: Path, pyarrow: Any) -> Any:
    with pyarrow.parquet.ParquetFile(path) as file:
        groups = (file.metadata.row_group(i) for i in range(file.metadata.num_row_groups))
        size = sum(group.total_byte_size for group in groups)
        if size > MAX_TABLE_BYTES:
            raise SourceError(f'{path} unpacks to {size >> 20} MiB; divide it')
        return file.read(use_threads=False)


def _read_text(path: Path, pyarrow: Any) -> tuple[Any, bool]:
    text = decode_text(path.read_bytes())
    lines = text.splitlines(keepends=True)
    dialect = find_dialect(lines)
    if dialect is None:
        raise SourceError(f'{path} holds no table of numbers\n{LAYOUT}')
    csv = pyarrow.csv
    data = ''.join(lines[dialect.first_line :]).encode()
    found = csv.read_csv(
        pyarrow.BufferReader(data),
        read_options=csv.ReadOptions(column_names=list(dialect.names), use_threads=False),
        parse_options=csv.ParseOptions(delimiter=dialect.separator),
        convert_options=csv.ConvertOptions(
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


def _to_numpy(column: Any, pyarrow: Any) -> NDArray[Any]:
    """Return a column as numbers, booleans or strings."""
    types, kind = pyarrow.types, column.type
    if types.is_dictionary(kind):
        column = column.cast(kind.value_type)
        kind = column.type
    if types.is_timestamp(kind):
        column = column.cast(pyarrow.timestamp('ns'), safe=False).cast(pyarrow.int64())
    elif types.is_decimal(kind) or types.is_duration(kind) or types.is_float16(kind):
        column = column.cast(pyarrow.float64(), safe=False)
    elif types.is_boolean(kind) and column.null_count:
        column = column.cast(pyarrow.string())
    values = column.to_numpy()
    if values.dtype.kind in 'fiub':
        return np.asarray(values)
    return np.array(['' if value is None else str(value) for value in values.tolist()], dtype=str)
