# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the phases are found in the tension, nodes and core find the same ones."""

import dataclasses

from tactile_bringup.bags import TactileBag
from tactile_bringup.replay import compare, recorded_config, replay_through_core
from tactile_bringup.replay_nodes import replay_through_nodes


def test_nodes_find_the_phases_that_the_core_finds(stiffness_bag, context):
    with TactileBag(stiffness_bag) as bag:
        config = dataclasses.replace(recorded_config(bag), phases='stiffness')
        core = replay_through_core(bag, {}, config)
        nodes = replay_through_nodes(bag, {}, config, context, expected=core)
    comparison = compare(core, nodes, ('core', 'nodes'))
    assert comparison.first_difference == ''
    assert comparison.window_count == 15
