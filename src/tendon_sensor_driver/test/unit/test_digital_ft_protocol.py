# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import struct

from digital_ft_device import encode_record
from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from tendon_sensor_driver import LinkError
from tendon_sensor_driver.ati.digital_ft_protocol import (
    CALIBRATION_REGISTERS,
    decode_calibration,
    describe_status,
    StreamDecoder,
)
from tendon_sensor_driver.ati.modbus import (
    compute_crc,
    decode_frame,
    decode_read,
    decode_write,
    encode_frame,
    encode_read,
    encode_write,
    ModbusError,
)

GAUGES = st.lists(
    st.lists(st.integers(-(2**15), 2**15 - 1), min_size=6, max_size=6), min_size=3, max_size=30
)


def feed(decoder, data, sizes):
    parts, at = [], 0
    for size in sizes:
        parts += decoder.feed(data[at : at + size])
        at += size
    return parts + decoder.feed(data[at:])


def test_a_record_has_its_gauges_in_the_order_of_the_manual():
    record = struct.pack('>6h', 100, 102, 104, 101, 103, -105)
    record += bytes((sum(record) & 0x7F | 0x80,))
    (part,) = StreamDecoder().feed(3 * record)
    assert part.gauges.tolist() == [[100, 101, 102, 103, 104, -105]]
    assert part.has_error.tolist() == [True]
    assert encode_record(part.gauges[0], has_error=True) == record


@settings(deadline=None)
@given(GAUGES, st.lists(st.integers(0, 40), max_size=20))
def test_records_come_out_however_the_stream_is_cut(gauges, sizes):
    gauges = [row if any(row) else [1] * 6 for row in gauges]
    data = b''.join(encode_record(np.array(row)) for row in gauges)
    decoder = StreamDecoder()
    parts = feed(decoder, data, sizes)
    rows = [row for part in parts for row in part.gauges.tolist()]
    assert rows == gauges[:-2]  # two wait for their confirmation
    assert decoder.dropped_bytes == 0


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    damage=st.binary(max_size=30),
    lost=st.integers(0, 30),
    sizes=st.lists(st.integers(0, 40), max_size=20),
)
def test_what_puts_the_stream_out_of_step_costs_samples_and_invents_none(
    seed, damage, lost, sizes
):
    assume((len(damage) - lost) % 13)
    generator = np.random.default_rng(seed)
    gauges = generator.integers(-(2**15), 2**15, (60, 6))
    data = b''.join(encode_record(row) for row in gauges)
    at = int(generator.integers(0, len(data) - 400))
    decoder = StreamDecoder()
    parts = feed(decoder, data[:at] + damage + data[at + lost :], sizes)
    known = {tuple(row): i for i, row in enumerate(gauges.tolist())}
    numbers = [known.get(tuple(row)) for part in parts for row in part.gauges.tolist()]
    invented = numbers.count(None)
    assert invented == 0
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == 57


