# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from dynamixel_packets import encode_instruction
import dynamixel_sdk
from hypothesis import given
from hypothesis import strategies as st
import pytest

from linear_guide_driver.dynamixel import registers as known
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.dynamixel import (
    compute_crc,
    DynamixelDevice,
    encode_status,
    InstructionParser,
)

DRIVE = default_catalogue().rig().tendon
RANGE, LENGTH, LIMIT, ACCESS = 4, 5, 6, 7
PING, REBOOT = 0x01, 0x08


class Bench:
    """A simulated servo that pulls on a spring, in virtual time."""

    def __init__(self):
        self.device = DynamixelDevice(DRIVE)
        self.now_s = 0.0
        self.spring_n_m = 0.0

    def wait(self, seconds):
        for _ in range(round(seconds * 1000)):
            self.now_s += 1e-3
            stretched_m = max(self.device.displacement_m, 0.0)
            self.device.advance(self.now_s, self.spring_n_m * stretched_m)

    def send(self, code, parameters=b'', device_id=1):
        said = self.device.receive(encode_instruction(device_id, code, parameters), self.now_s)
        if not said:
            return None
        data = said[9:-2].replace(b'\xff\xff\xfd\xfd', b'\xff\xff\xfd')
        assert said == encode_status(1, said[8], data)
        return said[8], data

    def read(self, register):
        head = register.address.to_bytes(2, 'little') + register.size.to_bytes(2, 'little')
        error, data = self.send(0x02, head)
        assert error & 0x7F == 0
        return int.from_bytes(data, 'little', signed=register.is_signed)

    def write(self, register, value):
        data = value.to_bytes(register.size, 'little', signed=register.is_signed)
        return self.send(0x03, register.address.to_bytes(2, 'little') + data)[0]

    def arm(self, current=100):
        assert self.write(known.OPERATING_MODE, 5) == 0
        assert self.write(known.GOAL_CURRENT, current) == 0
        assert self.write(known.TORQUE_ENABLE, 1) == 0


@given(st.binary(max_size=200))
def test_crc_is_the_sdks(data):
    handler = dynamixel_sdk.PacketHandler(2.0)
    assert compute_crc(data) == handler.updateCRC(0, data, len(data))


def test_ping_matches_the_published_packets():
    # The ping of ID 1 and its answer are copied from the e-Manual of ROBOTIS (Protocol 2.0), whose
    # example is a servo of model 1030 with firmware 38.
    assert encode_instruction(1, 0x01) == bytes.fromhex('fffffd0001030001194e')
    assert encode_status(1, 0, b'\x06\x04\x26') == bytes.fromhex('fffffd000107005500060426655d')


bodies = st.binary(max_size=20).map(lambda b: b.replace(b'\x00', b'\xff\xff\xfd'))
# Random bytes without 0xff, because the header of every packet contains 0xff.
garbage = st.binary(max_size=12).map(lambda b: b.replace(b'\xff', b'\x01'))


@given(st.lists(st.tuples(garbage, st.integers(0, 252), bodies), max_size=6), st.data())
def test_packets_are_found_in_any_chunking_between_garbage(packets, data):
    stream = b''.join(junk + encode_instruction(i, 3, body) for junk, i, body in packets)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    parser = InstructionParser()
    found = []
    for a, b in zip([0, *cuts], [*cuts, None], strict=True):
        found += parser.feed(stream[a:b])
    assert [(p.device_id, p.parameters) for p in found] == [(i, body) for _, i, body in packets]
    assert all(p.is_intact for p in found)


@given(st.binary(max_size=100), st.integers(0, 20))
def test_a_packet_after_a_broken_one_is_found(junk, kept):
    parser = InstructionParser()
    broken = encode_instruction(1, 0x03, b'0123456789')[:kept]
    parser.feed(broken)
    found = parser.feed(encode_instruction(1, 0x01) * 2)
    assert found[-1].code == 0x01
    assert found[-1].is_intact
    bench = Bench()
    bench.device.receive(junk, 0.0)  # no input may raise an exception


