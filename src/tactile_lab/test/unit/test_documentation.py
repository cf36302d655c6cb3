# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The documentation agrees with the code, and its links exist."""

import importlib
from pathlib import Path
import re

import pytest

from tactile_bringup.launch_config.parameter_files import ParameterFile
import tactile_sim

ROOT = Path(__file__).resolve().parents[4]
DOCS = ROOT / 'docs'
if not DOCS.is_dir():
    pytest.skip('the packages are not in their own repository', allow_module_level=True)

PAGES = [*ROOT.glob('*.md'), *DOCS.rglob('*.md')]
INTERFACES = sorted((ROOT / 'src' / 'tactile_msgs').glob('*/*.*'))
UNITLESS = {
    'bool',
    'FeatureSpecification',
    'ModelInfo',
    'string',
    'uint8',
    'uint32',
    'std_msgs/Header',
    'builtin_interfaces/Time',
}


def yaml_blocks(page):
    return re.findall(r'^```yaml\n(.*?)^```', page.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(
    'text',
    [
        pytest.param(text, id=f'{page.name} {number}')
        for page in PAGES
        for number, text in enumerate(yaml_blocks(page), 1)
        if 'ros__parameters' in text
    ],
)
def test_parameter_files_of_the_pages_can_be_copied(text, parameter_file):
    ParameterFile(parameter_file(text))


def test_generated_tables_equal_the_code(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    names = ('constants', 'interfaces', 'parameters')
    constants, interfaces, parameters = map(importlib.import_module, names)
    text = (DOCS / 'simulator_constants.md').read_text()
    config = Path(tactile_sim.__file__).parent / 'config'
    renewal = 'renew them: ./tactile run python docs/generate.py'
    tables = constants.build_tables(config)
    assert constants.replace_tables(text, 'constants', tables) == text, renewal
    text = (DOCS / 'parameters.md').read_text()
    assert parameters.replace_all_tables(text) == text, renewal
    page = interfaces.build_page(ROOT / 'src' / 'tactile_msgs')
    assert page == (DOCS / 'interfaces.md').read_text(), renewal


def test_promises_in_motion_md_name_existing_tests():
    table = (DOCS / 'motion.md').read_text().split('## Promises and their tests')[1]
    table = table.split('\n## ')[0]
    driver = ROOT / 'src' / 'linear_guide_driver' / 'test'
    path = None
    for name in re.findall(r'`([^`]+)`', table):
        file, _, test = name.partition('::')
        if file.endswith('.py'):
            bases = (driver, ROOT) if path is None else (driver, ROOT, path.parent)
            path = next((base / file for base in bases if (base / file).is_file()), None)
            assert path is not None, f'{file} is not there'
        if test:
            assert f'def {test}(' in path.read_text(), f'{path} has no {test}'


def anchors(page):
    """Return the anchors of the headings of a page, as GitHub makes them."""
    titles = re.findall(r'^#+ (.+)$', page.read_text(), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', title.lower()).replace(' ', '-') for title in titles}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_the_documentation_exist(page):
    for target in re.findall(r'\]\(([^)\s]+)\)', page.read_text()):
        if '://' not in target:
            name, _, anchor = target.partition('#')
            linked = page.parent / name if name else page
            assert linked.exists(), f'{target} is not there'
            assert not anchor or anchor in anchors(linked), f'{target} is not a heading'


def test_every_page_is_in_the_index():
    index = (DOCS / 'index.md').read_text()
    assert [p.name for p in DOCS.glob('*.md') if f'({p.name})' not in index] == ['index.md']


def interface_fields():
    for path in INTERFACES:
        for line in path.read_text().splitlines():
            match = re.match(r'([\w/]+)(?:\[\])? +(\w+)(?! *=) *(#.*)?$', line)
            if match:
                yield path.stem, *match.groups(default='')


def test_every_message_field_has_a_comment_with_its_unit():
    fields = list(interface_fields())
    assert len(fields) > 50
    for interface, type_name, name, comment in fields:
        assert len(comment) > 10, f'{interface}.{name} has no comment'
        if type_name not in UNITLESS:
            assert re.search(r'\[(s|ns|N|m|m/s|A|1|Hz)\]|units?|scores?', comment), (
                f'the comment of {interface}.{name} names no unit'
            )
