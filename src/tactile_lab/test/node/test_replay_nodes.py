# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import dataclasses

import pytest

from tactile_bags import TactileBag
from tactile_bags.replaying.comparison import compare
from tactile_bags.replaying.replay import (
    load_models,
    recorded_config,
    replay_through_core,
)
from tactile_bringup.launch_config.model_folder import find_models
from tactile_bringup.nodes.replay_nodes import replay_through_nodes
from tactile_ros.errors import TactileError


def test_bag_through_nodes_equals_bag_through_core(stiffness_bag, trained, context):
    models = find_models(trained)
    with TactileBag(stiffness_bag) as bag:
        config = recorded_config(bag)
        core = replay_through_core(bag, load_models(models), config)
        nodes = replay_through_nodes(bag, models, config, context, expected=core)
    comparison = compare(core, nodes, ('the core', 'the nodes'))
    assert comparison.is_equal, comparison.first_difference
    assert comparison.window_count == comparison.classification_count == 15


def test_model_that_does_not_fit_stops_the_replay(stiffness_bag, trained, context):
    with TactileBag(stiffness_bag) as bag:
        config = dataclasses.replace(recorded_config(bag), stiffness_settle_s=1.0)
        core = replay_through_core(bag, {}, config)
        with pytest.raises(TactileError, match='could not be started'):
            replay_through_nodes(bag, find_models(trained), config, context, expected=core)
