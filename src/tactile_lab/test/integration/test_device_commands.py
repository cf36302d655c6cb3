# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile devices` and `tactile check` on the simulated rig's ports."""

from http.server import BaseHTTPRequestHandler, HTTPServer
import threading

import pytest
import serial
from tactile_command import answer_of, hear_tactile

from tactile_lab.devices import device_probe
from tactile_lab.devices.device_probe import FoundDevice, probe_net_ft, probe_ports
from tactile_sim import SimulatedRig
from tactile_testing.simulated_rigs import advance_rig, home_fast


@pytest.fixture(scope='module')
def rig():
    with SimulatedRig(seed=2) as rig:
        home_fast(rig)
        yield rig


@pytest.fixture
def faulty(rig):
    """Return the rig; faults that the test injects are removed afterwards."""
    yield rig
    for device in ('sensor', 'guide', 'tendon'):
        rig.fault(device, 'none')
    rig.fault('tendon', 'restart')  # clears the error flag of the overheating
    advance_rig(rig, 0.5)  # the servo does not respond while it restarts


def probe(*ports, is_quiet=False):
    return probe_ports([FoundDevice(port) for port in ports], listen_s=0.2, is_quiet=is_quiet)


def check(option, port, *more):
    code, document = answer_of('check', option, port, '--seconds', 1, *more)
    (report,) = document['devices']
    assert document['fit'] == (not report['problems']) == (code == 0)
    return report['facts'], ' '.join(p['what'] + p['remedy'] for p in report['problems'])


# -- devices -------------------------------------------------------------------------------


def test_devices_are_recognised_and_not_changed(rig):
    before = rig.truth()
    code, document = answer_of(
        'devices', *(f'--port={port}' for port in rig.ports), '--listen=0.3'
    )
    assert code == 0
    found = {device['port']: device for device in document['devices']}
    assert found[rig.ports.guide]['device'] == 'guide'
    assert found[rig.ports.guide]['what'] == 'Grbl 1.1h.20190830, in state Alarm'
    assert found[rig.ports.tendon]['what'] == 'Dynamixel XM430-W350 with ID 1, firmware 45'
    assert found[rig.ports.tendon]['parameters']['device_id'] == 1
    sensor = found[rig.ports.sensor]
    assert sensor['device'] == 'sensor'
    assert sensor['parameters'] == {
        'baud': 115200,
        'time_column': 0,
        'time_unit_s': 0.001,
        'value_column': 1,
        'unit': 'kg',
    }
    after = rig.truth()
    assert after['guide_position_m'] == before['guide_position_m']
    assert after['tendon_displacement_m'] == before['tendon_displacement_m']


def test_port_in_use_is_not_probed(rig):
    with serial.Serial(rig.ports.sensor, exclusive=True):
        (found,) = probe(rig.ports.sensor)
    assert (found.device, found.what) == ('', 'in use by another program')


def test_silent_ports_and_unknown_data_are_described(faulty, monkeypatch):
    monkeypatch.setattr(device_probe, 'SERVO_BAUDS', (57_600,))  # each ping takes 0.8 s
    ports = faulty.ports
    guide, tendon = probe(ports.guide, ports.tendon, is_quiet=True)
    assert guide.what == tendon.what == 'silent'
    faulty.fault('guide', 'mute')
    faulty.fault('sensor', 'wrong_baud', ratio=3.0)
    guide, sensor, missing = probe(ports.guide, ports.sensor, ports.guide + '9')
    assert guide.what == 'silent'
    assert sensor.what == 'sends data of an unknown device'
    assert missing.what.startswith('no such port')


def test_net_ft_is_found_at_its_address():
    page = b"""<?xml version="1.0"?>
        <netft><prodname>Net F/T</prodname><runstat>0x00000000</runstat>
        <cfgcpf>1000000</cfgcpf><cfgcpt>1000000</cfgcpt><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu>
        <comrdte>Enabled</comrdte><comrdtrate>60</comrdtrate><cfgcalsn>FT12345</cfgcalsn>
        </netft>"""

    class Box(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, *_):
            pass

    with HTTPServer(('127.0.0.1', 0), Box) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        found = probe_net_ft('127.0.0.1', server.server_port)
        server.shutdown()
    assert found.device == 'sensor'
    assert found.what == 'Net F/T, calibration FT12345, 60 records/s, status 0x00000000'
    assert found.parameters == {'sensor': 'net_ft', 'host': '127.0.0.1'}
    gone = probe_net_ft('127.0.0.1', server.server_port)
    assert gone.device == ''
    assert 'no answer' in gone.what


