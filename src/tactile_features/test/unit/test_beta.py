# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The incomplete beta function against its series in fifty digits."""

from decimal import Decimal, localcontext
import math

import pytest

from tactile_features.measures.beta import incomplete_beta

PI = Decimal('3.14159265358979323846264338327950288419716939937510582097494')


def gamma(doubled):
    """Gamma function of ``doubled / 2``."""
    value, at = (Decimal(1), 2) if doubled % 2 == 0 else (PI.sqrt(), 1)
    while at < doubled:
        value *= Decimal(at) / 2
        at += 2
    return value


def reference(doubled_a, doubled_b, x):
    """Sum the series, whose terms are all positive; the parameters are half integers."""
    with localcontext() as context:
        context.prec = 50
        a, b, x = Decimal(doubled_a) / 2, Decimal(doubled_b) / 2, Decimal(x)
        term = total = Decimal(1)
        n = 0
        while term > total * Decimal('1e-40'):
            term *= (a + b + n) / (a + 1 + n) * x
            total += term
            n += 1
        beta = gamma(doubled_a) * gamma(doubled_b) / gamma(doubled_a + doubled_b)
        return (x**a * (1 - x) ** b / (a * beta)) * total


@pytest.mark.parametrize('doubled_a', [1, 2, 7, 151, 712])
@pytest.mark.parametrize('doubled_b', [1, 3, 25])
@pytest.mark.parametrize('x', [1e-6, 0.3, 0.8, 0.98])
def test_agrees_with_the_series(doubled_a, doubled_b, x):
    expected = reference(doubled_a, doubled_b, x)
    got = incomplete_beta(doubled_a / 2, doubled_b / 2, x)
    if expected < Decimal('1e-290'):
        assert 0.0 <= got < 1e-289
    else:
        assert abs(Decimal(got) / expected - 1) < Decimal('1e-12')


def test_ends_and_symmetry():
    assert incomplete_beta(3.5, 2.5, 0.0) == 0.0
    assert incomplete_beta(3.5, 2.5, 1.0) == 1.0
    assert incomplete_beta(3.5, 2.5, 0.3) + incomplete_beta(2.5, 3.5, 0.7) == pytest.approx(1.0)
    assert math.isclose(incomplete_beta(1.0, 1.0, 0.25), 0.25)
