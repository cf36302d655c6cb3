# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ONNX file as a container of a graph, a manifest and a card.

A file is untrusted input. It is read with ``onnx``, its graph is checked, and what no field of
ONNX names is dropped. `Container.model` is the checked model, written again: a runtime is given
these bytes and never those of the file.

The metadata hold the card, plain text for people, and the manifest, a JSON object. Its entry
``sha256`` is the digest of the whole file, taken while the digits of this entry are zeros. It
tells a damaged file from a whole one; it is no signature. Files of format 6 have that of all
bytes before it as their last entry of metadata.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import hashlib
import json
from typing import Any, NamedTuple

from tactile_features.errors import ModelFileError

MANIFEST_KEY = 'tactile_manifest'
CARD_KEY = 'tactile_card'
DIGEST = 'sha256'

MAX_CARD_BYTES = 64 * 2**10
"""A file with a larger card is refused [byte]."""

MAX_NODES = 10_000
"""A graph with more operations is refused; the largest of our own has 739."""

OPERATORS = frozenset((
    'Abs', 'Add', 'ArgMax', 'ArgMin', 'Cast', 'Concat', 'Div', 'Equal', 'Exp', 'Gather', 'Greater',
    'Identity', 'If', 'Less', 'MatMul', 'Max', 'Mul', 'Neg', 'ReduceMin', 'ReduceSum',
    'ReduceSumSquare', 'Reshape', 'Slice', 'Softmax', 'Sqrt', 'Squeeze', 'Sub', 'TopK',
    'Unsqueeze', 'Where', 'ai.onnx.ml:TreeEnsembleClassifier',
))  # fmt: skip
"""Operators of our graphs, with their domain where it is not that of ONNX itself. None repeats
another graph, reads a file or makes values out of a mere size."""

_MAX_DEPTH = 16  # graphs inside graphs


class Container(NamedTuple):
    """Contents of a model file: manifest without the digest, card, ONNX model to run."""

    manifest: dict[str, Any]
    card: str
    model: bytes


def pack_container(model: bytes, manifest: Mapping[str, Any], card: str) -> bytes:
    """Return the ONNX model with card and manifest, and the digest of it all in the manifest."""
    text = json.dumps({**manifest, DIGEST: _NO_DIGITS}, sort_keys=True)
    data = model + _encode_metadata({CARD_KEY: card, MANIFEST_KEY: text})
    return data.replace(_encode_digest(_NO_DIGITS), _encode_digest(_compute_digest(data)))


def open_container(data: bytes) -> Container:
    """Return the contents of an ONNX file that is whole and whose graph keeps to the rules.

    Refused with `ModelFileError` is a file that is not ONNX, holds no manifest, was changed after
    it was written, uses other operators than `OPERATORS`, functions or weights outside the file,
    or has a card that is no plain text.
    """
    from google.protobuf.message import DecodeError
    import onnx

    try:
        model = onnx.ModelProto.FromString(data)
    except DecodeError:
        raise ModelFileError('it is not an ONNX file, or only a part of one') from None
    if not model.HasField('graph'):
        raise ModelFileError('it is not an ONNX file, or only a part of one')
    _check_model(model)
    metadata: dict[str, str] = {}
    for entry in model.metadata_props:
        if entry.key in metadata:
            raise ModelFileError(f'it has the metadata "{entry.key}" twice')
        metadata[entry.key] = entry.value
    if MANIFEST_KEY not in metadata:
        raise ModelFileError('it has no manifest: it was not written by this software')
    manifest = _read_manifest(metadata[MANIFEST_KEY])
    if not _is_whole(data, manifest.pop(DIGEST, None)):
        raise ModelFileError('it was changed or damaged after it was written')
    card = metadata.get(CARD_KEY, '')
    if len(card.encode()) > MAX_CARD_BYTES:
        raise ModelFileError(f'its card has more than {MAX_CARD_BYTES >> 10} KiB')
    if not card.replace('\n', '').isprintable():  # nothing that a terminal would obey
        raise ModelFileError('its card is no plain text')
    model.DiscardUnknownFields()
    del model.metadata_props[:]
    return Container(manifest, card, model.SerializeToString())


def replace_manifest(data: bytes, manifest: Mapping[str, Any], card: str) -> bytes:
    """Return a model file with another manifest, another card and the same graph."""
    return pack_container(open_container(data).model, manifest, card)


_NO_DIGITS = '0' * 64


def _encode_metadata(texts: Mapping[str, str]) -> bytes:
    """Return a model of metadata alone: appended to another model, they are added to it."""
    import onnx

    entries = [onnx.StringStringEntryProto(key=key, value=text) for key, text in texts.items()]
    return bytes(onnx.ModelProto(metadata_props=entries).SerializeToString())


def _encode_digest(digits: str) -> bytes:
    return json.dumps({DIGEST: digits})[1:-1].encode()


def _compute_digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _read_manifest(text: str) -> dict[str, Any]:
    try:
        manifest = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f'its manifest is not JSON: {error}') from error
    if not isinstance(manifest, dict):
        raise ModelFileError('its manifest is no JSON object')
    return manifest


def _is_whole(data: bytes, digest: Any) -> bool:
    """Return whether a file is as it was written; without a digest it is one of format 6."""
    if digest is None:
        body = data[: -len(_encode_metadata({'tactile_sha256': _NO_DIGITS}))]
        return data == body + _encode_metadata({'tactile_sha256': _compute_digest(body)})
    if not isinstance(digest, str):
        return False
    blank = data.replace(_encode_digest(digest), _encode_digest(_NO_DIGITS))
    return digest == _compute_digest(blank)


def _check_model(model: Any) -> None:
    if model.functions or model.training_info:
        raise ModelFileError('it holds functions or training graphs, which are refused')
    for count, (node, depth) in enumerate(_walk(model.graph, 0), 1):
        if depth > _MAX_DEPTH:
            raise ModelFileError('its graphs are nested too deeply')
        if count > MAX_NODES:
            raise ModelFileError(f'its graph has more than {MAX_NODES} operations')
        domain = '' if node.domain in ('', 'ai.onnx') else f'{node.domain}:'
        if f'{domain}{node.op_type}' not in OPERATORS:
            raise ModelFileError(
                f'it uses the operator {domain}{node.op_type}, which no model of ours needs'
            )


def _walk(graph: Any, depth: int) -> Iterator[tuple[Any, int]]:
    """Yield each node of a graph and of the graphs in it; check all tensors on the way."""
    if graph.sparse_initializer:
        raise ModelFileError('it has sparse weights, which are refused')
    for tensor in graph.initializer:
        _check_tensor(tensor)
    for node in graph.node:
        yield node, depth
        for attribute in node.attribute:
            if attribute.HasField('sparse_tensor') or attribute.sparse_tensors:
                raise ModelFileError('it has sparse weights, which are refused')
            for tensor in [attribute.t, *attribute.tensors]:
                _check_tensor(tensor)
            for inner in [attribute.g, *attribute.graphs]:
                yield from _walk(inner, depth + 1)


def _check_tensor(tensor: Any) -> None:
    if tensor.external_data or tensor.data_location:
        raise ModelFileError('it keeps weights in another file, which is refused')
