# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags on a full disk, simulated by the operating system's limit of the size of a file."""

from contextlib import contextmanager
import resource

import pytest

from tactile_bags import BagWriter, TactileBag
from tactile_bags.errors import BagError
from tactile_ros.topics import STRAIN_TOPIC

MESSAGE = bytes(10_000)


@contextmanager
def largest_file(size):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_bag_ends_with_the_last_chunk_that_fitted(tmp_path):
    path = tmp_path / 'bag'
    writer = BagWriter(path, {'simulated': True})
    name = writer.add_topic(STRAIN_TOPIC)
    for i in range(3):
        writer.write_raw(name, i, MESSAGE)
    writer.save()
    size = (path / 'bag_0.mcap').stat().st_size
    for i in range(3, 6):
        writer.write_raw(name, i, MESSAGE)
    with largest_file(size + 15_000):  # space for half of the new messages
        with pytest.raises(BagError, match='File too large'):
            writer.save()
        assert (path / 'bag_0.mcap').stat().st_size == size
        writer.close()  # the closing records fit, because data were dropped
    assert writer.is_complete
    assert writer.saved_count == 3
    with TactileBag(path) as bag:
        assert bag.recovered is None
        assert [message.received_at_ns for message in bag.messages()] == [0, 1, 2]


def test_a_bag_that_cannot_be_closed_reads_up_to_its_last_chunk(tmp_path):
    path = tmp_path / 'bag'
    writer = BagWriter(path, {'simulated': True})
    name = writer.add_topic(STRAIN_TOPIC)
    writer.write_raw(name, 0, MESSAGE)
    writer.save()
    with (
        largest_file((path / 'bag_0.mcap').stat().st_size),
        pytest.raises(BagError, match='File too large'),
    ):
        writer.close()
    assert not writer.is_complete
    assert writer.saved_count == 1
    with TactileBag(path) as bag:
        assert 'never closed' in bag.recovered
        assert [message.received_at_ns for message in bag.messages()] == [0]
