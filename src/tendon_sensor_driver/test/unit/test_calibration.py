# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from fractions import Fraction
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tendon_sensor_driver import Calibration

EXACT_NEWTONS = {
    'kg': Fraction('9.80665'),
    'g': Fraction('0.00980665'),
    'N': Fraction(1),
    'lbf': Fraction('0.45359237') * Fraction('9.80665'),
}


@pytest.mark.parametrize('unit', EXACT_NEWTONS)
@given(
    value=st.floats(-1e15, 1e15, allow_subnormal=False),
    scale=st.sampled_from([1.0, -1.0, 0.1, -419.7, 1e-7]),
)
def test_newtons_are_right_to_three_roundings(unit, value, scale):
    newtons = Calibration(unit, scale).to_newtons(value)
    exact = Fraction(value) * Fraction(scale) * EXACT_NEWTONS[unit]
    # One rounding each: the unit's factor, its product with scale, the product with value.
    bound = max(abs(exact) * 3 * Fraction(2) ** -53, Fraction(5e-324))
    assert abs(Fraction(newtons) - exact) <= bound


def test_one_kilogram_weighs_standard_gravity():
    assert Calibration('kg').to_newtons(1.0) == 9.80665
    assert math.isclose(Calibration('lbf', -1.0).to_newtons(1.0), -4.4482216152605)


def test_a_numpy_free_float_comes_out():
    assert type(Calibration('g').to_newtons(float(np.float32(2.5)))) is float


@pytest.mark.parametrize(('value', 'scale', 'offset_n'), [(0.51, 1.02, -0.3), (-2.0, -0.5, 1e-9)])
def test_an_offset_is_added_to_the_product(value, scale, offset_n):
    exact = Fraction(value) * Fraction(9.80665) * Fraction(scale) + Fraction(offset_n)
    found = Calibration('kg', scale, offset_n).to_newtons(value)
    assert found == pytest.approx(float(exact), rel=1e-15)
