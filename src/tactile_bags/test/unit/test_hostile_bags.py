# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Untrusted bags cause an error message, and never exceed the stated memory limits."""

from contextlib import suppress
import os
import re
import struct
import subprocess
import sys
import zlib

from hypothesis import given
from hypothesis import strategies as st
import lz4.frame
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    Message,
    MessageIndex,
    Metadata,
    Schema,
    Statistics,
)
import pytest
import zstandard

from tactile_bags import TactileBag
from tactile_bags.bag_metadata import parse_metadata
from tactile_bags.bag_repair import repair_bag
from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import MAGIC
from tactile_ros.errors import TactileError
from tactile_ros.topics import STRAIN
from tactile_ros.yaml_files import load_yaml

STRAIN_NAME = '/tendon_sensor/strain'
HUGE = 2**62
RECORD_START = struct.Struct('<BQ')


def pack(*records):
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


# The tests build files from single records, because no library writes invalid files.
def pack_record(opcode, contents):
    return RECORD_START.pack(opcode, len(contents)) + contents


def channel(number=1, topic=STRAIN_NAME, encoding='cdr'):
    return Channel(number, topic, encoding, {}, 1)


START = MAGIC + pack(Header('ros2', ''))
SCHEMA = pack(Schema(1, b'', 'ros2msg', STRAIN))
DEFINED = START + SCHEMA + pack(channel())
NO_METADATA = pack(Metadata('rosbag2', {'serialized_metadata': '[1'}))
DATA_END, FOOTER = pack(DataEnd(0)), pack(Footer(0, 0, 0)) + MAGIC
END = DATA_END + FOOTER


def message(data=b'', channel=1, at_ns=5):
    return pack(Message(channel, at_ns, data, at_ns, 0))


def chunk(records, packing='', size=None, checksum=0, packed=None):
    compress = {'': bytes, 'zstd': zstandard.compress, 'lz4': lz4.frame.compress}
    packed = compress[packing](records) if packed is None else packed
    size = len(records) if size is None else size
    return pack(Chunk(packing, packed, 9, 0, checksum, size))


@pytest.fixture
def read_file(tmp_path):
    """Return a function that reads all messages of an MCAP file with given bytes."""

    def read(data):
        path = tmp_path / 'hostile.mcap'
        path.write_bytes(data)
        with TactileBag(path) as bag:
            return [m.data for m in bag.messages()], bag.recovered

    return read


ONE_FOUR = message(b'1', at_ns=1) + message(b'4', at_ns=4)
TWO_THREE = message(b'2', at_ns=2) + message(b'3', at_ns=3)


@pytest.mark.parametrize('packing', ['', 'zstd', 'lz4'])
def test_messages_are_read_in_order_however_they_are_packed(read_file, packing):
    """This includes messages after a chunk without an index, and chunks that overlap in time."""
    first = chunk(ONE_FOUR, packing, checksum=zlib.crc32(ONE_FOUR))
    for second in (chunk(TWO_THREE, packing), TWO_THREE):
        assert read_file(DEFINED + first + second + END) == ([b'1', b'2', b'3', b'4'], None)


def test_a_copy_of_the_metadata_that_came_in_part_keeps_no_message_back(read_file):
    messages, recovered = read_file(DEFINED + message(b'one') + NO_METADATA)
    assert messages == [b'one']
    assert recovered


BOMB = zstandard.compress(bytes(2**30))
ZEROS = bytes(2**28)
NO_SIZE = zstandard.ZstdCompressor(write_content_size=False).compress(ZEROS)
CHUNK_START = struct.Struct('<QQQIIQ')
HOSTILE_FILES = {
    'record without end': DEFINED + RECORD_START.pack(Opcode.SCHEMA, HUGE) + END,
    'definition too long': DEFINED + pack_record(Opcode.SCHEMA, bytes(2**20 + 1)) + END,
    'header without end': MAGIC + RECORD_START.pack(Opcode.HEADER, 2**40) + bytes(64),
    'text beyond its record': DEFINED + pack_record(Opcode.SCHEMA, bytes(2) + b'\xff' * 4) + END,
    'no text': DEFINED + pack_record(Opcode.SCHEMA, b'\0\0\2\0\0\0\xff\xfe') + END,
    'another profile': MAGIC + pack(Header('ros1', '')) + END,
    'message too short': DEFINED + pack_record(Opcode.MESSAGE, b'123') + END,
    'record of an unknown kind': DEFINED + pack_record(0x45, b'') + END,
    'channel defined otherwise': DEFINED + pack(channel(encoding='xml')) + END,
    'messages of another form': START + SCHEMA + pack(channel(encoding='xml')) + message() + END,
    'copy of the metadata that is none': DEFINED + message() + NO_METADATA + END,
    'unknown channel': DEFINED + message(channel=7) + END,
    'unknown channel in a chunk': DEFINED + chunk(message(channel=7)) + END,
    'chunk of an exabyte': DEFINED + chunk(message(), size=HUGE) + END,
    'chunk shorter than stated': DEFINED + chunk(message(), size=2**20) + END,
    'chunk with another length': DEFINED
    + pack_record(Opcode.CHUNK, CHUNK_START.pack(0, 9, 9, 0, 0, HUGE))
    + END,
    'record beyond its chunk': DEFINED + chunk(RECORD_START.pack(Opcode.MESSAGE, HUGE)) + END,
    'chunk cut within a record': DEFINED + chunk(b'\x05\x00') + END,
    'wrong checksum': DEFINED + chunk(message(), checksum=1) + END,
    'packed as nobody knows': DEFINED + chunk(b'', 'rar', packed=b'') + END,
    'zstd bomb': DEFINED + chunk(b'', 'zstd', size=1000, packed=BOMB) + END,
    'zstd bomb at the limit': DEFINED + chunk(b'', 'zstd', size=2**26, packed=BOMB) + END,
    'zstd bomb without a size': DEFINED + chunk(b'', 'zstd', size=1000, packed=NO_SIZE) + END,
    'lz4 bomb': DEFINED + chunk(b'', 'lz4', size=1000, packed=lz4.frame.compress(ZEROS)) + END,
    'broken zstd': DEFINED + chunk(b'', 'zstd', size=9, packed=b'rubbish') + END,
    'broken lz4': DEFINED + chunk(b'', 'lz4', size=9, packed=b'rubbish') + END,
}


