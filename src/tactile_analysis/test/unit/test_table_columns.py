# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Columns of a table are found by their exact names or by options; nothing is guessed."""

import re

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_analysis import SourceError, SourceOptions, TrialSet

UNITS = {'N': 1.0, 'mN': 1e-3, 'kN': 1e3}
TIMES = {'s': 1.0, 'ms': 1e-3, 'us': 1e-6}
NEVER_TAKEN = ['force2', 'myforce', 'forces', 'Kraft [N]', 'fz', 'value', 'signal_n', 'load [N]']


def write(path, lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('\n'.join(lines))
    return path


def write_trials(folder, names, rows):
    """Write one table for each of two labels, with the same rows; return the folder."""
    for label in ('pla', 'rubber'):
        write(folder / label / '1.csv', [names, *rows])
    return folder


@given(
    st.sampled_from(['force', 'tension', 'Force', 'TENSION']),
    st.sampled_from(['{} [{}]', '{} ({})', '{}_{}', '{} {}']),
    st.sampled_from(sorted(UNITS)),
    st.sampled_from(['t', 'time', 'Time', 'timestamp', 'stamp']),
    st.sampled_from(sorted(TIMES)),
    st.permutations(range(3)),
    st.lists(st.integers(-9_000_000, 9_000_000).map(lambda n: n / 10), min_size=3, max_size=20),
)
def test_exact_names_with_units_are_taken_in_any_order(
    tmp_path_factory, force, form, unit, time, time_unit, order, values
):
    names = [form.format(force, unit), form.format(time, time_unit), 'temperature']
    cells = [[v, i * 0.01 / TIMES[time_unit], 21.5] for i, v in enumerate(values)]
    lines = [','.join(names[k] for k in order)]
    lines += [','.join(repr(row[k]) for k in order) for row in cells]
    path = write(tmp_path_factory.getbasetemp() / 'exact' / 'a.csv', lines)
    options = SourceOptions(label='pla')
    if max(map(abs, values)) * UNITS[unit] > 1e6:
        with pytest.raises(SourceError, match='tendons carry'):
            TrialSet.load(path, options).windows()
        return
    recording = TrialSet.load(path, options)
    (trial,) = recording.trials
    expected = values if unit == 'N' else np.array(values) * UNITS[unit]
    np.testing.assert_array_equal(trial.signal.values[0], expected)
    assert trial.signal.rate_hz == pytest.approx(100.0)
    assert recording.unit == 'N'
    assert any(names[0] in note and names[1] in note for note in recording.notes)


@given(st.sampled_from(NEVER_TAKEN), st.sampled_from(['', ',other', ',label']))
def test_other_names_are_never_taken_for_the_force(tmp_path_factory, name, more):
    rows = [f'{i / 100},{i}.5{",1" if more else ""}' for i in range(9)]
    path = write(
        tmp_path_factory.getbasetemp() / 'other' / 'a.csv', [f'time_s,{name}{more}', *rows]
    )
    with pytest.raises(SourceError, match='--force-column') as refused:
        TrialSet.load(path, SourceOptions(label='pla'))
    assert f'time_s = 0.0, {name} = 0.5' in str(refused.value)
    stated = SourceOptions(label='pla', force_column=name)
    assert TrialSet.load(path, stated).trials[0].signal.values[0, 1] == 1.5 * 1.0


@pytest.mark.parametrize('names', ['time_s,force_n,tension_n', 'time_s,t_ms,force_n'])
def test_two_columns_that_fit_are_refused_until_one_is_stated(tmp_path, names):
    folder = write_trials(tmp_path, names, [f'{i / 100},{i},{i % 3}' for i in range(9)])
    role = 'time' if 't_ms' in names else 'force'
    with pytest.raises(SourceError, match=f'--{role}-column'):
        TrialSet.load(folder)
    column = {'time': 'time_s', 'force': 'tension_n'}[role]
    assert TrialSet.load(folder, SourceOptions(**{f'{role}_column': column})).trials


def test_times_without_a_unit_are_refused_with_the_rate_in_each(tmp_path):
    folder = write_trials(tmp_path, 'time,force_n', [f'{10 * i},{i % 3}' for i in range(9)])
    with pytest.raises(SourceError, match=re.escape('s: 0.1 Hz, ms: 100 Hz, us: 1e+05 Hz')):
        TrialSet.load(folder)
    recording = TrialSet.load(folder, SourceOptions(time_unit='ms'))
    assert recording.trials[0].signal.rate_hz == 100.0
    with pytest.raises(SourceError, match=r'--time-unit is "hours".* s, ms'):
        TrialSet.load(folder, SourceOptions(time_unit='hours'))


FORMS = [
    ('iso', '2026-11-{} {},{}'),
    ('iso', '2026-11-{}T{}.{}'),
    ('day-first', '{}.11.2026 {}.{}'),
    ('day-first', '{}/11/2026 {},{}'),
]


@pytest.mark.parametrize(('form', 'text'), FORMS)
def test_dates_are_read_in_the_stated_form(tmp_path, form, text):
    before = [text.format(12, '23:59:59', f'{90 + i}') for i in range(10)]
    after = [text.format(13, '00:00:00', f'{i:02d}') for i in range(10)]
    rows = [f'{date};{i % 3}' for i, date in enumerate([*before, *after])]
    folder = write_trials(tmp_path, 'time;force_n', rows)
    options = SourceOptions(separator='semicolon', time_unit=form)
    signal = TrialSet.load(folder, options).trials[0].signal
    np.testing.assert_allclose(np.diff(signal.time_s), 0.01, atol=1e-6)


def test_dates_of_another_form_are_named_with_file_column_and_row(tmp_path):
    rows = [f'{12 + i}/11/2026 10:00:00,1' for i in range(3)]
    folder = write_trials(tmp_path, 'time,force_n', rows)
    with pytest.raises(SourceError, match=r'row 1 .*"12/11/2026 .* day-first'):
        TrialSet.load(folder)
    write_trials(tmp_path, 'time,force_n', ['12/11/2026 10:00:00,1', '11/13/2026 10:00:00,1'])
    with pytest.raises(SourceError, match=r'pla/1\.csv: column "time", data row 2.*"11/13'):
        TrialSet.load(folder, SourceOptions(time_unit='day-first'))


def test_a_text_in_a_column_of_numbers_names_file_column_and_row(tmp_path):
    folder = write_trials(tmp_path, 'time_s,force_n', [f'{i / 100},{i}' for i in range(9)])
    broken = folder / 'rubber' / '1.csv'
    broken.write_text(broken.read_text().replace('0.04,4', '0.04,4 N'))
    with pytest.raises(SourceError, match=r'rubber/1\.csv: column "force_n" .* row 5 .* "4 N"'):
        TrialSet.load(folder)


def test_text_behind_a_closing_quotation_mark_is_refused(tmp_path):
    write(tmp_path / 'a.csv', ['time_s,force_n', '0.00,"1"', '0.01,"1"5', '0.02,2'])
    with pytest.raises(SourceError, match=r'a\.csv: line 2 '):
        TrialSet.load(tmp_path / 'a.csv', SourceOptions(label='pla'))


@given(st.lists(st.sampled_from(list('0123456789.,; eE+-\tN"')), max_size=12).map(''.join))
@example('"0"0')
def test_a_cell_of_any_form_is_its_number_or_refused(tmp_path_factory, cell):
    path = tmp_path_factory.getbasetemp() / 'cell' / 'a.csv'
    write(path, ['time_s,force_n', '0.00,1.5', f'0.01,{cell}', '0.02,2.5'])
    try:
        (trial,) = TrialSet.load(path, SourceOptions(label='pla')).trials
        values = trial.signal.values[0]
    except SourceError:
        return
    if len(values) == 3 and np.isfinite(values[1]):
        assert values[1] == float(cell.strip().strip('"'))
