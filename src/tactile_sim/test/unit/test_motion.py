# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_sim.physics.motion import move_duration_s, plan_move, plan_ramp, Trajectory

quantity = st.floats(1e-3, 1e3)


def test_trapezoid_is_the_closed_form():
    motion = Trajectory(0.0, plan_ramp(1.0, 0.0, 30.0, 15.0, 500.0), 30.0)
    assert motion.end_s == pytest.approx(1.0 + 30 / 15 + 15 / 500)
    assert motion.state_at(1.015) == pytest.approx((500 * 0.015**2 / 2, 7.5))
    assert motion.state_at(2.0) == pytest.approx((15 * (1.0 - 0.015), 15.0))
    assert motion.state_at(99.0) == (30.0, 0.0)
    assert motion.state_at(0.5) == (0.0, 0.0)


def test_short_move_is_a_triangle():
    assert move_duration_s(-2.0, 100.0, 8.0) == pytest.approx(2 * math.sqrt(2.0 / 8.0))
    assert move_duration_s(0.0, 1.0, 1.0) == 0.0


@given(quantity, quantity, quantity, st.floats(-1.0, 1.0), st.booleans())
def test_any_move_ends_on_target_within_limits(distance, speed, acceleration, entry, back):
    target = -distance if back else distance
    velocity = entry * speed
    segments = plan_move(0.0, 0.0, velocity, target, speed, acceleration)
    scale = max(distance, speed**2 / acceleration)
    assert segments[-1].end_position == pytest.approx(target, abs=1e-9 * scale)
    previous = velocity
    for segment in segments:
        assert segment.velocity == pytest.approx(previous, abs=1e-6 * speed)
        assert abs(segment.acceleration) <= acceleration * (1 + 1e-12)
        previous = segment.velocity + segment.acceleration * segment.duration_s
        assert abs(previous) <= speed * (1 + 1e-9)
    assert previous == pytest.approx(0.0, abs=1e-6 * speed)


def test_many_times_at_once_equal_one_at_a_time():
    segments = plan_ramp(0.5, 0.0, 3.0, 1.0, 2.0) + plan_ramp(6.0, 3.0, -1.0, 2.0, 2.0)
    motion = Trajectory(0.0, segments, -1.0)
    times = np.linspace(-1.0, 12.0, 500)
    one_by_one = [motion.state_at(t)[0] for t in times]
    np.testing.assert_allclose(motion.positions_at(times), one_by_one, atol=1e-12)
