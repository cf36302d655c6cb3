# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

from tactile_bags import TactileBag
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import compare, replay_through_core
from tactile_bringup.nodes.replay_nodes import replay_through_nodes
from tactile_classifier import ModelSet


def test_bag_through_nodes_equals_bag_through_core(stiffness_bag, trained, context):
    with TactileBag(stiffness_bag) as bag:
        features = recorded_features(bag)
        core = replay_through_core(bag, ModelSet.load(trained), features)
        nodes = replay_through_nodes(bag, trained, features.config, context, expected=core)
    comparison = compare(core, nodes, ('the core', 'the nodes'))
    assert comparison.is_equal, comparison.first_difference
    assert comparison.window_count == comparison.classification_count == 15


def test_the_model_and_not_the_parameters_decides_on_the_windows(stiffness_bag, trained, context):
    with TactileBag(stiffness_bag) as bag:
        features = recorded_features(bag)
        core = replay_through_core(bag, ModelSet.load(trained), features)
        other = dataclasses.replace(features.config, stiffness_settle_s=1.0)
        nodes = replay_through_nodes(bag, trained, other, context, expected=core)
    comparison = compare(core, nodes, ('the core', 'the nodes'))
    assert comparison.is_equal, comparison.first_difference
