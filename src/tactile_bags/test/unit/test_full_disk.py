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

"""Bags on a disk that takes no more: the operating system's own limit on a file's size."""

from contextlib import contextmanager
import resource

import pytest

from tactile_bags import BagWriter, STRAIN_TOPIC, TactileBag
from tactile_bags.errors import BagError

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
    with largest_file(size + 15_000):  # half of what is to come
        with pytest.raises(BagError, match='File too large'):
            writer.save()
        assert (path / 'bag_0.mcap').stat().st_size == size
        writer.close()  # what the half took is room for the index
    assert writer.is_complete
    assert writer.saved_count == 3
    with TactileBag(path) as bag:
        assert bag.recovered == ''
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
