# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import hashlib
import json

from hypothesis import given, settings
from hypothesis import strategies as st
import onnx
from onnx import helper, TensorProto
import pytest

from tactile_features import onnx_container
from tactile_features.errors import ModelFileError
from tactile_features.onnx_container import MAX_CARD_BYTES, open_container, replace_manifest

CARD = '# Model card\n- answers: Möbelstoff\n'


MANIFEST = {'labels': ['Möbelstoff', 'sponge'], 'threshold': 3.25}


def pack(model, manifest=MANIFEST, card=CARD):
    data = model if isinstance(model, bytes) else model.SerializeToString()
    return onnx_container.pack_container(data, manifest, card)


def make_model(nodes=None, initializer=(), functions=()):
    nodes = nodes or [helper.make_node('Identity', ['a'], ['b'])]
    info = [helper.make_tensor_value_info(n, TensorProto.DOUBLE, [None, 3]) for n in 'ab']
    graph = helper.make_graph(nodes, 'g', info[:1], info[1:], initializer=list(initializer))
    imports = [helper.make_opsetid('', 18)]
    return helper.make_model(graph, opset_imports=imports, functions=list(functions))


def test_packed_model_is_onnx_with_metadata_that_can_be_replaced():
    manifest = {'label': 'Möbelstoff', 'long': ' ' * 500}  # longer than one varint byte can say
    data = pack(make_model(), manifest)
    model = onnx.load_model_from_string(data)
    onnx.checker.check_model(model)
    card, text = (entry.value for entry in model.metadata_props)
    assert (card, json.loads(text).items() >= manifest.items()) == (CARD, True)
    assert open_container(data) == (manifest, CARD, make_model().SerializeToString())
    assert replace_manifest(data, {'a': 1}, 'other') == pack(make_model(), {'a': 1}, 'other')


def test_the_digest_is_of_the_file_with_zeros_in_its_place():
    data = pack(make_model())
    stated = json.loads(onnx.load_model_from_string(data).metadata_props[1].value)['sha256']
    blank = data.replace(stated.encode(), b'0' * 64)
    assert hashlib.sha256(blank).hexdigest() == stated


def seal_as_format_6(model, manifest):
    """Return a file as it was written before the manifest had the digest."""
    data = model.SerializeToString()
    for key, value in (('tactile_card', CARD), ('tactile_manifest', json.dumps(manifest))):
        entry = onnx.StringStringEntryProto(key=key, value=value)
        data += onnx.ModelProto(metadata_props=[entry]).SerializeToString()
    digest = hashlib.sha256(data).hexdigest()
    entry = onnx.StringStringEntryProto(key='tactile_sha256', value=digest)
    return data + onnx.ModelProto(metadata_props=[entry]).SerializeToString()


@pytest.mark.parametrize('write', [pack, seal_as_format_6])
def test_any_change_is_found(write):
    data = write(make_model(), MANIFEST)
    assert open_container(data) == (MANIFEST, CARD, make_model().SerializeToString())
    for at in range(len(data)):
        for bit in (1, 32):  # 32: the other case of a letter
            with pytest.raises(ModelFileError):
                open_container(data[:at] + bytes([data[at] ^ bit]) + data[at + 1 :])
    for damaged in (b'', data[:-1], data + b'\0', data[1:]):
        with pytest.raises(ModelFileError):
            open_container(damaged)
    with pytest.raises(ModelFileError, match='changed or damaged'):
        open_container(data.replace(b'3.25', b'3.75'))


NO_DIGESTS = [json.dumps({'sha256': each}) for each in ('', '0' * 64, 'é' * 64, 7, [], True)]


@pytest.mark.parametrize(
    ('text', 'message'),
    [(text, 'its manifest is no') for text in ('', '[]', '3', '{"a": 1', '[' * 100_000)]
    + [(text, 'changed or damaged') for text in NO_DIGESTS],
)
def test_a_manifest_that_is_none_or_whose_digest_is_none_is_refused(text, message):
    model = make_model()
    model.metadata_props.add(key='tactile_manifest', value=text)
    with pytest.raises(ModelFileError, match=message):
        open_container(model.SerializeToString())


def test_manifest_is_there_once():
    with pytest.raises(ModelFileError, match='it has no manifest'):
        open_container(make_model().SerializeToString())
    with pytest.raises(ModelFileError, match='the metadata "tactile_card" twice'):
        open_container(pack(pack(make_model())))


