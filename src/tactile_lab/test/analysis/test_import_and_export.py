# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exported trials are imported unchanged; missing information is reported first."""

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
from tactile_command import ask_tactile, hear_tactile, tactile
import yaml

from tactile_analysis import TrialSet
from tactile_classifier.datasets.dataset import table_from_trials
from tactile_classifier.model_file.model import load_model
from tactile_testing.recordings import Archive


def test_exported_trials_of_bags_are_imported_unchanged(stiffness_bag, tmp_path):
    table = tmp_path / 'trials.csv'
    found = ask_tactile('export', stiffness_bag, '-o', table)
    assert found['trials'] == 15
    names = ['trial', 'label', 'session_id', 'mounting_id', 'time_s', 'tension_n']
    assert found['columns'][:6] == names
    assert 'already exists' in hear_tactile('export', stiffness_bag, '-o', table, code=2)
    imported = ask_tactile('import', table, '-o', tmp_path / 'trials.npz')
    assert imported['unit'] == 'N'
    assert imported['rate_hz'] == 60.0
    back = Archive(tmp_path / 'trials.npz')
    with TrialSet.load(stiffness_bag) as recording:
        recording.save(tmp_path / 'whole.npz')
        assert len(back) == len(recording.trials)
        for row, trial in enumerate(recording.trials):
            np.testing.assert_array_equal(
                back.x[row, 0, : back.lengths[row]], trial.signal.values[0]
            )
            assert back.label[row] == trial.label
            assert back.columns['session_id'][row] == trial.session_id
            assert back.columns['mounting_id'][row] == trial.mounting_id
    whole = Archive(tmp_path / 'whole.npz')
    np.testing.assert_array_equal(back.x, whole.x)
    for name in ('trial', 'contact', 'task', 'glide_speed_m_s'):
        assert back.columns[name].tolist() == whole.columns[name].tolist()


def test_exported_table_has_units_and_a_dataset_card(stiffness_bag, tmp_path):
    hear_tactile('export', stiffness_bag, '-o', tmp_path / 'trials.parquet')
    table = pyarrow.parquet.read_table(tmp_path / 'trials.parquet')
    assert table.schema.field('tension_n').metadata[b'unit'] == b'N'
    assert table.schema.field('time_s').metadata[b'unit'] == b's'
    card = (tmp_path / 'trials.md').read_text()
    _, head, body = card.split('---\n', 2)
    stated = yaml.safe_load(head)
    assert stated['license'] == 'unknown'
    assert stated['configs'] == [{'config_name': 'default', 'data_files': 'trials.parquet'}]
    assert {'tactile', 'stiffness', 'simulated'} <= set(stated['tags'])
    assert stated['pretty_name'].startswith('SIMULATED')
    stated = ('| trials | 15 |', '| sessions | 1 |', '60 Hz', 'tension_n [N]', '## Licence')
    assert all(text in body for text in stated), body
    assert str(tmp_path) not in card
    assert set(table['bag'].to_pylist()) == {stiffness_bag.name}
    assert table.schema.field('glide_speed_m_s').metadata[b'unit'] == b'm/s'
    assert '| `label` | string |  |' in card


def write_trials(folder, heading='force_mN', *, rate=True, group='session'):
    """Write three trials of two labels in two sessions as one table; return it."""
    lines = [f'label,{group},trial,{"time_s," if rate else ""}{heading}']
    rng = np.random.default_rng(4)
    for label in ('pla', 'rubber'):
        for session in (1, 2):
            for trial in range(3):
                for i, value in enumerate(rng.normal(size=40).tolist()):
                    time = f'{i / 100},' if rate else ''
                    lines.append(f'{label},{session},{trial},{time}{value!r}')
    path = folder / 'table.csv'
    path.write_text('\n'.join(lines))
    return path


def test_import_draws_trials_and_prints_missing_information_and_the_next_command(tmp_path):
    table, picture = write_trials(tmp_path), tmp_path / 'trials.svg'
    archive = tmp_path / 'lab.npz'
    found = ask_tactile('import', table, '-o', archive, '--plot', picture)
    assert found['unit'] == 'N'
    assert 'force: converted from mN to N' in found['notes']
    assert not any(note.startswith('unknown') for note in found['notes'])
    stated = f'tactile evaluate {archive} --task texture (or stiffness) --group session_id'
    assert found['next'] == stated
    drawn = picture.read_text()
    assert drawn.count('signal [N]') == 3
    assert 'window' in drawn
    table = write_trials(tmp_path, 'force')
    done = tactile('import', table, '-o', archive, '--force')
    assert done.stdout.startswith('unknown: unit of the signal (--unit N)\n')
    table = write_trials(tmp_path, 'force', rate=False)
    assert '--rate-hz' in hear_tactile('import', table, '-o', tmp_path / 'b.npz', code=2)


