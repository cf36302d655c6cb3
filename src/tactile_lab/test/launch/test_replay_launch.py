# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Replay of a recording through launched nodes, with simulated time."""

import unittest

import pytest

pytest.importorskip(
    'launch_testing.actions', reason='launch_testing comes with an ordinary ROS 2, not from PyPI'
)
import launch_testing
import launch_testing.asserts
from launched import DEADLINE_S, Ear, launched, new_folder, simulated_bag, trained_model

from tactile_bags import TactileBag
from tactile_bags.recorded_setup import recorded_features
from tactile_bags.replay import replay_through_core
from tactile_classifier import ModelSet
from tactile_classifier.conversions import classification_from_msg
from tactile_msgs.msg import Classification

ANSWERS = 'tactile_classifier/classification'


@pytest.mark.launch_test
def generate_test_description():
    folder = new_folder()
    model = trained_model(folder, 'stiffness')
    bag = simulated_bag(folder / 'played', 'stiffness')
    with TactileBag(bag) as recording:
        core = replay_through_core(recording, ModelSet.load(model), recorded_features(recording))
    description = launched('replay', bag=str(bag), models=str(model), rate='8', log_level='warn')
    return description, {'expected': core.classifications}


class TestReplay(unittest.TestCase):
    def test_results_equal_those_of_the_plain_core_and_the_launch_ends(self, expected, proc_info):
        with Ear({ANSWERS: Classification}) as ear:
            messages = ear.wait_for_messages(ANSWERS, len(expected))
            answers = [classification_from_msg(message) for message in messages]
        self.assertEqual(answers, expected)
        proc_info.assertWaitForShutdown(process='bag_player_node', timeout=DEADLINE_S)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    def test_every_process_exits_with_code_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
