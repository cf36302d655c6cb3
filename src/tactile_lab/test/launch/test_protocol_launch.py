# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The launch file of each protocol, with a simulated rig: one trial and its classification."""

import unittest

import pytest

pytest.importorskip(
    'launch_testing.actions', reason='launch_testing comes with an ordinary ROS 2, not from PyPI'
)
import launch_testing
import launch_testing.asserts
import launch_testing.markers
from launched import Ear, launched, new_folder, trained_model

from tactile_bags import TactileBag
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_msgs.msg import Classification, TactileFeatures

OUTPUTS = (
    'tendon_sensor/strain',
    'linear_guide/joint_states',
    'tendon_actuator/joint_states',
    'trial_runner/events',
    'tactile_features/features',
)
OBJECTS = {'texture': 'R1', 'stiffness': 'sponge'}


@pytest.mark.launch_test
@launch_testing.markers.keep_alive
@launch_testing.parametrize('protocol', list(OBJECTS))
def generate_test_description(protocol):
    folder = new_folder()
    bag = folder / 'recording'
    description = launched(
        protocol,
        rig='simulated',
        object=OBJECTS[protocol],
        models=str(trained_model(folder, protocol)),
        record=str(bag),
        log_level='warn',
    )
    return description, {'bag': bag}


class TestTrial(unittest.TestCase):
    def test_trial_yields_features_and_a_classification(self, protocol):
        answers = 'tactile_classifier/classification'
        topics = {'tactile_features/features': TactileFeatures, answers: Classification}
        with Ear(topics, lambda context: [OperatorNode(context)]) as ear:
            ear.wait_for_publishers(*OUTPUTS, answers)
            (operator,) = ear.others
            operator.home_guide()
            operator.run_trial(TrialRequest(protocol, 'flexion', OBJECTS[protocol], 't1'))
            (window,) = ear.wait_for_messages('tactile_features/features')
            (answer,) = ear.wait_for_messages(answers)
        self.assertEqual(window.trial_id, 't1')
        self.assertEqual(window.outcome, TactileFeatures.OUTCOME_OK, window.reason)
        self.assertTrue(window.simulated)
        self.assertEqual(answer.trial_id, 't1')
        self.assertIn(OBJECTS[protocol], answer.labels)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    def test_every_process_exits_with_code_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)

    def test_the_trial_is_recorded(self, bag, protocol):
        with TactileBag(bag) as recording:
            counts = {name: count for name, (_, count) in recording.topics.items()}
        self.assertEqual(counts['/tactile_classifier/classification'], 1)
        self.assertGreater(counts['/tendon_sensor/strain'], 100)
