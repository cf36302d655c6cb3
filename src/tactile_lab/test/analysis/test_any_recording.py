# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings of other software, in many file formats, are imported by the commands."""

import json

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from tactile_command import ask_tactile, hear_tactile, tactile

from tactile_classifier.model_file.model import load_model
from tactile_testing.recordings import Archive

pytestmark = pytest.mark.usefixtures('few_convolutions')

RATE_HZ = 100.0
SLOPES = {'rubber': -0.9, 'pla': -0.5}


def hold(label, seed, count=240):
    """Return times [s] and tension [N] of a simulated hold."""
    rng = np.random.default_rng([seed, *label.encode()])
    time_s = np.arange(count) / RATE_HZ
    return time_s, 5.0 + SLOPES[label] * time_s + rng.normal(0.0, 0.1, count)


def all_holds(count=6):
    return [(label, i, *hold(label, i, 240 + i)) for label in SLOPES for i in range(count)]


def save_rows(path, lines):
    """Write a text table, and create its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('\n'.join(lines))
    return path


def rows_of(time_s, tension_n, form):
    return [form.format(*row) for row in zip(time_s.tolist(), tension_n.tolist(), strict=True)]


def import_json(tmp_path, *arguments):
    archive = tmp_path / 'imported.npz'
    found = ask_tactile('import', *arguments, '-o', archive, '--force')
    return found, Archive(archive)


def refusal(tmp_path, *arguments):
    done = tactile('import', *arguments, '-o', tmp_path / 'refused.npz')
    assert done.returncode == 2, done.stderr
    assert not (tmp_path / 'refused.npz').exists()
    return done.stderr


@pytest.fixture
def long_table(tmp_path):
    """Write one table of all trials. The trials of each object are numbered from 0."""
    lines = ['object,trial,time_s,force_n,session']
    for label, i, *samples in all_holds():
        lines += rows_of(*samples, f'{label},{i},{{:.3f}},{{!r}},{i % 2}')
    return save_rows(tmp_path / 'long.csv', lines)


def check_holds(trials, count=6, *, column='', pattern=''):
    """Compare trials with the written ones, bit for bit.

    The trials have the same order, or a ``column`` contains their names.
    """
    assert trials.rate_hz == RATE_HZ
    assert len(trials) == 2 * count
    for row, (label, i, _, tension_n) in enumerate(all_holds(count)):
        if column:
            row = trials.columns[column].tolist().index(pattern.format(label=label, i=i))
        assert trials.label[row] == label
        np.testing.assert_array_equal(trials.x[row, 0, : trials.lengths[row]], tension_n)


def test_a_long_table_in_csv_and_parquet(tmp_path, long_table):
    found, trials = import_json(tmp_path, long_table)
    check_holds(trials)
    assert found['samples'] == [240, 245]
    assert found['columns'] == ['source', 'trial', 'session_id']
    assert trials.columns['session_id'].tolist() == [0, 1, 0, 1, 0, 1] * 2
    assert 'used force: force_n; time: time_s in s; trial: trial; label: object' in found['notes']
    assert 'trials are distinguished by object and trial together' in found['notes']
    parquet = tmp_path / 'long.parquet'
    pyarrow.parquet.write_table(pyarrow.csv.read_csv(long_table), parquet)
    check_holds(import_json(tmp_path, parquet)[1])


def test_rows_of_trials_may_be_mixed(tmp_path, long_table):
    head, *lines = long_table.read_text().splitlines()
    order = np.argsort(np.arange(len(lines)) % 7, kind='stable')
    by_time = sorted(order.tolist(), key=lambda i: float(lines[i].split(',')[2]))
    long_table.write_text('\n'.join([head, *(lines[i] for i in by_time)]))
    _, trials = import_json(tmp_path, long_table)
    check_holds(trials, column='trial', pattern='{label}/{i}')


@pytest.fixture
def folders(tmp_path):
    """Write one file per trial, with header lines, semicolons and decimal commas."""
    for label, i, time_s, tension_n in all_holds():
        path = tmp_path / 'lab' / label / f'{i:02d}.csv'
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = ['Gerät;LC-1', 'Datum;22.11.2026', '', 'Zeit [ms];Kraft [N];Temperatur [°C]']
        samples = rows_of(1e3 * time_s, tension_n, f'{{:.1f}};{{!r}};{21.0 + 0.001 * i:.3f}')
        lines += [row.replace('.', ',') for row in samples]
        path.write_bytes('\r\n'.join(lines).encode('latin-1'))
    return tmp_path / 'lab'


GERMAN = (
    '--separator', 'semicolon', '--decimal', ',', '--header-rows', 4, '--time-column', 'Zeit [ms]',
)  # fmt: skip
FORCE = ('--force-column', 'Kraft [N]')


def test_one_file_per_trial_in_folders_named_after_the_label(tmp_path, folders):
    assert '--separator' in refusal(tmp_path, folders)
    found, trials = import_json(tmp_path, folders, *GERMAN, *FORCE)
    check_holds(trials, column='source', pattern='lab/{label}/{i:02d}.csv')
    assert 'used force: Kraft [N]; time: Zeit [ms] in ms' in found['notes']
    assert 'label: the folder of each file (pla, rubber)' in found['notes']


def test_ambiguous_force_column_must_be_named(tmp_path, folders):
    said = refusal(tmp_path, folders, *GERMAN)
    assert 'possible: Kraft [N]. State it with --force-column NAME[,NAME...]' in said
    assert 'columns and first row: Zeit [ms] = 0.0, Kraft [N] = ' in said
    assert 'has no column "Kraft"' in refusal(
        tmp_path, folders, *GERMAN, '--force-column', 'Kraft'
    )
    both = ('--force-column', 'Kraft [N],Temperatur [°C]')
    _, trials = import_json(tmp_path, folders, *GERMAN, *both)
    assert trials.x.shape[:2] == (12, 2)


def test_labels_are_taken_from_file_names_only_on_request(tmp_path):
    for label, i, time_s, tension_n in all_holds():
        table = np.column_stack([time_s, tension_n])
        np.savetxt(tmp_path / f'{label}_{i:02d}.txt', table, header='time_s force_n')
    blanks = ('--separator', 'space')
    said = refusal(tmp_path, tmp_path, *blanks)
    assert 'pla_00.txt would be pla' in said
    assert '--label-from file' in said
    files, named = sorted(tmp_path.glob('*.txt')), r'/(?P<label>\w+)_(?P<turn>\d+)'
    for how in ('file', r'/(\w+)_\d+', named):
        _, trials = import_json(tmp_path, *files, *blanks, '--label-from', how)
        assert trials.label.tolist() == ['pla'] * 6 + ['rubber'] * 6
    assert trials.columns['turn'].tolist() == ['00', '01', '02', '03', '04', '05'] * 2


def test_arrays_with_a_file_of_labels(tmp_path):
    x = np.stack([tension_n[:240] for _, _, _, tension_n in all_holds()])
    labels = [label for label, *_ in all_holds()]
    np.save(tmp_path / 'x.npy', x)
    assert 'write them to x_labels.npy' in refusal(tmp_path, tmp_path / 'x.npy')
    np.save(tmp_path / 'x_labels.npy', labels)
    assert '--rate-hz' in refusal(tmp_path, tmp_path / 'x.npy')
    _, trials = import_json(tmp_path, tmp_path / 'x.npy', '--rate-hz', 100)
    np.testing.assert_array_equal(trials.x[:, 0], x)
    assert trials.label.tolist() == labels
    (tmp_path / 'words.csv').write_text('\n'.join(['material', *labels]))
    stated = ('--rate-hz', 100, '--labels', tmp_path / 'words.csv')
    assert import_json(tmp_path, tmp_path / 'x.npy', *stated)[1].label.tolist() == labels
    np.savez(tmp_path / 'Xy.npz', X=x, y=labels, fs=100)
    found, trials = import_json(tmp_path, tmp_path / 'Xy.npz')
    np.testing.assert_array_equal(trials.x[:, 0], x)
    assert 'Xy.npz: X used as x' in found['notes']


STORE = get_typestore(Stores.ROS2_HUMBLE)


def write_bag(path, plugin, topic, messages):
    """Write pairs of stamp [ns] and message to a bag with rosbags."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        first = messages[0][1]
        connection = writer.add_connection(topic, first.__msgtype__, typestore=STORE)
        for stamp_ns, message in messages:
            data = STORE.serialize_cdr(message, message.__msgtype__)
            writer.write(connection, stamp_ns, data)


