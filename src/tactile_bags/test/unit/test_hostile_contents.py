# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags that can be opened, but have untrusted metadata, files, databases or messages."""

from contextlib import suppress
import io
import json
import os
import sqlite3

from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
import numpy as np
import pytest
import zstandard

from tactile_bags import BagMessage, BagWriter, TactileBag
from tactile_bags.audit import FingerAuditor
from tactile_bags.bag_repair import repair_bag
from tactile_bags.errors import BagError
from tactile_bags.message_types import message_store
from tactile_features.config import FeatureConfig
from tactile_features.conversions import check_block
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.types import TrialEvent
from tactile_ros.errors import MessageError
from tactile_ros.strain import StrainBlock
from tactile_ros.topics import EVENT, STRAIN, STRAIN_TOPIC


def write_bag(path):
    with BagWriter(path, {'simulated': True}) as writer:
        name = writer.add_topic(STRAIN_TOPIC)
        for i in range(5):
            writer.write_raw(name, i, strain_bytes(i))
    return path


@pytest.fixture
def small_bag(tmp_path):
    return write_bag(tmp_path / 'bag')


def read(bag):
    return [(message.received_at_ns, message.data) for message in bag.messages()]


def strain_bytes(sequence):
    types = message_store().types
    stamp = types['builtin_interfaces/msg/Time'](sec=1, nanosec=0)
    block = types[STRAIN](
        header=types['std_msgs/msg/Header'](stamp=stamp, frame_id='tendon_sensor_link'),
        sequence=sequence,
        period_ns=10**7,
        tension_n=np.arange(4.0),
        lost_before=0,
        stamp_error_s=-1.0,
        status=0,
    )
    return bytes(message_store().serialize_cdr(block, STRAIN))


def chunked(compression):
    """Return the bytes of the small bag's data file, but with chunks of two messages each."""
    file = io.BytesIO()
    writer = Writer(file, chunk_size=150, compression=compression)
    writer.start('ros2')
    schema = writer.register_schema(STRAIN, 'ros2msg', b'')
    channel = writer.register_channel('/tendon_sensor/strain', 'cdr', schema)
    for i in range(5):
        writer.add_message(channel, i, strain_bytes(i), i)
    writer.finish()
    return file.getvalue()


@pytest.mark.parametrize(
    'metadata',
    ['[' * 100_000, '[]', '{"a": ' + '9' * 5000 + '}'],
    ids=['deep', 'a list', 'a long number'],
)
def test_hostile_metadata_are_refused_with_a_sentence(small_bag, metadata):
    path = small_bag / 'metadata.yaml'
    text = path.read_text()
    old = json.dumps(json.dumps({'simulated': True}))
    assert old in text
    path.write_text(text.replace(old, json.dumps(metadata)))
    with pytest.raises(BagError, match=r'metadata\.yaml|custom data'):
        TactileBag(small_bag)


def test_files_outside_of_the_bag_are_not_opened(small_bag, tmp_path):
    (tmp_path / 'outside.mcap').write_bytes(b'secret')
    path = small_bag / 'metadata.yaml'
    path.write_text(path.read_text().replace('bag_0.mcap', '../outside.mcap'))
    with pytest.raises(BagError, match=r'outside\.mcap'):
        TactileBag(small_bag)


def test_a_packed_file_is_unpacked_up_to_a_limit(small_bag, monkeypatch):
    data = small_bag / 'bag_0.mcap'
    (small_bag / 'bag_0.mcap.zstd').write_bytes(zstandard.compress(data.read_bytes()))
    data.unlink()
    path = small_bag / 'metadata.yaml'
    text = path.read_text().replace('bag_0.mcap', 'bag_0.mcap.zstd')
    path.write_text(
        text.replace('compression_mode: ""', 'compression_mode: FILE').replace(
            'compression_format: ""', 'compression_format: zstd'
        )
    )
    with TactileBag(small_bag) as bag:
        assert len(list(bag.messages(STRAIN))) == 5
    monkeypatch.setattr('tactile_bags.bag_reader.MAX_UNPACKED_BYTES', 100)
    with pytest.raises(BagError, match='100 bytes'):
        TactileBag(small_bag)
    (small_bag / 'bag_0.mcap.zstd').write_bytes(b'rubbish')
    with pytest.raises(BagError, match=r'bag_0\.mcap\.zstd'):
        TactileBag(small_bag)


