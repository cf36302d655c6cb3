# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""YAML files of anybody are read, or refused with a sentence."""

from contextlib import suppress
import os

from hypothesis import given
from hypothesis import strategies as st
import pytest

from tactile_ros.errors import TactileError
from tactile_ros.yaml_files import load_yaml, MAX_DEPTH, read_text


@given(st.text(alphabet='ab:{}[]-&*!|> \n"\'0123456789.', max_size=200))
def test_any_text_is_yaml_or_refused(text):
    with suppress(TactileError):
        load_yaml(text)


def test_a_number_to_base_60_is_a_text():
    assert load_yaml('{a: 1:30, b: 1_000, c: 1.5, d: 1:30.5}') == {
        'a': '1:30',
        'b': 1000,
        'c': 1.5,
        'd': '1:30.5',
    }


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('a: &x [1]\nb: *x', 'it has YAML aliases'),
        ('[' * (MAX_DEPTH + 1), 'nested deeper than 32 levels'),
        ('a: [1', 'it is no YAML'),
        ('!!python/object:os.system {}', 'it is no YAML'),
    ],
)
def test_a_text_that_cannot_be_read_says_why(text, why):
    with pytest.raises(TactileError, match=why):
        load_yaml(text)


def test_what_is_no_readable_file_says_why(tmp_path):
    (tmp_path / 'long').write_text('a: 1234567')
    (tmp_path / 'bytes').write_bytes(b'\xff')
    os.mkfifo(tmp_path / 'pipe')
    assert read_text(tmp_path / 'long', 10) == 'a: 1234567'
    for name, why in {
        'long': 'larger than 9 bytes',
        'bytes': 'not UTF-8',
        'pipe': 'no file',
        'none': 'No such file',
    }.items():
        with pytest.raises(TactileError, match=why):
            read_text(tmp_path / name, 9)
