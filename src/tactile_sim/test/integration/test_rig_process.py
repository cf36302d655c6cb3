# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The process of a simulated rig: its ports, the answers to requests, and its end."""

from contextlib import ExitStack
import json
import os
import signal
import subprocess
import sys
import time

import pytest
import serial

from tactile_sim import RigError, SimulatedRig
from tactile_sim.pty_server import PtyPort
from tactile_testing.simulated_rigs import advance_rig
from tactile_testing.waiting import DEADLINE_S, wait_until
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.line_sensor import LineDecoder


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=7) as rig:
        yield rig
    assert rig._process.returncode == 0  # the process ends when its standard input is closed


def test_the_rigs_time_is_the_hosts_and_lines_come_at_60_hz(rig):
    decoder = LineDecoder(TendonSensorConfig())
    readings = []
    with serial.Serial(rig.ports.sensor, 115200, timeout=1.0) as port:
        started_s = time.monotonic()
        before_s = rig.truth()['time_s']
        wait_until(
            lambda: readings.extend(decoder.feed(port.read(max(port.in_waiting, 1)), 0))
            or len(readings) >= 60,
            'too few lines',
        )
        # At the first request, a rig on a busy computer can be up to 0.5 s late. It can then
        # simulate 0.5 s more than the time that has passed here.
        assert rig.truth()['time_s'] - before_s <= time.monotonic() - started_s + 0.6
    assert decoder.rejected_lines == 0
    sent_ms = [reading.device_ticks for reading in readings]
    assert (sent_ms[59] - sent_ms[0]) / 59 == pytest.approx(1000 / 60, rel=1e-3)


def test_requests_are_answered_or_refused_with_a_sentence(rig):
    assert rig.mount('texture', 'C2', 'abduction', (1, 2, 3))['ok']
    assert rig.truth()['mount'] == {'protocol': 'texture', 'object': 'C2', 'contact': 'abduction'}
    for request, reason in (
        (lambda: rig.mount('texture', 'R9', 'flexion'), "'R9'.* F, R1"),
        (lambda: rig.mount('texture', 'F', 'flexion', (-1, 0, 0)), '"mount"'),
        (lambda: rig.fault('camera', 'mute'), "'camera'.* sensor, guide"),
    ):
        with pytest.raises(RigError, match=reason):
            request()


def test_unplug_takes_the_port_away_and_brings_it_back_under_its_name(rig):
    name = rig.ports.sensor
    before = os.path.realpath(name)
    with serial.Serial(name, 115200, timeout=0.0) as port:
        rig.fault('sensor', 'unplug')

        def is_lost():
            try:
                port.read(100_000)
            except serial.SerialException:
                return True
            return False

        wait_until(is_lost, 'the open port is still readable')
        assert not os.path.lexists(name)
        with pytest.raises(serial.SerialException):
            serial.Serial(name)
        rig.fault('sensor', 'none')
        wait_until(lambda: os.path.exists(name), 'the port did not come back')
        assert os.path.realpath(name) != before  # as the old pty is still open in this test
    with serial.Serial(name, 115200, timeout=DEADLINE_S) as again:
        # The unplugged cable also powers the sensor, so its time restarts at 0.
        assert b'Readings:\r\n0,' in again.read_until(b'\r\n16,')


def test_unplug_ends_by_itself_and_the_guide_has_kept_its_power(rig):
    before = os.path.realpath(rig.ports.guide)
    with serial.Serial(rig.ports.guide):  # while the old pty is open, its name is not reused
        rig.fault('guide', 'unplug', 0.2)
        advance_rig(rig, 0.3)
        wait_until(lambda: os.path.exists(rig.ports.guide), 'the port did not come back')
        assert os.path.realpath(rig.ports.guide) != before
    with serial.Serial(rig.ports.guide, 115200, timeout=DEADLINE_S) as again:
        again.write(b'?')
        assert b'<Alarm|' in again.read_until(b'>')


def test_the_program_speaks_json_and_ends_cleanly(tmp_path):
    pipe = subprocess.PIPE
    command = [sys.executable, '-m', 'tactile_sim.rig_server', '--links']
    running = {
        ending: subprocess.Popen([*command, tmp_path / ending.name], stdin=pipe, stdout=pipe)
        for ending in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    }
    for ending, process in running.items():
        folder = tmp_path / ending.name
        with process:
            ports = json.loads(process.stdout.readline())
            assert ports == {name: str(folder / name) for name in ('guide', 'tendon', 'sensor')}
            assert all(os.path.realpath(port).startswith('/dev/pts/') for port in ports.values())
            process.stdin.write(b'nonsense\n{"mount": 3}\n{"fault": {"kind": "mute"}}\n')
            process.stdin.flush()
            for reason in ('JSON', '"mount"', '"device"'):
                assert reason in json.loads(process.stdout.readline())['error']
            process.send_signal(ending)
            assert process.wait(DEADLINE_S) == 0
        assert list(folder.iterdir()) == []


def test_a_rig_that_does_not_start_or_is_dead_says_why(tmp_path):
    (tmp_path / 'rig.yaml').write_text('load_cell: {noise_n: loud}')
    with pytest.raises(RigError, match=r"rig\.yaml\.load_cell\.noise_n is 'loud'"):
        SimulatedRig(description=tmp_path)
    with SimulatedRig() as rig:
        # Ctrl-C in the terminal must only reach the program that started the rig, not the rig.
        assert os.getpgid(rig._process.pid) != os.getpgid(0)
        rig._process.kill()
        with pytest.raises(RigError, match='-9'):
            rig.truth()
    with pytest.raises(RigError):
        rig.truth()
    assert not os.path.lexists(os.path.dirname(rig.ports.guide))


def test_a_port_does_not_replace_what_is_no_link(tmp_path):
    (tmp_path / 'guide').write_text('in the way')
    with pytest.raises(RigError, match='guide'):
        PtyPort(tmp_path / 'guide')


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
        rig.mount('texture', 'C2', 'abduction', rig=1)
        assert [rig.truth(rig=i)['mount']['object'] for i in range(2)] == ['none', 'C2']
        rig.fault('sensor', 'unplug', rig=1)
        wait_until(lambda: not os.path.lexists(folders[1] / 'sensor'), 'it is not unplugged')
        assert os.path.lexists(folders[0] / 'sensor')
        for number in (None, 2):
            with pytest.raises(RigError, match='0 to 1'):
                rig.truth(rig=number)
    values = [[reading.value for reading in found[:30]] for found in readings]
    assert values[0] != values[1]
    assert [list(folder.iterdir()) for folder in folders] == [[], []]
