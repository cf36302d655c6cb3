# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The examples of the documentation run, and their pages contain their output."""

import importlib
from pathlib import Path
import sys

import pytest

from tactile_features.feature_sets.registry import find_feature_set

DOCS = Path(__file__).resolve().parents[4] / 'docs'
SCRIPTS = sorted((DOCS / 'examples').glob('*.py'))


def test_there_are_examples():
    assert SCRIPTS or not DOCS.is_dir()


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda script: script.stem)
def test_the_page_of_an_example_is_what_it_does(script, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'path', [str(DOCS), *sys.path])
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
