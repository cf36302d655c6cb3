# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import itertools
import subprocess
import sys
import threading
import time

from background import Background
import pytest

from linear_guide_driver import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideClient,
    LinearGuideConfig,
    MotionFailedError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.grbl import connection
from tactile_testing.waiting import wait_until


@pytest.fixture
def guide(grbl):
    client = LinearGuideClient(LinearGuideConfig(port=grbl.port, poll_rate_hz=20.0))
    client.connect()
    yield client
    client.close()


@pytest.fixture
def move(guide, grbl):
    """Return a running move over most of the travel."""
    guide.home()
    move = Background(guide.move_to, 0.15, 0.05)
    wait_until(lambda: grbl.is_moving)
    return move


def test_a_guide_at_rest_is_asked_slowly_and_a_moving_one_at_full_rate(guide, monkeypatch):
    monkeypatch.setattr(connection, 'REST_AFTER_S', 0.1)
    monkeypatch.setattr(connection, 'REST_REPORT_S', 1e3)  # longer than this test
    monkeypatch.setattr(connection, 'SILENCE_S', 1e3)
    guide.home()
    there = guide._connection
    wait_until(lambda: time.monotonic() > there._rests_at_s)
    ticks, tick = [], there._link._on_tick

    def note_tick():
        ticks.append(tick())
        return ticks[-1]

    there._link._on_tick = note_tick
    wait_until(lambda: len(ticks) > 5)
    at_rest = there._reports
    wait_until(lambda: len(ticks) > 30)  # 1 s, in which 20 reports would arrive at full rate
    assert there._reports == at_rest
    assert set(ticks) == {connection.REST_CYCLE_S}
    guide.move_to(0.031, 0.03)
    assert there._reports > at_rest + 5
    assert connection.TICK_S in ticks


def test_home_then_move_ends_at_rest_at_the_target(guide, grbl):
    assert guide.home().position_m == pytest.approx(0.001)
    states = []
    began_s = time.monotonic()
    state = guide.move_to(0.031, 0.1, states.append)
    took_s = time.monotonic() - began_s
    assert state.position_m == pytest.approx(0.031, abs=1e-6)
    assert state.state == 'Idle'
    # The controller reports Idle right after the ok of the move. Only the ok of the dwell shows
    # that the motion has ended.
    assert took_s >= 0.3
    assert grbl.mpos == -169.0
    assert max(s.velocity_m_s for s in states) == pytest.approx(0.1)
    guide.move_to(0.021, 0.1, states.append)
    assert min(s.velocity_m_s for s in states) == pytest.approx(-0.1)
    assert 'G53 G1 X-169.000 F6000.000' in grbl.lines
    # The move is sent in pieces: 15 in the planner and 4 waiting lines contain 0.25 s of motion.
    # Each piece therefore lasts at most 13 ms.
    targets = [float(line.split()[2][1:]) for line in grbl.lines if line.startswith('G53 G1')]
    assert all(abs(b - a) < 1.34 for a, b in itertools.pairwise(targets))
    assert grbl.real_time.endswith(b'\x90')


def test_a_bad_command_moves_nothing(guide, grbl):
    guide.home()
    for position_m, speed_m_s, text in (
        (-0.001, 0.01, 'travel'),
        (0.2001, 0.01, 'travel'),
        (float('nan'), 0.01, 'travel'),
        (0.1, 0.0, 'peed'),
        (0.1, 0.101, '0.1'),
        (0.1, float('nan'), 'peed'),
    ):
        with pytest.raises(MotionRefusedError, match=text):
            guide.move_to(position_m, speed_m_s)
    assert not any('G1' in line for line in grbl.lines)
    assert guide.trouble is None


def test_a_setting_that_would_change_a_glide_is_refused(grbl):
    grbl.settings[13] = '1'
    with pytest.raises(DeviceRefusedError, match=r'\$13=0'):
        LinearGuideClient(LinearGuideConfig(port=grbl.port)).connect()


def test_a_missing_port_and_a_silent_one_are_told_apart(grbl, monkeypatch):
    for name in ('BOOT_S', 'RESTART_S'):
        monkeypatch.setattr(connection, name, 0.1)
    with pytest.raises(DeviceConnectionError, match='cannot open'):
        LinearGuideClient(LinearGuideConfig(port='/dev/does-not-exist')).connect()
    grbl.is_deaf = True
    with pytest.raises(DeviceConnectionError, match='Grbl'):
        LinearGuideClient(LinearGuideConfig(port=grbl.port)).connect()