# -- SQLite -----------------------------------------------------------------------------------

TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,
    offered_qos_profiles TEXT);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
INSERT INTO topics VALUES (1, '/tendon_sensor/strain', 'tactile_msgs/msg/StrainBlock', 'cdr', '');
"""
ENDLESS = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)
    SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(1000000) AS data FROM n;
"""


def make_database(path, script, messages=()):
    database = sqlite3.connect(path)
    database.executescript(script)
    for row in messages:
        database.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', row)
    database.commit()
    database.close()
    return path


def test_a_database_is_read_in_the_order_of_arrival(tmp_path):
    messages = [(1, 7, b'late'), (1, 3, b'early')]
    with TactileBag(make_database(tmp_path / 'a.db3', TABLES, messages)) as bag:
        assert [m.data for m in bag.messages()] == [b'early', b'late']
        assert bag.end_ns == 7


NO_MESSAGES = {
    'no data': (1, 5, None),
    'a text': (1, 6, 'text'),
    'an unknown topic': (9, 4, b'?'),
    'a topic that is a text': ('x', 4, b'?'),
    'a time that is a text': (1, 'noon', b'?'),
    'a time beyond all bounds': (1, float('inf'), b'?'),
    'no time': (1, None, b'?'),
}


@pytest.mark.parametrize('row', NO_MESSAGES.values(), ids=NO_MESSAGES)
def test_rows_of_a_database_that_are_no_messages_are_told(tmp_path, row):
    path = make_database(tmp_path / 'a.db3', TABLES, [(1, 3, b'good'), row])
    with pytest.raises(BagError, match=r'a\.db3 .*\d'):
        TactileBag(path)
    repair_bag(path, tmp_path / 'copy')
    with TactileBag(tmp_path / 'copy') as bag:
        assert [m.data for m in bag.messages()] == [b'good']


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3'])
def test_a_pipe_in_place_of_a_file_is_refused(tmp_path, name):
    os.mkfifo(tmp_path / name)
    for path in (tmp_path, tmp_path / name):
        with pytest.raises(BagError, match=name):
            TactileBag(path)


BROKEN = "{} UPDATE topics SET {} = CAST(x'fffe80' AS TEXT);"


@pytest.mark.parametrize(
    'script',
    [
        ENDLESS,
        'CREATE TABLE x(y)',
        *(BROKEN.format(TABLES, each) for each in ('name', 'type', 'serialization_format')),
        None,
    ],
    ids=['endless', 'other tables', 'name', 'type', 'serialization', 'no database'],
)
def test_a_database_that_is_no_bag_is_refused(tmp_path, script):
    path = tmp_path / 'a.db3'
    if script is None:
        path.write_bytes(b'SQLite format 3\x00' + bytes(range(256)) * 40)
    else:
        make_database(path, script)
    with pytest.raises(BagError, match=r'a\.db3'):
        TactileBag(path)


# -- anything at all -----------------------------------------------------------------------------


@given(st.sampled_from([STRAIN, EVENT]), st.binary(max_size=200))
def test_any_bytes_are_a_message_or_refused(type_name, data):
    with suppress(BagError):
        BagMessage('/x', type_name, 0, data, message_store()).decode()


@pytest.fixture(scope='module')
def closed_files(tmp_path_factory):
    """Return a bag's bytes without chunks and with each compression, its messages and its path."""
    path = write_bag(tmp_path_factory.mktemp('changed') / 'bag')
    (file,) = path.glob('*.mcap')
    packed = [file.read_bytes(), *map(chunked, CompressionType)]
    return packed, [(i, strain_bytes(i)) for i in range(5)], file


