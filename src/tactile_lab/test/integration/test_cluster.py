# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands on a Dask cluster of two workers have the same results as in one process."""

import hashlib

import pytest
from tactile_command import ask_tactile, hear_tactile

distributed = pytest.importorskip(
    'distributed', reason='Dask is an extra: tendon-tactile[cluster]'
)
pytest.importorskip('joblib', '1.4', reason='--cluster needs joblib 1.4 or later')


@pytest.fixture(scope='module')
def address():
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    )
    with cluster:
        yield cluster.scheduler_address


def digests(folder):
    files = sorted(path for path in folder.rglob('*') if path.is_file())
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def without_times(found):
    """Return a result without the times of fits, which differ in every run."""
    if isinstance(found, dict):
        return {
            name: without_times(each)
            for name, each in found.items()
            if name not in ('fold_s', 'time_ratio')
        }
    return [without_times(each) for each in found] if isinstance(found, list) else found


def test_results_of_two_workers_equal_results_of_one_process(address, tmp_path):
    plan = ('simulate', 'stiffness', '--contact', 'flexion', '--trials', 2, '--sessions', 2)
    hear_tactile(*plan, '-o', tmp_path / 'one', '--jobs', 1)
    hear_tactile(*plan, '-o', tmp_path / 'two', '--cluster', address)
    found = digests(tmp_path / 'two')
    assert len(found) >= 2
    assert found == digests(tmp_path / 'one')

    bag, quick = tmp_path / 'one' / 'stiffness_flexion', ('--folds', 2, '--repetitions', 1)
    here, there = (
        ask_tactile('evaluate', bag, *quick, '--cluster', where) for where in ('', address)
    )
    assert here['sets'][0]['trials'] == 20
    assert without_times(there) == without_times(here)

    told = []
    for folder, where in (('here', ''), ('there', address)):
        options = ('-o', tmp_path / folder, *quick, '--classifier', 'knn', '--cluster', where)
        (model,) = ask_tactile('train', bag, *options)['models']
        told.append(model['evaluation'])
    assert told[0] == told[1]


def test_address_without_a_scheduler_is_refused_in_one_sentence(tmp_path):
    wrong = ('simulate', 'texture', '-o', tmp_path / 'x', '--cluster', 'nonsense://1')
    assert 'tactile: no Dask scheduler responds at nonsense://1' in hear_tactile(*wrong, code=2)
