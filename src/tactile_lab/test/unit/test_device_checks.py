# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The checks of `tactile check` on the strain blocks that a sensor node publishes."""

import numpy as np
import pytest

from tactile_lab.devices.checks import judge_blocks
from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.config import TendonSensorConfig

PERIOD_NS = 16_666_667
CONFIG = TendonSensorConfig()


def block(index, tension_n, lost_before=0, status=StrainStatus.OK, stamp_error_s=0.001):
    return StrainBlock(
        stamp_ns=10**18 + index * PERIOD_NS,
        sequence=index,
        period_ns=PERIOD_NS,
        tension_n=np.atleast_1d(np.asarray(tension_n, float)),
        lost_before=lost_before,
        stamp_error_s=stamp_error_s,
        status=status,
    )


def texts(problems):
    return ' '.join(problem.what for problem in problems)


def test_faultless_sensor_has_facts_and_no_problems():
    generator = np.random.default_rng(1)
    # A drift of 0.1 N/s must not count as noise.
    values = 2.0 + 0.1 * np.arange(300) / 60 + 0.02 * generator.standard_normal(300)
    facts, problems = judge_blocks([block(i, value) for i, value in enumerate(values)], CONFIG)
    assert problems == []
    assert facts['samples'] == 300
    assert facts['rate [Hz]'] == pytest.approx(60.0, abs=1e-3)
    assert facts['lost samples'] == 0
    assert facts['tension [N]'] == pytest.approx(2.25, abs=0.01)
    assert facts['noise, standard deviation [N]'] == pytest.approx(0.02, rel=0.1)
    assert facts['error of the stamps [s]'] == 0.001


def test_samples_are_counted_in_blocks_of_any_size():
    blocks = [block(10 * i, np.linspace(0, 1, 10)) for i in range(6)]
    facts, _ = judge_blocks(blocks, CONFIG)
    assert facts['samples'] == 60
    assert facts['rate [Hz]'] == pytest.approx(60.0, abs=1e-3)
    assert judge_blocks([], CONFIG) == ({'samples': 0}, [])
    assert judge_blocks([block(0, 1.0)], CONFIG)[0]['rate [Hz]'] == 0.0


def test_lost_samples_are_reported_and_do_not_change_the_rate():
    indices = [i for i in range(120) if i not in (50, 51, 52)]
    blocks = [block(i, i % 7, lost_before=3 * (i == 53)) for i in indices]
    facts, problems = judge_blocks(blocks, CONFIG)
    assert facts['lost samples'] == 3
    assert facts['rate [Hz]'] == pytest.approx(60.0, abs=1e-3)
    assert texts(problems) == '3 of 120 samples were lost'
    # Samples lost before the start of the check are ignored.
    facts, problems = judge_blocks([block(i, i % 7, 99 * (i == 0)) for i in range(60)], CONFIG)
    assert facts['lost samples'] == 0
    assert problems == []


@pytest.mark.parametrize(
    ('changes', 'what'),
    [
        ({'status': StrainStatus.SATURATED}, 'saturates'),
        ({'status': StrainStatus.STUCK}, 'does not change'),
        ({'stamp_error_s': 0.02}, 'wrong by 20.0 ms'),
    ],
)
def test_each_fault_in_the_blocks_is_reported(changes, what):
    _, problems = judge_blocks([block(i, i % 7, **changes) for i in range(60)], CONFIG)
    assert what in texts(problems)
    assert all(problem.remedy for problem in problems)


def test_constant_zero_is_reported():
    _, problems = judge_blocks([block(i, 0.0) for i in range(33)], CONFIG)
    assert texts(problems) == 'all 33 samples are exactly 0 N'
    assert judge_blocks([block(i, 0.1 * (i == 7)) for i in range(33)], CONFIG)[1] == []


def test_deviation_from_the_configured_rate_is_reported():
    config = TendonSensorConfig(rate_hz=80.0)
    _, problems = judge_blocks([block(i, i % 7) for i in range(60)], config)
    assert texts(problems) == 'the rate is 60.00 Hz, but rate_hz is 80'


def test_sensor_without_a_clock_has_no_stamp_error():
    blocks = [block(i, i % 7, 0, StrainStatus.HOST_TIME, -1.0) for i in range(60)]
    facts, problems = judge_blocks(blocks, CONFIG)
    assert facts['error of the stamps [s]'] == 'not known (host time)'
    assert problems == []
