# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faulty lines in virtual time, byte by byte."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.dynamixel.dynamixel_device import DynamixelDevice
from tactile_sim.devices.faults import (
    FaultRequest,
    FaultyLine,
    GuideLine,
    KINDS,
    SensorLine,
    TendonLine,
)
from tactile_sim.devices.grbl.grbl_device import GrblDevice
from tactile_sim.devices.line_faults import resample_uart
from tactile_sim.devices.load_cell_device import LoadCellDevice
from tactile_sim.errors import RigError

RIG = default_catalogue().rig()


class Parrot:
    """Says a line in each poll and repeats what it hears."""

    def receive(self, data, now_s):
        return data

    def poll(self, now_s):
        return b'%d,ok\r\n' % round(now_s * 1000)


def begin(line, kind, now_s, duration_s=None, device='sensor', **options):
    line.begin(FaultRequest(device, kind, duration_s, options), now_s)


def test_a_sound_line_changes_nothing():
    line = FaultyLine(Parrot(), 1)
    assert line.receive(b'abc', 0.0) == b'abc'
    assert line.poll(0.001) == b'1,ok\r\n'


def test_a_fault_ends_after_its_time():
    line = FaultyLine(Parrot(), 1)
    begin(line, 'mute', 1.0, 0.5)
    assert line.poll(1.0) == line.poll(1.499) == b''
    assert line.poll(1.5) == b'1500,ok\r\n'


def test_none_ends_all_and_another_kind_does_not():
    line = FaultyLine(Parrot(), 1)
    begin(line, 'deaf', 0.0)
    begin(line, 'mute', 0.0)
    begin(line, 'burst', 0.0, 1.0)
    assert (line.receive(b'abc', 0.0), line.poll(2.0)) == (b'', b'')
    begin(line, 'none', 2.0)
    assert line.receive(b'abc', 2.0) == b'abc'
    assert line.poll(2.0) == b'2000,ok\r\n'


def test_bursts_come_each_period_and_the_last_one_at_the_end():
    line = FaultyLine(Parrot(), 1)
    begin(line, 'burst', 0.0, 0.03, period_s=0.01)
    said = {ms: line.poll(ms / 1000) for ms in range(5, 40)}
    assert [ms for ms, data in said.items() if data][:4] == [5, 10, 20, 30]
    assert said[10].count(b'\n') == 5
    assert said[20].count(b'\n') == 10
    assert said[30].count(b'\n') == 10
    assert b''.join(said.values()) == b''.join(b'%d,ok\r\n' % ms for ms in range(5, 40))


def test_drop_counts_what_can_be_lost_and_ends():
    line = FaultyLine(Parrot(), 1)
    begin(line, 'drop', 0.0, count=2)
    assert b''.join(line.poll(ms / 1000) for ms in range(4)) == b'2,ok\r\n3,ok\r\n'
    assert not line._running
    guide = GuideLine(GrblDevice(RIG.guide), 1)
    guide.poll(0.0)
    begin(guide, 'drop', 0.0, device='guide')
    assert guide.receive(b'$X\n', 0.0) == b'[MSG:Caution: Unlocked]\r\n'
    assert b'VER' in guide.receive(b'$I\n', 10.0)
    begin(guide, 'none', 10.0, device='guide')
    assert guide.receive(b'\n', 10.0) == b'ok\r\n'


def test_the_same_seed_gives_the_same_garbage():
    heard = []
    for _ in range(2):
        line = FaultyLine(Parrot(), 5)
        begin(line, 'garbage', 0.0, share=1.0)
        heard.append([line.poll(ms / 1000) for ms in range(20)])
    assert heard[0] == heard[1]
    assert all(1 <= len(data) - len(b'%d,ok\r\n' % ms) <= 12 for ms, data in enumerate(heard[0]))


def test_a_split_record_loses_its_end():
    line = FaultyLine(Parrot(), 1)
    begin(line, 'split', 0.0, share=1.0)
    for ms in range(50):
        data, whole = line.poll(ms / 1000), b'%d,ok\r\n' % ms
        assert whole.startswith(data)
        assert data != whole


@given(st.binary(max_size=50))
def test_the_right_speed_changes_nothing(data):
    assert resample_uart(data, 1.0) == data


@given(st.binary(max_size=50), st.floats(0.96, 1.04))
def test_an_uart_bears_four_per_cent(data, ratio):
    assert resample_uart(data, ratio) == data


@given(st.binary(max_size=50), st.floats(0.01, 100.0))
def test_another_speed_gives_a_bounded_number_of_bytes(data, ratio):
    heard = resample_uart(data, ratio)
    assert len(heard) <= 10 * len(data) / max(9.5 * ratio, 1.0) + 1


def test_another_speed_by_hand():
    # 0x0f on the line: start 0, four ones, four zeros, stop 1.
    # A receiver of half the speed samples the line's bits 3, 5, 7, 9 and then the idle line.
    assert resample_uart(b'\x0f', 2.0) == bytes([0b11111001])
    # One of twice the speed is done with its byte in bit 4, and starts again at bit 5.
    assert resample_uart(b'\x0f', 0.5) == bytes([0b11111110, 0b10000000])
    # One of eight times the speed sees the start bit as a whole byte without a stop bit.
    assert resample_uart(b'\xff', 0.1) == b'\0'


@pytest.mark.parametrize('device', KINDS)
def test_every_fault_begins_and_ends(device):
    cell = LoadCellDevice(RIG.load_cell, np.random.default_rng(1))
    lines = {
        'sensor': SensorLine(cell, 1),
        'guide': GuideLine(GrblDevice(RIG.guide), 1),
        'tendon': TendonLine(DynamixelDevice(RIG.tendon), 1),
    }
    line = lines[device]
    for kind, facts in KINDS[device].items():
        begin(line, kind, 0.0, None if facts.is_event else 1.0, device=device)
        assert line.is_unplugged == (kind == 'unplug')
        line.receive(b'?', 0.5)
        line.poll(1.0)
        assert not line.is_unplugged
    assert not line._running


@pytest.mark.parametrize(
    ('document', 'reason'),
    [
        (3, 'needs "device"'),
        ({'device': ['sensor'], 'kind': 'mute'}, 'no device'),
        ({'device': 'sensor', 'kind': None}, 'no fault None'),
        ({'device': 'sensor', 'kind': 'mute', 'duration_s': True}, 'must be a number'),
        ({'device': 'sensor', 'kind': 'mute', 'duration_s': float('nan')}, 'must be a number'),
        ({'device': 'sensor', 'kind': 'drop', 'count': 0}, 'count is 0; it must be a number'),
        ({'device': 'sensor', 'kind': 'none', 'share': 1}, 'takes nothing else'),
    ],
)
def test_a_bad_request_is_refused(document, reason):
    with pytest.raises(RigError, match=reason):
        FaultRequest.from_json(document)


def test_the_documentation_has_every_fault_and_option():
    text = (Path(__file__).parents[4] / 'docs' / 'faults.md').read_text()
    for device, kinds in KINDS.items():
        for kind, facts in kinds.items():
            (row,) = (
                line
                for line in text.splitlines()
                if line.startswith((f'| `{kind}` |', f'| {device} | `{kind}` |'))
            )
            for name, option in facts.options.items():
                default = '' if np.isnan(option.default) else f' {option.default:g}'
                assert f'`{name}`{default}' in row
