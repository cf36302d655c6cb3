# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Container of a model file: arrays and a JSON manifest in one ``.npz`` file.

NumPy reads the file without pickle: ``np.load('texture.npz')``. The array ``manifest`` contains
the manifest as JSON. The array ``sha256`` contains the digest of all other arrays. The digest
detects damage; it is not a signature.

A model file is untrusted input. Only `open_container` reads it. This function accepts a subset of
the ``.npz`` format: uncompressed arrays of four types, with the headers that `numpy.savez` writes.
Before an array is read, its size is compared with the number of bytes in the file. Nothing in the
file is evaluated, and no entry can refer to another file or to a class.
"""

from __future__ import annotations

from collections.abc import Mapping
import hashlib
import io
import json
import math
from pathlib import Path
import re
import struct
from typing import Any, NamedTuple
import zipfile

import numpy as np
import numpy.typing as npt

from tactile_features.errors import ModelFileError

MANIFEST, DIGEST = 'manifest', 'sha256'

MAX_MODEL_BYTES = 64 * 2**20
"""Larger files are refused [byte]."""

MAX_MANIFEST_BYTES = 4 * 2**20
"""A larger manifest is refused [byte]; typical ones have up to 300 kB."""

MAX_INDEX_BYTES = 64 * 2**10
"""A file with a larger index of its arrays is refused [byte]; 500 arrays fit."""

Arrays = Mapping[str, npt.NDArray[Any]]

_NAME = re.compile(r'([a-z0-9_.]{1,80})\.npy')
_END = struct.Struct('<4s4H2LH')  # the last record of a ZIP file without a comment
_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '(<f8|<f4|<i8|\|S\d{1,8})', 'fortran_order': False, "
    rb"'shape': \(((?:\d{1,9},)?|\d{1,9}(?:, \d{1,9}){1,3})\), \} *\n",
    re.DOTALL,
)
_DAMAGED = 'the file is damaged or incomplete'


class Container(NamedTuple):
    """Contents of a model file: the manifest, and the arrays by name."""

    manifest: dict[str, Any]
    arrays: dict[str, npt.NDArray[Any]]


def pack_container(manifest: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Return the bytes of a model file. Equal contents give equal bytes.

    Names of arrays consist of lower-case letters, digits, ``_`` and ``.``. Arrays are doubles,
    floats or 64-bit integers, with up to four dimensions. Raises ModelFileError when the file
    would be larger than `MAX_MODEL_BYTES`.
    """
    text = json.dumps(manifest, sort_keys=True).encode()
    contents = {name: np.ascontiguousarray(arrays[name]) for name in sorted(arrays)}
    # ascontiguousarray turns a scalar into an array of shape (1,).
    contents = {name: each.reshape(np.shape(arrays[name])) for name, each in contents.items()}
    size = sum(each.nbytes for each in contents.values())
    if size > MAX_MODEL_BYTES - MAX_MANIFEST_BYTES or len(text) > MAX_MANIFEST_BYTES:
        raise ModelFileError(
            f'it would have {(size + len(text)) / 2**20:.0f} MiB, but the limit is '
            f'{MAX_MODEL_BYTES >> 20} MiB: train it on fewer trials or shorter windows'
        )
    contents[MANIFEST] = np.array(text)
    contents[DIGEST] = np.array(_compute_digest(contents).encode())
    file = io.BytesIO()
    with zipfile.ZipFile(file, 'w') as archive:
        for name, array in contents.items():
            with archive.open(f'{name}.npy', 'w') as member:
                np.save(member, array, allow_pickle=False)
    return file.getvalue()


def read_container(path: Path) -> Container:
    """Return the contents of a model file; raise OSError and the errors of `open_container`."""
    return open_container(read_limited(path))


def read_limited(path: Path) -> bytes:
    """Return the bytes of a model file; raise ModelFileError for ONNX and for large files."""
    if path.suffix == '.onnx':
        raise ModelFileError(
            'it is an ONNX file, which this version does not read: train the model again with '
            '`tactile train`, which writes a .npz file'
        )
    size = path.stat().st_size
    if size > MAX_MODEL_BYTES:
        raise ModelFileError(
            f'it has {size / 2**20:.0f} MiB, but the limit is {MAX_MODEL_BYTES >> 20} MiB'
        )
    return path.read_bytes()


