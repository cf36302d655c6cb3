# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import re

from hypothesis import given
from hypothesis import strategies as st
import pytest

from linear_guide_driver.grbl.protocol import ERRORS
from tactile_sim.descriptions.catalogue import default_catalogue
from tactile_sim.devices.grbl import GrblDevice


class Bench:
    """A simulated Grbl controller in virtual time."""

    def __init__(self, homed=True):
        self.device = GrblDevice(default_catalogue().rig().guide)
        self.now_s = 0.0
        if homed:
            assert self.send('$H\n', after_s=20.0).endswith('ok\r\n')

    def send(self, text, after_s=0.0):
        data = text if isinstance(text, bytes) else text.encode('latin-1')
        said = self.device.receive(data, self.now_s)
        self.now_s += after_s
        return (said + self.device.poll(self.now_s)).decode()

    def mpos(self):
        return float(re.search(r'MPos:([-\d.]+)', self.send('?')).group(1))


UNLOCK = "\r\nGrbl 1.1h ['$' for help]\r\n[MSG:'$H'|'$X' to unlock]\r\n"


def test_after_power_up_homing_finds_the_negative_end():
    bench = Bench(homed=False)
    assert bench.send('') == UNLOCK
    assert bench.send('G0X-1\n') == 'error:9\r\n'
    assert bench.send('?').startswith('<Alarm|MPos:0.000,')
    assert bench.send('$H\n?', after_s=1.0) == ''  # Grbl sends no status while it homes
    assert bench.send('', after_s=10.0) == 'ok\r\n'
    assert bench.mpos() == -199.0
    assert bench.device.position_m(bench.now_s) == pytest.approx(0.001)


def test_ok_means_planned_and_dwell_means_done():
    bench = Bench()
    said = bench.send('G21G90G94\nG1X-169F900\nG4P0.01\n?')
    assert said.count('ok') == 2
    assert '<Run|' in said
    # The move takes distance / speed + speed / acceleration, and the dwell follows.
    assert 'ok' not in bench.send('', after_s=30 / 15 + 15 / 500 + 0.009)
    assert bench.send('', after_s=0.002) == 'ok\r\n'
    assert bench.mpos() == -169.0
    # The dwell ends before the '?' is received, so its 'ok' precedes the status.
    assert bench.send('G4P0\n?').startswith('ok\r\n<Idle|')


def test_lines_in_one_direction_do_not_stop_in_between():
    bench = Bench()
    bench.send('G1X-189F900\nX-179\nX-169\n', after_s=30 / 15 + 15 / 500 + 1e-6)
    assert bench.send('?').startswith('<Idle|MPos:-169.000')


def test_planner_holds_fifteen_moves_and_then_waits():
    bench = Bench()
    lines = ''.join(f'G1X{-198 + i}F900\n' for i in range(17))
    assert bench.send(lines[:120]).count('ok') < 17
    assert bench.send(lines[120:]).count('ok') <= 15
    assert bench.send('', after_s=20.0).count('ok') >= 1
    assert bench.mpos() == -182.0


def test_hold_resume_and_controlled_stop():
    bench = Bench()
    bench.send('G1X-99F900\n', after_s=1.0)
    assert '<Hold:1|' in bench.send('!?', after_s=0.1)
    held = bench.mpos()
    assert '<Hold:0|' in bench.send('?', after_s=1.0)
    assert bench.mpos() == held
    bench.send('~', after_s=10.0)
    assert bench.mpos() == -99.0
    bench.send('G1X-199F900\n', after_s=1.0)
    bench.send('!', after_s=0.5)
    stopped = bench.mpos()
    assert 'ALARM' not in (said := bench.send('\x18?'))
    assert said.startswith('\r\nGrbl 1.1h')
    assert f'<Idle|MPos:{stopped:.3f}' in said


def test_reset_while_moving_loses_the_position():
    bench = Bench()
    bench.send('G1X-99F900\n', after_s=1.0)
    assert bench.send('\x18') == 'ALARM:3\r\n'
    said = bench.send('?', after_s=0.6)
    assert said.endswith("[MSG:'$H'|'$X' to unlock]\r\n")
    assert bench.send('?').startswith('<Alarm|')


def test_soft_limit_raises_alarm_2_and_keeps_the_position():
    bench = Bench()
    bench.send('G1X-99F6000\n', after_s=5.0)
    assert bench.send('G1X1F900\n') == 'ALARM:2\r\n'
    assert bench.send('?G0X-5\n', after_s=1.0) == '[MSG:Reset to continue]\r\n'
    said = bench.send('\x18')
    assert said.startswith('ok\r\n\r\nGrbl')
    assert said.endswith('to unlock]\r\n')
    assert bench.mpos() == -99.0


@pytest.mark.parametrize(
    ('line', 'reply'),
    [
        ('', 'ok'),
        (' g1 (a comment) x-190 f 600 ; more', 'ok'),
        ('G1X', 'error:2'),
        ('-5', 'error:1'),
        ('G33X1', 'error:20'),
        ('M3', 'error:20'),
        ('G0G1X-5', 'error:21'),
        ('X-190X-191', 'error:25'),
        ('G1X-190', 'error:22'),
        ('F-100', 'error:4'),
        ('G4', 'error:28'),
        ('$Q', 'error:3'),
        ('$J=X-1F100', 'error:3'),
        ('$999=1', 'error:3'),
        ('$110=fast', 'error:2'),
        ('$110=-1', 'error:4'),
        ('$110=3000', 'ok'),
        ('G1' + '0' * 80, 'error:11'),
    ],
)
def test_replies(line, reply):
    assert Bench().send(line + '\n') == reply + '\r\n'
    if reply.startswith('error:'):
        assert int(reply[6:]) in ERRORS


