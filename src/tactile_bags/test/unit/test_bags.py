# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import shutil

import numpy as np
import pytest
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

from tactile_bags import BagWriter, message_store, TactileBag
from tactile_bags.bag_repair import repair_bag
from tactile_bags.errors import BagError
from tactile_ros.topics import EVENT, EVENT_TOPIC, FEATURES, FEATURES_TOPIC, STRAIN, STRAIN_TOPIC


def block(store, sequence, values):
    types = store.types
    stamp = types['builtin_interfaces/msg/Time'](sec=1, nanosec=sequence)
    return types[STRAIN](
        header=types['std_msgs/msg/Header'](stamp=stamp, frame_id='tendon_sensor_link'),
        sequence=sequence,
        period_ns=16_666_667,
        tension_n=np.array(values, dtype=np.float64),
        lost_before=0,
        stamp_error_s=-1.0,
        status=0,
    )


@pytest.fixture
def bag_path(tmp_path):
    path = tmp_path / 'bag'
    with BagWriter(path, {'simulated': True, 'note': 'two fingers'}) as writer:
        for namespace in ('thumb', 'index'):
            name = writer.add_topic(STRAIN_TOPIC, namespace)
            for i in range(3):
                writer.write(name, 100 + i, block(writer.store, i, [1.5, -2.25e-9]))
        writer.add_topic(EVENT_TOPIC, 'thumb')
        writer.add_topic(FEATURES_TOPIC, 'thumb')
    return path


def test_what_is_written_is_read_bit_for_bit(bag_path):
    with TactileBag(bag_path) as bag:
        assert bag.recovered is None
        assert bag.metadata == {'simulated': True, 'note': 'two fingers'}
        assert bag.namespaces == ('index', 'thumb')
        assert bag.topics['/thumb/tendon_sensor/strain'] == (STRAIN, 3)
        messages = list(bag.messages(STRAIN, namespace='thumb'))
        assert [m.received_at_ns for m in messages] == [100, 101, 102]
        decoded = messages[2].decode()
        assert decoded.sequence == 2
        assert decoded.tension_n.tolist() == [1.5, -2.25e-9]
        assert list(bag.messages(EVENT)) == []


def test_fingers_within_one_another_do_not_mix(tmp_path):
    with BagWriter(tmp_path / 'bag', {}) as writer:
        for i, namespace in enumerate(('', '/hand/', 'hand/thumb', 'hands')):
            name = writer.add_topic(STRAIN_TOPIC, namespace)
            writer.write(name, i, block(writer.store, i, [1.0]))
    with TactileBag(tmp_path / 'bag') as bag:
        assert bag.namespaces == ('', 'hand', 'hand/thumb', 'hands')
        for i, namespace in enumerate(bag.namespaces):
            assert [m.received_at_ns for m in bag.messages(STRAIN, namespace=namespace)] == [i]
        assert list(bag.messages(STRAIN, namespace='foot')) == []


def test_existing_folder_is_not_overwritten(bag_path):
    with pytest.raises(BagError, match='exist'):
        BagWriter(bag_path, {})


def test_writer_that_is_closed_says_so(tmp_path):
    writer = BagWriter(tmp_path / 'bag', {})
    writer.close()
    writer.close()
    with pytest.raises(BagError):
        writer.add_topic(STRAIN_TOPIC)


def test_no_bag_is_one_sentence(tmp_path):
    with pytest.raises(BagError):
        TactileBag(tmp_path / 'nothing')
    (tmp_path / 'file.txt').write_text('hello')
    with pytest.raises(BagError):
        TactileBag(tmp_path / 'file.txt')


def test_bag_without_strain_is_refused(tmp_path):
    with BagWriter(tmp_path / 'bag', {}) as writer:
        writer.add_topic(EVENT_TOPIC)
    with pytest.raises(BagError, match='StrainBlock'):
        TactileBag(tmp_path / 'bag')


def cut_off(bag_path, folder, keep):
    shutil.copytree(bag_path, folder)
    (data,) = folder.glob('*.mcap')
    data.write_bytes(data.read_bytes()[:keep])
    return folder


@pytest.mark.parametrize('keep', [0, 7, 10, 30])
def test_a_bag_cut_off_in_its_header_is_refused_with_a_sentence(bag_path, tmp_path, keep):
    with pytest.raises(BagError):
        TactileBag(cut_off(bag_path, tmp_path / 'damaged', keep))


