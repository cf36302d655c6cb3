# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Text tables in the formats of spreadsheets and instruments, which options state."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.table_files import read_table
from tactile_analysis.sources.table_trials import split_unit

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
    count = len(preamble) + 1
    stated = SourceOptions(separator=separator, decimal=decimal, header_rows=count)
    table = read_table(path, stated)
    assert list(table.columns) == (['label', *names] if words else names)
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


def test_a_table_without_names_has_numbered_columns(tmp_path):
    np.savetxt(tmp_path / 'bare.csv', np.arange(12.0).reshape(6, 2), delimiter=',')
    with pytest.raises(SourceError, match='line 1 '):
        read_table(tmp_path / 'bare.csv')
    table = read_table(tmp_path / 'bare.csv', SourceOptions(header_rows=0))
    assert list(table.columns) == ['column 1', 'column 2']
    np.testing.assert_array_equal(table.columns['column 2'], np.arange(1.0, 12.0, 2.0))


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('Force [N]', ('force', 'N')),
        ('time (ms)', ('time', 'ms')),
        ('time_ns', ('time', 'ns')),
        ('Zeit', ('zeit', '')),
        ('t', ('t', '')),
        ('force_mN', ('force', 'mN')),
        ('tension [N]', ('tension', 'N')),
        ('Kraft (N)', ('kraft', 'N')),
        ('force_n', ('force', 'N')),
        ('tension [Newton]', ('tension', 'N')),
        ('load_kN', ('load', 'kN')),
        ('pressure [kPa]', ('pressure', 'kPa')),
        ('signal [-]', ('signal', '')),
    ],
)
def test_units_in_names(name, expected):
    assert split_unit(name) == expected


MISREAD = {
    'semicolons': 'time_s;force_n\n0.0;1.5\n0.1;2.5\n',
    'semicolons and decimal commas': 'Zeit;Kraft\n0,0;1,5\n0,1;2,5\n',
    'tabs': 'time_s\tforce_n\n0.0\t1.5\n0.1\t2.5\n',
    'tabs and decimal commas': 't\tf\n0,0\t1,5\n0,1\t2,5\n',
    'commas in names, tabs and decimal commas': 'a,b,c\n0,0\t1,5\n0,1\t2,5\n',
    'blanks': 't f\n0.0 1.5\n0.1 2.5\n',
    'quoted decimal commas': 't,f\n"0,0","1,5"\n"0,1","2,5"\n',
    'preamble': 'Instrument LC-1\n\nt,f\n0.0,1.5\n0.1,2.5\n',
}


@pytest.mark.parametrize('name', MISREAD)
def test_a_text_of_another_form_is_refused_with_the_options_that_state_it(tmp_path, name):
    path = tmp_path / 'other.csv'
    path.write_text(MISREAD[name])
    with pytest.raises(SourceError, match='--separator'):
        read_table(path)
    if 'quoted' in name or 'names' in name:
        return
    kind = {'s': 'semicolon', 't': 'tab', 'b': 'space', 'p': 'comma'}[name[0]]
    decimal = ',' if 'decimal' in name else '.'
    rows = 3 if 'preamble' in name else 1
    stated = SourceOptions(separator=kind, decimal=decimal, header_rows=rows)
    (_, force_n) = read_table(path, stated).columns.values()
    assert force_n.tolist() == [1.5, 2.5]


def test_text_in_a_column_of_numbers_names_the_row(tmp_path):
    path = tmp_path / 'broken.csv'
    path.write_text('time_s,force_n\n0.0,1.0\n0.1,2.0,3.0\n')
    with pytest.raises(SourceError, match=r'broken\.csv .*3'):
        read_table(path)
