# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The incomplete beta function against that of SciPy, which the nodes do without."""

import pytest
from scipy.special import betainc

from tactile_features.measures import incomplete_beta


@pytest.mark.parametrize('a', [0.5, 1.0, 3.5, 75.5, 356.0])
@pytest.mark.parametrize('b', [0.5, 1.5, 12.5])
@pytest.mark.parametrize('x', [0.0, 1e-6, 0.3, 0.8, 0.98, 1.0])
def test_agrees_with_scipy(a, b, x):
    assert incomplete_beta(a, b, x) == pytest.approx(betainc(a, b, x), rel=1e-12, abs=1e-290)