def test_a_controller_left_moving_is_braked_before_it_is_reset(grbl):
    grbl.state = 'Idle'
    grbl._line('G53 G1 X-10.000 F600.000')
    client = LinearGuideClient(LinearGuideConfig(port=grbl.port))
    client.connect()
    # A reset without a preceding hold would have caused ALARM:3.
    assert grbl.state == 'Idle'
    assert not grbl.is_moving
    client.close()


def test_a_stop_brakes_and_keeps_the_position(guide, grbl):
    guide.home()
    flag = threading.Event()
    for stop in (flag.set, guide.request_stop):
        flag.clear()
        before = grbl.mpos
        move = Background(guide.move_to, 0.15, 0.05, lambda _: None, flag.is_set)
        wait_until(lambda before=before: grbl.is_moving and grbl.mpos > before + 2)
        stop()
        move.ends_by(MotionStoppedError, 'the guide is still homed')
        assert not grbl.is_moving
        assert guide.trouble is None
        assert guide.state.position_m == pytest.approx(0.2 + grbl.mpos / 1e3, abs=1e-6)
    guide.move_to(0.001, 0.1)


def test_a_stop_right_after_the_reset_of_another_holds_nothing(guide, move, monkeypatch):
    reset = connection.GrblConnection.reset

    def reset_then_stop(link):
        reset(link)
        assert not guide.request_stop()

    with monkeypatch.context() as patch:
        patch.setattr(connection.GrblConnection, 'reset', reset_then_stop)
        assert guide.request_stop()
        move.ends_by(MotionStoppedError)
    guide.move_to(0.002, 0.1)


def test_a_stop_that_comes_first_moves_nothing(guide, grbl):
    guide.home()
    assert not guide.request_stop()
    count = len(grbl.lines)
    with pytest.raises(MotionStoppedError, match='guide'):
        guide.move_to(0.1, 0.05, should_stop=lambda: True)
    with pytest.raises(MotionStoppedError, match='guide'):
        guide.home(should_stop=lambda: True)
    assert len(grbl.lines) == count
    guide.move_to(0.002, 0.1)


def test_a_stop_between_the_lines_of_a_move_sends_no_move(guide, grbl):
    guide.home()
    grbl.replies['G21.*'] = b''  # the line with the modes is never answered, so the move waits
    move = Background(guide.move_to, 0.1, 0.05)
    wait_until(lambda: grbl.lines[-1].startswith('G21'))
    assert guide.request_stop()
    move.ends_by(MotionStoppedError, 'the guide is still homed')
    assert not any('G1' in line for line in grbl.lines)


def test_a_move_whose_watcher_fails_is_braked_and_a_failing_consumer_ends_nothing(grbl):
    def fail(state):
        if state.state == 'Run':
            raise ZeroDivisionError

    client = LinearGuideClient(LinearGuideConfig(port=grbl.port), fail)
    client.connect()
    client.home()
    client.move_to(0.005, 0.05)
    with pytest.raises(ZeroDivisionError):
        client.move_to(0.19, 0.02, fail)
    wait_until(lambda: not grbl.is_moving)
    with pytest.raises(MotionRefusedError, match='abandoned'):
        client.move_to(0.1, 0.05)
    client.close()


def test_an_alarm_ends_the_move_and_homing_right_after_it_works(guide, grbl, move):
    grbl.raise_alarm(1)
    move.ends_by(MotionFailedError, 'ALARM:1')
    assert guide.state.position_m is None
    with pytest.raises(MotionRefusedError, match='ALARM:1'):
        guide.move_to(0.1, 0.05)
    guide.home()  # Grbl ignores the first reset
    guide.move_to(0.002, 0.05)


def test_a_move_whose_stepper_runs_dry_is_started_again(guide, grbl):
    guide.home()
    grbl.runs_dry = 2
    guide.move_to(0.011, 0.05)
    assert (grbl.runs_dry, grbl.mpos) == (0, -189.0)


@pytest.mark.parametrize('who', ['driver', 'pendant'])
def test_a_held_move_is_not_started_again(guide, grbl, monkeypatch, who):
    guide.home()
    grbl.runs_dry = 1
    # The stop comes after the driver's last check for a stop, and before its cycle start.
    if who == 'driver':
        stalls = property(lambda _: grbl.is_dry and guide.request_stop())
        monkeypatch.setattr(connection.GrblConnection, 'has_stalled', stalls)
    move = Background(guide.move_to, 0.011, 0.05)
    if who == 'pendant':
        wait_until(lambda: grbl.is_dry)
        grbl._real_time(b'!')
    move.ends_by(MotionStoppedError if who == 'driver' else MotionFailedError)
    assert b'!' in grbl.real_time
    assert b'~' not in grbl.real_time.partition(b'!')[2]
    assert grbl.mpos < -189.0