@pytest.mark.parametrize(
    ('card', 'message'),
    [
        ('a' * (MAX_CARD_BYTES + 1), 'card has more than 64 KiB'),
        ('ö' * (MAX_CARD_BYTES // 2 + 1), 'card has more than 64 KiB'),
        ('\x1b[2J', 'no plain text'),
        ('right\u202eleft', 'no plain text'),
        ('line\rover', 'no plain text'),
    ],
)
def test_card_that_is_no_short_plain_text_is_refused(card, message):
    with pytest.raises(ModelFileError, match=message):
        open_container(pack(make_model(), card=card))


def custom(domain='com.microsoft'):
    return helper.make_node('CDist', ['a'], ['b'], domain=domain)


def subgraph(node):
    info = [helper.make_tensor_value_info('b', TensorProto.DOUBLE, [None, 3])]
    branch = helper.make_graph([node], 'branch', [], info)
    return helper.make_node('If', ['c'], ['b'], then_branch=branch)


def external():
    tensor = helper.make_tensor('w', TensorProto.DOUBLE, [1], [1.0])
    tensor.ClearField('double_data')
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key='location', value='/etc/passwd')
    return tensor


def sparse_with(tensor):
    indices = helper.make_tensor('i', TensorProto.INT64, [1], [0])
    return helper.make_sparse_tensor(tensor, indices, [3])


def sparse_constant():
    sparse = onnx.AttributeProto.SPARSE_TENSOR
    node = helper.make_node('Identity', ['a'], ['b'])
    node.attribute.add(name='v', type=sparse).sparse_tensor.CopyFrom(sparse_with(external()))
    return node


def sparse_initializer():
    model = make_model()
    model.graph.sparse_initializer.append(sparse_with(external()))
    return model


def with_function():
    imports = [helper.make_opsetid('', 18)]
    return make_model(
        functions=[helper.make_function('local', 'F', ['a'], ['b'], [custom()], imports)]
    )


def nested(depth):
    node = helper.make_node('Identity', ['a'], ['b'])
    for _ in range(depth):
        node = subgraph(node)
    return make_model([node])


HOSTILE = {
    'custom operator': (make_model([custom()]), 'the operator com.microsoft:CDist'),
    'in a subgraph': (make_model([subgraph(custom('evil'))]), 'the operator evil:CDist'),
    'external weights': (make_model(initializer=[external()]), 'weights in another file'),
    'external weights of an operator': (
        make_model([helper.make_node('Identity', ['a'], ['b'], value=external())]),
        'weights in another file',
    ),
    'constant': (
        make_model([helper.make_node('Constant', [], ['b'], value=external())]),
        'the operator Constant',
    ),
    'sparse constant': (make_model([sparse_constant()]), 'sparse weights'),
    'sparse weights': (sparse_initializer(), 'sparse weights'),
    'too long': (make_model([helper.make_node('Identity', ['a'], ['b'])] * 10_001), '10000 oper'),
    **{
        name: (make_model([helper.make_node(name, ['a'], ['b'])]), f'the operator {name}')
        for name in ('Loop', 'Scan', 'ConstantOfShape', 'Expand', 'Tile', 'Range', 'Conv')
    },
    'nesting': (nested(20), 'nested too deeply'),
    'function': (with_function(), 'functions or training graphs'),
}


@pytest.mark.parametrize('name', HOSTILE)
def test_hostile_graph_is_refused_though_well_packed(name):
    model, message = HOSTILE[name]
    with pytest.raises(ModelFileError, match=message):
        open_container(pack(model))


def varint(value):
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def field(number, content, beyond=0):
    """Return a field of a message; a bit beyond the 32 of a tag hides it from some readers."""
    return varint((number << 3 | 2) + (beyond << 32)) + varint(len(content)) + content


LOOP = helper.make_node('Loop', ['', ''], ['b'])


@pytest.mark.parametrize(
    ('hidden', 'is_known'),
    [
        (field(1, LOOP.SerializeToString(), 1), True),
        (field(5, external().SerializeToString(), 1), True),
        (field(77, LOOP.SerializeToString()), False),
    ],
    ids=['operation', 'weights', 'a field that ONNX does not have'],
)
def test_what_is_hidden_in_the_encoding_is_refused_or_not_handed_on(hidden, is_known):
    model = make_model()
    graph = model.graph.SerializeToString()
    model.ClearField('graph')
    data = pack(model.SerializeToString() + field(7, hidden + graph))
    if is_known:
        with pytest.raises(ModelFileError, match='not an ONNX file'):
            open_container(data)
    else:
        assert open_container(data).model == make_model().SerializeToString()


GOOD = pack(make_model(initializer=[helper.make_tensor('w', 1, [2], [1.0, 2.0])]))


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_damaged_bytes_never_raise_anything_else(data):
    damaged = bytearray(GOOD[: data.draw(st.integers(0, len(GOOD)))] or data.draw(st.binary()))
    for _ in range(data.draw(st.integers(0, 4))):
        if damaged:
            damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    try:
        assert open_container(bytes(damaged))[:2] == (MANIFEST, CARD)
    except ModelFileError:
        assert bytes(damaged) != GOOD
