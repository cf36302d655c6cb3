# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands on a real Dask cluster of two workers give the bits of one process."""

import hashlib
import json

import pytest
from tactile_command import tactile

distributed = pytest.importorskip(
    'distributed', reason='Dask is an extra: tendon-tactile[cluster]'
)


@pytest.fixture(scope='module')
def address():
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    )
    with cluster:
        yield cluster.scheduler_address


def run(*arguments, code=0):
    done = tactile(*arguments)
    assert done.returncode == code, done.stderr
    return done.stdout if code == 0 else done.stderr


def digests(folder):
    files = sorted(path for path in folder.rglob('*') if path.is_file())
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_two_workers_give_the_bits_of_one_process(address, tmp_path):
    plan = ['simulate', 'texture', '--contact', 'flexion', '--trials', 3, '--sessions', 2]
    run(*plan, '-o', tmp_path / 'one', '--jobs', 1)
    run(*plan, '-o', tmp_path / 'two', '--cluster', address)
    found = digests(tmp_path / 'two')
    assert len(found) >= 2
    assert found == digests(tmp_path / 'one')

    bag = tmp_path / 'one' / 'texture_flexion'
    evaluation = ['evaluate', bag, '--folds', 2, '--repetitions', 1, '--json']
    here = json.loads(run(*evaluation))
    there = json.loads(run(*evaluation, '--cluster', address))
    assert here['sets'][0]['trials'] == 48
    assert there == here

    told = []
    for folder, where in (('here', ()), ('there', ('--cluster', address))):
        options = ['-o', tmp_path / folder, '--folds', 2, '--repetitions', 1, '--json']
        options += ['--classifier', 'knn']
        (model,) = json.loads(run('train', bag, *options, *where))['models']
        told.append(model['evaluation'])
    assert told[0] == told[1]


def test_an_address_where_nobody_answers_is_one_sentence(tmp_path):
    wrong = ['simulate', 'texture', '-o', tmp_path / 'x', '--cluster', 'nonsense://1']
    assert 'tactile: no Dask scheduler answers at nonsense://1' in run(*wrong, code=2)
