# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import dataclasses
import types

import numpy as np

from tendon_sensor_driver import Block, Health, StrainStatus, TendonSensorConfig
from tendon_sensor_driver.conversions import (
    LEVEL_ERROR,
    LEVEL_OK,
    LEVEL_WARN,
    assess_health,
    from_strain_msg,
    to_strain_msg,
    to_values,
    to_wrench_msg,
)

BLOCK = Block(
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


def assert_same(block, other):
    for field in dataclasses.fields(Block):
        assert np.array_equal(getattr(block, field.name), getattr(other, field.name))


def test_a_block_survives_the_message():
    message = to_strain_msg(BLOCK, 'left_link')
    assert message.header.frame_id == 'left_link'
    assert_same(from_strain_msg(message), BLOCK)


def test_a_message_of_other_classes_with_the_same_fields_will_do():
    message = to_strain_msg(BLOCK, '')
    fields = {name: getattr(message, name) for name in message.get_fields_and_field_types()}
    fields['tension_n'] = np.array(message.tension_n)
    assert_same(from_strain_msg(types.SimpleNamespace(**fields)), BLOCK)


def test_the_wrench_is_the_last_sample_along_x():
    message = to_wrench_msg(BLOCK, 'left_link')
    assert message.header.frame_id == 'left_link'
    stamp_ns = message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec
    assert stamp_ns == BLOCK.stamp_ns + 2 * BLOCK.period_ns
    force, torque = message.wrench.force, message.wrench.torque
    assert (force.x, force.y, force.z) == (3.25, 0.0, 0.0)
    assert (torque.x, torque.y, torque.z) == (0.0, 0.0, 0.0)


def assess(now_s=5.5, before=HEALTHY, **changes):
    now_ns = round(now_s * SECOND_NS)
    return assess_health(dataclasses.replace(HEALTHY, **changes), before, CONFIG, now_ns)


def test_a_link_with_samples_is_ok():
    assert assess()[0] == LEVEL_OK


def test_a_link_that_is_down_is_an_error_with_its_reason():
    level, sentence = assess(is_connected=False, last_error='lost serial port /dev/x')
    assert level == LEVEL_ERROR
    assert '/dev/x' in sentence


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


def test_every_counter_is_a_value_of_the_diagnostics():
    assert set(to_values(HEALTHY)) == {field.name for field in dataclasses.fields(Health)}
