# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of the serial lines of simulated devices, in virtual time."""

from pathlib import Path

from dynamixel_packets import encode_instruction
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.dynamixel import DynamixelDevice, encode_status
from tactile_sim.devices.faults import (
    FaultyLine,
    GuideLine,
    KINDS,
    MOMENTS,
    read_request,
    resample_uart,
    SensorLine,
    TendonLine,
)
from tactile_sim.devices.grbl import GrblDevice
from tactile_sim.devices.load_cell import LoadCellDevice
from tactile_sim.errors import RigError

RIG = default_catalogue().rig()
PING, PONG = encode_instruction(1, 0x01), encode_status(1, 0, b'\xfc\x03\x2d')


class Parrot:
    """Device that sends a line in each poll and echoes received bytes."""

    def receive(self, data, now_s):
        return data

    def poll(self, now_s):
        return b'%d,ok\r\n' % round(now_s * 1000)


def begin(line, kind, now_s, duration_s=None, device='sensor', **options):
    request = {'device': device, 'kind': kind, 'duration_s': duration_s, **options}
    line.begin(read_request(request), now_s)


def test_a_fault_lasts_its_time_or_until_all_are_ended():
    line = FaultyLine(Parrot(), 1)
    assert (line.receive(b'abc', 0.0), line.poll(0.001)) == (b'abc', b'1,ok\r\n')
    begin(line, 'mute', 1.0, 0.5)
    assert line.poll(1.0) == line.poll(1.499) == b''
    assert line.poll(1.5) == b'1500,ok\r\n'
    begin(line, 'deaf', 2.0)
    begin(line, 'mute', 2.0)
    begin(line, 'burst', 2.0, 1.0)  # its end does not end the other faults
    assert (line.receive(b'abc', 2.0), line.poll(4.0)) == (b'', b'')
    begin(line, 'none', 4.0)
    assert (line.receive(b'abc', 4.0), line.poll(4.0)) == (b'abc', b'4000,ok\r\n')


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


def test_garbage_and_cuts_of_records_follow_the_seed():
    heard = []
    for kind in ('garbage', 'garbage', 'split'):
        line = FaultyLine(Parrot(), 5)
        begin(line, kind, 0.0, share=1.0)
        heard.append([line.poll(ms / 1000) for ms in range(50)])
    assert heard[0] == heard[1]
    for ms, (spoilt, _, cut) in enumerate(zip(*heard, strict=True)):
        whole = b'%d,ok\r\n' % ms
        assert spoilt.endswith(whole)
        assert 1 <= len(spoilt) - len(whole) <= 12
        assert whole.startswith(cut)
        assert cut != whole


@given(st.binary(max_size=50), st.floats(0.96, 1.04))
def test_an_uart_bears_four_per_cent(data, ratio):
    assert resample_uart(data, ratio) == data


@given(st.binary(max_size=50), st.floats(0.01, 100.0))
def test_another_speed_gives_a_bounded_number_of_bytes(data, ratio):
    heard = resample_uart(data, ratio)
    assert len(heard) <= 10 * len(data) / max(9.5 * ratio, 1.0) + 1


def test_another_speed_by_hand():
    # The byte 0x0f is sent as a start bit (0), four ones, four zeros and a stop bit (1), which are
    # counted from 0 here. A receiver of half the speed samples bits 3, 5, 7 and 9, and then the
    # idle line.
    assert resample_uart(b'\x0f', 2.0) == bytes([0b11111001])
    # A receiver of twice the speed completes its first byte at bit 4, and begins a second one at
    # bit 5.
    assert resample_uart(b'\x0f', 0.5) == bytes([0b11111110, 0b10000000])
    # A receiver of ten times the speed takes the start bit for a whole byte of zeros.
    assert resample_uart(b'\xff', 0.1) == b'\0'


CORES = {
    'sensor': (lambda: LoadCellDevice(RIG.load_cell, np.random.default_rng(1)), SensorLine),
    'guide': (lambda: GrblDevice(RIG.guide), GuideLine),
    'tendon': (lambda: DynamixelDevice(RIG.tendon), TendonLine),
}


class Bench:
    """A simulated device behind a faulty line, in virtual time."""

    def __init__(self, device):
        self.name = device
        self.now_s = 0.0
        make_core, line = CORES[device]
        self.core = make_core()
        self.line = line(self.core, 1)
        self.wait(0.1)

    def begin(self, kind, duration_s=None, **options):
        begin(self.line, kind, self.now_s, duration_s, self.name, **options)

    def wait(self, seconds):
        said = b''
        for _ in range(round(seconds * 1000)):
            self.now_s += 1e-3
            if self.name == 'sensor':
                self.core.record(self.now_s, 3.0, 0.0)
            elif self.name == 'tendon':
                self.core.advance(self.now_s, 0.0)
            said += self.line.poll(self.now_s)
        return said

    def send(self, data):
        return self.line.receive(data, self.now_s)


