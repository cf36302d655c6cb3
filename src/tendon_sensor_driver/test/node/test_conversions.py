# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import re

import numpy as np
import pytest

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver import SensorHealth, TendonSensorConfig
from tendon_sensor_driver.config import AXES
from tendon_sensor_driver.conversions import (
    assess_health,
    LEVEL_ERROR,
    LEVEL_OK,
    LEVEL_WARN,
    to_strain_msg,
    to_tare_msg,
    to_values,
    to_wrench_msg,
    turn_wrench,
)
from tendon_sensor_driver.tare import TareValue

BLOCK = StrainBlock(
    stamp_ns=1_700_000_000_123_456_789,
    sequence=2**40,
    period_ns=16_666_667,
    tension_n=np.array([1.5, -0.1, 3.25]),
    lost_before=7,
    stamp_error_s=0.002,
    status=StrainStatus.RECONNECTED | StrainStatus.SATURATED,
)
CONFIG = TendonSensorConfig()
SECOND_NS = 1_000_000_000
HEALTHY = SensorHealth(True, 5 * SECOND_NS, bytes=900, lines=40, readings=38, rejected_lines=2)


def test_a_block_becomes_a_message():
    message = to_strain_msg(BLOCK, 'left_link')
    assert message.header.frame_id == 'left_link'
    stamp = message.header.stamp
    assert stamp.sec * SECOND_NS + stamp.nanosec == BLOCK.stamp_ns
    assert list(message.tension_n) == BLOCK.tension_n.tolist()
    for name in ('sequence', 'period_ns', 'lost_before', 'stamp_error_s', 'status'):
        assert getattr(message, name) == getattr(BLOCK, name), name


def test_the_wrench_is_the_last_sample_along_x():
    message = to_wrench_msg(BLOCK, 'left_link')
    assert message.header.frame_id == 'left_link'
    stamp_ns = message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec
    assert stamp_ns == BLOCK.stamp_ns + 2 * BLOCK.period_ns
    force, torque = message.wrench.force, message.wrench.torque
    assert (force.x, force.y, force.z) == (3.25, 0.0, 0.0)
    assert (torque.x, torque.y, torque.z) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('axis', 'scale', 'expected'),
    [
        ('fx', 1.0, [1, 2, 3, 4, 5, 6]),
        ('fy', 1.0, [2, 3, 1, 5, 6, 4]),
        ('fz', 1.0, [3, 1, 2, 6, 4, 5]),
        ('fz', -1.0, [-3, 1, -2, -6, 4, -5]),
    ],
)
def test_a_wrench_of_six_axes_is_turned_into_the_frame(axis, scale, expected):
    wrench = np.array([[0.0] * 6, [1.0, 2, 3, 4, 5, 6]])
    tension_n = scale * wrench[:, AXES.index(axis)]
    block = dataclasses.replace(BLOCK, tension_n=tension_n, wrench=wrench)
    message = to_wrench_msg(block, 'left_link', axis, scale)
    force, torque = message.wrench.force, message.wrench.torque
    assert [force.x, force.y, force.z, torque.x, torque.y, torque.z] == expected
    assert force.x == tension_n[-1]
    frame = [turn_wrench(np.append(unit, np.zeros(3)), axis, scale)[:3] for unit in np.eye(3)]
    assert np.linalg.det(frame) == pytest.approx(1.0)  # the frame is right-handed


def test_a_tare_becomes_a_message():
    message = to_tare_msg(TareValue(1_500_000_000, 0.25, 0.01, 60), 'left_link')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    assert (message.is_set, message.bias_n, message.spread_n) == (True, 0.25, 0.01)
    assert (message.samples, message.header.frame_id) == (60, 'left_link')
    assert not to_tare_msg(TareValue(5), '').is_set


def assess(now_s=5.5, before=HEALTHY, **changes):
    now_ns = round(now_s * SECOND_NS)
    return assess_health(dataclasses.replace(HEALTHY, **changes), before, CONFIG, now_ns)


def test_silence_is_a_warning_and_says_what_arrives_instead():
    assert assess(now_s=5.4)[0] == LEVEL_OK
    level, sentence = assess(now_s=6.1)
    assert level == LEVEL_WARN
    assert '1.1 s' in sentence
    _, sentence = assess(now_s=6.1, rejected_lines=9, last_rejected='12,0.5,lbs,')
    assert re.search('12,0.5,lbs,.*unit', sentence)
    assert 'baud' in assess(now_s=6.1, bytes=2000)[1]
    health = dataclasses.replace(HEALTHY, bytes=10**6, rejected_lines=5)
    config = TendonSensorConfig(sensor='net_ft')  # its counters mean no lines
    _, sentence = assess_health(health, HEALTHY, config, 7 * SECOND_NS)
    assert '2.0 s' in sentence
    assert 'baud' not in sentence


@pytest.mark.parametrize(
    ('changes', 'level', 'words'),
    [
        ({}, LEVEL_OK, ''),
        ({'is_connected': False, 'last_error': 'lost /dev/x'}, LEVEL_ERROR, 'lost /dev/x'),
        ({'status': StrainStatus.SATURATED}, LEVEL_ERROR, 'saturated'),
        ({'status': StrainStatus.STUCK}, LEVEL_WARN, 'stuck'),
        ({'status': StrainStatus.DEVICE_ERROR}, LEVEL_ERROR, ''),
        ({'device_status': 'gauge broken'}, LEVEL_ERROR, 'gauge broken'),
        ({'restarts': 1}, LEVEL_WARN, 'tare'),
        ({'reconnects': 1}, LEVEL_WARN, ''),
        ({'rejected_lines': 5, 'last_rejected': 'zz'}, LEVEL_WARN, '3 .*zz'),
        ({'duplicates': 2, 'lost_samples': 1}, LEVEL_WARN, '1 .*2 '),
    ],
)
def test_every_state_has_its_sentence(changes, level, words):
    got, sentence = assess(**changes)
    assert got == level
    assert re.search(words, sentence)


@pytest.mark.parametrize('counter', ['lost_samples', 'late_samples', 'outliers', 'rejected_lines'])
def test_what_was_counted_before_is_no_news(counter):
    before = dataclasses.replace(HEALTHY, **{counter: 3})
    assert assess(before=before, **{counter: 3})[0] == LEVEL_OK
    assert assess(before=before, **{counter: 4})[0] == LEVEL_WARN


def test_every_counter_is_a_value_of_the_diagnostics_and_status_bits_are_words():
    values = to_values(dataclasses.replace(HEALTHY, status=BLOCK.status))
    assert set(values) == {field.name for field in dataclasses.fields(SensorHealth)}
    assert values['status'] == 'saturated, reconnected'
    assert to_values(HEALTHY)['status'] == 'ok'


def test_status_bits_are_those_of_the_message():
    from tactile_msgs.msg import StrainBlock as StrainBlockMsg

    names = [name for name in dir(type(StrainBlockMsg)) if name.startswith('STATUS_')]
    constants = {name.removeprefix('STATUS_'): getattr(StrainBlockMsg, name) for name in names}
    assert constants == {name: int(bit) for name, bit in StrainStatus.__members__.items()}
    assert len(constants) == 10