@pytest.mark.parametrize('name', HOSTILE_FILES)
def test_hostile_file_is_refused_with_a_sentence(read_file, name, tmp_path):
    with pytest.raises(BagError) as caught:
        read_file(HOSTILE_FILES[name])
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


def test_chunks_that_all_overlap_are_not_all_read_at_once(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bags.bag_reader.MAX_OPEN_BYTES', 1000)
    records = message(bytes(100), at_ns=0) + message(bytes(100), at_ns=9)
    assert len(read_file(DEFINED + 3 * chunk(records) + END)[0]) == 6
    with pytest.raises(BagError, match='overlap'):
        read_file(DEFINED + 5 * chunk(records) + END)


def test_the_memory_for_the_index_of_the_chunks_is_limited(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bags.mcap_reader.MAX_SEGMENTS', 5)
    with pytest.raises(BagError, match='chunks'):
        read_file(DEFINED + 6 * chunk(message()) + END)


def index_of(channel):
    return pack(MessageIndex(channel, [(0, 0)]))


EVENTS = pack(channel(2, '/trial_runner/events'))
BOTH = message(b'one', at_ns=1) + message(b'two', channel=2, at_ns=2)


def finish(counts):
    totals = Statistics(0, 2, counts, 1, sum(counts.values()), 9, 0, 0, 1)
    return DATA_END + pack(totals) + FOOTER


def test_the_index_of_a_chunk_hides_no_message(read_file):
    """The index of a chunk is not used: it may lack a topic, or contain another topic."""
    data = DEFINED + EVENTS + chunk(BOTH)
    for index in (index_of(1) + index_of(2), index_of(1), index_of(1) + index_of(7), b''):
        for end in (finish({1: 1, 2: 1}), END):
            assert read_file(data + index + end) == ([b'one', b'two'], None)


def test_a_closed_file_without_all_of_its_messages_is_refused_and_can_be_repaired(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(
        DEFINED + EVENTS + chunk(BOTH) + index_of(1) + index_of(2) + finish({1: 1, 2: 5})
    )
    said = r'a\.mcap .*1 .*/trial_runner/events.* 5'
    with pytest.raises(BagError, match=f'{said}.*tactile repair'):
        TactileBag(path)
    repair = repair_bag(path, tmp_path / 'copy')
    assert repair.message_count == 2
    assert re.search(said, repair.recovered)
    with TactileBag(tmp_path / 'copy') as bag:
        assert [m.data for m in bag.messages()] == [b'one', b'two']


def test_the_metadata_of_a_bag_are_compared_with_its_messages(tmp_path):
    bag = tmp_path / 'bag'
    (tmp_path / 'a.mcap').write_bytes(DEFINED + message(b'one') + message(b'two') + END)
    repair_bag(tmp_path / 'a.mcap', bag)
    metadata = bag / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace('message_count: 2', 'message_count: 3'))
    with pytest.raises(BagError, match=r' 2 .*metadata\.yaml .*3'):
        TactileBag(bag)
    assert repair_bag(bag, tmp_path / 'copy').message_count == 2


def test_chunks_with_ever_other_channels_are_limited(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bags.mcap_reader.MAX_CHANNELS', 2)
    one, two = chunk(message()), chunk(message(channel=2))
    assert len(read_file(DEFINED + EVENTS + 2 * (one + two) + END)[0]) == 4
    with pytest.raises(BagError, match='chunks'):
        read_file(DEFINED + EVENTS + one + two + chunk(BOTH) + END)


def test_definitions_are_limited_together(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bags.mcap_reader.MAX_DEFINITION_BYTES', 200)
    definitions = pack(*(Schema(i, b'y' * 50, '', 'x') for i in range(2, 9)))
    with pytest.raises(BagError, match='definitions'):
        read_file(DEFINED + definitions + END)


LIMITED = """
import resource, sys
from pathlib import Path
from tactile_bags import TactileBag
from tactile_bags.errors import BagError
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
    """All files are read in a process that may use 400 MiB more than at its start."""
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
    'a number to base 60': lambda path: path.write_text('version: 1' + ':1' * 10**6),
    'a pipe': os.mkfifo,
}


@pytest.mark.parametrize('name', METADATA)
def test_hostile_metadata_is_refused_with_a_sentence(tmp_path, name):
    METADATA[name](tmp_path / 'metadata.yaml')
    with pytest.raises(BagError, match=r'metadata\.yaml') as caught:
        TactileBag(tmp_path)
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


@given(st.text(alphabet='ab:{}[]-&*!|> \n"\'0123456789.', max_size=200))
def test_any_text_is_yaml_or_refused(text):
    with suppress(TactileError):
        load_yaml(text)
    with suppress(TactileError):
        parse_metadata(text)
