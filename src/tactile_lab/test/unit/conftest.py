# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the tests of launch plans share."""

import pytest

from tactile_bringup.launch_config.launch_plans import plan_launch


@pytest.fixture
def launch(tmp_path):
    """Return what gives the plan of a launch file, and its nodes by path."""

    def plan(name, **arguments):
        made = plan_launch(name, {key: str(value) for key, value in arguments.items()}, tmp_path)
        return made, {node.path: node for node in made.nodes}

    return plan
