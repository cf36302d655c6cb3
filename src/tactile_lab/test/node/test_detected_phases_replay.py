# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Replay through nodes that detect the phases in the tension."""

import dataclasses

from tactile_bags import TactileBag
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import compare, replay_through_core
from tactile_lab.replay_nodes import replay_through_nodes


def test_nodes_detect_the_same_phases_as_the_plain_core(stiffness_bag, context):
    with TactileBag(stiffness_bag) as bag:
        config = dataclasses.replace(recorded_features(bag).config, phases='stiffness')
        core = replay_through_core(bag, None, RecordedFeatures(config))
        nodes = replay_through_nodes(bag, None, config, context, expected=core)
    comparison = compare(core, nodes, ('core', 'nodes'))
    assert comparison.first_difference is None
    assert comparison.window_count == 15
