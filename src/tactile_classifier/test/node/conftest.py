# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import sys

import pytest

# What several test files share lies beside them and is no part of the package.
sys.path.insert(0, str(Path(__file__).parent))

from finger_nodes import Finger


@pytest.fixture
def make_finger(context, model_path):
    """Return a maker of fingers; ``features`` are the parameters of the feature node, if any."""
    fingers = []

    def make(features=None, **parameters):
        fingers.append(Finger(context, {'models': str(model_path), **parameters}, features))
        return fingers[-1]

    yield make
    for finger in fingers:
        finger.close()