def header(stamp_ns):
    types = STORE.types
    time = types['builtin_interfaces/msg/Time'](stamp_ns // 10**9, stamp_ns % 10**9)
    return types['std_msgs/msg/Header'](time, 'ft')


def wrench(stamp_ns, force_n):
    types = STORE.types
    vector = types['geometry_msgs/msg/Vector3']
    inner = types['geometry_msgs/msg/Wrench'](vector(3.0, 4.0, force_n), vector(0.0, 0.0, 0.0))
    return types['geometry_msgs/msg/WrenchStamped'](header(stamp_ns), inner)


def effort(stamp_ns, force_n):
    both = np.array([0.0, force_n])
    return STORE.types['sensor_msgs/msg/JointState'](
        header(stamp_ns), ['guide', 'tendon'], both, both, both
    )


def number(stamp_ns, force_n):
    return STORE.types['std_msgs/msg/Float64'](force_n)


def stamped(make, time_s, tension_n):
    stamps = (10**18 + np.rint(time_s * 1e9)).astype(np.int64).tolist()
    return [(t, make(t, f)) for t, f in zip(stamps, tension_n.tolist(), strict=True)]


@pytest.mark.parametrize(
    ('make', 'field', 'plugin'),
    [
        (wrench, 'force.z', StoragePlugin.SQLITE3),
        (effort, 'effort.tendon', StoragePlugin.MCAP),
        (number, None, StoragePlugin.MCAP),
    ],
)
def test_bags_of_other_software(tmp_path, make, field, plugin):
    for label, i, time_s, tension_n in all_holds(2):
        messages = stamped(make, time_s, tension_n)
        write_bag(tmp_path / 'bags' / label / f'run_{i}', plugin, '/ft', messages)
    if field is not None:
        assert '--field' in refusal(tmp_path, tmp_path / 'bags')
        assert 'effort.z' in refusal(tmp_path, tmp_path / 'bags', '--field', 'effort.z')
    stated = ('--field', field) if field else ()
    found, trials = import_json(tmp_path, tmp_path / 'bags', *stated)
    assert found['labels'] == {'pla': 2, 'rubber': 2}
    check_holds(trials, 2, column='source', pattern='bags/{label}/run_{i}')
    assert 'no topic /other' in refusal(tmp_path, tmp_path / 'bags', '--topic', '/other')


def test_duplicate_and_unordered_messages_are_reported(tmp_path):
    for label, i, time_s, tension_n in all_holds(2):
        messages = stamped(wrench, time_s, tension_n)
        messages = [*messages[:50], messages[51], messages[50], messages[50], *messages[52:]]
        bag = [(10**18 + k, message) for k, (_, message) in enumerate(messages)]
        write_bag(tmp_path / label / f'{i}', StoragePlugin.MCAP, '/ft', bag)
    paths = [tmp_path / label for label in SLOPES]
    found, trials = import_json(tmp_path, *paths, '--field', 'force.z,force.norm')
    check_holds(trials, 2)
    np.testing.assert_allclose(
        trials.x[:, 1], np.hypot(5.0, trials.x[:, 0]) * (trials.x[:, 0] != 0)
    )
    assert any('out of order' in note for note in found['notes'])
    assert any('with repeated stamps' in note for note in found['notes'])


EVEN_S = np.arange(200) / RATE_HZ


def line(label, i, time_s=EVEN_S):
    return SLOPES[label] * time_s + i


def write_lines(folder, pla_s, rubber_s):
    """Write three trials per label with these times [s]; return the folder."""
    for label, time_s in (('pla', pla_s), ('rubber', rubber_s)):
        for i in range(3):
            rows = rows_of(time_s, line(label, i, time_s), '{!r},{!r}')
            save_rows(folder / label / f'{i}.csv', ['time_s,force_n', *rows])
    return folder


def test_missing_samples_and_jitter_are_interpolated_and_reported(tmp_path):
    folder = write_lines(tmp_path / 'lost', EVEN_S, np.delete(EVEN_S, [50, 51, 120]))
    found, trials = import_json(tmp_path, folder)
    assert any('3 of 6 trials have uneven stamps' in note for note in found['notes'])
    assert trials.lengths.tolist() == [200] * 6
    for row in range(6):  # interpolation does not change a straight line
        np.testing.assert_allclose(trials.x[row, 0], line(trials.label[row], row % 3), atol=1e-12)


def test_rate_that_contradicts_the_stamps_is_refused(tmp_path):
    folder = write_lines(tmp_path / 'a', EVEN_S, EVEN_S)
    assert 'say 100 Hz' in refusal(tmp_path, folder, '--rate-hz', 60)
    assert import_json(tmp_path, folder, '--rate-hz', 100.2)[1].rate_hz == 100.2
    assert '--resample-hz' in refusal(tmp_path, folder, '--rate-hz', 60)


def test_each_rate_is_named_with_its_files(tmp_path):
    said = refusal(tmp_path, write_lines(tmp_path / 'b', EVEN_S, 2.0 * EVEN_S))
    for rate, label in ((100, 'pla'), (50, 'rubber')):
        files = ', '.join(f'b/{label}/{i}.csv' for i in range(3))
        assert f'{rate} Hz ({files})' in said
    assert 'use recordings of one rate at a time' in said
    assert '75 Hz' not in said  # this rate does not occur in any file
    assert '--resample-hz' not in said  # `import` has no such option
    lines = ['label,trial,time_s,force_n']
    for trial, step_s in enumerate((0.01, 0.01, 0.02)):
        lines += [f'pla,{trial},{i * step_s!r},{i % 7}' for i in range(50)]
    said = refusal(tmp_path, save_rows(tmp_path / 'rates.csv', lines))
    assert 'different rates: 100 Hz (trial 0, trial 1), 50 Hz (trial 2); use' in said


@pytest.mark.filterwarnings('error:.*:RuntimeWarning')
def test_properties_of_float32_signals_are_reported(tmp_path):
    x = np.random.default_rng(0).normal(size=(16, 2, 3)).astype(np.float32)
    x[2, 1] = 1.0
    np.savez(tmp_path / 'odd.npz', x=x, label=['a', 'b'] * 8, rate_hz=50.0)
    found, _ = import_json(tmp_path, tmp_path / 'odd.npz')
    assert 'warning: channel channel_1 is constant in 1 trial (2)' in found['notes']
    assert any('fewer than 16 samples in 16 trials' in note for note in found['notes'])
    for task in ('texture', 'stiffness'):
        options = ('--task', task, '--folds', 2, '--repetitions', 1)
        said = hear_tactile('evaluate', tmp_path / 'odd.npz', *options)
        assert 'fewer than 16 samples' in said
        assert 'channel channel_1 is constant' in said


def test_recordings_of_different_kinds_are_not_mixed(tmp_path, long_table):
    np.save(tmp_path / 'x.npy', np.zeros((2, 3)))
    assert 'several kinds' in refusal(tmp_path, long_table, tmp_path / 'x.npy')


def test_train_and_evaluate_accept_the_same_recordings_as_import(tmp_path, long_table):
    common = ('--task', 'stiffness', '--folds', 2, '--repetitions', 1)
    import_json(tmp_path, long_table)
    (found,) = ask_tactile('evaluate', tmp_path / 'imported.npz', *common)['sets']
    to = ('-o', tmp_path / 'models', '--classifier', 'knn')
    (trained,) = ask_tactile('train', long_table, *to, *common)['models']
    (same,) = (e for e in found['evaluations'] if e['split'] == trained['evaluation']['split'])
    assert trained['evaluation']['scores'] == same['scores']
    model = load_model(tmp_path / 'models' / 'stiffness.npz')
    assert model.model_id == trained['model_id']
    assert model.contact == ''


def test_features_as_tables_with_units(tmp_path, long_table):
    common = ('--task', 'stiffness', '--group', 'session_id')
    files = {suffix: tmp_path / f'features.{suffix}' for suffix in ('parquet', 'csv')}
    for file in files.values():
        hear_tactile('features', long_table, '-o', file, *common)
    table = pyarrow.parquet.read_table(files['parquet'])
    known = ['source', 'trial', 'label', 'session', 'group', 'simulated']
    assert table.column_names[:6] == known
    units = [field.metadata[b'unit'].decode() for field in list(table.schema)[6:]]
    assert units == ['N/s', 'N', '1']
    assert json.loads(table.schema.metadata[b'tactile'])['feature_set'] == 'stiffness_regression'
    assert table['label'].to_pylist() == ['rubber'] * 6 + ['pla'] * 6
    assert table['group'].to_pylist() == ['0', '1', '0', '1', '0', '1'] * 2
    text = pyarrow.csv.read_csv(files['csv'])
    names = table.column_names[6:]
    assert text.column_names[6:] == [f'{n} [{u}]' for n, u in zip(names, units, strict=True)]
    for name, stated in zip(names, text.column_names[6:], strict=True):
        assert text[stated].to_pylist() == table[name].to_pylist()  # CSV contains all digits
    # Expected: the least-squares line of each trial, truncated to the length of the shortest one.
    for row, (_, _, time_s, tension_n) in enumerate(all_holds()):
        slope = np.polyfit(time_s[:240], tension_n[:240], 1)[0]
        assert table[names[0]].to_pylist()[row] == pytest.approx(slope, rel=1e-9)
    assert '--force' in hear_tactile('features', long_table, '-o', files['csv'], *common, code=2)


def test_features_of_our_bags_have_a_file_for_each_kind(texture_bag, stiffness_bag, tmp_path):
    hear_tactile('features', texture_bag, stiffness_bag, '-o', tmp_path / 'f.parquet')
    table = pyarrow.parquet.read_table(tmp_path / 'f_texture_flexion.parquet')
    assert set(table['simulated'].to_pylist()) == {True}
    assert table.num_rows == 32
    assert (tmp_path / 'f_stiffness_flexion.parquet').exists()
    assert 'read it directly' in refusal(tmp_path, texture_bag)


def test_equal_trial_numbers_in_different_sessions_are_different_trials(tmp_path):
    lines = ['session,label,trial,time_s,force_n']
    for session in (1, 2):
        for label in SLOPES:
            lines += rows_of(*hold(label, session, 50), f'{session},{label},0,{{!r}},{{!r}}')
    found, trials = import_json(tmp_path, save_rows(tmp_path / 'sessions.csv', lines))
    assert trials.lengths.tolist() == [50] * 4
    assert trials.columns['session_id'].tolist() == [1, 1, 2, 2]
    assert 'trials are distinguished by session and label and trial together' in found['notes']
