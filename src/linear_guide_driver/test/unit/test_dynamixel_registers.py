# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st
import pytest

from linear_guide_driver.dynamixel import registers

RADII = st.floats(0.001, 0.1)


@given(st.integers(-1_048_575, 1_048_575), st.integers(1, 1023), st.integers(-1193, 1193), RADII)
def test_raw_values_survive_their_units(counts, velocity, current, radius_m):
    assert registers.m_to_counts(registers.counts_to_m(counts, radius_m), radius_m) == counts
    speed_m_s = registers.velocity_to_m_s(velocity, radius_m)
    assert registers.m_s_to_velocity(speed_m_s, radius_m) == velocity
    assert registers.a_to_current(registers.current_to_a(current)) == current


def test_units_against_exact_arithmetic():
    pi = Fraction(3141592653589793238462643383279503, 10**33)
    radius = Fraction(1, 100)
    turn_m = 2 * pi * radius
    assert registers.counts_to_m(4096, 0.01) == pytest.approx(float(turn_m), rel=1e-15)
    speed = Fraction(229, 1000) / 60 * turn_m * 200
    assert registers.velocity_to_m_s(200, 0.01) == pytest.approx(float(speed), rel=1e-15)
    assert registers.current_to_a(1193) == pytest.approx(3.20917, rel=1e-12)
    assert registers.m_s_to_velocity(1e-9, 0.01) == 1  # 0 would mean unlimited


def test_the_polled_block_by_hand():
    block = bytearray(registers.STATE_BLOCK.size)
    assert registers.STATE_BLOCK == (64, 83, False)

    def put(address, data):
        block[address - 64 : address - 64 + len(data)] = data

    put(64, b'\x01')
    put(70, b'\x24')
    put(68, b'\x02')
    put(98, b'\xff')
    put(102, b'\x70\x00')
    put(112, b'\xc8\x00\x00\x00')
    put(116, b'\x00\x08\x00\x00')
    put(126, b'\xfe\xff')
    put(128, b'\x9c\xff\xff\xff')
    put(132, b'\x00\xf0\xff\xff')
    put(144, b'\x78\x00')
    put(146, b'\x2a')
    assert registers.decode_state(bytes(block)) == registers.ServoState(
        True, 2, 0x24, registers.WATCHDOG_TRIPPED, 112, 0, 200, 2048, -2, -100, -4096, 120, 42
    )


def test_error_words():
    assert registers.format_hardware_error(0x24) == 'overheating and overload'
    assert registers.format_hardware_error(0x41) == (
        'supply voltage out of range and unknown bits 0x40'
    )
    assert registers.format_status_error(0x80 | 7) == 'the register cannot be written now'
    assert registers.format_status_error(0x35) == 'unknown error 53'
