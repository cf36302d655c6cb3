# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A week of recording without waiting: does memory grow with time, and does the bag open."""

from __future__ import annotations

from collections.abc import Iterator
from heapq import merge
import logging
from pathlib import Path
import struct
import tempfile
import time
from typing import Any

import numpy as np

from benchmarks.measuring import Report, Row
from tactile_bags.auditing.auditor import FingerAuditor
from tactile_bags.bag_reader import TactileBag
from tactile_bags.bag_repair import repair_bag
from tactile_bags.bag_writer import BagWriter
from tactile_bags.recorded_topics import (
    EVENT,
    JOINT_STATE,
    message_store,
    recorded_topics,
    RecordedTopic,
    STRAIN,
)
from tactile_bags.storage.mcap_format import StoredTopic
from tactile_bags.storage.mcap_writer import McapWriter
from tactile_ros.strain import StrainBlock

START_NS = 1_600_000_000_000_000_000
SAVE_PERIOD_NS = 5_000_000_000  # the recorder's 0.5 s would take an hour for metadata.yaml alone
OLD_CHUNKS_PER_S = 2.0  # chunks were once cut with each save
TRIAL_S = 20  # a trial is found in the signal every so often
BOUND_MIB = 128.0
MARK = 0x0123456789ABCDEF


def run_long_recording(quick: bool) -> Report:
    """Write, open, read the end of, cut off, repair and read a bag of a week."""
    logging.disable(logging.WARNING)  # that the bag was never closed is what is wanted
    hours = 2.0 if quick else 7 * 24.0
    name = f'{hours / 24:g} days' if hours >= 24 else f'{hours:g} hours'
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        rows = list(measure(folder, hours))
    return Report(
        f'a recording of {name}, without waiting: 60 Hz strain, two joint states, trials found',
        'none',
        'growth of the resident memory [MiB] while it is done, at its peak; of the steps '
        'behind "messages", how many are not as they were written',
        rows,
    )


