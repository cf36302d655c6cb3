# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig as a process: its ports, its requests, its end."""

from contextlib import ExitStack
import json
import os
import signal
import subprocess
import sys

import pytest
import serial

from tactile_sim import RigError, SimulatedRig
from tactile_testing.waiting import wait_until
from tendon_sensor_driver.line_sensor import LineDecoder
from tendon_sensor_driver.records import TendonSensorConfig

DEADLINE_S = 20.0


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=7) as rig:
        yield rig


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
    command = [sys.executable, '-m', 'tactile_sim.rig_server', '--links']
    endings = ('eof', signal.SIGTERM, signal.SIGINT)
    folders = [tmp_path / str(i) for i in range(3)]
    processes = [
        subprocess.Popen([*command, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for folder in folders
    ]
    for ending, folder, process in zip(endings, folders, processes, strict=True):
        ports = json.loads(process.stdout.readline())
        for name in ('guide', 'tendon', 'sensor'):
            assert ports[name] == str(folder / name)
            assert os.path.realpath(ports[name]).startswith('/dev/pts/')
        process.stdin.write(b'nonsense\n{"mount": 3}\n{"fault": {"kind": "mute"}}\n')
        process.stdin.flush()
        for reason in ('this is no JSON', 'send {"mount"', 'a fault needs "device"'):
            assert reason in json.loads(process.stdout.readline())['error']
        if ending == 'eof':
            process.stdin.close()
        else:
            process.send_signal(ending)
        assert process.wait(DEADLINE_S) == 0
        assert list(folder.iterdir()) == []
        process.stdout.close()
        process.stdin.close()


def test_several_rigs_share_a_process_and_have_noise_of_their_own(tmp_path):
    folders = [tmp_path / name for name in ('index', 'thumb')]
    decoders = [LineDecoder(TendonSensorConfig()) for _ in folders]
    with SimulatedRig(3, folders) as rig, ExitStack() as stack:
        ports = [
            stack.enter_context(serial.Serial(str(folder / 'sensor'), 115200, timeout=1.0))
            for folder in folders
        ]
        readings = [[], []]
        for port, decoder, found in zip(ports, decoders, readings, strict=True):
            wait_until(
                lambda port=port, decoder=decoder, found=found: found.extend(
                    decoder.feed(port.read(max(port.in_waiting, 1)), 0)
                )
                or len(found) >= 30,
                'too few lines',
            )
        with pytest.raises(RigError, match='2 rigs take no requests'):
            rig.truth()
    values = [[reading.value for reading in found[:30]] for found in readings]
    assert values[0] != values[1]
    assert [list(folder.iterdir()) for folder in folders] == [[], []]


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


def test_a_bad_description_is_the_reason_why_the_rig_does_not_start(tmp_path):
    (tmp_path / 'rig.yaml').write_text('load_cell: {noise_n: loud}')
    with pytest.raises(RigError, match=r"rig\.yaml\.load_cell\.noise_n is 'loud'; it must be"):
        SimulatedRig(description=tmp_path)
