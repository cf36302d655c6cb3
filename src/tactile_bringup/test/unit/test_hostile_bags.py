# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Bags from strangers: whatever is in them, a sentence and no more memory than is stated."""

from contextlib import suppress
import json
import os
import sqlite3
import subprocess
import sys
import zlib

from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import lz4.frame
import numpy as np
import pytest
import zstandard

from tactile_bringup.errors import BagError, BringupError
from tactile_bringup.recording.audit import FingerAuditor
from tactile_bringup.recording.bag_metadata import parse_metadata
from tactile_bringup.recording.bags import (
    BagMessage,
    BagWriter,
    EVENT,
    STRAIN,
    STRAIN_TOPIC,
    TactileBag,
)
from tactile_bringup.recording.mcap_format import (
    CHANNEL,
    CHUNK,
    CHUNK_START,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_START,
    pack_number,
    pack_record,
    pack_text,
    pack_texts,
    RECORD_START,
    SCHEMA,
)
from tactile_bringup.recording.recorded_topics import message_store
from tactile_bringup.wiring.plain_yaml import parse_plain_yaml
from tactile_features.extractor import TrialFeatureExtractor
from tactile_features.records import FeatureConfig, StrainBlock, TrialEvent

HUGE = 2**62
STRAIN_NAME = '/tendon_sensor/strain'
START = MAGIC + pack_record(HEADER, pack_text('ros2'), pack_text(''))
DEFINED = (
    START
    + pack_record(
        SCHEMA, pack_number(1, 2), pack_text(STRAIN), pack_text('ros2msg'), pack_text('')
    )
    + pack_record(
        CHANNEL,
        pack_number(1, 2),
        pack_number(1, 2),
        pack_text(STRAIN_NAME),
        pack_text('cdr'),
        pack_texts({}),
    )
)
END = pack_record(DATA_END, bytes(4)) + RECORD_START.pack(FOOTER, 20) + bytes(20) + MAGIC


def message(data=b'', channel=1, at_ns=5):
    return pack_record(MESSAGE, MESSAGE_START.pack(channel, 0, at_ns, at_ns), data)


def chunk(records, packing='', size=None, checksum=0, packed=None):
    pack = {'': bytes, 'zstd': zstandard.compress, 'lz4': lz4.frame.compress}
    packed = pack[packing](records) if packed is None else packed
    size = len(records) if size is None else size
    return pack_record(
        CHUNK,
        CHUNK_START.pack(0, 9, size, checksum),
        pack_text(packing),
        pack_number(len(packed), 8),
        packed,
    )


@pytest.fixture
def read_file(tmp_path):
    """Return a function that opens these bytes as an MCAP file and reads all of it."""

    def read(data):
        path = tmp_path / 'hostile.mcap'
        path.write_bytes(data)
        with TactileBag(path) as bag:
            return [m.data for m in bag.messages()], bag.recovered

    return read


@pytest.mark.parametrize('packing', ['', 'zstd', 'lz4'])
def test_chunks_however_packed_are_read(read_file, packing):
    records = message(b'one') + message(b'two', at_ns=3)
    data = DEFINED + chunk(records, packing, checksum=zlib.crc32(records)) + END
    assert read_file(data) == ([b'two', b'one'], '')


def test_messages_outside_of_chunks_are_read(read_file):
    assert read_file(DEFINED + message(b'one') + END) == ([b'one'], '')


def test_messages_behind_a_chunk_without_an_index_are_read(read_file):
    data = DEFINED + chunk(message(b'one', at_ns=1)) + message(b'two', at_ns=2) + END
    assert read_file(data) == ([b'one', b'two'], '')


def test_chunks_that_overlap_in_time_are_merged(read_file):
    one = message(b'1', at_ns=1) + message(b'4', at_ns=4)
    two = message(b'2', at_ns=2) + message(b'3', at_ns=3)
    assert read_file(DEFINED + chunk(one) + chunk(two) + END)[0] == [b'1', b'2', b'3', b'4']


