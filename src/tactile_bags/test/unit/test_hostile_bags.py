# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Untrusted bags: whatever is in them, a sentence and no more memory than is stated."""

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
import pytest
import zstandard

from tactile_bags import STRAIN, TactileBag
from tactile_bags.bag_metadata import parse_metadata
from tactile_bags.bag_repair import repair_bag
from tactile_bags.errors import BagError
from tactile_bags.mcap_reader import MAGIC
from tactile_bags.yaml_files import load_yaml
from tactile_ros.errors import TactileError

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = range(1, 8)
STATISTICS, DATA_END = 0x0B, 0x0F
RECORD_START = struct.Struct('<BQ')
MESSAGE_START = struct.Struct('<HIQQ')
CHUNK_START = struct.Struct('<QQQI')
STATISTICS_START = struct.Struct('<QHIIIIQQ')


# The records are made by hand: no library writes hostile ones.
def pack_record(opcode, *parts):
    contents = b''.join(parts)
    return RECORD_START.pack(opcode, len(contents)) + contents


def pack_number(value, size):
    return value.to_bytes(size, 'little')


def pack_text(text):
    return pack_number(len(text.encode()), 4) + text.encode()


def pack_texts(texts):
    data = b''.join(pack_text(k) + pack_text(v) for k, v in texts.items())
    return pack_number(len(data), 4) + data


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
    'record of an unknown kind': DEFINED + pack_record(0x45, b'') + END,
    'channel defined otherwise': DEFINED.replace(b'cdr', b'xml') + DEFINED[len(START) :] + END,
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
    monkeypatch.setattr('tactile_bags.bag_reader.MAX_OPEN_BYTES', 1000)
    records = message(bytes(100), at_ns=0) + message(bytes(100), at_ns=9)
    assert len(read_file(DEFINED + 3 * chunk(records) + END)[0]) == 6
    with pytest.raises(BagError, match='overlap in time'):
        read_file(DEFINED + 5 * chunk(records) + END)


def test_the_memory_for_the_index_of_the_chunks_is_limited(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bags.mcap_reader.MAX_SEGMENTS', 5)
    with pytest.raises(BagError, match='so many chunks'):
        read_file(DEFINED + 6 * chunk(message()) + END)


def index_of(channel):
    return pack_record(MESSAGE_INDEX, pack_number(channel, 2), pack_number(16, 4), bytes(16))


def statistics_of(counts):
    pairs = b''.join(pack_number(c, 2) + pack_number(n, 8) for c, n in counts.items())
    totals = STATISTICS_START.pack(sum(counts.values()), 1, 2, 0, 0, 1, 0, 9)
    return pack_record(STATISTICS, totals, pack_number(len(pairs), 4), pairs)


EVENTS = pack_record(
    CHANNEL,
    pack_number(2, 2),
    pack_number(1, 2),
    pack_text('/trial_runner/events'),
    pack_text('cdr'),
    pack_texts({}),
)
BOTH = message(b'one', at_ns=1) + message(b'two', channel=2, at_ns=2)


def finish(counts):
    data_end, rest = END[: len(END) - 29 - len(MAGIC)], END[len(END) - 29 - len(MAGIC) :]
    return data_end + statistics_of(counts) + rest


def test_the_index_of_a_chunk_hides_no_message(read_file):
    """One that lacks a topic, or names another, is not used."""
    data = DEFINED + EVENTS + chunk(BOTH)
    for index in (index_of(1) + index_of(2), index_of(1), index_of(1) + index_of(7), b''):
        for end in (finish({1: 1, 2: 1}), END):
            assert read_file(data + index + end) == ([b'one', b'two'], '')


def test_a_closed_file_without_all_of_its_messages_is_refused_and_can_be_repaired(tmp_path):
    path = tmp_path / 'a.mcap'
    path.write_bytes(
        DEFINED + EVENTS + chunk(BOTH) + index_of(1) + index_of(2) + finish({1: 1, 2: 5})
    )
    said = (
        r'a\.mcap holds 1 messages on /trial_runner/events, and its own statistics say 5: it was '
        'damaged after it was closed'
    )
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
    with pytest.raises(BagError, match=r'holds 2 messages on .*, and its metadata\.yaml says 3'):
        TactileBag(bag)
    assert repair_bag(bag, tmp_path / 'copy').message_count == 2


def test_chunks_with_ever_other_channels_are_limited(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bags.mcap_reader.MAX_CHANNELS', 2)
    one, two = chunk(message()), chunk(message(channel=2))
    assert len(read_file(DEFINED + EVENTS + 2 * (one + two) + END)[0]) == 4
    with pytest.raises(BagError, match='so many chunks'):
        read_file(DEFINED + EVENTS + one + two + chunk(BOTH) + END)


def test_definitions_are_limited_together(read_file, monkeypatch):
    monkeypatch.setattr('tactile_bags.mcap_reader.MAX_DEFINITION_BYTES', 200)
    definition = [
        pack_record(SCHEMA, pack_number(i, 2), pack_text('x'), pack_text(''), pack_text('y' * 50))
        for i in range(2, 9)
    ]
    with pytest.raises(BagError, match='all definitions'):
        read_file(DEFINED + b''.join(definition) + END)


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
    'a number to base 60': lambda path: path.write_text('version: 1' + ':1' * 10**6),
    'a pipe': os.mkfifo,
}


@pytest.mark.parametrize('name', METADATA)
def test_hostile_metadata_is_refused_with_a_sentence(tmp_path, name):
    METADATA[name](tmp_path / 'metadata.yaml')
    with pytest.raises(BagError, match=r'metadata\.yaml') as caught:
        TactileBag(tmp_path)
    assert len(str(caught.value)) < 500


@given(st.text(alphabet='ab:{}[]-&*!|> \n"\'0123456789.', max_size=200))
def test_any_text_is_yaml_or_refused(text):
    with suppress(TactileError):
        load_yaml(text)
    with suppress(TactileError):
        parse_metadata(text)