def test_a_restart_of_the_controller_loses_the_position(guide, grbl, move):
    grbl.lose_power()
    move.ends_by(MotionFailedError, 'restarted by itself')
    with pytest.raises(MotionRefusedError, match='restarted by itself'):
        guide.move_to(0.1, 0.05)


def test_a_refused_line_or_another_end_is_no_success(guide, grbl):
    for reply, text in (
        (b'error:22\r\n', 'error:22'),
        (b'ok\r\n', r'Idle.* 0\.001'),  # the line is accepted, but nothing moves
    ):
        guide.home()
        grbl.replies['G53 G1.*'] = reply
        with pytest.raises(MotionFailedError, match=text):
            guide.move_to(0.1, 0.05)
        with pytest.raises(MotionRefusedError, match=text):
            guide.move_to(0.1, 0.05)
        grbl.replies.clear()
    guide.home()
    guide.move_to(0.002, 0.05)


def test_a_hold_by_somebody_else_fails_the_move(grbl, move):
    grbl._real_time(b'!')
    move.ends_by(MotionFailedError, 'Hold')


def test_a_silent_controller_is_noticed_at_rest_and_in_motion(guide, grbl, monkeypatch):
    monkeypatch.setattr(connection, 'SILENCE_S', 0.4)
    guide.home()
    grbl.is_deaf = True
    wait_until(lambda: 'silent' in str(guide.trouble))
    grbl.is_deaf = False
    guide.home()
    move = Background(guide.move_to, 0.15, 0.05)
    wait_until(lambda: grbl.is_moving)
    grbl.is_deaf = True
    move.ends_by(MotionFailedError, 'silent')


def test_an_unplugged_line_ends_the_move(guide, grbl, move):
    grbl.close()
    move.ends_by(MotionFailedError, 'is lost')
    assert guide.is_lost
    with pytest.raises(DeviceConnectionError, match='cannot open'):
        guide.home()
    assert guide.is_lost


def test_homing_can_be_stopped_or_fail_and_must_then_be_repeated(guide, grbl):
    grbl.home_s = 5.0
    homing = Background(guide.home)
    wait_until(lambda: grbl.state == 'Home')
    assert guide.request_stop()
    homing.ends_by(MotionStoppedError)
    with pytest.raises(MotionRefusedError, match='homing'):
        guide.move_to(0.1, 0.05)
    grbl.replies[r'\$H'] = b'ALARM:9\r\n'
    with pytest.raises(MotionFailedError, match='ALARM:9'):
        guide.home()


def test_close_brings_a_moving_guide_to_rest(guide, grbl):
    guide.home()
    move = Background(guide.move_to, 0.19, 0.02)
    wait_until(lambda: grbl.is_moving)
    guide.close()
    assert not grbl.is_moving
    move.ends_by(MotionStoppedError)
    with pytest.raises(MotionRefusedError, match='not connected'):
        guide.home()


HOME_AND_MOVE = """
import sys
from linear_guide_driver import LinearGuideClient, LinearGuideConfig
client = LinearGuideClient(LinearGuideConfig(port=sys.argv[1]))
client.connect()
client.home()
client.move_to(0.19, 0.02)
"""


def test_a_killed_driver_leaves_little_for_the_controller_to_carry_out(grbl):
    command = [sys.executable, '-c', HOME_AND_MOVE, grbl.port]
    driver = subprocess.Popen(command)
    wait_until(lambda: grbl.mpos > -195)
    driver.kill()
    driver.wait()
    killed_at = grbl.mpos
    wait_until(lambda: not grbl.is_moving)
    # The controller has received 0.25 s of motion in advance: 5 mm at 20 mm/s. If the move had
    # been sent as a whole, the guide would move on by up to 150 mm.
    assert grbl.mpos < killed_at + 10


HOME_MOVE_AND_HOME = """
import sys
from linear_guide_driver import LinearGuideClient, LinearGuideConfig
client = LinearGuideClient(LinearGuideConfig(port=sys.argv[1]))
client.connect()
client.home()
client.move_to(0.1, 0.1)
client.home()
"""