# -- check ---------------------------------------------------------------------------------


def test_check_of_a_faultless_rig_passes_and_moves_it_if_allowed(rig):
    code, document = answer_of(
        'check',
        *(f'--{name}={port}' for name, port in rig.ports._asdict().items()),
        *('--seconds', 1, '--move'),
    )
    assert [report['problems'] for report in document['devices']] == [[], [], []]
    assert code == 0
    assert document['fit']
    sensor, guide, tendon = (report['facts'] for report in document['devices'])
    assert sensor['rate [Hz]'] == pytest.approx(60.0, rel=0.02)
    assert 1e-4 < sensor['noise, standard deviation [N]'] < 0.1
    assert abs(guide['error at rest [mm]']) < 0.1
    assert tendon['tightened and slackened [mm]'] == 2.0
    assert rig.truth()['tendon_displacement_m'] == pytest.approx(0.0, abs=2e-4)


def test_check_moves_nothing_unless_allowed(rig):
    before = rig.truth()
    facts, _ = check('--guide', rig.ports.guide)
    assert facts['firmware'] == 'Grbl 1.1h.20190830'
    facts, _ = check('--tendon', rig.ports.tendon)
    assert 'stops the servo after 0.2 s' in facts['watchdog']
    after = rig.truth()
    assert after['guide_position_m'] == before['guide_position_m']
    assert after['tendon_displacement_m'] == pytest.approx(
        before['tendon_displacement_m'], abs=1e-5
    )


def test_faults_of_the_sensor_are_reported_with_a_remedy(faulty, parameter_file):
    params = parameter_file('tendon_sensor: {ros__parameters: {rate_hz: 80.0}}')
    _, problems = check('--sensor', faulty.ports.sensor, '--params', params)
    assert 'rate_hz is 80' in problems
    faulty.fault('sensor', 'saturate')
    _, problems = check('--sensor', faulty.ports.sensor)
    assert 'the reading does not change' in problems
    faulty.fault('sensor', 'none')
    faulty.fault('sensor', 'garbage', share=0.5)
    facts, problems = check('--sensor', faulty.ports.sensor)
    assert 'lines that are not readings' in problems
    assert 'samples were lost' in problems
    assert facts['lost samples'] > 10
    faulty.fault('sensor', 'none')
    faulty.fault('sensor', 'mute')
    _, problems = check('--sensor', faulty.ports.sensor)
    assert 'no reading in 1 s' in problems


def test_faults_of_guide_and_tendon_are_reported(faulty):
    faulty.fault('tendon', 'overheat', temperature_c=91)
    facts, problems = check('--tendon', faulty.ports.tendon)
    assert facts['temperature [C]'] == 91
    assert facts['hardware errors'] == 'overheating'
    assert 'has shut down: overheating' in problems
    assert 'let it cool' in problems
    faulty.fault('tendon', 'mute')
    _, problems = check('--tendon', faulty.ports.tendon)
    assert 'no answer from servo 1' in problems
    with serial.Serial(faulty.ports.guide, 115200, timeout=5.0) as port:
        port.write(b'$X\n$110=500\n')
        assert port.read_until(b'ok\r\nok\r\n')
    try:
        _, problems = check('--guide', faulty.ports.guide)
        assert '500 mm/min' in problems
        assert 'set $110=6000' in problems
    finally:
        with serial.Serial(faulty.ports.guide, 115200, timeout=5.0) as port:
            port.write(b'$110=6000\n')
            assert port.read_until(b'ok\r\n')


def test_check_without_a_device_is_refused():
    assert 'choose what to test' in hear_tactile('check', code=2)
