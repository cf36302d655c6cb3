# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import pytest

from linear_guide_driver.errors import DeviceRefusedError
from linear_guide_driver.grbl.protocol import GuideSettings

LINES = {
    13: '0', 20: '1', 22: '1', 24: '60.000', 25: '600.000', 27: '1.000', 100: '250.000',
    110: '6000.000', 120: '500.000', 130: '200.000',
}  # fmt: skip


def test_durations_by_hand():
    settings = GuideSettings.from_lines(LINES)
    # 30 mm at 15 mm/s and 500 mm/s^2: 2 s and 30 ms to start and stop.
    assert settings.compute_move_duration_s(-0.03, 0.015) == pytest.approx(2.03)
    # 300 mm at 10 mm/s, 10 mm at 1 mm/s, 20 ms.
    assert settings.compute_homing_timeout_s() == pytest.approx(40.02)


@pytest.mark.parametrize('value', ['nan', 'inf', '-1', '0', 'x'])
def test_a_setting_that_cannot_be_is_refused(value):
    with pytest.raises(DeviceRefusedError, match=r'\$120'):
        GuideSettings.from_lines({**LINES, 120: value})


def test_a_missing_setting_is_named():
    with pytest.raises(DeviceRefusedError, match=r'\$130 is missing'):
        GuideSettings.from_lines({n: v for n, v in LINES.items() if n != 130})


def test_grblhal_homing_mask():
    assert GuideSettings.from_lines({**LINES, 22: '5'}).has_homing
    assert not GuideSettings.from_lines({**LINES, 22: '4'}).has_homing
