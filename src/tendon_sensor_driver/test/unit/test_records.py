# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import pytest

from tendon_sensor_driver import make_sensor, TendonSensorConfig, TendonSensorError


@pytest.mark.parametrize(
    ('wrong', 'named'),
    [
        ({'rate_hz': 0.0}, 'rate_hz'),
        ({'rate_hz': float('nan')}, 'rate_hz'),
        ({'scale': float('inf')}, 'scale'),
        ({'scale': 0.0}, 'scale'),
        ({'samples_per_block': 1001}, 'samples_per_block'),
        ({'value_column': -1}, 'value_column'),
        ({'unit': 'stone'}, 'unit'),
        ({'time_column': 1}, 'time_column'),
        ({'port': ''}, 'port'),
        ({'time_unit_s': 0.0}, 'time_unit_s'),
        ({'rate_hz': 1000.0}, '1000 Hz'),
        ({'time_unit_s': 1.0, 'time_decimals': 1}, 'micros'),
        ({'sensor': 'laser'}, 'sensor'),
        ({'sensor': 'net_ft', 'host': ''}, 'host'),
        ({'axis': 'fw'}, 'axis'),
        ({'low_pass_hz': 17}, 'low_pass_hz'),
        ({'tare_samples': 1}, 'tare_samples'),
        ({'sensor': 'topic'}, 'topic'),
        ({'sensor': 'topic', 'topic': '/f', 'rate_hz': 0.05}, 'rate_hz'),
        ({'sensor': 'net_ft', 'rate_hz': 0.0}, 'rate_hz is 0'),
        ({'sensor': 'net_ft', 'axis': 'norm'}, 'axis is norm'),
        ({'sensor': 'topic', 'topic': '/f', 'topic_stamps': 'wall'}, 'topic_stamps'),
    ],
)
def test_a_wrong_value_is_refused_by_name(wrong, named):
    with pytest.raises(ValueError, match=named):
        TendonSensorConfig(**wrong)


def test_what_a_sensor_does_not_have_is_not_looked_at():
    TendonSensorConfig(sensor='net_ft', port='', rate_hz=7000.0, value_column=0)
    TendonSensorConfig(host='')
    TendonSensorConfig(rate_hz=1000.0, time_unit_s=1e-6)
    TendonSensorConfig(rate_hz=1000.0, time_column=-1)


@pytest.mark.parametrize(
    ('rate_hz', 'stated', 'expected'),
    [(60.0, 0, 1), (100.0, 0, 1), (101.0, 0, 2), (1000.0, 0, 10), (7000.0, 0, 70), (7000.0, 3, 3)],
)
def test_a_hundred_blocks_a_second_are_the_most_by_default(rate_hz, stated, expected):
    config = TendonSensorConfig(
        sensor='net_ft', host='h', axis='fz', rate_hz=rate_hz, samples_per_block=stated
    )
    assert config.block_samples == expected


def test_without_a_node_there_is_no_topic():
    with pytest.raises(TendonSensorError, match='tendon_sensor_node'):
        make_sensor(TendonSensorConfig(sensor='topic', topic='/f'), print, lambda: 0)
