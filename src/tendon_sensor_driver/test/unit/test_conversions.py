# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import re

import numpy as np
import pytest

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver import Health, TendonSensorConfig
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
from tendon_sensor_driver.records import AXES
from tendon_sensor_driver.tare import Bias

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
HEALTHY = Health(True, 5 * SECOND_NS, bytes=900, lines=40, readings=38, rejected_lines=2)


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


@pytest.mark.parametrize('axis', ['fx', 'fy', 'fz'])
@pytest.mark.parametrize('scale', [1.0, -1.0])
def test_the_frame_of_the_wrench_stays_right_handed(axis, scale):
    turned = [
        turn_wrench(np.concatenate([unit, np.zeros(3)]), axis, scale)[:3] for unit in np.eye(3)
    ]
    assert np.linalg.det(turned) == pytest.approx(1.0)


def test_a_tare_becomes_a_message():
    message = to_tare_msg(Bias(1_500_000_000, 0.25, 0.01, 60), 'left_link')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    assert (message.is_set, message.bias_n, message.spread_n) == (True, 0.25, 0.01)
    assert (message.samples, message.header.frame_id) == (60, 'left_link')
    assert not to_tare_msg(Bias(5), '').is_set


def assess(now_s=5.5, before=HEALTHY, **changes):
    now_ns = round(now_s * SECOND_NS)
    return assess_health(dataclasses.replace(HEALTHY, **changes), before, CONFIG, now_ns)


def test_silence_is_a_warning_and_says_what_arrives_instead():
    assert assess(now_s=5.4)[0] == LEVEL_OK
    assert assess(now_s=6.1) == (LEVEL_WARN, 'no reading for 1.1 s')
    _, sentence = assess(now_s=6.1, rejected_lines=9, last_rejected='12,0.5,lbs,')
    assert '12,0.5,lbs,' in sentence
    assert 'unit' in sentence
    _, sentence = assess(now_s=6.1, bytes=2000)
    assert 'baud' in sentence


def test_new_losses_are_a_warning_and_old_ones_are_not():
    for counter in ('lost_samples', 'late_samples', 'outliers'):
        assert assess(**{counter: 3})[0] == LEVEL_WARN
        before = dataclasses.replace(HEALTHY, **{counter: 3})
        assert assess(before=before, **{counter: 3})[0] == LEVEL_OK


@pytest.mark.parametrize(
    ('changes', 'level', 'words'),
    [
        ({}, LEVEL_OK, 'samples arrive'),
        ({'is_connected': False, 'last_error': 'lost /dev/x'}, LEVEL_ERROR, 'down.*lost /dev/x'),
        ({'status': StrainStatus.SATURATED}, LEVEL_ERROR, 'saturated'),
        ({'status': StrainStatus.STUCK}, LEVEL_WARN, 'stuck'),
        ({'status': StrainStatus.DEVICE_ERROR}, LEVEL_ERROR, 'device reports'),
        ({'device_status': 'gauge broken'}, LEVEL_ERROR, 'gauge broken'),
        ({'restarts': 1}, LEVEL_WARN, 'restarted'),
        ({'reconnects': 1}, LEVEL_WARN, 'is back'),
        ({'rejected_lines': 5, 'last_rejected': 'zz'}, LEVEL_WARN, '3 lines .* "zz"'),
        ({'duplicates': 2, 'lost_samples': 1}, LEVEL_WARN, '1 samples lost and 2 without'),
    ],
)
def test_every_state_has_its_sentence(changes, level, words):
    got, sentence = assess(**changes)
    assert got == level
    assert re.search(words, sentence)


def test_a_silent_six_axis_sensor_is_not_told_about_lines():
    config = TendonSensorConfig(sensor='net_ft')
    health = dataclasses.replace(HEALTHY, bytes=10**6, rejected_lines=5)
    _, sentence = assess_health(health, HEALTHY, config, 7 * SECOND_NS)
    assert sentence == 'no reading for 2.0 s'


def test_status_bits_are_told_in_words():
    assert StrainStatus.OK.describe() == 'ok'
    assert (StrainStatus.STUCK | StrainStatus.SATURATED).describe() == 'saturated, stuck'


def test_every_counter_is_a_value_of_the_diagnostics():
    assert set(to_values(HEALTHY)) == {field.name for field in dataclasses.fields(Health)}