BOMB = zstandard.compress(bytes(2**30))
NO_SIZE = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(2**28))
HOSTILE_FILES = {
    'record without end': DEFINED + RECORD_START.pack(SCHEMA, HUGE) + END,
    'definition too long': DEFINED + pack_record(SCHEMA, bytes(2**20 + 1)) + END,
    'header without end': MAGIC + RECORD_START.pack(HEADER, 2**40) + bytes(64),
    'text beyond its record': START
    + pack_record(SCHEMA, bytes(2), pack_number(2**32 - 1, 4))
    + END,
    'no text': START + pack_record(SCHEMA, bytes(2), pack_number(2, 4), b'\xff\xfe') + END,
    'another profile': MAGIC + pack_record(HEADER, pack_text('ros1'), pack_text('')) + END,
    'message too short': DEFINED + pack_record(MESSAGE, b'123') + END,
    'unknown channel': DEFINED + message(channel=7) + END,
    'unknown channel in a chunk': DEFINED + chunk(message(channel=7)) + END,
    'chunk of an exabyte': DEFINED + chunk(message(), size=HUGE) + END,
    'chunk shorter than stated': DEFINED + chunk(message(), size=2**20) + END,
    'chunk with another length': DEFINED
    + pack_record(CHUNK, CHUNK_START.pack(0, 9, 9, 0), pack_text(''), pack_number(HUGE, 8))
    + END,
    'record beyond its chunk': DEFINED + chunk(RECORD_START.pack(MESSAGE, HUGE)) + END,
    'chunk cut within a record': DEFINED + chunk(b'\x05\x00') + END,
    'wrong checksum': DEFINED + chunk(message(), checksum=1) + END,
    'packed as nobody knows': DEFINED
    + pack_record(CHUNK, CHUNK_START.pack(0, 9, 9, 0), pack_text('rar'), pack_number(0, 8))
    + END,
    'zstd bomb': DEFINED + chunk(b'', 'zstd', size=1000, packed=BOMB) + END,
    'zstd bomb at the limit': DEFINED + chunk(b'', 'zstd', size=2**26, packed=BOMB) + END,
    'zstd bomb without a size': DEFINED + chunk(b'', 'zstd', size=1000, packed=NO_SIZE) + END,
    'lz4 bomb': DEFINED
    + chunk(b'', 'lz4', size=1000, packed=lz4.frame.compress(bytes(2**28)))
    + END,
    'broken zstd': DEFINED + chunk(b'', 'zstd', size=9, packed=b'rubbish') + END,
    'broken lz4': DEFINED + chunk(b'', 'lz4', size=9, packed=b'rubbish') + END,
}


@pytest.mark.parametrize('name', HOSTILE_FILES)
def test_hostile_file_is_refused_with_a_sentence(read_file, name):
    with pytest.raises(BagError) as caught:
        read_file(HOSTILE_FILES[name])
    assert len(str(caught.value)) < 500


