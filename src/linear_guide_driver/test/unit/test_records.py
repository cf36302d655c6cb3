# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses
import subprocess
import sys

import pytest

import linear_guide_driver
from linear_guide_driver import LinearGuideConfig, TendonActuatorConfig


@pytest.mark.parametrize('config_class', [LinearGuideConfig, TendonActuatorConfig])
def test_parameters_with_a_unit_in_their_name_state_it(config_class):
    for field in dataclasses.fields(config_class):
        if field.name.rpartition('_')[2] in ('m', 's', 'hz', 'n', 'a'):
            assert 'unit' in field.metadata, field.name


@pytest.mark.parametrize(
    ('config_class', 'values', 'text'),
    [
        (LinearGuideConfig, {'poll_rate_hz': 20.1}, r'poll_rate_hz is .*between'),
        (LinearGuideConfig, {'poll_rate_hz': float('nan')}, r'poll_rate_hz is .*between'),
        (TendonActuatorConfig, {'poll_rate_hz': 10.0}, 'shorter than three polls'),
        (TendonActuatorConfig, {'hang_timeout_s': 0.4}, 'which a busy computer may exceed'),
    ],
)
def test_values_that_cannot_be_are_refused_by_name(config_class, values, text):
    with pytest.raises(ValueError, match=text):
        config_class(**values)


def test_public_names_exist_and_importing_them_brings_no_ros():
    for name in linear_guide_driver.__all__:
        assert getattr(linear_guide_driver, name).__name__ == name
    code = (
        'import sys, linear_guide_driver as d; [getattr(d, n) for n in d.__all__]; '
        'sys.exit("rclpy" in sys.modules)'
    )
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
