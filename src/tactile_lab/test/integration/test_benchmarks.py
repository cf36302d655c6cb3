# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks run, and the errors that they report stay within their bounds.

Times are not looked at: they are the machine's.
"""

import importlib
import json
from pathlib import Path
import subprocess
import sys

import pytest

REPOSITORY = Path(__file__).resolve().parents[4]

CHEAP = {
    'spectrum': {'1 x 180': 2e-15, '480 x 180': 2e-15, 'offset 1e6 N': 2e-15},
    'regression': {
        '480 x 204': 1e-15,
        'offset 1e6 N, 1e-6 N/s': 1e-15,
        'times since 1970': 1e-15,
        'a step of 1 ulp': 1e-15,
    },
    'extractor': {'single samples': 0, 'blocks of 12 samples': 0},
}

needs_benchmarks = pytest.mark.skipif(
    not (REPOSITORY / 'benchmarks').is_dir(),
    reason='the packages are not in their own repository: no benchmarks beside them',
)


@pytest.fixture(scope='module')
def reports():
    only = [argument for topic in CHEAP for argument in ('--only', topic)]
    done = subprocess.run(
        [sys.executable, '-m', 'benchmarks', '--quick', '--json', *only],
        capture_output=True,
        cwd=REPOSITORY,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@needs_benchmarks
def test_errors_are_within_their_bounds(reports):
    found = {
        topic: {row['case']: row for row in report['rows']} for topic, report in reports.items()
    }
    for topic, cases in CHEAP.items():
        for case, bound in cases.items():
            assert found[topic][case]['error'] <= found[topic][case]['bound'] == bound, case


@needs_benchmarks
def test_the_reference_tells_a_lossy_computation(reports):
    """A benchmark that calls everything exact would pass all bounds."""
    for topic, case in (('spectrum', 'offset 1e6 N'), ('regression', 'times since 1970')):
        rows = {row['case']: row for row in reports[topic]['rows']}
        assert rows[case]['floor_error'] > 1e-12


@needs_benchmarks
def test_every_ratio_lies_between_its_quartiles(reports):
    ratios = [row['ratio'] for report in reports.values() for row in report['rows']]
    measured = [ratio for ratio in ratios if ratio]
    assert len(measured) >= 2 * len(CHEAP)
    for ratio in measured:
        assert 0 < ratio['low'] <= ratio['median'] <= ratio['high']


@needs_benchmarks
def test_the_hard_plates_are_fixed_by_their_description(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(REPOSITORY)
    hard = importlib.import_module('benchmarks.accuracy.twelve_plates')
    hard.write_plates(tmp_path / 'plates.yaml')
    shipped = hard.FOLDER / 'plates.yaml'
    assert (tmp_path / 'plates.yaml').read_bytes() == shipped.read_bytes()
    labels = [name for name in hard.Catalogue(hard.FOLDER).labels('texture') if name[0] == 'P']
    assert len(labels) == 12