@pytest.mark.parametrize('device', KINDS)
def test_every_fault_begins_and_ends(device):
    bench = Bench(device)
    for kind in KINDS[device]:
        bench.begin(kind, None if kind in MOMENTS else 0.01)
        assert bench.line.is_unplugged == (kind == 'unplug')
        bench.send(b'?')
        bench.wait(0.02)
        assert not bench.line.is_unplugged
    assert not bench.line._running


def test_a_mute_sensor_and_an_unplugged_one_lose_their_lines():
    bench = Bench('sensor')
    bench.begin('mute', 0.5)
    assert bench.wait(0.499) == b''
    assert int(bench.wait(0.1).split(b',')[0]) >= 500
    bench.begin('unplug', 0.1)
    # The unplugged cable also powers the sensor, so the sensor restarts.
    assert bench.wait(0.1) == b''
    assert b'version 1.2\r\n' in (said := bench.wait(0.7))
    assert b'Readings:\r\n0,' in said
    bench.begin('restart')
    assert b'Readings:\r\n0,' in bench.wait(0.7)


def test_a_muted_guide_obeys_and_a_deaf_one_does_not():
    bench = Bench('guide')
    bench.send(b'$X\nG91\n')
    for kind, moved_m in (('mute', -0.005), ('deaf', 0.0)):
        start_m = bench.core.position_m(bench.now_s)
        bench.begin(kind, 1.0)
        assert bench.send(b'G1X-5F3000\n') == b''
        bench.wait(1.0)
        assert bench.core.position_m(bench.now_s) - start_m == pytest.approx(moved_m)


def test_what_a_guide_says_by_itself_is_not_lost_with_its_ok():
    bench = Bench('guide')
    bench.begin('drop')
    assert bench.send(b'$X\n') == b'[MSG:Caution: Unlocked]\r\n'
    assert b'VER' in bench.send(b'$I\n')
    bench.begin('none')
    assert bench.send(b'\n') == b'ok\r\n'


def test_a_restarted_servo_is_silent():
    bench = Bench('tendon')
    bench.send(PING[:6])
    bench.begin('restart')
    assert bench.send(PING) == b''
    bench.wait(0.35)
    # The first half of this packet was sent before the restart, so the servo has forgotten it.
    assert bench.send(PING[6:]) == b''
    assert bench.send(PING) == PONG


@pytest.mark.parametrize('kind', ['mute', 'deaf', 'drop', 'corrupt', 'split', 'wrong_baud'])
def test_a_disturbed_servo_gives_no_answer(kind):
    bench = Bench('tendon')
    bench.begin(kind, **({'share': 1.0} if kind in ('corrupt', 'split') else {}))
    assert PONG not in bench.send(PING)
    bench.begin('none')
    assert bench.send(PING) == PONG


def test_garbage_and_noise_come_besides_the_packets():
    bench = Bench('tendon')
    bench.begin('garbage', share=1.0)
    assert bench.send(PING)[1:].endswith(PONG)
    bench.begin('none')
    bench.begin('noise')
    assert bench.wait(0.1).count(b'\xff\xff') in range(5, 11)


@pytest.mark.parametrize(
    ('document', 'reason'),
    [
        (3, '"device"'),
        ({'device': ['sensor'], 'kind': 'mute'}, 'sensor'),
        ({'device': 'sensor', 'kind': None}, 'None'),
        ({'device': 'sensor', 'kind': 'mute', 'duration_s': True}, 'duration_s'),
        ({'device': 'sensor', 'kind': 'mute', 'duration_s': float('nan')}, 'duration_s'),
        ({'device': 'guide', 'kind': 'alarm', 'duration_s': 1.0}, 'alarm'),
        ({'device': 'sensor', 'kind': 'mute', 'share': 1}, 'share'),
        ({'device': 'sensor', 'kind': 'drop', 'count': 0}, 'count is 0'),
        ({'device': 'sensor', 'kind': 'none', 'share': 1}, 'none'),
    ],
)
def test_a_bad_request_is_refused(document, reason):
    with pytest.raises(RigError, match=reason):
        read_request(document)


def test_the_documentation_has_every_fault_and_option():
    text = (Path(__file__).parents[4] / 'docs' / 'faults.md').read_text()
    for device, kinds in KINDS.items():
        for kind, options in kinds.items():
            (row,) = (
                line
                for line in text.splitlines()
                if line.startswith((f'| `{kind}` |', f'| {device} | `{kind}` |'))
            )
            for name, value in options.items():
                default = '' if np.isinf(value) else f' {value:g}'
                assert f'`{name}`{default}' in row