@given(data=st.data())
def test_a_changed_bag_is_refused_or_holds_the_same(closed_files, data):
    """If bytes in one place of a closed file are changed, a checksum detects it.

    The bag is refused, or has the same messages. Only one place is changed, because a second
    change could set the checksum to zero, which means that the file has no checksum.
    """
    packed, messages, file = closed_files
    changed = bytearray(data.draw(st.sampled_from(packed)))
    first, last = changed.find(messages[0][1]), changed.rfind(messages[-1][1])
    anywhere = st.integers(0, len(changed))
    at = data.draw(anywhere if first < 0 else st.integers(first, last) | anywhere)
    new = data.draw(st.binary(max_size=9))
    changed[at : at + data.draw(st.just(len(new)) | st.integers(0, 9))] = new
    file.write_bytes(changed)
    with suppress(BagError), TactileBag(file.parent) as bag:
        assert read(bag) == messages


@given(data=st.data())
def test_a_bag_that_is_cut_off_says_so_and_holds_what_came_before(closed_files, data):
    packed, messages, file = closed_files
    whole = data.draw(st.sampled_from(packed))
    file.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
    with suppress(BagError), TactileBag(file.parent) as bag:
        assert 'never closed' in bag.recovered
        found = read(bag)
        assert found == messages[: len(found)]


def test_a_chunk_that_was_changed_is_not_read_as_one_that_is_cut(small_bag):
    (path,) = small_bag.glob('*.mcap')
    changed = bytearray(chunked(CompressionType.NONE)[:-9])  # the file was never closed
    at = changed.index(strain_bytes(0))
    changed[at:at] = bytes(6)  # the chunk now ends in a zero
    path.write_bytes(changed)
    with TactileBag(small_bag) as bag:
        assert bag.recovered
        assert not list(bag.messages())


EXTREME = st.sampled_from([0, 1, 2, 59, 2**31, 2**63 - 1])


@given(
    blocks=st.lists(
        st.builds(
            StrainBlock,
            stamp_ns=st.one_of(st.integers(0, (2**31) * 10**9 - 1), st.just(-1)),
            sequence=st.one_of(EXTREME, st.just(2**64 - 1)),
            period_ns=st.one_of(EXTREME, st.just(-1), st.just(-(2**63)), st.integers(0, 10**18)),
            tension_n=st.lists(
                st.one_of(st.floats(-1e6, 1e6), st.floats(width=64)), max_size=4
            ).map(np.array),
            lost_before=st.one_of(EXTREME, st.just(2**64 - 1)),
            status=st.one_of(st.integers(0, 2**9 - 1), st.integers(0, 2**32 - 1)),
        ),
        max_size=8,
    ),
    stamps_ns=st.lists(st.integers(-(2**31) * 10**9, (2**31) * 10**9 - 1), max_size=6),
)
def test_wild_numbers_harm_neither_audit_nor_features(blocks, stamps_ns):
    """Messages with any content are refused or result in windows with a reason."""
    auditor, extractor = FingerAuditor('', 60.0), TrialFeatureExtractor(FeatureConfig())
    audits = []
    phases = ['approach', 'hold', 'glide', 'release', 'done', 'approach']
    for phase, stamp_ns in zip(phases, stamps_ns, strict=False):
        event = TrialEvent(stamp_ns, 't', '', 'stiffness', 'flexion', '', phase)
        audits += auditor.add_event(event)
        extractor.add_event(event)
    for block in blocks:
        try:
            check_block(block)  # done by every conversion of a message
        except MessageError:
            continue
        audits += auditor.add_block(block)
        extractor.add_block(block)
    for audit in [*audits, *auditor.finish()]:
        json.dumps(audit.to_dict(), allow_nan=False)
