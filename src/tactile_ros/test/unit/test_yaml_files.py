# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each YAML text is either read or refused with a message, also if it is malicious."""

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


def test_a_number_needs_no_decimal_point_before_its_exponent():
    assert load_yaml('[1e-3, -2E+4, 1.5e2, 0e0]') == [0.001, -20000.0, 150.0, 0.0]
    assert load_yaml('[1e, e3, 0x1e3]') == ['1e', 'e3', 0x1E3]


@pytest.mark.parametrize(
    ('text', 'named'),
    [
        ('a: &x [1]\nb: *x', 'alias'),
        ('[' * (MAX_DEPTH + 1), '32'),
        ('a: [1', 'YAML'),
        ('!!python/object:os.system {}', 'YAML'),
        ('a: 1\nb: 2\na: 3', "'a' occurs twice.* line 3"),
        ('a: {b: {c: 1, c: 2}}', "'c' occurs twice"),
        ('a: 1\n---\nb: 2', 'document'),
        ('a: "\\UFFFFFFFF"', 'YAML'),
        ('a: ' + '9' * 100_000, 'YAML'),
        ('- ' * 100_000, 'nested'),
    ],
)
def test_a_text_that_cannot_be_read_says_why(text, named):
    with pytest.raises(TactileError, match=named):
        load_yaml(text)


def test_what_is_no_readable_file_says_why(tmp_path):
    (tmp_path / 'long').write_text('a: 1234567')
    (tmp_path / 'bytes').write_bytes(b'\xff')
    os.mkfifo(tmp_path / 'pipe')
    assert read_text(tmp_path / 'long', 10) == 'a: 1234567'
    for name, named in {'long': '9', 'bytes': 'UTF-8', 'pipe': '', 'none': ''}.items():
        with pytest.raises(TactileError, match=named):
            read_text(tmp_path / name, 9)
