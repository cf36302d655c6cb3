# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the documents say must be what the code does."""

import importlib
from pathlib import Path
import re

from ament_index_python.packages import get_package_share_directory
import pytest

from tactile_bringup.launch_config.parameter_tables import renew
import tactile_sim

README = Path(__file__).resolve().parents[4] / 'README.md'
UNITLESS = (
    *('bool', 'string', 'uint8', 'uint32', 'std_msgs/Header', 'builtin_interfaces/Time'),
    'Measure',
)


@pytest.fixture
def docs():
    """Return the folder of the documents."""
    folder = README.with_name('docs')
    if not folder.is_dir():
        pytest.skip('the packages are not in their own repository: no docs beside them')
    return folder


def test_tables_in_the_docs_are_those_of_the_code(docs):
    text = (docs / 'parameters.md').read_text()
    assert renew(text) == text, (
        'renew them: ./tactile run python -m tactile_bringup.launch_config.parameter_tables '
        'docs/parameters.md'
    )


def test_constants_in_the_docs_are_those_of_the_simulator(docs, monkeypatch):
    monkeypatch.syspath_prepend(str(docs))
    constants = importlib.import_module('constants')
    text = (docs / 'simulator_constants.md').read_text()
    config = Path(tactile_sim.__file__).parent / 'config'
    assert constants.replace_tables(text, constants.build_tables(config)) == text, (
        'renew them: ./tactile run python docs/generate.py'
    )


def test_the_page_on_interfaces_is_that_of_the_definitions(docs, monkeypatch):
    package = README.with_name('src') / 'tactile_msgs'
    monkeypatch.syspath_prepend(str(docs))
    interfaces = importlib.import_module('interfaces')
    assert interfaces.build_page(package) == (docs / 'interfaces.md').read_text(), (
        'renew it: ./tactile run python docs/generate.py'
    )


def test_the_promises_of_motion_name_tests_that_exist(docs):
    table = (docs / 'motion.md').read_text().split('## Promises and their tests')[1]
    table = table.split('\n## ')[0]
    root, driver = README.parent, README.with_name('src') / 'linear_guide_driver' / 'test'
    path = None
    for name in re.findall(r'`([^`]+)`', table):
        file, _, test = name.partition('::')
        if file.endswith('.py'):
            bases = (driver, root) if path is None else (driver, root, path.parent)
            path = next((base / file for base in bases if (base / file).is_file()), None)
            assert path is not None, f'{file} is not there'
        if test:
            assert f'def {test}(' in path.read_text(), f'{path} has no {test}'


def test_every_page_is_in_the_index(docs):
    index = (docs / 'index.md').read_text()
    missing = [page.name for page in docs.glob('*.md') if f'({page.name})' not in index]
    assert missing == ['index.md']


def interface_fields():
    share = Path(get_package_share_directory('tactile_msgs'))
    for path in sorted([*share.glob('msg/*.msg'), *share.glob('action/*.action')]):
        for line in path.read_text().splitlines():
            match = re.match(r'([\w/]+)(\[\])? +(\w+) *(=[^#]*)?(#.*)?$', line)
            if match:
                yield f'{path.stem}.{match[3]}', match.groups(default='')


def test_every_field_says_what_it_is_and_in_which_unit():
    for name, (type_name, _, _, constant, comment) in interface_fields():
        if constant:
            continue
        assert len(comment) > 10, f'{name} has no comment'
        if type_name not in UNITLESS:
            assert re.search(r'\[(s|ns|N|m|m/s|A|1|Hz)\]|own unit|units|scores?', comment), (
                f'the comment of {name} names no unit'
            )
