# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Atomic replacement of files."""

import os

import pytest

from tactile_ros.files import replace_file


def test_file_is_made_and_replaced_without_leaving_others(tmp_path):
    path = tmp_path / 'plan.yaml'
    for data in (b'first', b'second'):
        replace_file(path, data)
        assert path.read_bytes() == data
    assert list(tmp_path.iterdir()) == [path]


def test_file_and_its_entry_in_the_folder_are_written_to_the_disk(tmp_path, monkeypatch):
    written, fsync = [], os.fsync

    def note(handle):
        written.append(os.readlink(f'/proc/self/fd/{handle}'))
        fsync(handle)

    monkeypatch.setattr(os, 'fsync', note)
    replace_file(tmp_path / 'plan.yaml', b'first')
    assert written == [f'{tmp_path}/.plan.yaml.{os.getpid()}.new', str(tmp_path)]


def test_file_is_unchanged_and_nothing_is_left_after_an_error(tmp_path, monkeypatch):
    path = tmp_path / 'plan.yaml'
    replace_file(path, b'first')

    def fail(handle):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'fsync', fail)
    with pytest.raises(OSError, match='No space'):
        replace_file(path, b'second')
    assert path.read_bytes() == b'first'
    assert list(tmp_path.iterdir()) == [path]
