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

"""Bytes of the load cell and of the guide's controller to numbers."""

from __future__ import annotations

import re

from measuring import measure_ratio, Report, Row
import numpy as np

from linear_guide_driver.grbl.protocol import GrblDecoder
from tendon_sensor_driver.lines.line_protocol import encode_reading, LineDecoder
from tendon_sensor_driver.records import TendonSensorConfig

COUNT = 2000


def run_lines(quick: bool) -> Report:
    """Decode load-cell lines, against a split and two conversions."""
    values = np.random.default_rng(4).normal(0.5, 0.3, COUNT)
    lines = [encode_reading(17 * i, value) for i, value in enumerate(values)]

    def split_each(pieces: list[bytes]) -> list[tuple[int, float]]:
        readings = []
        for piece in pieces:
            for line in piece.splitlines():
                ticks, value, *_ = line.split(b',')
                readings.append((int(ticks), float(value)))
        return readings

    def decode(pieces: list[bytes]) -> list[tuple[int | None, float]]:
        decoder = LineDecoder(TendonSensorConfig())
        decoder.feed(b'\n', 0)
        return [(r.device_ticks, r.value) for piece in pieces for r in decoder.feed(piece, 0)]

    rows = []
    for name, size in (('a line a read', 1), ('50 lines a read', 50)):
        pieces = [b''.join(lines[i : i + size]) for i in range(0, COUNT, size)]
        expected, got = split_each(pieces), decode(pieces)
        wrong = sum(a != b for a, b in zip(expected, got, strict=True))
        ratio = measure_ratio(
            lambda pieces=pieces: decode(pieces),
            lambda pieces=pieces: split_each(pieces),
            rounds=5 if quick else 15,
        )
        rows.append(Row(name, ratio, wrong, 0))
    return Report(
        'load-cell lines: LineDecoder',
        'bytes.split, int and float on whole lines: no cut line, no wrong unit, no count of '
        'columns is seen',
        f'readings of {COUNT} that differ from those of the floor',
        rows,
    )


def run_status(quick: bool) -> Report:
    """Decode Grbl's status reports, against one regular expression."""
    positions = np.random.default_rng(5).uniform(-199.0, 0.0, COUNT).round(3)
    plain = '<Run|MPos:{:.3f},0.000,0.000|FS:900,0>\r\n'
    offset = '<Idle|MPos:{:.3f},0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n'
    match = re.compile(rb'<([A-Za-z]+)[^|]*\|MPos:(-?[\d.]+),(-?[\d.]+),(-?[\d.]+)').match
    rows = []
    for name, report in (('state, position, speed', plain), ('and work offset', offset)):
        lines = [report.format(x).encode() for x in positions]

        def match_each(lines: list[bytes] = lines) -> list[float]:
            return [float(found[2]) for line in lines if (found := match(line))]

        def decode(lines: list[bytes] = lines) -> list[float]:
            decoder = GrblDecoder()
            return [event.mpos_mm[0] for line in lines for event in decoder.feed(line)]

        wrong = sum(a != b for a, b in zip(match_each(), decode(), strict=True))
        ratio = measure_ratio(decode, match_each, rounds=5 if quick else 15)
        rows.append(Row(name, ratio, wrong, 0))
    return Report(
        'Grbl status reports: GrblDecoder',
        'one regular expression a report that reads the state and the first axis',
        f'positions of {COUNT} that differ from those of the floor',
        rows,
    )