def measure(folder: Path, hours: float) -> Iterator[Row]:
    """Yield one row a step."""
    path, repaired = folder / 'bag', folder / 'repaired'
    written, audits = 0, 0
    with _Memory() as memory:
        written, audits, saved = write(path, hours)
    (file,) = path.glob('*.mcap')
    size = file.stat().st_size
    more = {'messages': written, 'GB': round(size / 1e9, 2)}
    yield memory.row('written, audited, saved', more)
    with _Memory() as memory, TactileBag(path) as bag:
        found = sum(count for _, count in bag.topics.values())
    yield memory.row('opened', {'messages': found})
    end_ns = START_NS + round(hours * 3.6e12)
    with _Memory() as memory, TactileBag(path) as bag:
        last = sum(1 for _ in bag.messages(since_ns=end_ns - 60_000_000_000))
    yield memory.row('last minute read', {'messages': last})
    with file.open('r+b') as data:
        data.truncate(size - size // 1000)
    with _Memory() as memory:
        repair = repair_bag(path, repaired)
    yield memory.row('cut off by 0.1 % and repaired', {'messages': repair.message_count})
    file.unlink()
    with TactileBag(repaired) as bag:
        left = sum(count for _, count in bag.topics.values())
    (file,) = repaired.glob('*.mcap')
    file.unlink()
    chunks = round(hours * 3600.0 * OLD_CHUNKS_PER_S)
    write_chunks(folder / 'old.mcap', chunks)
    with _Memory() as memory, TactileBag(folder / 'old.mcap') as bag:
        old = sum(count for _, count in bag.topics.values())
        (newest,) = bag.messages(since_ns=START_NS + chunks - 1)
    yield memory.row('opened: two chunks a second', {'messages': old})
    least = round(0.99 * written)
    wrong = [
        found != written or saved != written,
        last < 60 * 60,
        not least < repair.message_count < written,
        left != repair.message_count,
        old != chunks or newest.received_at_ns != START_NS + chunks - 1,
        audits != 1,
    ]
    yield Row('messages not as written', error=float(sum(wrong)), bound=0.0)


def write_chunks(path: Path, count: int) -> None:
    """Write a file of so many chunks with one message each."""
    topic = next(topic for topic in recorded_topics(()) if topic.type_name == STRAIN)
    template = _Template(message_store(), STRAIN)
    writer = McapWriter(path)
    channel = writer.add_channel(StoredTopic(f'/{topic.name}', STRAIN))
    for i in range(count):
        writer.write(channel, START_NS + i, template.fill(START_NS + i, i))
        writer.cut()
    writer.close()


def write(path: Path, hours: float) -> tuple[int, int, int]:
    """Write a bag as the recorder does; return messages written, audits made, messages saved."""
    auditor = FingerAuditor('', 60.0)
    audits, count, save_ns = [], 0, START_NS
    tension_n = np.array([1.5])
    with BagWriter(path, {'simulated': True}) as writer:
        topics = {topic.name: topic for topic in recorded_topics(())}
        for topic in topics.values():
            writer.add_topic(topic)
        for at_ns, name, data, sequence in _messages(topics, hours):
            writer.write_raw(f'/{name}', at_ns, data)
            count += 1
            if sequence >= 0:
                block = StrainBlock(at_ns, sequence, 16_666_667, tension_n)
                audits += auditor.add_block(block)
            if at_ns >= save_ns:
                writer.save()
                save_ns = at_ns + SAVE_PERIOD_NS
        audits += auditor.finish()
    return count, len(audits), writer.saved_count


def _messages(
    topics: dict[str, RecordedTopic], hours: float
) -> Iterator[tuple[int, str, bytes, int]]:
    """Yield time, topic, bytes and sequence number (strain alone) in the order of time."""
    store = message_store()
    rates = {
        'tendon_sensor/strain': 60.0,
        'linear_guide/joint_states': 10.0,
        'tendon_actuator/joint_states': 10.0,
        'tactile_features/detected_events': 4.0 / TRIAL_S,
    }
    streams = []
    for name, rate_hz in rates.items():
        template = _Template(store, topics[name].type_name)
        period_ns = round(1e9 / rate_hz)
        streams.append(_stream(name, template, period_ns, round(hours * 3.6e12)))
    return merge(*streams)


def _stream(
    name: str, template: _Template, period_ns: int, length_ns: int
) -> Iterator[tuple[int, str, bytes, int]]:
    for i in range(length_ns // period_ns):
        at_ns = START_NS + i * period_ns
        yield at_ns, name, template.fill(at_ns, i), i if template.counts else -1


class _Template:
    """A serialised message, into which a time and a sequence number are put."""

    def __init__(self, store: Any, type_name: str) -> None:
        header = store.types['std_msgs/msg/Header'](
            store.types['builtin_interfaces/msg/Time'](0, 0), 'tendon_sensor_link'
        )
        fields = {
            STRAIN: {
                'sequence': MARK,
                'period_ns': 16_666_667,
                'tension_n': np.array([1.5]),
                'lost_before': 0,
                'stamp_error_s': 0.0005,
                'status': 0,
            },
            JOINT_STATE: {
                'name': ['tendon'],
                'position': np.zeros(1),
                'velocity': np.zeros(1),
                'effort': np.zeros(1),
            },
            EVENT: {
                'trial_id': 'detected-1600000000000000000',
                'session_id': 's',
                'protocol': 'stiffness',
                'contact': 'flexion',
                'object_label': 'pla',
                'phase': 'hold',
                'message': '',
                'glide_speed_m_s': 0.0,
                'simulated': True,
                'pull_speed_m_s': 0.01,
                'pull_displacement_m': 0.0,
                'detected': True,
            },
        }[type_name]
        message = store.types[type_name](header=header, **fields)
        self._data = bytearray(store.serialize_cdr(message, type_name))
        self._sequence_at = bytes(self._data).find(struct.pack('<Q', MARK))
        self.counts = self._sequence_at >= 0

    def fill(self, at_ns: int, sequence: int) -> bytes:
        struct.pack_into('<iI', self._data, 4, *divmod(at_ns, 1_000_000_000))
        if self.counts:
            struct.pack_into('<Q', self._data, self._sequence_at, sequence)
        return bytes(self._data)


class _Memory:
    """How far the peak of the resident memory rises in a block, and how long that lasts."""

    def __enter__(self) -> _Memory:
        Path('/proc/self/clear_refs').write_text('5')  # the peak begins anew
        self._before = _status_mib('VmRSS')
        self._start_s = time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        self._seconds = time.perf_counter() - self._start_s
        self._grown = max(0.0, _status_mib('VmHWM') - self._before)

    def row(self, case: str, more: dict[str, Any]) -> Row:
        return Row(
            case,
            error=round(self._grown, 1),
            bound=BOUND_MIB,
            more={**more, 'seconds': round(self._seconds)},
        )


def _status_mib(name: str) -> float:
    for line in Path('/proc/self/status').read_text().splitlines():
        if line.startswith(f'{name}:'):
            return int(line.split()[1]) / 1024
    raise OSError(f'no {name} in /proc/self/status')
