# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest

from tactile_sim.description import load_rig
from tactile_sim.load_cell_device import LoadCellDevice
from tendon_sensor_driver.line_protocol import LineDecoder
from tendon_sensor_driver.records import TendonSensorConfig

QUIET = dataclasses.replace(load_rig().load_cell, noise_n=0.0)


def record(cell, tension_at, seconds):
    device = LoadCellDevice(cell, np.random.default_rng(1))
    lines = b''
    for step in range(round(seconds * 1000) + 1):
        device.record(step * 1e-3, np.array([tension_at(step * 1e-3)]))
        lines += device.poll(step * 1e-3)
    return [line.split(b',') for line in lines.split(b'\r\n')[:-1]]


def test_lines_carry_time_and_tension_between_steps():
    lines = record(QUIET, lambda t: 2.0 * t, 1.0)
    assert len(lines) == 60  # the sixty-first comes 30 microseconds after the second is over
    assert [int(line[0]) for line in lines[:4]] == [0, 16, 33, 50]
    for i, line in enumerate(lines):
        true_s = i / 60 * (1 + 30e-6)
        assert float(line[1]) == pytest.approx(2.0 * true_s / 9.80665, abs=0.51e-5)
        assert line[2:] == [b'kg', b'']


def test_reading_saturates_at_the_capacity():
    lines = record(QUIET, lambda t: 100.0 if t > 0.05 else -100.0, 0.1)
    assert {line[1] for line in lines} == {b'2.00000', b'-2.00000'}


def test_noise_repeats_with_the_seed():
    cell = load_rig().load_cell
    assert record(cell, lambda t: 1.0, 0.5) == record(cell, lambda t: 1.0, 0.5)
    values = [float(line[1]) * 9.80665 for line in record(cell, lambda t: 1.0, 10.0)]
    assert np.std(values) == pytest.approx(cell.noise_n, rel=0.15)


def test_the_drivers_decoder_reads_every_line():
    device = LoadCellDevice(QUIET, np.random.default_rng(1))
    for step in range(1001):
        device.record(step * 1e-3, np.array([5.0]))
    decoder = LineDecoder(TendonSensorConfig())
    decoder.feed(device.poll(1.0), 0)
    assert decoder.readings == 59  # the first line after the start is not trusted
    assert decoder.rejected_lines == 0
