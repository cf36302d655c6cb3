# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages of another release are decoded by the definitions that their bag stores."""

import pytest
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from tactile_bags import BagWriter, message_store, TactileBag
from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import StoredTopic
from tactile_bags.message_types import qos_text
from tactile_ros.topics import MODELS, STRAIN_TOPIC

DEFINITION = message_store().generate_msgdef(MODELS, ros_version=2)[0]
QOS = qos_text(latched=True)


def of_another_release(*changes):
    """Return the definition of ``ModelInfos`` with some texts replaced."""
    text = DEFINITION
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def write_bag(folder, definition, **info):
    """Write a bag with one message of this definition; return its path."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, MODELS))
    types = store.types
    stamp = types['builtin_interfaces/msg/Time'](sec=1, nanosec=2)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
    values = {'model_id': 'm', 'path': 'p', 'task': 'texture', 'labels': ['a', 'b'], **info}
    kinds = {'string': '', 'bool': True, 'uint32': 3, 'uint8': 4}
    fields = {}
    for name, (_, detail) in store.fielddefs['tactile_msgs/msg/ModelInfo'][1]:
        fields[name] = values.get(name, kinds.get(detail[0], []))
    model = types['tactile_msgs/msg/ModelInfo'](**fields)
    outer = {'header': header, 'models': [model], 'refused': ['x']}
    more = {n: 5 for n, _ in store.fielddefs[MODELS][1] if n not in outer}
    data = bytes(store.serialize_cdr(types[MODELS](**outer, **more), MODELS))
    type_hash = store.hash_rihs01(MODELS)
    topic = StoredTopic('/tactile_classifier/models', MODELS, type_hash, definition, qos=QOS)
    with BagWriter(folder, {}) as writer:
        writer.add_topic(STRAIN_TOPIC)
        writer.write_raw(writer.add_stored_topic(topic), 1, data)
    return folder


def read_one(path):
    with TactileBag(path) as bag:
        (message,) = bag.messages(MODELS)
        return message.decode()


def test_fields_that_are_gone_are_left_out_and_missing_ones_have_their_default(tmp_path):
    definition = of_another_release(
        ('string sha256\n', 'string colour\n'),
        ('bool simulated\n', ''),
        ('string[] refused\n', 'string[] refused\nuint8 mood\n'),
    )
    message = read_one(write_bag(tmp_path / 'bag', definition, colour='red'))
    (model,) = message.models
    assert (model.model_id, model.path, model.labels) == ('m', 'p', ['a', 'b'])
    assert (model.sha256, model.simulated) == ('', False)
    assert (message.header.stamp.nanosec, message.refused) == (2, ['x'])
    assert not hasattr(model, 'colour')
    assert not hasattr(message, 'mood')
    assert type(message) is message_store().types[MODELS]


def test_a_field_of_another_type_is_refused(tmp_path):
    definition = of_another_release(('string path\n', 'uint8 path\n'))
    path = write_bag(tmp_path / 'bag', definition, path=1)
    with pytest.raises(BagError, match='path of tactile_msgs/msg/ModelInfo'):
        read_one(path)


@pytest.mark.parametrize(
    'change',
    [
        ('string sha256\n', 'string sha256\nuint8[4] four\n'),
        ('string sha256\n', 'string sha256\nuint8[4000000000] many\n'),
        ('string sha256\n', 'string sha256\nNothing[] none\n'),
        ('string sha256\n', 'string sha256\nModelInfo[] within\n'),
        ('string sha256\n', 'string sha256\nUnknown one\n'),
        ('string[] refused\n', 'import os\n'),
        (DEFINITION, ''),
        (DEFINITION, '=' * 10_000),
    ],
    ids=['fixed', 'long', 'empty', 'recursive', 'unknown', 'import', 'none', 'garbage'],
)
def test_hostile_definitions_are_not_used(tmp_path, change):
    hostile = of_another_release(change)
    if 'Nothing' in hostile:
        hostile += '=' * 80 + '\nMSG: tactile_msgs/Nothing\n'
    path = write_bag(tmp_path / 'bag', DEFINITION.replace('sha256', 'sha512'))
    with TactileBag(path) as bag:
        (stored,) = (topic for topic in bag.stored_topics if topic.type_name == MODELS)
        (message,) = bag.messages(MODELS)
    topic = StoredTopic(stored.name, MODELS, stored.type_hash, hostile, qos=QOS)
    with BagWriter(tmp_path / 'hostile', {}) as writer:
        writer.add_topic(STRAIN_TOPIC)
        writer.write_raw(writer.add_stored_topic(topic), 1, message.data)
    with TactileBag(tmp_path / 'hostile') as bag, pytest.raises(BagError, match='definition'):
        list(bag.messages(MODELS))
