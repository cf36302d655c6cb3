# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The container of a model file: valid and refused contents."""

import contextlib
import hashlib
import io
import json
import struct
import zipfile

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_features import model_container
from tactile_features.errors import ModelFileError
from tactile_features.model_container import (
    is_model_file,
    open_container,
    pack_container,
    read_container,
)

MANIFEST = {'labels': ['Möbelstoff', 'sponge'], 'threshold': 3.25}
ARRAYS = {
    'classifier.trials': np.arange(6.0).reshape(2, 3),
    'classifier.biases': np.ones((2, 1), dtype=np.float32),
    'classifier.codes': np.array([0, -1]),
    'classifier.gamma': np.array(0.25),
    'empty': np.empty((0, 4)),
}


def zip_members(members, compression=zipfile.ZIP_STORED):
    """Return a ZIP file of ``members``, which are pairs of a name and bytes or an array."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, 'w', compression) as archive:
        for name, content in members:
            data = content if isinstance(content, bytes) else to_npy(content)
            archive.writestr(name, data)
    return file.getvalue()


def to_npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def seal(arrays, manifest=b'{}'):
    """Return a model file with any arrays, even invalid ones, and a valid digest."""
    contents = {**arrays, 'manifest': np.array(manifest)}
    digest = model_container._compute_digest(contents).encode()
    named = [(f'{name}.npy', array) for name, array in contents.items()]
    return zip_members([*named, ('sha256.npy', np.array(digest))])


def test_numpy_reads_what_is_packed_and_equal_contents_give_equal_bytes():
    data = pack_container(MANIFEST, ARRAYS)
    assert data == pack_container(dict(reversed(MANIFEST.items())), dict(reversed(ARRAYS.items())))
    with np.load(io.BytesIO(data)) as file:
        assert json.loads(file['manifest'].item()) == MANIFEST
        np.testing.assert_array_equal(file['classifier.trials'], ARRAYS['classifier.trials'])
    manifest, arrays = open_container(data)
    assert manifest == MANIFEST
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert (arrays[name].dtype, arrays[name].shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(arrays[name], array)


def test_the_digest_is_over_names_types_shapes_and_bytes_of_all_arrays():
    data = pack_container({'a': 1}, {'x': np.array([1.5])})
    text = b'manifest |S8 ()\n{"a": 1}x <f8 (1,)\n' + struct.pack('<d', 1.5)
    with np.load(io.BytesIO(data)) as file:
        assert file['sha256'].item().decode() == hashlib.sha256(text).hexdigest()


# -- damaged files -------------------------------------------------------------------


def test_each_flipped_bit_and_each_cut_is_refused_or_changes_nothing():
    data = pack_container({'a': 3.25}, {'x': np.arange(3.0)})
    same = open_container(data)
    for at in range(len(data)):
        changed = bytearray(data)
        changed[at] ^= 1 << at % 8
        try:
            found = open_container(bytes(changed))
        except ModelFileError:
            continue
        # The bit is part of a date or version number in the ZIP file, which is not used.
        assert found.manifest == same.manifest
        np.testing.assert_array_equal(found.arrays['x'], same.arrays['x'])
    for size in range(len(data)):
        with pytest.raises(ModelFileError):
            open_container(data[:size])


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_any_bytes_are_refused(data):
    whole = pack_container(MANIFEST, ARRAYS)
    start = data.draw(st.integers(0, len(whole)))
    noise = data.draw(st.binary(min_size=1, max_size=60))
    changed = whole[:start] + noise + whole[start + data.draw(st.integers(0, 60)) :]
    if changed != whole:
        with contextlib.suppress(ModelFileError):
            assert open_container(changed).manifest == MANIFEST
    with pytest.raises(ModelFileError):
        open_container(noise)


# -- hostile files -------------------------------------------------------------------


class Evil:
    """An object that creates a file when it is unpickled."""

    def __reduce__(self):
        return (open, ('/tmp/must-not-be-there', 'w'))


@pytest.mark.parametrize(
    ('data', 'named'),
    [
        (b'', 'npz'),
        (b'\x80\x04\x95', 'npz'),
        (zip_members([]), 'npz'),
        (zip_members([('x.npy', np.zeros(3))]), 'manifest'),
        (seal({'x': np.array([Evil()], dtype=object)}), '"x"'),
        (seal({'x': np.zeros(2, dtype='f8,i4')}), '"x"'),
        (seal({'x': np.zeros(2, dtype='>f8')}), '"x"'),
        (seal({'x': np.asfortranarray(np.zeros((2, 2)))}), '"x"'),
        (seal({'x': np.zeros((1,) * 5)}), '"x"'),
        (seal({}, b'[1]'), 'JSON'),
        (seal({}, b'{"a":'), 'JSON'),
        (seal({}, b'[' * 50_000), 'JSON'),
        (seal({}, b' ' * (2**22 + 1)), '4 MiB'),
        (zip_members([('../x.npy', np.zeros(3))]), r"'\.\./x\.npy'"),
        (zip_members([('run.py', b'print()')]), r"'run\.py'"),
        (zip_members([('x.npy', b'ab')], zipfile.ZIP_DEFLATED), 'compressed'),
        (zip_members([('x.npy', b'ab')], zipfile.ZIP_LZMA), 'compressed'),
    ],
    ids=lambda value: value if isinstance(value, str) else '',
)
def test_what_is_no_model_file_is_refused(data, named):
    with pytest.raises(ModelFileError, match=named):
        open_container(data)


def test_an_array_that_is_there_twice_is_refused():
    with pytest.warns(UserWarning, match='Duplicate name'):
        data = zip_members([('x.npy', np.zeros(3)), ('x.npy', np.ones(3))])
    with pytest.raises(ModelFileError, match='"x" twice'):
        open_container(data)


def test_a_header_that_announces_more_than_there_is_allocates_nothing():
    npy = to_npy(np.zeros(1))
    bomb = npy.replace(b"'shape': (1,)", b"'shape': (999999999, 999999999)")
    bomb = bomb[:8] + struct.pack('<H', bomb.index(b'\n') + 1 - 10) + bomb[10:]
    with pytest.raises(ModelFileError, match=r'"x" .*\d+ bytes, .* 8'):
        open_container(zip_members([('x.npy', bomb)]))


def test_a_list_that_announces_more_bytes_than_the_file_has_is_refused():
    data = zip_members([('x.npy', np.zeros(3))])
    at = data.index(b'PK\x01\x02')
    size = struct.pack('<2L', 2**31, 2**31)
    with pytest.raises(ModelFileError, match='bytes'):
        open_container(data[: at + 20] + size + data[at + 28 :])
    many = zip_members([(f'a{i}.npy', b'') for i in range(2_000)])
    with pytest.raises(ModelFileError, match='64 KiB'):
        open_container(many)


def test_a_header_is_never_evaluated():
    npy = to_npy(np.zeros(1))
    for text in (b'__import__("os")', b'(' * 118):
        header = text.ljust(len(npy) - 18 - 1) + b'\n'
        with pytest.raises(ModelFileError, match='"x"'):
            open_container(zip_members([('x.npy', npy[:10] + header + npy[-8:])]))


def test_files_of_other_kinds_are_named(tmp_path):
    model, archive, old = (tmp_path / name for name in ('m.npz', 'a.npz', 'm.onnx'))
    model.write_bytes(pack_container(MANIFEST, ARRAYS))
    np.savez(archive, x=np.zeros(3))
    old.write_bytes(b'\x08\x08')
    assert [is_model_file(path) for path in (model, archive, old, tmp_path)] == [1, 0, 0, 0]
    with pytest.raises(ModelFileError, match=r'ONNX.* train'):
        read_container(old)
    with pytest.raises(ModelFileError, match='manifest'):
        read_container(archive)


def test_a_model_beyond_the_limit_is_not_packed():
    with pytest.raises(ModelFileError, match='64 MiB'):
        pack_container({}, {'x': np.zeros(2**23)})