def test_corrupt_packet_is_answered_with_the_crc_error():
    bench = Bench()
    packet = bytearray(encode_instruction(1, 0x02, b'\x84\x00\x04\x00'))
    packet[9] ^= 1
    assert bench.device.receive(bytes(packet), 0.0) == encode_status(1, 3)
    assert bench.send(0x01, device_id=2) is None
    assert bench.send(0x01, device_id=254)[1] == (1020).to_bytes(2, 'little') + b'\x2d'
    assert bench.send(0x55)[0] == 2


def test_control_table_guards_itself():
    bench = Bench()
    assert bench.read(known.MODEL_NUMBER) == 1020
    assert bench.write(known.MODEL_NUMBER, 1) == ACCESS
    assert bench.write(known.OPERATING_MODE, 2) == RANGE
    assert bench.write(known.BUS_WATCHDOG, 128) == RANGE
    assert bench.write(known.CURRENT_LIMIT, 50) == 0
    assert bench.write(known.GOAL_CURRENT, 51) == LIMIT
    assert bench.send(0x03, b'\x74\x00\x01')[0] == LENGTH
    assert bench.send(0x03, b'\x74\x00')[0] == LENGTH
    assert bench.send(0x03, b'\x41\x00\x01')[0] == ACCESS  # the LED is not simulated
    assert bench.send(0x02, b'\x41\x00\x01\x00') == (0, b'\x00')
    assert bench.send(0x02, b'\x84\x00\xff\x00')[0] == RANGE
    bench.write(known.PROFILE_VELOCITY, 7)
    bench.write(known.GOAL_CURRENT, 7)
    assert bench.write(known.OPERATING_MODE, 5) == 0  # this also resets the profile
    assert (bench.read(known.PROFILE_VELOCITY), bench.read(known.GOAL_CURRENT)) == (0, 50)
    bench.arm(current=50)
    assert bench.write(known.OPERATING_MODE, 4) == ACCESS  # refused while the torque is on
    assert bench.read(known.OPERATING_MODE) == 5


def test_a_run_of_registers_is_written_as_a_whole_or_not_at_all():
    bench = Bench()
    bench.arm()

    def write(velocity, goal, end=b''):
        values = (0, velocity, goal)
        data = b''.join(value.to_bytes(4, 'little', signed=True) for value in values)
        return bench.send(0x03, b'\x6c\x00' + data + end)[0]

    assert write(20, 3000) == 0
    assert (bench.read(known.PROFILE_VELOCITY), bench.read(known.GOAL_POSITION)) == (20, 3000)
    assert write(30, 2_000_000) == RANGE
    assert write(30, 2500, b'\x00') == ACCESS  # the byte after the goal is read-only
    assert (bench.read(known.PROFILE_VELOCITY), bench.read(known.GOAL_POSITION)) == (20, 3000)


def test_profile_is_a_trapezoid():
    bench = Bench()
    bench.arm()
    bench.write(known.PROFILE_VELOCITY, 20)
    bench.write(known.PROFILE_ACCELERATION, 5)
    bench.write(known.GOAL_POSITION, 2048 + 1000)
    speed, acceleration = 20 * 0.229 / 60 * 4096, 5 * 214.577 / 3600 * 4096
    bench.wait(0.5)
    assert bench.read(known.PRESENT_VELOCITY) == 20
    expected = speed * 0.5 - speed**2 / acceleration / 2
    assert bench.read(known.PRESENT_POSITION) - 2048 == pytest.approx(expected, abs=1)
    duration_s = 1000 / speed + speed / acceleration
    bench.wait(duration_s - 0.5 - 0.01)
    assert bench.read(known.PRESENT_POSITION) < 3048 + 1
    bench.wait(0.02)
    assert bench.read(known.PRESENT_POSITION) == 3048
    assert bench.read(known.PRESENT_VELOCITY) == 0
    assert bench.device.displacement_m == pytest.approx(1000 / 4096 * 2 * 3.14159265 * 0.01)


