# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each fault of the servo, as packets on real ptys."""

import dynamixel_sdk

from simulated_rigs import advance_rig
from waiting import wait_until

TORQUE, HARDWARE_ERROR, TEMPERATURE, WATCHDOG, PROFILE = 64, 70, 146, 98, 112
ALERT = 0x80


def test_overheating_switches_off_until_cool_and_rebooted(rig, servo):
    port, packets = servo
    assert packets.write1ByteTxRx(port, 1, TORQUE, 1) == (0, 0)
    rig.fault('tendon', 'overheat', temperature_c=91)
    wait_until(lambda: packets.ping(port, 1)[2] == ALERT, 'no alert')
    assert packets.read1ByteTxRx(port, 1, HARDWARE_ERROR)[0] == 0x04
    assert packets.read1ByteTxRx(port, 1, TEMPERATURE)[0] == 91
    assert packets.read1ByteTxRx(port, 1, TORQUE)[0] == 0
    packets.reboot(port, 1)
    wait_until(lambda: packets.ping(port, 1)[1:] == (0, ALERT), 'no alert after a hot reboot')
    rig.fault('tendon', 'none')
    assert packets.read1ByteTxRx(port, 1, TEMPERATURE)[0] == 30
    assert packets.read1ByteTxRx(port, 1, HARDWARE_ERROR)[0] == 0x04
    packets.reboot(port, 1)
    wait_until(lambda: packets.ping(port, 1)[1:] == (0, 0), 'still an alert')


def test_overload_is_latched(rig, servo):
    port, packets = servo
    rig.fault('tendon', 'overload')
    assert packets.read1ByteTxRx(port, 1, HARDWARE_ERROR) == (0x20, 0, ALERT)
    assert packets.write1ByteTxRx(port, 1, TORQUE, 1)[1] == ALERT | 1


def test_a_restarted_servo_is_silent_and_forgets(rig, servo):
    port, packets = servo
    for register, value in ((WATCHDOG, 10), (TORQUE, 1)):
        assert packets.write1ByteTxRx(port, 1, register, value) == (0, 0)
    assert packets.write4ByteTxRx(port, 1, PROFILE, 30) == (0, 0)
    rig.fault('tendon', 'restart')
    assert packets.ping(port, 1)[1] == dynamixel_sdk.COMM_RX_TIMEOUT
    wait_until(lambda: packets.ping(port, 1)[1] == 0, 'no life')
    for register in (TORQUE, WATCHDOG):
        assert packets.read1ByteTxRx(port, 1, register)[0] == 0
    assert packets.read4ByteTxRx(port, 1, PROFILE)[0] == 0


def test_a_muted_servo_hears_and_a_deaf_one_does_not(rig, servo):
    port, packets = servo
    for kind, heard in (('mute', 1), ('deaf', 0)):
        assert packets.write1ByteTxRx(port, 1, 65, 0) == (0, 0)
        rig.fault('tendon', kind)
        assert packets.write1ByteTxRx(port, 1, 65, 1)[0] == dynamixel_sdk.COMM_RX_TIMEOUT
        rig.fault('tendon', 'none')
        wait_until(lambda: packets.ping(port, 1)[1] == 0, 'no answer')
        assert packets.read1ByteTxRx(port, 1, 65)[0] == heard


def test_drop_loses_one_packet(rig, servo):
    port, packets = servo
    rig.fault('tendon', 'drop', count=1)
    assert packets.ping(port, 1)[1] == dynamixel_sdk.COMM_RX_TIMEOUT
    wait_until(lambda: packets.ping(port, 1)[1] == 0, 'no answer')


def test_corrupt_split_and_noisy_packets_are_no_answers(rig, servo):
    port, packets = servo
    for kind in ('corrupt', 'split'):
        rig.fault('tendon', kind, share=1.0)
        for _ in range(5):
            assert packets.ping(port, 1)[1] in (
                dynamixel_sdk.COMM_RX_TIMEOUT,
                dynamixel_sdk.COMM_RX_CORRUPT,
            )
        rig.fault('tendon', 'none')
    wait_until(lambda: packets.ping(port, 1)[1] == 0, 'no answer')
    rig.fault('tendon', 'noise')
    advance_rig(rig, 0.2)
    port.ser.reset_input_buffer()
    advance_rig(rig, 0.2)
    assert port.ser.read(port.ser.in_waiting).count(b'\xff') > 10
    rig.fault('tendon', 'none')
    rig.fault('tendon', 'garbage', share=1.0)
    port.ser.reset_input_buffer()
    port.ser.write(bytes.fromhex('fffffd0001030001194e'))
    said = b''

    def is_answered():
        nonlocal said
        said += port.ser.read(port.ser.in_waiting)
        return len(said) > 14

    wait_until(is_answered, 'no answer')
    assert said.index(b'\xff\xff\xfd\x00') > 0
