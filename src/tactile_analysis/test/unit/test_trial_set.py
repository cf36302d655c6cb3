# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`TrialSet` reads recordings of all kinds: trials equal the written data, and are read once."""

import dataclasses
import json
import os
import re

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores

from tactile_analysis import FeatureOptions, prepare, SourceError, SourceOptions, TrialSet
from tactile_ros.errors import TactileError
from tactile_testing.recordings import Archive, check_source


def write_archive(path, **more):
    x = np.random.default_rng(3).normal(size=(6, 2, 40))
    x[3:, :, 30:] = 0.0
    arrays = {
        'x': x,
        'label': np.repeat(['pla', 'rubber'], 3),
        'rate_hz': 100.0,
        'length': np.repeat([40, 30], 3),
        'session_id': np.array(['a', 'b', 'c'] * 2),
        'speed_mm_s': np.arange(6.0),
        **more,
    }
    np.savez(path, **arrays)
    return path


def write_tables(folder, suffix):
    """Write a folder for each label, with one table per trial; return ``folder``."""
    for label in ('pla', 'rubber'):
        (folder / label).mkdir(parents=True)
        for number in range(2):
            time_s = np.arange(40) / 100.0
            table = pyarrow.table({'time_s': time_s, 'force_n': np.sin(number + time_s)})
            path = folder / label / f'{number}{suffix}'
            if suffix == '.csv':
                pyarrow.csv.write_csv(table, path)
            else:
                pyarrow.parquet.write_table(table, path)
    return folder


def write_list(folder):
    tables = write_tables(folder / 'data', '.csv')
    paths = sorted(path.relative_to(folder) for path in tables.rglob('*.csv'))
    (folder / 'recordings.txt').write_text('\n'.join(map(str, paths)))
    return folder / 'recordings.txt'


def write_long_table(folder):
    table = TrialSet.load(write_archive(folder / 'a.npz', unit='mN')).to_table()
    pyarrow.parquet.write_table(table, folder / 'trials.parquet')
    return folder / 'trials.parquet'


def write_labelled_array(folder):
    np.save(folder / 'x.npy', np.random.default_rng(3).normal(size=(4, 2, 40)))
    np.save(folder / 'x_labels.npy', np.repeat(['pla', 'rubber'], 2))
    return folder / 'x.npy'


def write_arrays(folder):
    """Write a folder for each label, with one array per trial; return ``folder``."""
    rng = np.random.default_rng(3)
    for label in ('pla', 'rubber'):
        (folder / label).mkdir()
        for number in range(2):
            np.save(folder / label / f'{number}.npy', rng.normal(size=(2, 40)))
    return folder


