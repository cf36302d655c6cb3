# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ONNX file as a sealed container of a graph and a manifest.

Only what must be known before the file is handed to a runtime is read here, from
the protobuf encoding itself (onnx/onnx.proto): the metadata, the domains of the
operators, and whether weights lie outside the file. The `onnx` package is not needed.

A card for people stands before the manifest: plain text, shown by ``tactile show``.

The last metadata entry is the seal: the SHA-256 of all bytes before it. It tells a
damaged file from a whole one; it is no signature.
"""

from __future__ import annotations

from collections.abc import Iterator
import hashlib

from tactile_features.errors import ModelFileError

MANIFEST_KEY = 'tactile_manifest'
CARD_KEY = 'tactile_card'
SEAL_KEY = 'tactile_sha256'

MAX_CARD_BYTES = 64 * 2**10
"""A file with a larger card is refused [byte]."""

_ALLOWED_DOMAINS = {'', 'ai.onnx', 'ai.onnx.ml'}
_MAX_DEPTH = 16  # graphs inside graphs

# Field numbers of onnx.proto.
_MODEL_GRAPH, _MODEL_METADATA, _MODEL_TRAINING, _MODEL_FUNCTIONS = 7, 14, 20, 25
_GRAPH_NODE, _GRAPH_TENSOR, _GRAPH_SPARSE = 1, 5, 15
_NODE_OP_TYPE, _NODE_ATTRIBUTE, _NODE_DOMAIN = 4, 5, 7
_ATTRIBUTE_TENSORS, _ATTRIBUTE_GRAPHS, _ATTRIBUTE_SPARSE = (5, 10), (6, 11), (22, 23)
_SPARSE_TENSORS = (1, 2)
_TENSOR_EXTERNAL_DATA, _TENSOR_DATA_LOCATION = 13, 14
_ENTRY_KEY, _ENTRY_VALUE = 1, 2


def seal(model: bytes, manifest: str, card: str) -> bytes:
    """Return the ONNX model with card, manifest and seal appended."""
    body = model + _encode_texts(manifest, card)
    return body + _encode_seal(body)


def open_container(data: bytes) -> tuple[str, str]:
    """Return manifest and card of a sealed ONNX file whose graph keeps to the rules.

    Raises
    ------
    ModelFileError
        When the bytes are not ONNX, hold no manifest, were changed after they were written,
        use operators of other domains, functions or weights outside the file, or have a card
        that is no plain text.
    """
    try:
        metadata = _read_model(data)
    except _NotProtobufError:
        raise ModelFileError('it is not an ONNX file, or only a part of one') from None
    if MANIFEST_KEY not in metadata:
        raise ModelFileError('it has no manifest: it was not written by this software')
    body = data[: -len(_encode_seal(b''))]
    if data != body + _encode_seal(body):
        raise ModelFileError('it was changed or damaged after it was written')
    card = metadata.get(CARD_KEY, '')
    if len(card.encode()) > MAX_CARD_BYTES:
        raise ModelFileError(f'its card has more than {MAX_CARD_BYTES >> 10} KiB')
    if not card.replace('\n', '').isprintable():  # nothing that a terminal would obey
        raise ModelFileError('its card is no plain text')
    return metadata[MANIFEST_KEY], card


def replace_manifest(data: bytes, manifest: str, card: str) -> bytes:
    """Return a sealed model with another manifest, another card and the same graph."""
    body = data[: -len(_encode_seal(b''))]
    old = _encode_texts(*open_container(data))
    if not body.endswith(old):
        raise ModelFileError('its manifest is not where this software writes it')
    return seal(body.removesuffix(old), manifest, card)


def _encode_texts(manifest: str, card: str) -> bytes:
    return _encode_entry(CARD_KEY, card) + _encode_entry(MANIFEST_KEY, manifest)


def _encode_seal(body: bytes) -> bytes:
    return _encode_entry(SEAL_KEY, hashlib.sha256(body).hexdigest())


def _encode_entry(key: str, value: str) -> bytes:
    entry = _encode_field(_ENTRY_KEY, key.encode()) + _encode_field(_ENTRY_VALUE, value.encode())
    return _encode_field(_MODEL_METADATA, entry)


def _encode_field(number: int, content: bytes) -> bytes:
    return _encode_varint(number << 3 | 2) + _encode_varint(len(content)) + content


def _encode_varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


class _NotProtobufError(Exception):
    pass


def _read_model(data: bytes) -> dict[str, str]:
    metadata: dict[str, str] = {}
    has_graph = False
    for number, value in _read_fields(data):
        if number == _MODEL_GRAPH:
            has_graph = True
            _check_graph(_content(value), 0)
        elif number == _MODEL_METADATA:
            entry = dict(_read_fields(_content(value)))
            key, text = (_text(entry.get(n, b'')) for n in (_ENTRY_KEY, _ENTRY_VALUE))
            if key in metadata:
                raise ModelFileError(f'it has the metadata "{key}" twice')
            metadata[key] = text
        elif number in (_MODEL_TRAINING, _MODEL_FUNCTIONS):
            raise ModelFileError('it holds functions or training graphs, which are refused')
    if not has_graph:
        raise _NotProtobufError
    return metadata


def _check_graph(data: bytes, depth: int) -> None:
    if depth > _MAX_DEPTH:
        raise ModelFileError('its graphs are nested too deeply')
    for number, value in _read_fields(data):
        if number == _GRAPH_NODE:
            _check_node(_content(value), depth)
        elif number == _GRAPH_TENSOR:
            _check_tensor(_content(value))
        elif number == _GRAPH_SPARSE:
            _check_sparse(_content(value))


def _check_node(data: bytes, depth: int) -> None:
    op_type = domain = ''
    for number, value in _read_fields(data):
        if number == _NODE_OP_TYPE:
            op_type = _text(value)
        elif number == _NODE_DOMAIN:
            domain = _text(value)
        elif number == _NODE_ATTRIBUTE:
            for inner, content in _read_fields(_content(value)):
                if inner in _ATTRIBUTE_TENSORS:
                    _check_tensor(_content(content))
                elif inner in _ATTRIBUTE_GRAPHS:
                    _check_graph(_content(content), depth + 1)
                elif inner in _ATTRIBUTE_SPARSE:
                    _check_sparse(_content(content))
    if domain not in _ALLOWED_DOMAINS:
        raise ModelFileError(f'it uses the custom operator {domain}:{op_type}, which is refused')
    if op_type == 'Loop':
        raise ModelFileError('it uses the operator Loop, which need not end, and is refused')


def _check_sparse(data: bytes) -> None:
    for number, value in _read_fields(data):
        if number in _SPARSE_TENSORS:
            _check_tensor(_content(value))


def _check_tensor(data: bytes) -> None:
    for number, value in _read_fields(data):
        if number == _TENSOR_EXTERNAL_DATA or (number == _TENSOR_DATA_LOCATION and value):
            raise ModelFileError('it keeps weights in another file, which is refused')


def _content(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise _NotProtobufError
    return value


def _text(value: int | bytes) -> str:
    try:
        return _content(value).decode()
    except UnicodeDecodeError:
        raise _NotProtobufError from None


def _read_fields(data: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Yield number and value of each field: int for varints, bytes for the others."""
    at = 0
    while at < len(data):
        tag, at = _read_varint(data, at)
        number, kind = tag >> 3, tag & 7
        if number == 0:
            raise _NotProtobufError
        if kind == 0:
            value, at = _read_varint(data, at)
            yield number, value
            continue
        if kind == 2:
            size, at = _read_varint(data, at)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
        else:
            raise _NotProtobufError
        if size > len(data) - at:
            raise _NotProtobufError
        yield number, data[at : at + size]
        at += size


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            raise _NotProtobufError
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise _NotProtobufError