def test_settings_rule_the_motion():
    bench = Bench()
    assert '$110=6000.000\r\n' in bench.send('$$\n')
    bench.send('$110=600\n')
    bench.send('G1X-99F6000\n', after_s=1.0)
    assert '|FS:600,0' in bench.send('?')
    assert bench.send('$$\n') == 'error:8\r\n'
    bench = Bench()
    assert bench.send('$22=0\n$20=1\n$H\n') == 'ok\r\nerror:10\r\nerror:5\r\n'


def test_an_unlocked_carriage_that_runs_into_the_end_of_the_rail_loses_steps():
    bench = Bench(homed=False)
    bench.send('')
    assert bench.send('$X\n') == '[MSG:Caution: Unlocked]\r\nok\r\n'
    bench.send('G0X-150\n', after_s=10.0)  # the rail ends after 100 mm
    assert bench.device.position_m(bench.now_s) == 0.0
    bench.send('G0X-140\n', after_s=10.0)
    assert bench.device.position_m(bench.now_s) == pytest.approx(0.010)


def test_status_fields_come_in_turn():
    reports = Bench().send('?' * 25).split('\r\n')[:-1]
    offset = [i for i, report in enumerate(reports) if '|WCO:' in report]
    overrides = [i for i, report in enumerate(reports) if '|Ov:' in report]
    assert offset == [0, 10, 20]
    assert overrides == [1, 11, 21]


line_text = st.sampled_from(
    ['G1X-150F900', 'G91X1', '$$', 'G4P0', '!', '~', '?', '\x18', '$X', '$H']
)


@given(st.lists(line_text, max_size=8), st.data())
def test_any_chunking_gives_the_same_answers(lines, data):
    stream = ''.join(text + '\n' for text in lines).encode('latin-1')
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    whole, parts = Bench(), Bench()
    one = whole.send(stream)
    many = ''.join(parts.send(stream[a:b]) for a, b in zip([0, *cuts], [*cuts, None], strict=True))
    assert one == many


# -- what the world does to it ---------------------------------------------------------------


@pytest.mark.parametrize('doing', ['', 'G1X-100F900\n', 'G4P9\n', '$H\n', 'G1X-3F20\n!'])
def test_power_loss_forgets_all_but_settings(doing):
    bench = Bench()
    bench.send('$110=3000\nG20\n')
    bench.send(doing, after_s=0.2)
    bench.device.restart(bench.now_s)
    here_m = bench.device.position_m(bench.now_s)
    # While the controller boots, it ignores all bytes.
    assert bench.send('G1X0F900\n?\x18', after_s=0.999) == ''
    said = bench.send('', after_s=0.001)
    assert said == UNLOCK
    bench.now_s += 20.0
    assert bench.send('?').startswith('<Alarm|MPos:0.000,')  # no late "ok" before it
    assert bench.device.position_m(bench.now_s) == here_m
    assert '$110=3000.000' in bench.send('$$\n')
    assert bench.send('$H\n', after_s=20.0) == 'ok\r\n'
    assert bench.mpos() == -199.0


@pytest.mark.parametrize('doing', ['', 'G1X-100F900\n', 'G4P9\n', '$H\n'])
def test_the_limit_switch_stops_it_dead_until_a_reset(doing):
    bench = Bench()
    bench.send(doing, after_s=0.2)
    bench.device.trip_limit(bench.now_s)
    here_m = bench.device.position_m(bench.now_s)
    assert bench.send('', after_s=0.4).endswith('ALARM:1\r\n')
    assert bench.send('\x18', after_s=0.099) == ''  # a reset within half a second is ignored
    assert bench.send('?$X\n~!\x85', after_s=0.001) == '[MSG:Reset to continue]\r\n'
    assert bench.send('?$X\n', after_s=20.0) == ''
    assert bench.device.position_m(bench.now_s) == here_m
    assert bench.send('\x18').endswith("[MSG:'$H'|'$X' to unlock]\r\n")
    assert bench.send('?').startswith('<Alarm|')
    assert bench.send('G0X-1\n') == 'error:9\r\n'


def test_a_dwell_whose_stepper_runs_dry_waits_for_a_cycle_start():
    bench = Bench()
    bench.device.stall(bench.now_s)
    assert bench.send('G21G90G94\nG1X-169F900\nG4P0.01\n', after_s=60.0).count('ok') == 2
    assert bench.send('?').startswith('<Idle|MPos:-')
    assert bench.mpos() < -169.0
    assert bench.send('~', after_s=3.0) == 'ok\r\n'
    assert bench.mpos() == -169.0
    bench.device.stall(bench.now_s)
    bench.send('G1X-199F900\nG4P0.01\n', after_s=1.0)
    assert '<Hold:0|' in bench.send('!?')


FAULTS = ('restart', 'trip_limit', 'stall')
LINES = ('G1X-150F900\n', 'G1X9F900\n', '$H\n', '!', '~', '\x18', 'G4P1\n')
events = st.sampled_from([*FAULTS, *LINES]) | st.binary(max_size=100)


@given(st.lists(st.tuples(events, st.floats(0.0, 2.0)), max_size=12))
def test_no_order_of_events_leaves_it_dead_or_off_the_rail(happenings):
    bench = Bench(homed=False)
    for event, after_s in happenings:
        if event in FAULTS:
            getattr(bench.device, event)(bench.now_s)
        else:
            bench.send(event)
        bench.now_s += after_s
        assert 0.0 <= bench.device.position_m(bench.now_s) <= 0.2
    bench.send('', after_s=30.0)
    for _ in range(2):
        bench.send('\x18', after_s=2.0)
    assert bench.send('$H\n', after_s=30.0).endswith('ok\r\n')
    assert bench.mpos() == -199.0