def test_chunks_that_all_overlap_are_not_all_read_at_once(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bringup.recording.bag_reader.MAX_OPEN_BYTES', 1000)
    records = message(bytes(100), at_ns=0) + message(bytes(100), at_ns=9)
    assert len(read_file(DEFINED + 3 * chunk(records) + END)[0]) == 6
    with pytest.raises(BagError, match='overlap in time'):
        read_file(DEFINED + 5 * chunk(records) + END)


def test_the_number_of_chunks_is_limited(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bringup.recording.mcap_reader.MAX_CHUNKS', 3)
    with pytest.raises(BagError, match='more than 3 chunks'):
        read_file(DEFINED + 4 * chunk(message()) + END)


def test_definitions_are_limited_together(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bringup.recording.mcap_reader.MAX_DEFINITION_BYTES', 200)
    definition = [
        pack_record(SCHEMA, pack_number(i, 2), pack_text('x'), pack_text(''), pack_text('y' * 50))
        for i in range(2, 9)
    ]
    with pytest.raises(BagError, match='all definitions'):
        read_file(DEFINED + b''.join(definition) + END)


LIMITED = """
import resource, sys
from pathlib import Path
from tactile_bringup.recording.bags import TactileBag
from tactile_bringup.errors import BagError
(size,) = [line.split()[1] for line in open('/proc/self/status') if line.startswith('VmSize')]
limit = int(size) * 1024 + 400 * 2**20
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
for path in sys.argv[1:]:
    try:
        with TactileBag(Path(path)) as bag:
            for message in bag.messages():
                message.decode()
        sys.exit(f'{path} was read')
    except BagError:
        print('refused', path)
"""


@pytest.mark.skipif(not os.path.exists('/proc/self/status'), reason='needs Linux')
def test_no_hostile_file_takes_more_than_the_stated_memory(tmp_path):
    """All of them, in a process that may have 400 MiB more than it starts with."""
    paths = []
    for i, data in enumerate(HOSTILE_FILES.values()):
        paths.append(tmp_path / f'{i}.mcap')
        paths[-1].write_bytes(data)
    for name, write in METADATA.items():
        paths.append(tmp_path / name.replace(' ', '_'))
        paths[-1].mkdir()
        write(paths[-1] / 'metadata.yaml')
    done = subprocess.run(
        [sys.executable, '-c', LIMITED, *map(str, paths)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('refused') == len(paths)


# -- metadata ---------------------------------------------------------------------------------


def sparse(path):
    with path.open('wb') as file:
        file.truncate(2**30)


def laughs(path):
    lines = ['a0: &a0 [x, x, x, x, x, x, x, x, x]']
    lines += [f'a{i}: &a{i} [{", ".join([f"*a{i - 1}"] * 9)}]' for i in range(1, 30)]
    path.write_text('\n'.join(lines))


METADATA = {
    'a gigabyte': sparse,
    'billion laughs': laughs,
    'deep': lambda path: path.write_text('[' * 200_000),
    'deep blocks': lambda path: path.write_text(''.join(' ' * i + '-\n' for i in range(1000))),
    'code': lambda path: path.write_text('!!python/object/apply:os.system ["true"]'),
    'not text': lambda path: path.write_bytes(b'\xff\xfe\xfd'),
    'a list': lambda path: path.write_text('[1, 2]'),
    'nothing': lambda path: path.write_text(''),
    'a number beyond all bounds': lambda path: path.write_text('version: ' + '9' * 10_000),
}


@pytest.mark.parametrize('name', METADATA)
def test_hostile_metadata_is_refused_with_a_sentence(tmp_path, name):
    METADATA[name](tmp_path / 'metadata.yaml')
    with pytest.raises(BagError, match=r'metadata\.yaml') as caught:
        TactileBag(tmp_path)
    assert len(str(caught.value)) < 500


@given(st.text(alphabet='ab:{}[]-&*!|> \n"\'0123456789.', max_size=200))
def test_any_text_is_plain_yaml_or_refused(text):
    with suppress(BringupError):
        parse_plain_yaml(text)
    with suppress(BringupError):
        parse_metadata(text)


@pytest.fixture
def small_bag(tmp_path):
    path = tmp_path / 'bag'
    with BagWriter(path, {'simulated': True}) as writer:
        name = writer.add_topic(STRAIN_TOPIC)
        for i in range(5):
            writer.write_raw(name, i, strain_bytes(i))
    return path


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


@pytest.mark.parametrize(
    'facts', ['[' * 100_000, '[]', '{"a": ' + '9' * 5000 + '}', '{"models": 7}']
)
def test_hostile_facts_are_refused_with_a_sentence(small_bag, facts):
    path = small_bag / 'metadata.yaml'
    text = path.read_text()
    old = json.dumps(json.dumps({'simulated': True}))
    assert old in text
    path.write_text(text.replace(old, json.dumps(facts)))
    with pytest.raises(BagError, match='facts'):
        TactileBag(small_bag)


def test_files_outside_of_the_bag_are_not_opened(small_bag, tmp_path):
    (tmp_path / 'outside.mcap').write_bytes(b'secret')
    path = small_bag / 'metadata.yaml'
    path.write_text(path.read_text().replace('bag_0.mcap', '../outside.mcap'))
    with pytest.raises(BagError, match=r'outside\.mcap: No such file|No such file'):
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
    monkeypatch.setattr('tactile_bringup.recording.bag_reader.MAX_UNPACKED_BYTES', 100)
    with pytest.raises(BagError, match='unpacked'):
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
    messages = [(1, 7, b'late'), (1, 3, b'early'), (1, 5, None), (1, 6, 'text'), (9, 4, b'?')]
    with TactileBag(make_database(tmp_path / 'a.db3', TABLES, messages)) as bag:
        assert [m.data for m in bag.messages()] == [b'early', b'late']


@pytest.mark.parametrize('script', [ENDLESS, 'CREATE TABLE x(y)'])
def test_a_database_that_computes_is_refused(tmp_path, script):
    with pytest.raises(BagError, match='tables of a bag'):
        TactileBag(make_database(tmp_path / 'a.db3', script))


def test_what_is_no_database_is_refused(tmp_path):
    (tmp_path / 'a.db3').write_bytes(b'SQLite format 3\x00' + bytes(range(256)) * 40)
    with pytest.raises(BagError, match='SQLite'):
        TactileBag(tmp_path / 'a.db3')


# -- anything at all -----------------------------------------------------------------------------


@given(st.sampled_from([STRAIN, EVENT]), st.binary(max_size=200))
def test_any_bytes_are_a_message_or_refused(type_name, data):
    with suppress(BagError):
        BagMessage('/x', type_name, 0, data, message_store()).decode()


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_changed_bag_is_read_or_refused(small_bag, data):
    """Bytes flipped, taken out, put in or cut off: no other error than a sentence."""
    (path,) = small_bag.glob('*.mcap')
    original = path.read_bytes()
    changed = bytearray(original)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(changed)))
        new = data.draw(st.binary(max_size=9))
        changed[at : at + data.draw(st.integers(0, 9))] = new
    try:
        path.write_bytes(changed)
        with suppress(BagError), TactileBag(small_bag) as bag:
            for message in bag.messages():
                message.decode()
    finally:
        path.write_bytes(original)


EXTREME = st.sampled_from([0, 1, 2, 59, 2**31, 2**63 - 1])


@settings(max_examples=200, deadline=None)
@given(
    blocks=st.lists(
        st.builds(
            StrainBlock,
            stamp_ns=st.integers(-(2**31) * 10**9, (2**31) * 10**9 - 1),
            sequence=st.one_of(EXTREME, st.just(2**64 - 1)),
            period_ns=st.one_of(EXTREME, st.just(-1), st.just(-(2**63))),
            tension_n=st.lists(st.floats(width=64), max_size=4).map(np.array),
            lost_before=st.one_of(EXTREME, st.just(2**64 - 1)),
            status=st.integers(0, 2**32 - 1),
        ),
        max_size=8,
    ),
    stamps_ns=st.lists(st.integers(-(2**31) * 10**9, (2**31) * 10**9 - 1), max_size=6),
)
def test_wild_numbers_harm_neither_audit_nor_features(blocks, stamps_ns):
    """What a well-formed message can say at most: windows with a reason, not an exception."""
    auditor, extractor = FingerAuditor('', 60.0), TrialFeatureExtractor(FeatureConfig())
    audits = []
    phases = ['approach', 'hold', 'glide', 'release', 'done', 'approach']
    for phase, stamp_ns in zip(phases, stamps_ns, strict=False):
        event = TrialEvent(stamp_ns, 't', '', 'stiffness', 'flexion', '', phase)
        audits += auditor.add_event(event)
        extractor.add_event(event)
    for block in blocks:
        audits += auditor.add_block(block)
        extractor.add_block(block)
    for audit in [*audits, *auditor.finish()]:
        json.dumps(audit.to_dict(), allow_nan=False)
