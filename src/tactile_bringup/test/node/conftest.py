# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lets the tests here share their bench."""

from pathlib import Path
import sys

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from trial_bench import Bench


@pytest.fixture
def bench(context):
    with Bench(context) as bench:
        yield bench