def test_damage_that_leaves_the_stream_in_step_is_seen_as_often_as_seven_bits_can():
    generator = np.random.default_rng(1)
    records = [encode_record(row) for row in generator.integers(-(2**15), 2**15, (3000, 6))]
    spoilt = [record[:3] + generator.bytes(8) + record[11:] for record in records[::4]]
    data = b''.join(spoilt[i // 4] if i % 4 == 0 else record for i, record in enumerate(records))
    rows = {tuple(row) for part in StreamDecoder().feed(data) for row in part.gauges.tolist()}
    known = {tuple(StreamDecoder().feed(3 * record)[0].gauges[0].tolist()) for record in records}
    assert len(rows - known) / len(spoilt) < 2 / 128


def test_the_zeros_of_an_idle_line_are_no_records():
    decoder = StreamDecoder()
    assert decoder.feed(bytes(10_000)) == []
    assert decoder.dropped_bytes > 9_900


def test_noise_leaves_no_backlog():
    decoder = StreamDecoder()
    generator = np.random.default_rng(0)
    for _ in range(200):
        decoder.feed(generator.bytes(500))
    assert decoder.bytes - decoder.dropped_bytes - 13 * decoder.records < 60


def calibrate(**changes):
    block = bytearray(2 * CALIBRATION_REGISTERS)
    block[0:8] = b'FT12345\0'
    block[8:16] = b'SI-660-6'
    block[64:208] = np.eye(6).astype('>f4').tobytes()
    block[208:210] = bytes(changes.get('units', (2, 4)))
    struct.pack_into('>ii', block, 234, changes.get('per_force', 1000), 500)
    struct.pack_into('>12H', block, 242, *range(12))
    if changes.get('is_empty'):
        block[64:208] = bytes(144)
    return struct.unpack(f'>{CALIBRATION_REGISTERS}H', block)


def test_a_calibration_block_is_read():
    calibration = decode_calibration(calibrate())
    assert calibration.serial == 'FT12345'
    np.testing.assert_allclose(np.diag(calibration.matrix), [1e-3] * 3 + [2e-6] * 3)
    assert calibration.gauge_settings == tuple(range(12))


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'is_empty': True}, 'choose another slot'),
        ({'units': (9, 3)}, 'force unit 9'),
        ({'units': (2, 0)}, 'torque unit 0'),
        ({'per_force': 0}, 'has a calibration'),
        ({'per_force': -5}, 'has a calibration'),
    ],
)
def test_a_block_without_a_calibration_is_refused(changes, reason):
    with pytest.raises(LinkError, match=reason):
        decode_calibration(calibrate(**changes))


@given(st.lists(st.integers(0, 65535), max_size=CALIBRATION_REGISTERS + 1))
def test_any_registers_are_a_calibration_or_refused(registers):
    try:
        calibration = decode_calibration(tuple(registers))
    except LinkError:
        return
    assert np.isfinite(calibration.matrix).all()


def test_status_bits_have_words():
    assert describe_status(0) == ()
    assert describe_status(1 << 5 | 1 << 8) == ('supply too low', 'invalid configuration')
    assert describe_status(1 << 15) == ('bit 15',)


def test_the_check_is_that_of_modbus():
    assert compute_crc(b'123456789') == 0x4B37  # the catalogued check value of CRC-16/MODBUS
    # A request that every Modbus text shows: 10 registers from 0 of device 1.
    assert encode_read(1, 0, 10).hex() == '01030000000ac5cd'


def test_registers_are_read_and_written():
    answer = encode_frame(10, 3, b'\x04\x12\x34\xff\xff')
    assert decode_read(answer, 10, 2) == (0x1234, 0xFFFF)
    assert encode_write(10, 6, [1, 2])[:-2].hex() == '0a10000600020400010002'
    decode_write(encode_frame(10, 16, b'\x00\x06\x00\x02'), 10, 6, 2)
    with pytest.raises(ModbusError, match='did not take'):
        decode_write(encode_frame(10, 16, b'\x00\x06\x00\x01'), 10, 6, 2)


@pytest.mark.parametrize(
    ('frame', 'reason'),
    [
        (b'', '0 bytes'),
        (b'\x0a\x03\x02\x00\x00\x00\x00', 'wrong check'),
        (encode_frame(11, 3, b'\x02\0\0'), 'of device 11'),
        (encode_frame(10, 0x83, b'\x02'), 'refuses Modbus function 3 with code 2'),
        (encode_frame(10, 4, b'\x02\0\0'), 'of function 4'),
    ],
)
def test_a_wrong_answer_is_refused_with_the_reason(frame, reason):
    with pytest.raises(ModbusError, match=reason):
        decode_frame(frame, 10, 3)


@given(st.binary(max_size=40), st.integers(0, 200))
def test_any_answer_is_the_right_one_or_refused(frame, flipped):
    with pytest.raises(ModbusError):
        decode_read(frame, 10, 2)
    good = bytearray(encode_frame(10, 3, b'\x04\x12\x34\xff\xff'))
    good[flipped % len(good)] ^= 1 << flipped % 8
    with pytest.raises(ModbusError):
        decode_read(bytes(good), 10, 2)