def write_bags(folder, plugin, *, with_stamps=True):
    """Write a folder for each label, with one bag of wrenches per trial; return ``folder``."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    vector = types['geometry_msgs/msg/Vector3']
    kind = 'geometry_msgs/msg/WrenchStamped'
    for label in ('pla', 'rubber'):
        (folder / label).mkdir()
        for number in range(2):
            with Writer(folder / label / str(number), version=9, storage_plugin=plugin) as writer:
                connection = writer.add_connection('/ft', kind, typestore=store)
                for i in range(40):
                    sec, nanosec = 1_700_000_000, i * 10_000_000
                    stamp = types['builtin_interfaces/msg/Time'](
                        *((sec, nanosec) if with_stamps else (0, 0))
                    )
                    force = vector(0.0, float(i), np.sin(number + i / 100))
                    wrench = types['geometry_msgs/msg/Wrench'](force, vector(0.0, 0.0, 0.0))
                    message = types[kind](types['std_msgs/msg/Header'](stamp, 'ft'), wrench)
                    data = store.serialize_cdr(message, kind)
                    writer.write(connection, sec * 10**9 + nanosec, data)
    return folder


SOURCES = {
    'archive': lambda folder: write_archive(folder / 'a.npz', unit='mN'),
    'tables': lambda folder: write_tables(folder, '.csv'),
    'parquet': lambda folder: write_tables(folder, '.parquet'),
    'list': write_list,
    'long table': write_long_table,
    'labelled array': write_labelled_array,
    'arrays': write_arrays,
    'MCAP bags': lambda folder: write_bags(folder, StoragePlugin.MCAP),
    'SQLite bags': lambda folder: write_bags(folder, StoragePlugin.SQLITE3),
}

STATED = {
    'labelled array': SourceOptions(rate_hz=100.0),
    'arrays': SourceOptions(rate_hz=100.0),
    'MCAP bags': SourceOptions(field='force.z,force.y'),
    'SQLite bags': SourceOptions(field='force.z'),
}
"""Facts that a recording of `SOURCES` does not contain."""


@pytest.mark.parametrize('source', SOURCES)
def test_every_source_keeps_what_a_set_of_trials_promises(tmp_path, source):
    path = SOURCES[source](tmp_path)
    check_source(lambda: TrialSet.load(path, STATED.get(source)))


def test_a_set_with_an_excluded_trial_keeps_the_promises_too(tmp_path):
    path = write_tables(tmp_path, '.csv')
    is_first = np.arange(4) == 0
    check_source(lambda: TrialSet.load(path).exclude(is_first, 'the object was loose'))


def test_only_files_beside_arrays_are_labels(tmp_path):
    write_tables(tmp_path / 'tables', '.csv')
    (tmp_path / 'tables' / 'pla').rename(tmp_path / 'tables' / 'y')
    (tmp_path / 'tables' / 'y' / '0.csv').rename(tmp_path / 'tables' / 'y' / 'labels.csv')
    tables = TrialSet.load(tmp_path / 'tables')
    assert [trial.label for trial in tables] == ['rubber', 'rubber', 'y', 'y']
    (tmp_path / 'labelled').mkdir()
    write_labelled_array(tmp_path / 'labelled')
    one = TrialSet.load(tmp_path / 'labelled', STATED['labelled array'])
    assert [trial.label for trial in one] == ['pla', 'pla', 'rubber', 'rubber']
    assert any('x_labels.npy' in note for note in one.notes)
    (tmp_path / 'arrays').mkdir()
    write_arrays(tmp_path / 'arrays')
    np.save(tmp_path / 'arrays' / 'pla' / 'labels.npy', np.array(['a', 'b']))
    several = TrialSet.load(tmp_path / 'arrays', STATED['arrays'])
    assert [trial.label for trial in several] == ['pla', 'pla', 'rubber', 'rubber']
    assert any('labels.npy' in note for note in several.notes)


def test_files_of_labels_above_arrays_or_beside_an_archive_are_no_recordings(tmp_path):
    (tmp_path / 'arrays').mkdir()
    (tmp_path / 'archive').mkdir()
    write_arrays(tmp_path / 'arrays')
    archive = write_archive(tmp_path / 'archive' / 'a.npz', unit='mN')
    for path, folder in ((tmp_path / 'arrays', 'arrays'), (archive, 'archive')):
        before = len(TrialSet.load(path, STATED.get(folder)))
        (tmp_path / folder / 'labels.csv').write_text('a\n')
        assert len(TrialSet.load(tmp_path / folder, STATED.get(folder))) == before


def test_arrays_named_like_labels_are_recordings_if_there_are_no_others(tmp_path):
    write_arrays(tmp_path)
    for label in ('pla', 'rubber'):
        first, second = sorted((tmp_path / label).iterdir())
        first.rename(tmp_path / label / 'y.npy')
        second.unlink()
    found = TrialSet.load(tmp_path, STATED['arrays'])
    assert [trial.label for trial in found] == ['pla', 'rubber']
    assert not any('not used' in note for note in found.notes)
    one = TrialSet.load(
        tmp_path / 'pla' / 'y.npy', dataclasses.replace(STATED['arrays'], label='a')
    )
    assert [trial.label for trial in one] == ['a']


def test_a_file_of_labels_for_several_arrays_is_refused(tmp_path):
    (tmp_path / 'arrays').mkdir()
    write_arrays(tmp_path / 'arrays')
    labels = tmp_path / 'these.csv'
    labels.write_text('a\nb\n')
    with pytest.raises(SourceError, match='4 arrays'):
        TrialSet.load(tmp_path / 'arrays', dataclasses.replace(STATED['arrays'], labels=labels))


def test_bags_whose_messages_have_no_stamp_state_that_they_use_the_arrival(tmp_path):
    write_bags(tmp_path, StoragePlugin.MCAP, with_stamps=False)
    with TrialSet.load(tmp_path, STATED['MCAP bags']) as trials:
        assert any(note.startswith('time: the arrival') for note in trials.notes)
        assert trials.even().rate_hz == 100.0


def test_an_archive_is_trials_and_the_same_archive_again(tmp_path):
    path = write_archive(tmp_path / 'a.npz', unit='mN')
    recording = TrialSet.load(path)
    assert recording.kind == 'archive'
    assert recording.unit == 'N'
    assert recording.rate_hz == 100.0
    assert [trial.label for trial in recording.trials] == ['pla'] * 3 + ['rubber'] * 3
    last = recording.trials[-1]
    assert last.session_id == 'c'
    assert last.columns['speed_mm_s'] == 5.0
    assert last.signal.values.shape == (2, 30)
    assert last.signal.unit == 'N'
    assert last.signal.time_s[-1] == pytest.approx(0.29)
    recording.save(tmp_path / 'b.npz')
    again, before = Archive(tmp_path / 'b.npz'), Archive(path)
    assert (again.unit, again.rate_hz, again.lengths.tolist()) == ('N', 100.0, [40] * 3 + [30] * 3)
    np.testing.assert_array_equal(again.x, before.x * 1e-3)
    assert again.label.tolist() == before.label.tolist()
    for name, column in before.columns.items():
        assert again.columns[name].tolist() == column.tolist()
    assert re.search('mN.* N', ' '.join(recording.notes))
    with pytest.raises(SourceError, match=r'mN.*--unit.*kN'):
        TrialSet.load(path, SourceOptions(unit='kN'))


def test_a_unit_that_is_not_known_is_the_first_note(tmp_path):
    recording = TrialSet.load(write_archive(tmp_path / 'a.npz'))
    assert '--unit' in recording.notes[0]
    stated = TrialSet.load(tmp_path / 'a.npz', SourceOptions(unit='N'))
    assert stated.unit == stated.trials[0].signal.unit == 'N'
    assert not stated.notes


def test_a_column_of_units_stays_a_column(tmp_path):
    path = write_archive(tmp_path / 'a.npz', unit=np.array(['N'] * 6))
    recording = TrialSet.load(path)
    assert recording.unit == ''
    assert recording.trials[0].columns['unit'] == 'N'
    with pytest.raises(SourceError, match='unit in'):
        TrialSet.load(write_archive(tmp_path / 'b.npz', unit=3))


def test_a_trial_that_cannot_be_used_says_why(tmp_path):
    x = np.random.default_rng(0).normal(size=(3, 1, 20))
    x[1, 0, 4] = np.nan
    np.savez(tmp_path / 'a.npz', x=x, label=['a', 'b', 'c'], rate_hz=10.0)
    trials = TrialSet.load(tmp_path / 'a.npz').trials
    assert [bool(trial.why_not) for trial in trials] == [False, True, False]
    assert '1 of 20' in trials[1].why_not


def test_equal_trials_are_refused(tmp_path):
    x = np.tile(np.sin(np.arange(30.0)), (4, 1, 1))
    np.savez(tmp_path / 'a.npz', x=x, label=['a', 'b'] * 2, rate_hz=10.0)
    with pytest.raises(SourceError, match='all 4'):
        TrialSet.load(tmp_path / 'a.npz').windows()


@pytest.mark.parametrize('heading', ['force_mN', 'tension [mN]', 'Force (mN)', 'Kraft (mN)'])
def test_forces_are_converted_from_the_unit_of_their_heading(tmp_path, heading):
    for label in ('pla', 'rubber'):
        (tmp_path / 'lab' / label).mkdir(parents=True)
        rows = [f'{i / 100},{i % 7 + len(label)}' for i in range(50)]
        text = '\n'.join([f'time_s,{heading}', *rows])
        (tmp_path / 'lab' / label / '01.csv').write_text(text)
    options = SourceOptions(force_column=heading if 'Kraft' in heading else '')
    recording = TrialSet.load(tmp_path / 'lab', options)
    assert recording.unit == 'N'
    assert recording.trials[0].signal.values[0, :3].tolist() == [0.003, 0.004, 0.005]
    assert re.search('mN.* N', ' '.join(recording.notes))
    assert recording.trials[0].signal.channels == (heading,)
    assert recording.trials[0].signal.rate_hz == 100.0
    with pytest.raises(SourceError, match=r'mN.*--unit'):
        TrialSet.load(tmp_path / 'lab', SourceOptions(force_column=heading, unit='N'))


@pytest.mark.parametrize(('unit', 'newtons'), [('N', 1.0), ('kN', 1e3), ('g', 9.80665e-3)])
def test_a_stated_unit_is_converted_and_forces_beyond_a_million_newtons_are_refused(
    tmp_path, unit, newtons
):
    for label in ('pla', 'rubber'):
        (tmp_path / 'lab' / label).mkdir(parents=True)
        rows = [f'{i / 100},{i % 7 + len(label)}' for i in range(50)]
        (tmp_path / 'lab' / label / '01.csv').write_text('\n'.join(['time_s,force', *rows]))
    recording = TrialSet.load(tmp_path / 'lab', SourceOptions(unit=unit))
    assert recording.trials[0].signal.values[0, :2].tolist() == [3 * newtons, 4 * newtons]
    assert recording.unit == 'N'
    broken = tmp_path / 'lab' / 'pla' / '01.csv'
    broken.write_text(broken.read_text().replace('0.05,8', '0.05,1234567890'))
    with pytest.raises(SourceError, match=r'lab/pla/01\.csv: channel force, sample 5 '):
        TrialSet.load(tmp_path / 'lab', SourceOptions(unit=unit)).windows()
    x = np.random.default_rng(0).normal(size=(3, 1, 20))
    x[2, 0, 7] = -2e6
    np.savez(tmp_path / 'a.npz', x=x, label=['a', 'b', 'a'], rate_hz=10.0, unit='N')
    with pytest.raises(SourceError, match=r'trial 2.* 2e\+06 N'):
        TrialSet.load(tmp_path / 'a.npz').windows()


@pytest.mark.parametrize('suffix', ['.parquet', '.csv'])
def test_the_long_table_is_read_back_equal(tmp_path, suffix):
    write_archive(tmp_path / 'a.npz', unit='mN')
    first = TrialSet.load(tmp_path / 'a.npz')
    table = first.to_table()
    assert table.column_names[:4] == ['trial', 'label', 'session_id', 'time_s']
    assert table.schema.field('channel_1').metadata[b'unit'] == b'N'
    assert table.schema.field('time_s').metadata == {b'unit': b's'}
    assert json.loads(table.schema.metadata[b'tactile']) == {'rate_hz': 100.0}
    assert table.num_rows == 3 * 40 + 3 * 30
    path = tmp_path / f'trials{suffix}'
    options = SourceOptions()
    if suffix == '.parquet':
        pyarrow.parquet.write_table(table, path)
    else:
        pyarrow.csv.write_csv(table, path)
        options = SourceOptions(force_column='channel_0,channel_1', unit='N')
    again = TrialSet.load(path, options)
    first.save(tmp_path / 'one.npz')
    again.save(tmp_path / 'two.npz')
    one, two = Archive(tmp_path / 'one.npz'), Archive(tmp_path / 'two.npz')
    np.testing.assert_array_equal(one.x, two.x)
    np.testing.assert_array_equal(one.lengths, two.lengths)
    assert one.rate_hz == two.rate_hz
    assert one.unit == two.unit == again.unit
    assert one.label.tolist() == two.label.tolist()
    for name, column in one.columns.items():
        assert column.tolist() == two.columns[name].tolist()


def test_a_stated_rate_that_the_times_do_not_have_is_refused(tmp_path):
    write_archive(tmp_path / 'a.npz')
    table = TrialSet.load(tmp_path / 'a.npz').to_table()
    for stated, problem in (
        (b'{"rate_hz": 50.0}', 'trial 0: .* 50 Hz.* 100 Hz'),
        (b'{"rate_hz": "x"}', ''),
        (b'[' * 100_000, ''),
        (b'{"rate_hz": 1e999}', ''),
    ):
        changed = table.replace_schema_metadata({b'tactile': stated})
        pyarrow.parquet.write_table(changed, tmp_path / 'b.parquet')
        recording = TrialSet.load(tmp_path / 'b.parquet')
        if problem:
            with pytest.raises(SourceError, match=problem):
                recording.windows()
        else:
            assert recording.even().rate_hz == 100.0


def write_stated(folder, rates_hz):
    """Write files without times, with these rates [Hz] in their metadata; return the folder."""
    for label, rate_hz in rates_hz.items():
        path = folder / label / '1.parquet'
        path.parent.mkdir(parents=True)
        table = pyarrow.table({'force_n': [i % len(label) + 0.5 for i in range(40)]})
        stated = {b'tactile': json.dumps({'rate_hz': rate_hz}).encode()}
        pyarrow.parquet.write_table(table.replace_schema_metadata(stated), path)
    return folder


def test_rates_that_files_state_agree_or_are_named(tmp_path):
    same = write_stated(tmp_path / 'same', {'pla': 100.0, 'rubber': 100.5})
    assert TrialSet.load(same).even().rate_hz == 100.25
    with pytest.raises(SourceError, match=r'--rate-hz .*60 Hz.* 100 Hz'):
        TrialSet.load(same, SourceOptions(rate_hz=60.0)).windows()
    mixed = write_stated(tmp_path / 'mixed', {'pla': 100.0, 'rubber': 50.0})
    told = r'100 Hz \(mixed/pla/1\.parquet\), 50 Hz \(mixed/rubber/1\.parquet\)'
    with pytest.raises(SourceError, match=told):
        TrialSet.load(mixed).windows()
    rows = [f'{i / 50!r},{i % 7}.5' for i in range(40)]  # times instead of a stated rate
    (mixed / 'rubber' / '1.parquet').unlink()
    (mixed / 'rubber' / '1.csv').write_text('\n'.join(['time_s,force_n', *rows]))
    with pytest.raises(SourceError, match=told.replace('rubber/1\\.parquet', 'rubber/1\\.csv')):
        TrialSet.load(mixed).windows()


def test_a_pipe_is_no_recording(tmp_path):
    os.mkfifo(tmp_path / 'pipe.csv')
    with pytest.raises(SourceError, match=r'pipe\.csv'):
        TrialSet.load(tmp_path / 'pipe.csv')
    with pytest.raises(SourceError):
        TrialSet.load(tmp_path)


def test_the_columns_are_a_frame_with_one_row_per_trial(tmp_path):
    pytest.importorskip('pandas', reason='pandas is not installed')
    trials = TrialSet.load(write_archive(tmp_path / 'a.npz'))
    frame = trials.to_frame()
    assert len(frame) == len(trials) == 6
    assert frame.label.tolist() == [trial.label for trial in trials]
    assert frame.speed_mm_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert {'session', 'mounting', 'contact', 'task', 'simulated', 'why_not'} <= {*frame}


@pytest.mark.parametrize('source', SOURCES)
def test_a_set_is_selected_excluded_and_relabelled_without_changing_the_loaded_one(
    tmp_path, source
):
    whole = TrialSet.load(SOURCES[source](tmp_path), STATED.get(source))
    before = whole.even()
    x = [trial.signal.values for trial in before]
    labels = np.array([trial.label for trial in before])
    pla = whole.select('label=pla')
    assert {trial.label for trial in pla} == {'pla'}
    np.testing.assert_array_equal(pla.windows()[1], labels[labels == 'pla'])
    first = np.arange(len(whole)) == 0
    without = whole.exclude(first, 'the plate was loose')
    assert without.trials[0].why_not == 'the plate was loose'
    assert len(without) == len(whole)
    left = without.windows()[0]
    assert len(left) == len(before) - 1
    assert any(note.endswith(': the plate was loose') for note in without.notes)
    np.testing.assert_array_equal(left[0, :, :30], x[1][:, :30])
    named = without.relabel(~first, 'cork').windows()[1]
    assert set(named) == {'cork'}
    assert len(named) == len(before) - 1
    assert without.select(first).trials[0].why_not
    np.testing.assert_array_equal(whole.windows()[1], labels)
    for wrong in ('label=gone', 'nothing=1', first[1:]):
        with pytest.raises(TactileError):
            whole.select(wrong)


def test_a_list_file_stands_for_its_recordings(tmp_path):
    for label in ('pla', 'rubber'):
        (tmp_path / 'data').mkdir(exist_ok=True)
        rows = [f'{i / 100},{(i * len(label)) % 7}' for i in range(50)]
        text = '\n'.join(['time_s,force_n', *rows])
        (tmp_path / 'data' / f'{label}_01.csv').write_text(text)
    (tmp_path / 'recordings.txt').write_text('# mine\ndata/pla_01.csv\n\ndata/rubber_01.csv\n')
    recording = TrialSet.load(tmp_path / 'recordings.txt', SourceOptions(label_from='file'))
    assert [trial.label for trial in recording.trials] == ['pla', 'rubber']
    (tmp_path / 'recordings.txt').write_text('data/pla_01.csv\ndata/gone.csv\n')
    with pytest.raises(SourceError, match=r'recordings\.txt, line 2: .*gone\.csv'):
        TrialSet.load(tmp_path / 'recordings.txt')


def test_a_trial_with_a_pause_does_not_count_and_is_not_written(tmp_path):
    lines = ['label,trial,time_s,force_n']
    for trial in range(3):
        times = [i for i in range(60) if trial != 1 or not 20 <= i < 30]
        lines += [f'a,{trial},{i / 100},{(i * (trial + 2)) % 7}' for i in times]
    (tmp_path / 'long.csv').write_text('\n'.join(lines))
    recording = TrialSet.load(tmp_path / 'long.csv')
    assert [trial.why_not for trial in recording.trials] == [
        None,
        'trial 1: no samples for 0.11 s, from 0.19 s on',
        None,
    ]
    assert set(recording.to_table()['trial'].to_pylist()) == {'0', '2'}
    even = recording.even(skip_bad=True)
    assert [trial.name for trial in even.included] == ['0', '2']
    assert even.rate_hz == 100.0
    assert even.resample(50.0).windows()[0].shape == (2, 1, 30)


def write_holds(folder, *names):
    """Write a file for each name, with different samples; return the folder."""
    for number, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = (f'{i / 100},{number + i % 7}' for i in range(50))
        path.write_text('\n'.join(['time_s,force_n', *rows]))
    return folder


def facts_of(folder, **options):
    with TrialSet.load(folder, SourceOptions(**options)) as recording:
        return [
            {name: text for name, text in trial.columns.items() if name != 'source'}
            for trial in recording.trials
        ]


@pytest.mark.parametrize(
    ('days', 'column'), [(('day1', 'day2'), 'day'), (('2026-11-27', '2026-11-28'), 'date')]
)
def test_folders_of_sessions_are_columns_and_not_labels(tmp_path, days, column):
    pairs = [(label, day) for day in days for label in ('pla', 'steel')]
    expected = [{'label': label, column: day} for label, day in sorted(pairs)]
    inner = write_holds(tmp_path / 'inner', *(f'{label}/{day}/1.csv' for label, day in pairs))
    assert facts_of(inner) == expected
    around = write_holds(tmp_path / 'around', *(f'{day}/{label}/1.csv' for label, day in pairs))
    assert sorted(facts_of(around), key=lambda facts: facts['label']) == expected
    names = (f'{day}/{label}_{i}.csv' for i, (label, day) in enumerate(pairs))
    flat = write_holds(tmp_path / 'flat', *names)
    assert {facts['label'] for facts in facts_of(flat)} == {''}
    with TrialSet.load(flat) as recording, pytest.raises(SourceError, match='--label-from file'):
        recording.windows()
    stated = facts_of(flat, label_from='file')
    assert sorted(stated, key=lambda facts: facts['label']) == expected
    assert {facts['label'] for facts in facts_of(flat, label_from='folder')} == set(days)


def test_columns_in_newtons_are_proposed_as_channels(tmp_path):
    path = tmp_path / 'a.csv'
    path.write_text('time_s,fx_N,fy_N,speed\n0,1,2,3\n0.01,2,3,3\n')
    with pytest.raises(SourceError, match='--force-column "fx_N,fy_N" for 2 channels'):
        TrialSet.load(path)


def test_columns_that_some_trials_lack_are_named_and_not_saved(tmp_path):
    folder = write_tables(tmp_path / 'lab', '.csv')
    first = folder / 'pla' / '0.csv'
    lines = first.read_text().splitlines()
    first.write_text('\n'.join([f'{lines[0]},speed_mm_s', *(f'{line},3' for line in lines[1:])]))
    trials = TrialSet.load(folder)
    assert trials.columns['speed_mm_s'].tolist() == [3, None, None, None]
    trials.save(tmp_path / 'a.npz')
    assert 'speed_mm_s' not in Archive(tmp_path / 'a.npz').columns
    assert len(trials.select('speed_mm_s=3')) == 1
    assert 'omitted, because some trials lack it: speed_mm_s' in trials.even().notes


def test_windows_have_groups_and_the_same_samples_as_the_signals(tmp_path):
    trials = TrialSet.load(write_archive(tmp_path / 'a.npz', unit='N'))
    x, y, groups = trials.crop(0.05, 0.25).windows('session')
    assert x.shape == (6, 2, 20)
    assert groups.tolist() == ['a', 'b', 'c'] * 2
    assert y.tolist() == [trial.label for trial in trials]
    for row, trial in zip(x, trials, strict=True):
        np.testing.assert_array_equal(row, trial.signal.values[:, 5:25])
    assert trials.windows()[2] is None


def test_columns_of_a_file_win_over_properties_of_the_same_name(tmp_path):
    more = {
        'source': np.repeat(['left', 'right'], 3),
        'contact': np.arange(6) < 2,
        'session': np.repeat(['x', 'y'], 3),
    }
    trials = TrialSet.load(write_archive(tmp_path / 'a.npz', unit='N', **more))
    assert len(trials.select('source=left')) == 3
    assert len(trials.select('contact')) == 2
    assert trials.windows('session')[2].tolist() == ['x'] * 3 + ['y'] * 3
    assert trials.windows('session_id')[2].tolist() == ['a', 'b', 'c'] * 2


def test_an_empty_crop_and_an_archive_without_its_suffix_are_refused(tmp_path):
    trials = TrialSet.load(write_archive(tmp_path / 'a.npz', unit='N'))
    with pytest.raises(SourceError, match='no sample from'):
        trials.crop(0.011, 0.019)
    with pytest.raises(SourceError, match=r'must end in \.npz'):
        trials.save(tmp_path / 'trials')


def test_all_trials_without_features_are_skipped(tmp_path):
    columns = {'speed_mm_s': np.array([20.0, 20.0, 2.0, 20.0, 2.0, 20.0])}
    path = write_archive(tmp_path / 'a.npz', unit='N', length=np.full(6, 40), **columns)
    options = FeatureOptions(
        task='texture', over='2:0.5', speed_column='speed_mm_s', skip_bad=True, channel='mean'
    )
    trials = prepare(TrialSet.load(path), options)
    assert [trial.name for trial in trials.included] == ['0', '1', '3', '5']
    with pytest.raises(SourceError, match='trial 2: it has 40 samples'):
        prepare(TrialSet.load(path), dataclasses.replace(options, skip_bad=False))
