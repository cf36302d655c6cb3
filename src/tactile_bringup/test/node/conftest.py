# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures that the tests of trials share."""

from pathlib import Path
import sys

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from trial_bench import Bench


@pytest.fixture
def bench(context):
    with Bench(context) as bench:
        yield bench


@pytest.fixture
def bench_apart(context):
    """Return simulated devices and a trial runner in a separate process; see `Bench`."""
    with Bench(context, is_apart=True) as bench:
        yield bench
