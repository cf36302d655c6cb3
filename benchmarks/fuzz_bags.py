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

"""Damaged and forged bags against the reader: a sentence or the messages, bounded memory."""

from __future__ import annotations

import argparse
from collections import Counter
import logging
from pathlib import Path
import random
import resource
import struct
import sys
import tempfile
import time

import numpy as np
import zstandard

from tactile_bags.bag_reader import TactileBag
from tactile_bags.bag_writer import BagWriter
from tactile_bags.errors import BagError
from tactile_bags.recorded_topics import message_store, STRAIN, STRAIN_TOPIC
from tactile_bags.storage.bag_metadata import FILE_NAME
from tactile_bags.storage.mcap_format import (
    CHUNK,
    CHUNK_START,
    MAGIC,
    pack_number,
    pack_record,
    pack_text,
)

MEMORY_BOUND_BYTES = 400 * 2**20
WILD = (0, 1, 0xFF, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)

DESCRIPTION = """Open bags whose data file or metadata.yaml were changed, and read all of them.

Bytes are flipped, put in, taken out, doubled; numbers of four and eight bytes become wild;
the file is cut off; chunks become bombs. Each bag must be read, or refused with a sentence.
"""


def write_bag(folder: Path) -> bytes:
    """Write a small bag; return its data file."""
    store = message_store()
    types = store.types
    with BagWriter(folder, {'simulated': True}) as writer:
        name = writer.add_topic(STRAIN_TOPIC)
        for i in range(20):
            stamp = types['builtin_interfaces/msg/Time'](sec=i, nanosec=0)
            block = types[STRAIN](
                header=types['std_msgs/msg/Header'](stamp=stamp, frame_id='tendon_sensor_link'),
                sequence=i,
                period_ns=10**9,
                tension_n=np.array([0.5 * i]),
                lost_before=0,
                stamp_error_s=-1.0,
                status=0,
            )
            writer.write(name, i, block)
            if i % 5 == 4:
                writer.save()
    (path,) = folder.glob('*.mcap')
    return path.read_bytes()


def damage(data: bytes, rng: random.Random) -> bytes:
    """Return the data changed in one to six places."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(changed) + 1)
        kind = rng.randrange(7)
        if kind == 0 and at < len(changed):
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            changed[at:at] = rng.randbytes(rng.randrange(20))
        elif kind == 2:
            del changed[at : at + rng.randrange(40)]
        elif kind == 3:
            changed[at:at] = changed[at : at + rng.randrange(200)]
        elif kind == 4:
            changed[at : at + 8] = struct.pack('<Q', rng.choice(WILD))
        elif kind == 5:
            changed[at : at + 4] = struct.pack('<I', rng.choice(WILD) & 0xFFFFFFFF)
        else:
            del changed[at:]
            changed += rng.choice((b'', MAGIC, BOMB))
    return bytes(changed)


def _bomb() -> bytes:
    packer = zstandard.ZstdCompressor().compressobj()  # in parts: our own peak must stay low
    packed = b''.join(packer.compress(bytes(2**20)) for _ in range(1024)) + packer.flush()
    fields = CHUNK_START.pack(0, 9, 2**20, 0), pack_text('zstd'), pack_number(len(packed), 8)
    return pack_record(CHUNK, *fields, packed)


BOMB = _bomb()


def read(folder: Path) -> str:
    """Open a bag and read all of it; return what came of it."""
    try:
        with TactileBag(folder) as bag:
            for message in bag.messages():
                message.decode()
            return 'read as far as it went' if bag.recovered else 'read'
    except BagError:
        return 'refused'


def say(text: str) -> None:
    sys.stdout.write(f'{text}\n')


def main() -> int:
    parser = argparse.ArgumentParser(description=DESCRIPTION)
    parser.add_argument('--inputs', type=int, default=20_000, help='bags to open')
    parser.add_argument('--seed', type=int, default=1)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    rng = random.Random(arguments.seed)
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / 'bag'
        data = write_bag(folder)
        (path,) = folder.glob('*.mcap')
        metadata = (folder / FILE_NAME).read_bytes()
        assert read(folder) == 'read'
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start_s = time.monotonic()
        for i in range(arguments.inputs):
            in_data = i % 4 != 0
            path.write_bytes(damage(data, rng) if in_data else data)
            (folder / FILE_NAME).write_bytes(metadata if in_data else damage(metadata, rng))
            try:
                outcomes[read(folder)] += 1
            except Exception as error:
                raise AssertionError(f'input {i} of seed {arguments.seed}') from error
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    say(f'{arguments.inputs} bags in {time.monotonic() - start_s:.0f} s: {dict(outcomes)}')
    say(f'peak memory grew by {grown / 2**20:.0f} MiB, bound {MEMORY_BOUND_BYTES >> 20} MiB')
    return 0 if grown < MEMORY_BOUND_BYTES else 1


if __name__ == '__main__':
    sys.exit(main())