def test_goal_current_limits_the_tension():
    bench = Bench()
    bench.spring_n_m = 4000.0
    bench.arm(current=60)
    bench.write(known.GOAL_POSITION, 6000)
    bench.wait(3.0)
    tension_n = bench.spring_n_m * bench.device.displacement_m
    limit_n = (60 * 2.69e-3 - 0.02) * 1.78 / 0.01
    assert tension_n == pytest.approx(limit_n, rel=0.03)
    assert bench.read(known.PRESENT_POSITION) < 6000
    current = bench.read(known.PRESENT_CURRENT)
    assert current == pytest.approx(tension_n * 0.01 / 1.78 / 2.69e-3, abs=1)
    bench.write(known.GOAL_POSITION, 2048)
    bench.wait(1.0)
    assert bench.read(known.PRESENT_POSITION) == 2048


def test_without_torque_the_tendon_unwinds():
    bench = Bench()
    bench.spring_n_m = 4000.0
    bench.arm(current=200)
    bench.write(known.GOAL_POSITION, 2300)
    bench.wait(1.0)
    bench.write(known.TORQUE_ENABLE, 0)
    bench.wait(1.0)
    assert bench.spring_n_m * bench.device.displacement_m < 0.2


def test_watchdog_stops_the_motor_and_locks_the_goals():
    bench = Bench()
    bench.arm()
    bench.write(known.PROFILE_VELOCITY, 20)
    bench.write(known.BUS_WATCHDOG, 10)
    bench.write(known.GOAL_POSITION, 4048)
    for _ in range(5):  # every read restarts the time of the bus watchdog
        bench.wait(0.15)
        assert bench.read(known.BUS_WATCHDOG) == 10
    bench.wait(0.4)
    assert bench.read(known.BUS_WATCHDOG) == 255
    stopped = bench.read(known.PRESENT_POSITION)
    assert stopped < 4000
    bench.wait(0.5)
    assert bench.read(known.PRESENT_POSITION) == stopped
    assert bench.write(known.GOAL_POSITION, 2048) == RANGE
    assert bench.write(known.BUS_WATCHDOG, 0) == 0
    assert bench.write(known.GOAL_POSITION, 2048) == 0


def test_a_hardware_error_ends_torque_until_a_reboot_when_its_cause_is_gone():
    bench = Bench()
    bench.arm()
    bench.device.heat(85)
    bench.wait(0.01)
    for _ in range(2):
        assert bench.send(PING)[0] == 0x80
        assert bench.read(known.HARDWARE_ERROR) == 0x04
        assert bench.read(known.TORQUE_ENABLE) == 0
        assert bench.read(known.PRESENT_TEMPERATURE) == 85
        bench.send(REBOOT)
        assert bench.send(PING) is None  # the servo does not answer while it boots
        bench.wait(0.35)
    bench.device.cool()
    assert bench.read(known.HARDWARE_ERROR) == 0x04  # the error remains until a reboot
    assert bench.write(known.TORQUE_ENABLE, 1) == 0x81
    bench.send(REBOOT)
    bench.wait(0.35)
    assert bench.send(PING)[0] == 0
    assert bench.read(known.HARDWARE_ERROR) == 0
    assert bench.read(known.PRESENT_TEMPERATURE) == 30
    assert bench.read(known.OPERATING_MODE) == 5
    assert bench.write(known.TORQUE_ENABLE, 1) == 0


def test_reboot_forgets_whole_turns():
    bench = Bench()
    bench.arm()
    bench.write(known.GOAL_POSITION, 2048 + 4096)
    bench.wait(2.0)
    assert bench.read(known.PRESENT_POSITION) == 2048 + 4096
    wound_m = bench.device.displacement_m
    bench.send(REBOOT)
    bench.wait(0.4)
    assert bench.read(known.PRESENT_POSITION) == 2048
    assert bench.device.displacement_m == pytest.approx(wound_m)
