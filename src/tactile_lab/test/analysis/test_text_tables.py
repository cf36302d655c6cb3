# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables as text, in any form that a spreadsheet or an instrument writes."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_lab.datasets.sources.column_roles import split_unit
from tactile_lab.datasets.sources.questions import SourceError
from tactile_lab.datasets.sources.table_files import read_table
from tactile_lab.datasets.sources.text_dialect import find_dialect

NUMBERS = st.floats(-1e6, 1e6, allow_nan=False).map(lambda x: round(x, 6))
NAMES = st.lists(
    st.from_regex(r'[a-z][a-z_]{1,9}( \[(s|ms|N|mV)\])?', fullmatch=True).filter(
        lambda name: not name.startswith(('nan', 'inf'))
    ),
    min_size=2,
    max_size=5,
    unique=True,
)
FORMS = [(',', '.'), (';', '.'), (';', ','), ('\t', '.'), ('\t', ','), (' ', '.')]


@settings(deadline=None, max_examples=50)
@given(data=st.data())
def test_every_form_is_read_back(tmp_path_factory, data):
    separator, decimal = data.draw(st.sampled_from(FORMS))
    names = data.draw(NAMES)
    if separator == ' ':
        names = [name.partition(' ')[0] + str(i) for i, name in enumerate(names)]
    rows = data.draw(st.lists(st.tuples(*[NUMBERS for _ in names]), min_size=2, max_size=130))
    words = data.draw(st.booleans())
    above = ['', 'Instrument LC-1', '# made by x', '"a b"', 'Rate 100']
    preamble = data.draw(st.lists(st.sampled_from(above), unique=True))
    lines = [*preamble, separator.join(['label', *names] if words else names)]
    for row in rows:
        cells = [f'{value!r}'.replace('.', decimal) for value in row]
        lines.append(separator.join(['R1', *cells] if words else cells))
    end = data.draw(st.sampled_from(['\n', '\r\n']))
    encoding = data.draw(st.sampled_from(['utf-8', 'utf-8-sig', 'utf-16', 'latin-1']))
    path = tmp_path_factory.getbasetemp() / 'table.csv'
    path.write_bytes(end.join(lines).encode(encoding))
    table = read_table(path)
    assert list(table.columns) == (['label', *names] if words else names)
    assert table.is_named
    for i, name in enumerate(names):
        np.testing.assert_array_equal(table.columns[name], [row[i] for row in rows])
    if words:
        assert set(table.columns['label']) == {'R1'}


@settings(deadline=None)
@given(data=st.binary(max_size=400))
def test_any_bytes_are_a_table_or_refused(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp()
    for name in ('any.csv', 'any.parquet'):
        (folder / name).write_bytes(data)
        try:
            table = read_table(folder / name)
        except SourceError:
            continue
        assert len({len(column) for column in table.columns.values()}) == 1


@settings(deadline=None)
@given(text=st.text(alphabet='0123456789.,;\t \n"#abN[]-e', max_size=200))
def test_any_text_has_a_form_or_none(text):
    dialect = find_dialect(text.splitlines())
    assert dialect is None or len(set(dialect.names)) == len(dialect.names)


def test_a_table_without_names_has_numbered_columns(tmp_path):
    np.savetxt(tmp_path / 'bare.csv', np.arange(12.0).reshape(6, 2), delimiter=',')
    table = read_table(tmp_path / 'bare.csv')
    assert list(table.columns) == ['column 1', 'column 2']
    assert not table.is_named
    np.testing.assert_array_equal(table.columns['column 2'], np.arange(1.0, 12.0, 2.0))


def test_units_may_stand_below_the_names(tmp_path):
    (tmp_path / 'units.csv').write_text('time,force\ns,N\n0.0,1.5\n0.1,1.25\n')
    assert list(read_table(tmp_path / 'units.csv').columns) == ['time [s]', 'force [N]']


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('Force [N]', ('force', 'N')),
        ('time (ms)', ('time', 'ms')),
        ('time_ns', ('time', 'ns')),
        ('Zeit', ('zeit', '')),
        ('t', ('t', '')),
    ],
)
def test_units_in_names(name, expected):
    assert split_unit(name) == expected


def test_text_in_a_column_of_numbers_names_the_row(tmp_path):
    path = tmp_path / 'broken.csv'
    path.write_text('time_s,force_n\n0.0,1.0\n0.1,2.0,3.0\n')
    with pytest.raises(SourceError, match=r'broken\.csv cannot be read as a table.*3'):
        read_table(path)