@pytest.mark.parametrize(('keep', 'missing'), [(100, 6), (2000, 3)])
def test_a_bag_cut_off_later_says_what_is_missing(bag_path, tmp_path, keep, missing):
    """If a chunk is truncated, the messages before the cut are read."""
    with TactileBag(cut_off(bag_path, tmp_path / 'damaged', keep)) as bag:
        assert 'never closed' in bag.recovered
        assert f'{missing} recorded messages are missing' in bag.recovered
        assert bag.metadata['simulated'] is True
        assert len(list(bag.messages())) == 6 - missing


@pytest.mark.parametrize('content', [b'', b'\0' * 400, b'\n'])
def test_empty_metadata_as_after_a_power_failure_keeps_no_message_back(
    bag_path, tmp_path, content
):
    with TactileBag(bag_path) as bag:
        messages = [message.data for message in bag.messages()]
    (bag_path / 'metadata.yaml').write_bytes(content)
    with TactileBag(bag_path) as bag:
        assert 'or an empty one' in bag.recovered
        assert bag.metadata['simulated'] is True
        assert [message.data for message in bag.messages()] == messages
    repair_bag(bag_path, tmp_path / 'copy')
    with TactileBag(tmp_path / 'copy') as bag:
        assert bag.recovered is None


def test_recordings_of_another_message_definition_are_refused(bag_path):
    path = bag_path / 'metadata.yaml'
    whole = path.read_text()

    def define_otherwise(type_name):
        digest = message_store().hash_rihs01(type_name)
        assert digest in whole
        path.write_text(whole.replace(digest, 'RIHS01_' + '0' * 64))

    for type_name in (STRAIN, EVENT):
        define_otherwise(type_name)
        with pytest.raises(BagError, match='definition'):
            TactileBag(bag_path)
    define_otherwise(FEATURES)
    with TactileBag(bag_path) as bag:
        assert len(list(bag.messages(STRAIN, EVENT))) == 6
        with pytest.raises(BagError, match='definition'):
            list(bag.messages(FEATURES))


@pytest.mark.parametrize('storage', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize('compression', list(CompressionMode))
def test_bags_of_another_writer_are_read(tmp_path, storage, compression):
    """Bags of rosbags can be read with every storage and compression."""
    store = message_store()
    writer = Writer(tmp_path / 'bag', version=9, storage_plugin=storage)
    if compression == CompressionMode.STORAGE and storage == StoragePlugin.SQLITE3:
        pytest.skip('SQLite has no compression of its own')
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        strain = writer.add_connection('/tendon_sensor/strain', STRAIN, typestore=store)
        event = writer.add_connection('/trial_runner/events', EVENT, typestore=store)
        for i in range(20):
            writer.write(strain, i, store.serialize_cdr(block(store, i, [1.5] * 9), STRAIN))
    with TactileBag(tmp_path / 'bag') as bag:
        assert bag.recovered is None
        assert bag.topics[event.topic] == (EVENT, 0)
        messages = list(bag.messages(STRAIN))
        assert [m.received_at_ns for m in messages] == list(range(20))
        assert [m.decode().sequence for m in messages] == list(range(20))


def test_our_bags_are_read_by_another_reader(bag_path):
    with Reader(bag_path) as reader, TactileBag(bag_path) as bag:
        assert reader.message_count == 6
        expected = [(m.topic, m.received_at_ns, m.data) for m in bag.messages()]
        found = [(c.topic, at_ns, bytes(data)) for c, at_ns, data in reader.messages()]
        assert sorted(found) == sorted(expected)
        latched = next(c for c in reader.connections if c.topic == '/thumb/trial_runner/events')
        assert latched.ext.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL
        assert latched.ext.offered_qos_profiles[0].depth == 16


def test_status_bits_leave_the_type_of_a_recorded_block_as_it_was():
    """Constants are not part of a type's hash, so bags without a new status bit can be read."""
    recorded = 'RIHS01_93f831e7aa91f8290fe888e7ad54696f629ac944cf95240cefcbe6cacfdbf4cc'
    assert message_store().hash_rihs01(STRAIN) == recorded
