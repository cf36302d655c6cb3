# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each fault of the sensor and the guide, and of any line, as bytes on real ptys."""

from itertools import pairwise
import os
import time

from faulty_rig import Ear, LINE
import pytest
import serial

from simulated_rigs import advance_rig
from tactile_sim import RigError
from waiting import wait_until

# -- refusals ------------------------------------------------------------------------------


def test_bad_requests_are_answered_with_a_sentence(rig):
    for arguments, reason in (
        (('camera', 'mute'), "no device 'camera'; there are sensor, guide, tendon"),
        (('sensor', 'overheat'), "the sensor has no fault 'overheat'; there are mute"),
        (('guide', 'alarm', 1.0), 'alarm is a moment; leave duration_s out'),
        (('guide', 'mute', -1.0), 'duration_s is -1.0; it must be a number from 0'),
        (('sensor', 'none', 1.0), 'takes nothing else'),
    ):
        with pytest.raises(RigError, match=reason):
            rig.fault(*arguments)
    with pytest.raises(RigError, match="no option 'force'; there are: share"):
        rig.fault('sensor', 'garbage', force=1)
    with pytest.raises(RigError, match="share is 'all'; it must be a number from 0 to 1"):
        rig.fault('sensor', 'garbage', share='all')
    with pytest.raises(RigError, match='needs "device" and "kind"'):
        rig._request({'fault': {'kind': 'mute'}})


# -- the line itself -----------------------------------------------------------------------


def test_unplug_takes_the_port_away_and_brings_it_back_under_its_name(rig, sensor):
    before = os.path.realpath(rig.ports.sensor)
    rig.fault('sensor', 'unplug')

    def is_lost():
        try:
            sensor.listen()
        except serial.SerialException:
            return True
        return False

    wait_until(is_lost, 'the open port is still readable')
    assert not os.path.lexists(rig.ports.sensor)
    with pytest.raises(serial.SerialException):
        serial.Serial(rig.ports.sensor)
    rig.fault('sensor', 'none')
    wait_until(lambda: os.path.exists(rig.ports.sensor), 'the port did not come back')
    assert os.path.realpath(rig.ports.sensor) != before  # our end of the old one is open yet
    with Ear(rig.ports.sensor) as again:
        said = again.wait_for(lambda data: len(LINE.findall(data)) > 2, 'no lines')
    assert b'Readings:\r\n0,' in said  # its power came through the cable


def test_unplug_ends_by_itself(rig, guide):
    rig.fault('guide', 'unplug', 0.2)
    wait_until(lambda: not os.path.lexists(rig.ports.guide), 'the port is still there')
    wait_until(lambda: os.path.exists(rig.ports.guide), 'the port did not come back')
    with Ear(rig.ports.guide) as again:
        again.port.write(b'?')
        again.wait_for(lambda data: b'<Alarm|' in data, 'no status')


def test_mute_is_silence_and_the_lines_in_it_are_lost(rig, sensor):
    last_ms = int(LINE.findall(sensor.wait_for_lines(2))[-1][0])
    rig.fault('sensor', 'mute')
    advance_rig(rig, 0.1)
    sensor.listen()
    sensor.data = b''
    advance_rig(rig, 0.5)
    assert sensor.listen() == b''
    rig.fault('sensor', 'none')
    said = sensor.wait_for(lambda data: LINE.search(data), 'no line')
    assert int(LINE.search(said).group(1)) >= last_ms + 500


def test_a_muted_guide_still_obeys_and_a_deaf_one_does_not(rig, guide):
    guide.port.write(b'$X\n$25=6000\n$24=600\n$H\n')
    guide.wait_for(lambda data: data.count(b'ok\r\n') == 4, 'not homed')
    for kind, moved in (('mute', True), ('deaf', False)):
        start_m = rig.truth()['guide_position_m']
        rig.fault('guide', kind)
        guide.port.write(b'G91\nG1X5F3000\n')
        advance_rig(rig, 0.6)
        assert guide.listen() == b''
        assert (rig.truth()['guide_position_m'] > start_m + 0.004) == moved
        rig.fault('guide', 'none')


def test_burst_clumps_lines_and_loses_none(rig, sensor):
    rig.fault('sensor', 'burst', period_s=0.25)
    advance_rig(rig, 0.3)
    said = sensor.wait_for_lines(40)
    times = [int(ms) for ms, _ in LINE.findall(said)]
    assert max(b - a for a, b in pairwise(times)) <= 17
    gaps_s, heard_s = [], time.monotonic()

    def listen():
        nonlocal heard_s
        if sensor.port.read(100_000):
            if time.monotonic() - heard_s > 0.05:
                gaps_s.append(time.monotonic() - heard_s)
            heard_s = time.monotonic()
        return len(gaps_s) >= 4

    wait_until(listen)
    assert sorted(gaps_s)[1] > 0.15


def test_garbage_leaves_good_lines_between(rig, sensor):
    rig.fault('sensor', 'garbage', share=0.5)
    said = sensor.wait_for_lines(60)
    lines = said.split(b'\r\n')
    good = [line for line in lines if LINE.fullmatch(line + b'\r\n')]
    assert 10 < len(good) < 50
    assert any(byte > 0x7F for byte in said)


