# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks run, and the numerical errors that they report stay within their bounds.

Times are not tested, because they depend on the computer.
"""

import importlib
from importlib.util import find_spec
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[4]
if not (REPOSITORY / 'benchmarks').is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)

BOUNDS = {
    'spectrum': {'480 x 180': 2e-15, 'offset 1e6 N': 2e-15},
    'regression': {'480 x 204': 1e-15, 'offset 1e6 N, 1e-6 N/s': 1e-15},
}
LOSSY = {'spectrum': 'offset 1e6 N', 'regression': 'offset 1e6 N, 1e-6 N/s'}
"""For each topic, a case whose error must not be zero. A benchmark that reports only zeros would
be wrong."""


@pytest.fixture
def topics(monkeypatch):
    monkeypatch.syspath_prepend(REPOSITORY)
    return {topic.name: topic for topic in importlib.import_module('benchmarks.topics').TOPICS}


def test_every_topic_is_listed(topics):
    for topic in topics.values():
        if topic.module != 'simulator.twin' or find_spec('mujoco'):
            assert callable(topic.find())


@pytest.mark.parametrize('name', BOUNDS)
def test_errors_of_kernels_are_within_their_bounds(topics, name):
    rows = {row.case: row for row in topics[name].find()(True).rows}
    for case, bound in BOUNDS[name].items():
        assert rows[case].error <= rows[case].bound == bound
    assert rows[LOSSY[name]].floor_error > 1e-12
    ratios = [row.ratio for row in rows.values() if row.ratio]
    assert ratios
    assert all(0 < ratio.low <= ratio.median <= ratio.high for ratio in ratios)