def is_model_file(path: Path) -> bool:
    """Return True for a ``.npz`` file with a manifest; archives of trials have no manifest."""
    try:
        with zipfile.ZipFile(path) as file:
            return f'{MANIFEST}.npy' in file.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def open_container(data: bytes) -> Container:
    """Return the contents of a model file after checking it completely.

    Raises ModelFileError when the data are not a ``.npz`` file, have no manifest or no digest,
    were changed after they were written, or contain anything except plain arrays.
    """
    arrays = _read_arrays(data)
    missing = {MANIFEST, DIGEST} - arrays.keys()
    if missing:
        raise ModelFileError(f'it has no {min(missing)}: it was not written by this software')
    if arrays.pop(DIGEST).tobytes() != _compute_digest(arrays).encode():
        raise ModelFileError('it was changed or damaged after it was written')
    text = arrays.pop(MANIFEST).tobytes()
    if len(text) > MAX_MANIFEST_BYTES:
        raise ModelFileError(f'its manifest has more than {MAX_MANIFEST_BYTES >> 20} MiB')
    try:
        manifest = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f'its manifest is not JSON: {error}') from error
    if not isinstance(manifest, dict):
        raise ModelFileError('its manifest is not a JSON object')
    return Container(manifest, arrays)


def _compute_digest(arrays: Arrays) -> str:
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f'{name} {array.dtype.str} {array.shape}\n'.encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _read_arrays(data: bytes) -> dict[str, npt.NDArray[Any]]:
    _check_index(data)
    arrays: dict[str, npt.NDArray[Any]] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            members = file.infolist()
            if sum(member.file_size for member in members) > len(data):
                raise ModelFileError('its index states more bytes than the file has')
            for member in members:
                name = _check_member(member)
                if name in arrays:
                    raise ModelFileError(f'it has the array "{name}" twice')
                arrays[name] = _parse_array(name, file.read(member))
    except (zipfile.BadZipFile, struct.error, EOFError, OSError, RuntimeError, ValueError) as e:
        raise ModelFileError(f'{_DAMAGED}: {e}') from e
    return arrays


def _check_index(data: bytes) -> None:
    """Refuse data that are not a ZIP file, or whose index is too large."""
    if not data.startswith(b'PK\x03\x04'):
        raise ModelFileError('it is not an .npz file')
    signature, *_, size, _, _ = _END.unpack(data[-_END.size :].rjust(_END.size, b'\0'))
    if signature != b'PK\x05\x06' or b'PK\x06\x07' in data[-_END.size - 20 : -_END.size]:
        raise ModelFileError(_DAMAGED)
    if size > MAX_INDEX_BYTES:
        raise ModelFileError(f'the index of its arrays has more than {MAX_INDEX_BYTES >> 10} KiB')


def _check_member(member: zipfile.ZipInfo) -> str:
    """Return the name of the array that a member of the ZIP file contains."""
    match = _NAME.fullmatch(member.filename)
    if match is None:
        raise ModelFileError(f'it contains {member.filename!r:.80}, which is not a model array')
    if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 0x1:
        raise ModelFileError(f'its array "{match[1]}" is compressed or encrypted')
    return match[1]


def _parse_array(name: str, data: bytes) -> npt.NDArray[Any]:
    """Return the array in the bytes of a ``.npy`` file, read-only."""
    header = _HEADER.match(data)
    if header is None or header.end() != 10 + int.from_bytes(data[8:10], 'little'):
        raise ModelFileError(
            f'its array "{name}" does not consist of doubles, floats, 64-bit integers or bytes'
        )
    dtype = np.dtype(header[1].decode())
    shape = tuple(int(size) for size in header[2].replace(b' ', b'').split(b',') if size)
    size = math.prod(shape) * dtype.itemsize
    if size != len(data) - header.end():
        raise ModelFileError(
            f'the header of its array "{name}" states {size} bytes, but the array has '
            f'{len(data) - header.end()}'
        )
    if not size:
        return np.empty(shape, dtype)
    return np.frombuffer(data, dtype, offset=header.end()).reshape(shape)
