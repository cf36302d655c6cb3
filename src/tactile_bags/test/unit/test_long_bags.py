# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of long recordings need little memory, and can be read wherever they are truncated."""

from collections import Counter
import io
import tracemalloc

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader, NonSeekingReader
from mcap.writer import CompressionType, Writer
import pytest

from tactile_bags import BagWriter, message_store, TactileBag
from tactile_bags.bag_repair import repair_bag
from tactile_bags.mcap_reader import McapFile
from tactile_ros.topics import STRAIN, STRAIN_TOPIC

SIZE = 9000
COUNT = 300
"""Number of messages, which is so large that the reader divides them into several segments."""


def payload(i):
    return i.to_bytes(4, 'little') * (SIZE // 4)


@pytest.fixture(scope='module')
def unfinished(tmp_path_factory):
    """Return the data of a bag before it was closed, and the path of the closed bag."""
    path = tmp_path_factory.mktemp('long') / 'bag'
    with BagWriter(path, {'simulated': True}) as writer:
        name = writer.add_topic(STRAIN_TOPIC)
        for i in range(COUNT):
            writer.write_raw(name, 100 + i, payload(i))
            writer.save()
        (file,) = path.glob('*.mcap')
        data = file.read_bytes()
    return data, path


@pytest.fixture(scope='module')
def files(unfinished, tmp_path_factory):
    """Return the data of the bag before it was closed, and a path for a truncated copy.

    The data have a short ``repr``, so that messages of failed tests stay short.
    """

    class Left(bytes):
        def __repr__(self):
            return 'what was left'

    return Left(unfinished[0]), tmp_path_factory.mktemp('cut') / 'cut.mcap'


def messages_of(path):
    with TactileBag(path) as bag:
        return [(m.received_at_ns, m.data) for m in bag.messages()]


def expected(count):
    return [(100 + i, payload(i)) for i in range(count)]


def test_the_library_reads_what_we_write_and_finds_no_index_that_grew_in_memory(unfinished):
    _, path = unfinished
    (file,) = path.glob('*.mcap')
    summary = make_reader(file.open('rb')).get_summary()
    assert summary.statistics.channel_message_counts == {1: COUNT}
    assert not summary.chunk_indexes
    reader = NonSeekingReader(file.open('rb'), validate_crcs=True)
    found = [(message.log_time, message.data) for _, _, message in reader.iter_messages()]
    assert found == expected(COUNT)


def test_all_that_was_saved_is_read_after_a_kill(unfinished, tmp_path):
    data, _ = unfinished
    killed = tmp_path / 'killed.mcap'
    killed.write_bytes(data)
    assert messages_of(killed) == expected(COUNT)
    assert repair_bag(killed, tmp_path / 'repaired').message_count == COUNT
    assert messages_of(tmp_path / 'repaired') == expected(COUNT)


@settings(max_examples=20)
@given(part=st.floats(0.0, 1.0), zeros=st.sampled_from([0, 1, 4096, 10**7]))
def test_wherever_it_is_cut_what_came_before_is_read(files, part, zeros):
    """The file is truncated, and in some cases filled with zeros, as file systems may do.

    The cut is before the last message.
    """
    whole, file = files
    cut = 5000 + round(part * (len(whole) - (9 + 22 + SIZE) - 5000))
    file.write_bytes((whole[:cut] + bytes(zeros))[: len(whole)])
    found = messages_of(file)
    assert found == expected(len(found))
    # 60 bytes are more than the overhead of a message
    least = (cut - 5000) // (SIZE + 60)
    assert len(found) >= least - 1


def test_a_recording_in_small_chunks_opens_in_little_memory(tmp_path):
    path, count = tmp_path / 'small.mcap', 2_000
    message_store()  # loaded before memory is measured
    with path.open('wb') as file:
        writer = Writer(file, chunk_size=1, compression=CompressionType.NONE)
        writer.start('ros2')
        schema = writer.register_schema(STRAIN, 'ros2msg', b'')
        channel = writer.register_channel('/tendon_sensor/strain', 'cdr', schema)
        for i in range(count):
            writer.add_message(channel, i, b'', i)
        writer.finish()
    tracemalloc.start()
    with TactileBag(path) as bag:
        used, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert len(bag._files[0].segments) == count
        assert bag.topics['/tendon_sensor/strain'] == (STRAIN, count)
        *_, newest = bag.messages()
    assert used < 300 * count
    assert newest.received_at_ns == count - 1


def read_by_channel(path):
    """Return the number of messages on each channel: according to the file, and as read."""
    file = McapFile(path)
    try:
        read = Counter(
            channel
            for segment in file.segments
            for _, channel, _ in file.messages_of(segment, file.topics)
        )
        return file.counts, read
    finally:
        file.close()


@pytest.fixture(scope='module')
def two_channels(tmp_path_factory):
    """Return a finished file of two channels in two chunks, and the position of its last index.

    The chunks are not compressed, as in the bags of version 0.2 and before.
    """
    data = io.BytesIO()
    writer = Writer(data, compression=CompressionType.NONE)
    writer.start('ros2')
    schema = writer.register_schema(STRAIN, 'ros2msg', b'')
    channels = [writer.register_channel(name, 'cdr', schema) for name in ('/a', '/b')]
    for i in range(6):
        for channel in channels:
            writer.add_message(channel, i + 1, bytes([channel]) * 8, i + 1)
        if i == 2:
            writer.flush()
    writer.flush()
    index_end = data.tell()
    writer.add_metadata('rosbag2', {'serialized_metadata': ''})
    writer.finish()
    # The last chunk is followed by an index for each of two channels, with 3 entries each.
    return data.getvalue(), index_end - 2 * (9 + 6 + 3 * 16), index_end


def test_a_cut_behind_the_last_chunk_costs_no_message(two_channels, tmp_path):
    """The file is truncated, or filled with zeros, at each byte of the last index or after it."""
    whole, index_start, index_end = two_channels
    path = tmp_path / 'cut.mcap'
    for cut in range(index_start, len(whole) + 1):
        of_index = (index_end - cut, len(whole) - cut, 10_000) if cut <= index_end else ()
        for zeros in (0, *of_index):
            path.write_bytes(whole[:cut] + bytes(zeros))
            assert read_by_channel(path) == ({1: 6, 2: 6}, {1: 6, 2: 6}), (cut, zeros)


@pytest.mark.parametrize('zeros', [0, 1, 100, 5000])
def test_a_chunk_that_is_cut_off_is_read_up_to_its_last_whole_message(
    two_channels, tmp_path, zeros
):
    whole, index_start, _ = two_channels
    path = tmp_path / 'cut.mcap'
    size = 9 + 22 + 8  # size of each of the six messages at the end of the last chunk
    for cut in range(index_start - 6 * size, index_start):
        path.write_bytes(whole[:cut] + bytes(zeros))
        left = 12 - -(-(index_start - cut) // size)
        counts = {1: -(-left // 2), 2: left // 2}
        assert read_by_channel(path) == (counts, counts), cut