GROUP_COLUMNS = (
    'day',
    'subject',
    'specimen',
    'Subject ID',
    'sessionNumber',
    'participant',
    'run_1',
)


@pytest.mark.parametrize('group', GROUP_COLUMNS)
def test_import_suggests_to_hold_out_columns_named_like_groups(tmp_path, group):
    found = ask_tactile('import', write_trials(tmp_path, group=group), '-o', tmp_path / 'a.npz')
    assert found['next'].endswith(f'--group {group}')


def test_import_names_other_columns_that_can_be_held_out(tmp_path):
    label = np.repeat(['a', 'b'], 8)
    arrays = {'x': np.random.default_rng(1).normal(size=(16, 60)), 'label': label, 'rate_hz': 60.0}
    np.savez(tmp_path / 'rigs.npz', **arrays, rig=np.arange(16) % 4)
    found = ask_tactile('import', tmp_path / 'rigs.npz', '-o', tmp_path / 'a.npz')
    assert '--group' not in found['next']
    assert found['remarks'][0].endswith('hold them out: --group rig')
    groups = {'specimen': label, 'day': np.arange(16) % 4, 'subject': np.arange(16) % 2}
    np.savez(tmp_path / 'groups.npz', **arrays, **groups)
    found = ask_tactile('import', tmp_path / 'groups.npz', '-o', tmp_path / 'b.npz')
    assert found['next'].endswith('--group day')
    impossible, further = found['remarks']
    assert 'column specimen' in impossible
    assert '--group subject' in further


def test_used_and_unused_channels_are_printed(tmp_path):
    rng = np.random.default_rng(3)
    lines = ['label,trial,time_s,fx_N,fy_N,fz_N']
    for trial in range(12):
        for i, (a, b, c) in enumerate(rng.normal(size=(60, 3)).tolist()):
            lines.append(f'{"pla" if trial % 2 else "rubber"},{trial},{i / 60},{a},{b},{c}')
    (tmp_path / 'table.csv').write_text('\n'.join(lines))
    columns = ('--force-column', 'fx_N,fy_N,fz_N')
    said = hear_tactile('import', tmp_path / 'table.csv', '-o', tmp_path / 'a.npz', *columns)
    assert 'channel fx_N; other channels (fy_N, fz_N)' in said
    options = ('--task', 'texture', '--repetitions', 1)
    used = 'channel: fx_N; not used: fy_N, fz_N'
    assert used in hear_tactile('evaluate', tmp_path / 'a.npz', *options)
    stated = ('--features', 'texture_spectrum')
    for name, more in (('table.csv', columns), ('a.npz', stated)):  # `train` also reads the table
        train = (tmp_path / name, '-o', tmp_path / 'm', *options, '--force')
        assert used in hear_tactile('train', *train, *more)
        assert used in hear_tactile('show', tmp_path / 'm' / 'texture.npz')
    default = load_model(tmp_path / 'm' / 'texture.npz').spec
    back = Archive(tmp_path / 'a.npz')
    stated = {'channels': back.channels, 'unit': back.unit}
    table = table_from_trials('texture', back.x, back.label, back.rate_hz, **stated)
    assert default.digest == table.spec.digest
    hear_tactile('train', *train, '--classifier', 'knn', '--channel', 'mean')
    mean = load_model(tmp_path / 'm' / 'texture.npz').spec
    assert (mean.channel, mean.digest != default.digest) == ('mean', True)


def test_import_proposes_columns_for_the_label(tmp_path):
    table = write_trials(tmp_path)
    table.write_text(table.read_text().replace('label,', 'material,', 1))
    said = hear_tactile('import', table, '-o', tmp_path / 'a.npz', code=2)
    assert '--label-column material' in said
    hear_tactile('import', table, '-o', tmp_path / 'a.npz', '--label-column', 'material')
