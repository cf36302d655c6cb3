# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables that would not fit into memory, or are damaged, cause an error of one sentence."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tactile_analysis.options import SourceError
from tactile_analysis.sources.table_files import read_table


@pytest.fixture
def little_memory(monkeypatch):
    """Limit the memory of a table to 1 MiB."""
    monkeypatch.setattr('tactile_analysis.sources.table_files.MAX_TABLE_BYTES', 2**20)


@pytest.mark.usefixtures('little_memory')
def test_numbers_that_runs_pack_without_limit_are_counted_before_they_are_read(tmp_path):
    # Each row group contains 10,000 equal numbers in a few hundred bytes.
    path, part = tmp_path / 'bomb.parquet', pa.table({'force_n': np.ones(10_000)})
    with pq.ParquetWriter(path, part.schema) as writer:
        for _ in range(20):
            writer.write_table(part)
    assert path.stat().st_size < 20_000
    with pytest.raises(SourceError, match=r'bomb\.parquet .*\d MiB'):
        read_table(path)


@pytest.mark.usefixtures('little_memory')
@pytest.mark.parametrize(
    ('encoding', 'store_schema'),
    [('plain', True), ('dictionary', True), ('dictionary', False), ('delta', True)],
)
def test_texts_that_numpy_would_widen_are_refused(tmp_path, store_schema, encoding):
    path = tmp_path / 'words.parquet'
    long, rows = 'x' * 3_000, 200
    texts = pa.array([long, *['y'] * (rows - 1)] if encoding == 'plain' else [long] * rows)
    if encoding == 'dictionary':
        texts = texts.dictionary_encode()
    more = {'use_dictionary': False, 'column_encoding': {'label': 'DELTA_BYTE_ARRAY'}}
    pq.write_table(
        pa.table({'force_n': np.ones(rows), 'label': texts}),
        path,
        store_schema=store_schema,
        **(more if encoding == 'delta' else {}),
    )
    assert path.stat().st_size < 30_000
    with pytest.raises(SourceError):
        read_table(path)


@pytest.mark.usefixtures('little_memory')
def test_texts_that_repeat_the_one_before_are_counted_before_they_are_read(tmp_path):
    path, texts = tmp_path / 'words.parquet', ['x' * 3_000] * 2_000
    more = {'use_dictionary': False, 'column_encoding': {'label': 'DELTA_BYTE_ARRAY'}}
    pq.write_table(pa.table({'label': texts}), path, **more)
    assert path.stat().st_size < 30_000
    with pytest.raises(SourceError, match=r'words\.parquet .*\d+ MiB'):
        read_table(path)


def test_short_texts_of_any_encoding_are_read(tmp_path):
    labels = ['pla', 'plastic', 'rubber', 'pla'] * 50
    for encoding in ('PLAIN', 'DELTA_BYTE_ARRAY', 'DELTA_LENGTH_BYTE_ARRAY'):
        path = tmp_path / f'{encoding}.parquet'
        more = {'use_dictionary': False, 'column_encoding': {'label': encoding}}
        pq.write_table(pa.table({'label': labels}), path, **more)
        assert read_table(path).columns['label'].tolist() == labels


@pytest.mark.usefixtures('little_memory')
def test_a_long_text_in_a_csv_is_refused_too(tmp_path):
    path = tmp_path / 'long.csv'
    path.write_text('\n'.join(['force_n,label', *['1.0,a'] * 30, f'1.0,{"x" * 10_000}']))
    with pytest.raises(SourceError, match=r'column label .*10000'):
        read_table(path)


def test_a_name_beyond_the_limit_of_csv_is_one_sentence(tmp_path):
    path = tmp_path / 'field.csv'
    path.write_text(f'force_n,{"x" * 140_000}\n1.0,2.0\n')
    with pytest.raises(SourceError, match=r'field\.csv'):
        read_table(path)


def test_lists_are_left_out_and_named(tmp_path):
    path = tmp_path / 'lists.parquet'
    lists = pa.array([[1.0, 2.0], [3.0], []])
    structures = pa.array([{'a': 1}, {'a': 2}, {'a': 3}])
    pq.write_table(pa.table({'force_n': [1.0, 2.0, 3.0], 'x': lists, 'y': structures}), path)
    table = read_table(path)
    assert list(table.columns) == ['force_n']
    assert table.nested == ('x', 'y')
    pq.write_table(pa.table({'x': lists}), path)
    with pytest.raises(SourceError):
        read_table(path)


@pytest.mark.parametrize('store_schema', [False, True])
def test_what_parquet_can_hold_is_read_as_before(tmp_path, store_schema):
    path = tmp_path / 'kinds.parquet'
    labels = ['pla', None, 'rubber', 'pla']
    table = pa.table(
        {
            'force_n': [1.5, 2.5, None, 4.0],
            'count': pa.array([1, 2, 3, 4], pa.int16()),
            'label': labels,
            'code': pa.array(labels).dictionary_encode(),
            'number': pa.array([7, 8, 7, 8]).dictionary_encode(),
            'good': [True, False, True, True],
            'perhaps': [True, None, False, True],
            'price': pa.array([1, 2, 3, 4], pa.decimal128(5, 2)),
            'stamp': pa.array([1, 2, 3, 4], pa.timestamp('us')),
            'nothing': pa.nulls(4),
            'nobody': pa.nulls(4, pa.string()),
        }
    )
    pq.write_table(table, path, store_schema=store_schema, row_group_size=3)
    found = read_table(path)
    kinds = {name: column.dtype.kind for name, column in found.columns.items()}
    assert kinds == {
        'force_n': 'f', 'count': 'i', 'label': 'U', 'code': 'U', 'number': 'i', 'good': 'b',
        'perhaps': 'U', 'price': 'f', 'stamp': 'i', 'nothing': kinds['nothing'], 'nobody': 'U',
    }  # fmt: skip
    for name in ('label', 'code'):
        assert found.columns[name].tolist() == ['pla', '', 'rubber', 'pla']
    assert found.columns['perhaps'].tolist() == ['true', '', 'false', 'true']
    assert found.columns['number'].tolist() == [7, 8, 7, 8]
    assert found.columns['price'].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert found.columns['nobody'].tolist() == [''] * 4
    assert found.times == {'stamp'}
