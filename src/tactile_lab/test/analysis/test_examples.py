# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The examples of the documentation run, and their pages contain their output."""

import importlib
from importlib.util import find_spec
import os
from pathlib import Path
import re
import sys

import pytest

from tactile_features.feature_sets.registry import find_feature_set

DOCS = Path(__file__).resolve().parents[4] / 'docs'
SCRIPTS = sorted((DOCS / 'examples').glob('*.py'))


@pytest.fixture(autouse=True)
def _domain(monkeypatch):
    """Give each example a ROS domain of its own, if the ROS nodes are installed."""
    if find_spec('domain_coordinator') is None:
        yield
        return
    from domain_coordinator import domain_id

    with domain_id() as domain:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        yield


def test_examples_exist():
    assert SCRIPTS or not DOCS.is_dir()


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda script: script.stem)
def test_page_of_an_example_contains_its_output(script, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'path', [str(DOCS), *sys.path])
    monkeypatch.delenv('TACTILE_DATA', raising=False)
    examples = importlib.import_module('examples')
    try:
        page = examples.build_page(script, tmp_path)
    finally:
        find_feature_set.cache_clear()
    assert page == script.with_suffix('.md').read_text(), (
        'renew it: ./tactile run python docs/examples.py'
    )
    notebook = script.with_suffix('.ipynb').read_text()
    assert examples.build_notebook(script) == notebook, (
        'renew it: ./tactile run python docs/examples.py'
    )
    for image in tmp_path.glob('*.png'):
        assert (DOCS / 'images' / image.name).is_file()


def test_accuracies_of_the_paper_protocol_on_public_recordings(tmp_path, monkeypatch):
    shared = Path(__file__).resolve().parents[5] / 'shared' / 'data'
    folder = Path(os.environ.get('TACTILE_DATA', shared))
    if not (folder / 'fabric_slide.npz').is_file():
        pytest.skip(f'no fabric_slide.npz in {folder}; set TACTILE_DATA to the folder that has it')
    monkeypatch.setattr(sys, 'path', [str(DOCS), *sys.path])
    monkeypatch.setenv('TACTILE_DATA', str(folder))
    examples = importlib.import_module('examples')
    page = examples.build_page(DOCS / 'examples' / 'paper_protocol.py', tmp_path)
    assert 'fabric_slide.npz (252, 180) 7 labels' in page
    measured = re.findall(r'^(.+?) +(not scaled|scaled) +([\d.]+) ±', page, re.MULTILINE)
    expected = {  # from the table in docs/real_recordings.md
        ('3 neighbours', 'scaled'): 61.0,
        ('3 neighbours', 'not scaled'): 90.0,
        ('SVM linear', 'scaled'): 63.5,
        ('SVM linear', 'not scaled'): 79.0,
        ('SVM RBF', 'scaled'): 58.0,
        ('SVM RBF', 'not scaled'): 68.8,
        ('tree', 'scaled'): 65.7,
        ('tree', 'not scaled'): 65.7,
    }
    assert {(name, scaling) for name, scaling, _ in measured} == expected.keys()
    for name, scaling, accuracy in measured:
        assert float(accuracy) == pytest.approx(expected[name, scaling], abs=2), (name, scaling)