def test_a_driver_killed_in_a_homing_from_a_known_position_leaves_as_little(grbl):
    grbl.settings[25] = '1200.000'  # 20 mm/s
    driver = subprocess.Popen([sys.executable, '-c', HOME_MOVE_AND_HOME, grbl.port])
    wait_until(lambda: grbl.state == 'Idle' and '$H' in grbl.lines and grbl.mpos > -101)
    wait_until(lambda: grbl.mpos < -110)
    driver.kill()
    driver.wait()
    killed_at = grbl.mpos
    wait_until(lambda: not grbl.is_moving)
    # The switch is 80 mm away. Only a homing cycle ($H) would move the guide that far.
    assert grbl.mpos > killed_at - 10
    assert grbl.lines.count('$H') == 1


@pytest.mark.parametrize(('homed_mm', 'near_m'), [(-199.0, 0.003), (-1.0, 0.197)])
def test_a_homing_from_a_known_position_begins_near_the_switch(guide, grbl, homed_mm, near_m):
    grbl.homed_mm, grbl.home_s = homed_mm, 0.3
    guide.home()
    guide.move_to(0.1, 0.1)
    for start_m in (0.1, near_m):  # for the second homing, the guide is near the switch already
        homing = Background(guide.home)
        wait_until(lambda: grbl.state == 'Home')
        assert grbl.mpos == pytest.approx((near_m - 0.2) * 1e3, abs=0.01), start_m
        assert homing.end() is None
        guide.move_to(near_m, 0.1)


def test_a_homing_that_is_stopped_before_its_cycle_keeps_the_position(guide, grbl):
    guide.home()
    guide.move_to(0.1, 0.1)
    homing = Background(guide.home)
    wait_until(lambda: grbl.is_moving)
    assert guide.request_stop()
    assert isinstance(homing.end(), MotionStoppedError)
    assert not guide.trouble
    guide.move_to(0.1, 0.1)
    assert grbl.lines.count('$H') == 1


def test_a_fault_before_the_homing_cycle_asks_for_a_homing(guide, grbl):
    guide.home()
    guide.move_to(0.1, 0.1)
    homing = Background(guide.home)
    wait_until(lambda: grbl.is_moving)
    grbl.raise_alarm(1)
    homing.ends_by(MotionFailedError, 'ALARM:1')
    assert guide.trouble
    lines = len(grbl.lines)
    guide.home()  # without a preceding move, because the position is unknown
    assert not any(line.startswith('G1') for line in grbl.lines[lines:])


def test_a_move_that_pauses_on_the_way_is_counted_and_a_steady_one_is_known(guide, grbl):
    guide.home()
    guide.move_to(0.051, 0.05)
    assert guide.last_move.mean_speed_m_s == pytest.approx(0.05, rel=0.2)
    assert guide.last_move.lag_s < 0.25
    guide.move_to(0.053, 0.05)
    assert guide.last_move is None, 'a move of 40 ms gives too few reports to judge it'
    late_moves = guide.late_moves  # on a busy computer, an earlier move may have paused
    move = Background(guide.move_to, 0.113, 0.1)
    wait_until(lambda: grbl.is_moving)
    grbl.pause_s = 0.5
    assert move.end() is None
    assert guide.late_moves == late_moves + 1
    assert guide.last_move.lag_s > 0.3


def test_grblhal_is_known_by_its_banner_and_may_step_faster(grbl):
    grbl.banner = b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
    grbl.build = (
        b'[VER:1.1f.20230919:]\r\n[OPT:%sNMSL,35,1024,3,0]\r\n[AXS:3:XYZ]\r\n'
        b'[NEWOPT:ENUMS,RT+,REBOOT]\r\n[FIRMWARE:grblHAL]\r\n[DRIVER:STM32F407]\r\nok\r\n'
    )
    grbl.settings[100] = '1600.000'
    grbl.settings[10] = '511'
    guide = LinearGuideClient(LinearGuideConfig(port=grbl.port))
    guide.connect()
    assert guide.identification == 'grblHAL 1.1f.20230919'
    guide.home()
    grbl.lines.clear()
    guide.move_to(0.011, 0.1)
    guide.close()
    # 35 blocks in the planner and 4 waiting lines contain 0.25 s of motion. Each piece therefore
    # lasts 6.4 ms, in which the guide moves by 0.64 mm, and 10 mm need 16 pieces.
    assert sum(line.startswith('G53') for line in grbl.lines) == 16
