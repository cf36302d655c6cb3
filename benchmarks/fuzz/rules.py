# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Damaged streams, and what no parser may do with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import random

STREAM_RECORDS = 20


class FuzzError(Exception):
    """A parser did what it must not."""


def damage(record: bytes, source: random.Random) -> bytes:
    """Return the record as a bad line would hand it on; every second one whole."""
    kind = source.randrange(14)
    if kind < 7 or not record:
        return record
    place = source.randrange(len(record))
    if kind == 7:
        flipped = record[place] ^ (1 << source.randrange(8))
        return record[:place] + bytes([flipped]) + record[place + 1 :]
    if kind == 8:
        return record[:place]
    if kind == 9:
        return record[place:]
    if kind == 10:
        return record[:place] + record[place + source.randrange(1, 4) :]
    if kind == 11:
        return record[:place] + source.randbytes(source.randrange(1, 6)) + record[place:]
    if kind == 12:
        return record + record
    return source.randbytes(source.randrange(300))


def chunk(stream: bytes, source: random.Random) -> Iterator[bytes]:
    """Yield the stream in pieces, as a port would."""
    start = 0
    while start < len(stream):
        end = start + source.choice((1, 3, 16, 64, 200))
        yield stream[start:end]
        start = end


def make_streams(
    make_record: Callable[[random.Random], bytes], source: random.Random, inputs: int
) -> Iterator[bytes]:
    """Yield streams of twenty records each, until there were enough of them."""
    for _ in range(0, inputs, STREAM_RECORDS):
        yield b''.join(damage(make_record(source), source) for _ in range(STREAM_RECORDS))


def check(holds: bool, what: str, stream: bytes) -> None:
    """Raise when a parser did what it must not, with the stream that shows it."""
    if not holds:
        raise FuzzError(f'{what}, from {stream!r}')
