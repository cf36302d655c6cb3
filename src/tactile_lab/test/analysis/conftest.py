# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixture for tests that train with random convolutions."""

import pytest

from tactile_classifier.estimators import random_convolutions


@pytest.fixture
def few_convolutions():
    """Fit 168 features of random convolutions instead of thousands, which take most of the time.

    Returns the patch; ``undo()`` ends it.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(random_convolutions, 'FEATURES', 168)
        yield patch
