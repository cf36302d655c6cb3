# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import subprocess
import sys

import pytest

import linear_guide_driver
from linear_guide_driver import LinearGuideConfig, TendonActuatorConfig


@pytest.mark.parametrize('config_class', [LinearGuideConfig, TendonActuatorConfig])
def test_every_parameter_is_described_and_its_default_allowed(config_class):
    for field in dataclasses.fields(config_class):
        assert field.metadata['description']
        if field.name.rpartition('_')[2] in ('m', 's', 'hz', 'n', 'a'):
            assert 'unit' in field.metadata, field.name
    config_class()


@pytest.mark.parametrize('value', [0.0, 20.1, float('nan')])
def test_values_out_of_range_are_refused_by_name(value):
    with pytest.raises(ValueError, match=r'poll_rate_hz is .*between'):
        LinearGuideConfig(poll_rate_hz=value)


def test_a_watchdog_shorter_than_three_polls_is_refused():
    with pytest.raises(ValueError, match='shorter than three polls'):
        TendonActuatorConfig(watchdog_s=0.2, poll_rate_hz=10.0)


def test_public_names_exist_and_importing_them_brings_no_ros():
    for name in linear_guide_driver.__all__:
        assert getattr(linear_guide_driver, name).__name__ == name
    code = (
        'import sys, linear_guide_driver as d; [getattr(d, n) for n in d.__all__]; '
        'sys.exit("rclpy" in sys.modules)'
    )
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
