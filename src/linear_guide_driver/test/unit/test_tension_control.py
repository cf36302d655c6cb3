# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from collections import deque

import pytest

from linear_guide_driver.dynamixel.tension_control import TensionController


def run(stiffness_n_m, stop_n, target_n, limit_n, delay_steps=6, seconds=30.0):
    """A finger behind a late sensor and servo, on a rigid stop from ``stop_n`` on."""
    controller = TensionController(target_n, limit_n, 0.01, 0.0, 0.05)
    goals = deque([0.0] * delay_steps)
    tensions = []
    for _ in range(int(seconds * 60)):
        displacement_m = goals.popleft()
        beyond_m = max(0.0, displacement_m - stop_n / stiffness_n_m)
        tensions.append(stiffness_n_m * (displacement_m - beyond_m) + 2000.0 * limit_n * beyond_m)
        goals.append(controller.step(displacement_m, tensions[-1], 1 / 60))
    return controller, tensions


@pytest.mark.parametrize(
    ('stiffness_n_m', 'stop_n', 'target_n', 'limit_n'),
    [
        (1.5e3, 100.0, 12.0, 15.0),
        (1.5e3, 10.0, 12.0, 15.0),
        (5e3, 100.0, 12.0, 15.0),
        (200.0, 100.0, 2.0, 3.0),
        (200.0, 1.6, 2.0, 3.0),
    ],
)
def test_a_target_is_reached_and_kept_without_passing_the_limit(
    stiffness_n_m, stop_n, target_n, limit_n
):
    controller, tensions = run(stiffness_n_m, stop_n, target_n, limit_n)
    assert controller.is_near
    assert max(tensions) < limit_n
    assert all(abs(n - target_n) <= 0.011 * limit_n for n in tensions[-60:])


def test_a_lower_target_lets_the_tendon_out():
    controller = TensionController(2.0, 15.0, 0.01, 0.005, 0.02)
    assert controller.step(0.005, 12.0, 1 / 60) == pytest.approx(0.005 - 0.006 * 10 / 15 / 60)


def test_speed_and_reach_are_bounded_and_nothing_winds_up():
    controller = TensionController(12.0, 15.0, 0.001, 0.0, 0.003)
    assert controller.step(0.0, 0.0, 0.1) == pytest.approx(0.0001)
    for _ in range(1000):  # the tendon does not follow
        goal_m = controller.step(0.0, 0.0, 0.1)
    assert goal_m == pytest.approx(0.0001)
    assert not controller.is_at_end
    controller.step(0.003, 0.0, 0.1)
    for _ in range(100):
        goal_m = controller.step(0.003, 0.0, 0.1)
    assert goal_m == 0.003
    assert controller.is_at_end


def test_a_long_pause_is_no_long_step():
    controller = TensionController(12.0, 15.0, 0.01, 0.0, 0.02)
    assert controller.step(0.0, 0.0, 60.0) == pytest.approx(0.0048 * 0.1)


def test_one_sample_near_the_target_is_chance():
    controller = TensionController(5.0, 15.0, 0.01, 0.0, 0.02)
    for tension_n, is_near in ((5.3, False), (4.8, False), (6.0, False), (5.0, False)):
        controller.step(0.01, tension_n, 0.01)
        assert controller.is_near is is_near
    controller.step(0.01, 5.0, 0.01)
    controller.step(0.01, 5.0, 0.01)
    assert controller.is_near
