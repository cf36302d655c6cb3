# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig as a process: real ptys, pyserial, the real dynamixel_sdk."""

import json
import os
import signal
import subprocess
import sys

import dynamixel_sdk
import pytest
import serial

from tactile_sim import RigError, SimulatedRig
from tendon_sensor_driver.lines.line_protocol import LineDecoder
from tendon_sensor_driver.records import TendonSensorConfig
from waiting import wait_until

DEADLINE_S = 20.0


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=7) as rig:
        yield rig


def read_until(port, ending):
    data = b''

    def complete():
        nonlocal data
        data += port.read(port.in_waiting)
        return data.endswith(ending)

    wait_until(complete, f'{ending!r} after {data[-200:]!r}')
    return data


def test_guide_over_pyserial(rig):
    with serial.Serial(rig.ports.guide, 115200, timeout=1.0) as port:
        port.write(b'\x18')
        assert b'Grbl 1.1h' in read_until(port, b'\r\n')
        port.write(b'$X\n$25=6000\n$24=600\n$H\n')
        assert read_until(port, b'ok\r\nok\r\nok\r\nok\r\n')
        port.write(b'G21G90\nG1X-140F6000\nG4P0.01\n')
        read_until(port, b'ok\r\nok\r\nok\r\n')
        port.write(b'?')
        assert b'<Idle|MPos:-140.000,' in read_until(port, b'>\r\n')
    assert rig.truth()['guide_position_m'] == pytest.approx(0.060)


def test_servo_over_the_real_sdk(rig):
    port, packets = dynamixel_sdk.PortHandler(rig.ports.tendon), dynamixel_sdk.PacketHandler(2.0)
    assert port.openPort()
    try:
        model, result, error = packets.ping(port, 1)
        assert (model, result, error) == (1020, dynamixel_sdk.COMM_SUCCESS, 0)
        assert packets.ping(port, 2)[1] == dynamixel_sdk.COMM_RX_TIMEOUT
        assert packets.write1ByteTxRx(port, 1, 11, 5) == (0, 0)
        assert packets.write2ByteTxRx(port, 1, 102, 100) == (0, 0)
        assert packets.write4ByteTxRx(port, 1, 112, 30) == (0, 0)
        assert packets.write1ByteTxRx(port, 1, 64, 1) == (0, 0)
        assert packets.write4ByteTxRx(port, 1, 116, 2048 + 200) == (0, 0)
        wait_until(lambda: packets.read4ByteTxRx(port, 1, 132)[0] == 2248, 'goal not reached')
        assert packets.write1ByteTxRx(port, 1, 11, 4) == (0, 7)  # EEPROM is locked
        reader = dynamixel_sdk.GroupSyncRead(port, packets, 126, 10)
        assert reader.addParam(1)
        assert reader.txRxPacket() == dynamixel_sdk.COMM_SUCCESS
        assert reader.getData(1, 132, 4) == 2248
        writer = dynamixel_sdk.GroupSyncWrite(port, packets, 116, 4)
        assert writer.addParam(1, [0x00, 0x08, 0x00, 0x00])
        assert writer.txPacket() == dynamixel_sdk.COMM_SUCCESS
        wait_until(lambda: packets.read4ByteTxRx(port, 1, 132)[0] == 2048, 'not back')
        assert packets.write1ByteTxRx(port, 1, 64, 0) == (0, 0)
        assert packets.reboot(port, 1) == (0, 0)
        wait_until(lambda: packets.ping(port, 1)[1] == 0, 'no life after the reboot')
    finally:
        port.closePort()


def test_load_cell_lines_come_at_60_hz(rig):
    decoder = LineDecoder(TendonSensorConfig())
    with serial.Serial(rig.ports.sensor, 115200, timeout=1.0) as port:
        start_s = rig.truth()['time_s']
        readings = []
        wait_until(
            lambda: readings.extend(decoder.feed(port.read(max(port.in_waiting, 1)), 0))
            or len(readings) >= 60,
            'too few lines',
        )
        elapsed_s = rig.truth()['time_s'] - start_s
    assert decoder.rejected_lines == 0
    assert len(readings) / elapsed_s == pytest.approx(60.0, rel=0.1)


def test_mount_answers_or_refuses_with_a_sentence(rig):
    answer = rig.mount('texture', 'C2', 'abduction')
    assert answer['ok']
    assert rig.truth()['mount'] == {'protocol': 'texture', 'object': 'C2', 'contact': 'abduction'}
    with pytest.raises(RigError, match="no texture plate 'R9'; there are F, R1"):
        rig.mount('texture', 'R9', 'flexion')


def test_server_speaks_json_and_ends_cleanly(tmp_path):
    command = [sys.executable, '-m', 'tactile_sim.rig_server', '--links', str(tmp_path / 'rig')]
    for ending in ('eof', signal.SIGTERM, signal.SIGINT):
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        ports = json.loads(process.stdout.readline())
        for name in ('guide', 'tendon', 'sensor'):
            assert ports[name] == str(tmp_path / 'rig' / name)
            assert os.path.realpath(ports[name]).startswith('/dev/pts/')
        process.stdin.write(b'nonsense\n{"mount": 3}\n')
        process.stdin.flush()
        assert 'this is no JSON' in json.loads(process.stdout.readline())['error']
        assert 'send {"mount"' in json.loads(process.stdout.readline())['error']
        if ending == 'eof':
            process.stdin.close()
        else:
            process.send_signal(ending)
        assert process.wait(DEADLINE_S) == 0
        assert list((tmp_path / 'rig').iterdir()) == []
        process.stdout.close()
        process.stdin.close()


def test_a_dead_rig_says_so(tmp_path):
    (tmp_path / 'guide').write_text('in the way')
    with pytest.raises(RigError, match='is no symbolic link'):
        SimulatedRig(links=tmp_path)
    with SimulatedRig() as rig:
        rig._process.kill()
        with pytest.raises(RigError, match='ended with code -9'):
            rig.truth()
    with pytest.raises(RigError, match='closed'):
        rig.truth()
    assert not os.path.lexists(os.path.dirname(rig.ports.guide))


def test_ctrl_c_in_the_terminal_of_its_program_does_not_end_the_rig():
    program = """
import signal, sys
from tactile_sim import SimulatedRig
signal.signal(signal.SIGINT, lambda *_: None)
with SimulatedRig() as rig:
    print('ready', flush=True)
    sys.stdin.readline()
    print(rig.truth()['tension_n'], flush=True)
"""
    process = subprocess.Popen(
        [sys.executable, '-c', program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout.readline() == 'ready\n'
    os.killpg(process.pid, signal.SIGINT)
    output, errors = process.communicate('go on\n', timeout=DEADLINE_S)
    assert process.returncode == 0, errors
    assert float(output) < 1.0