def test_split_lines_lose_their_ends(rig, sensor):
    rig.fault('sensor', 'split', share=0.5)
    said = sensor.wait_for_lines(30)
    lines = said.split(b'\r\n')[:-1]
    assert any(LINE.fullmatch(line + b'\r\n') for line in lines)
    assert not all(LINE.fullmatch(line + b'\r\n') for line in lines)
    assert all(byte in b'0123456789.-,kg\r\n' for byte in said)


def test_wrong_baud_makes_other_bytes_of_all_lines(rig, sensor):
    rig.fault('sensor', 'wrong_baud', ratio=12.0)
    advance_rig(rig, 0.1)
    sensor.listen()
    sensor.data = b''
    said = sensor.wait_for(lambda data: len(data) > 50, 'silence')
    assert not LINE.search(said)


def test_wrong_baud_garbles_what_the_device_hears(rig, guide):
    rig.fault('guide', 'wrong_baud')
    guide.port.write(b'$I\n')
    advance_rig(rig, 0.2)
    assert b'VER' not in guide.listen()


# -- the sensor ----------------------------------------------------------------------------


def test_drop_loses_so_many_lines(rig, sensor):
    sensor.data = b''
    said = sensor.wait_for(LINE.search, 'no line')
    rig.fault('sensor', 'drop', count=7)
    said += sensor.wait_for(lambda data: len(LINE.findall(data)) > 20, 'no lines')
    times = [int(ms) for ms, _ in LINE.findall(said)]
    steps = [b - a for a, b in pairwise(times)]
    assert [step for step in steps if step > 17] in ([133], [134])


def test_saturate_and_stuck(rig, sensor):
    rig.fault('sensor', 'saturate')
    advance_rig(rig, 0.1)
    sensor.listen()
    said = sensor.wait_for_lines(10)
    (highest,) = {value for _, value in LINE.findall(said)}
    assert float(highest) == pytest.approx(2.0, abs=1e-4)  # the capacity in kilograms
    rig.fault('sensor', 'none')
    advance_rig(rig, 0.1)
    rig.fault('sensor', 'stuck')
    advance_rig(rig, 0.1)
    sensor.listen()
    said = sensor.wait_for_lines(30)
    readings = LINE.findall(said)
    assert len({value for _, value in readings}) == 1
    assert readings[0][1] != highest
    assert len({ms for ms, _ in readings}) == len(readings)


def test_menu_stops_the_lines_until_x(rig, sensor):
    rig.fault('sensor', 'menu')
    said = sensor.wait_for(lambda data: data.endswith(b'x) Exit\r\n>'), 'no prompt')
    assert b'System Configuration' in said
    advance_rig(rig, 0.3)
    assert sensor.listen() == b''
    sensor.port.write(b'x')
    sensor.wait_for(lambda data: b'Exiting\r\n' in data and LINE.search(data), 'no lines')


def test_a_restarted_sensor_says_its_banner_and_counts_from_0(rig, sensor):
    rig.fault('sensor', 'restart')
    said = sensor.wait_for(lambda data: b'Readings:\r\n0,' in data, 'no banner')
    assert b'Serial Load Cell Converter version 1.2\r\n' in said


# -- the guide -----------------------------------------------------------------------------


def test_a_lost_ok_is_lost_and_the_report_is_not(rig, guide):
    rig.fault('guide', 'drop', count=1)
    guide.port.write(b'$X\n?$I\n')
    said = guide.wait_for(lambda data: b'ok\r\n' in data, 'no second ok')
    assert said.count(b'ok\r\n') == 1
    assert b'Unlocked' in said
    assert b'[OPT:' in said[: said.index(b'ok\r\n')]


def test_alarm_stops_the_guide_dead_and_locks_it(rig, guide):
    guide.port.write(b'$X\nG91\nG1X-100F1200\n')
    guide.wait_for(lambda data: data.count(b'ok\r\n') == 3, 'no ok')
    advance_rig(rig, 0.3)
    rig.fault('guide', 'alarm')
    here_m = rig.truth()['guide_position_m']
    said = guide.wait_for(lambda data: b'[MSG:Reset to continue]\r\n' in data, 'no message')
    assert b'ALARM:1\r\n' in said
    guide.port.write(b'?')
    advance_rig(rig, 0.2)
    assert guide.listen() == b''
    assert rig.truth()['guide_position_m'] == here_m
    guide.port.write(b'\x18')
    guide.wait_for(lambda data: b'to unlock]\r\n' in data, 'no banner')
    guide.port.write(b'?')
    guide.wait_for(lambda data: b'<Alarm|' in data, 'not locked')


def test_a_restarted_guide_has_lost_its_place(rig, guide):
    guide.port.write(b'$X\nG91\nG1X-100F1200\n')
    guide.wait_for(lambda data: data.count(b'ok\r\n') == 3, 'no ok')
    advance_rig(rig, 0.3)
    rig.fault('guide', 'restart')
    here_m = rig.truth()['guide_position_m']
    said = guide.wait_for(lambda data: b'to unlock]\r\n' in data, 'no banner')
    assert b'ALARM' not in said
    assert "\r\nGrbl 1.1h ['$' for help]" in said.decode()
    guide.port.write(b'?')
    said = guide.wait_for(lambda data: b'>\r\n' in data, 'no status')
    assert said.startswith(b'<Alarm|MPos:0.000,')
    assert rig.truth()['guide_position_m'] == here_m
