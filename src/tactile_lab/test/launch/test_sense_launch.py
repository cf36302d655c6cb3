# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A finger that another program moves, with phases from trial events or detected in the tension.

Here, the test moves the finger with the simulated rig, which the launched nodes do not know.
"""

import unittest

import pytest

pytest.importorskip(
    'launch_testing.actions', reason='launch_testing comes with an ordinary ROS 2, not from PyPI'
)
import launch_testing
import launch_testing.asserts
import launch_testing.markers
from launched import Ear, launched, new_folder, trained_model, until_end

from tactile_bringup.launch_config.graph import Ports, rig_graph
from tactile_bringup.nodes.graph_runner import running_graph
from tactile_bringup.nodes.operator_node import OperatorNode
from tactile_bringup.trial_protocols import TrialRequest
from tactile_msgs.msg import Classification, TactileFeatures
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.simulated_rigs import advance_rig

FEATURES = 'index/tactile_features/features'
ANSWERS = 'index/tactile_classifier/classification'
REST_S = 1.0


@pytest.mark.launch_test
@launch_testing.markers.keep_alive
@launch_testing.parametrize('phases', ['stated', 'stiffness'])
def generate_test_description(phases):
    rig = until_end(SimulatedRig(seed=3))
    rig.mount('stiffness', 'rubber_shell', 'flexion')
    description = launched(
        'sense',
        rig='simulated',
        sensor_port=rig.ports.sensor,
        models=str(trained_model(new_folder(), 'stiffness')),
        phases=phases,
        contact='flexion',
        namespace='index',
        log_level='warn',
    )
    return description, {'rig': rig}


class TestPress(unittest.TestCase):
    def test_press_yields_features_and_a_classification(self, rig, phases):
        topics = {FEATURES: TactileFeatures, ANSWERS: Classification}
        with Ear(topics) as ear:
            ear.wait_for_publishers('index/tendon_sensor/strain', *topics)
            motion = [
                node
                for node in rig_graph(
                    Ports(*rig.ports), None, {}, simulated=True, namespace='index'
                )
                if node.name in ('linear_guide', 'tendon_actuator', 'trial_runner')
            ]
            operator = OperatorNode(ear.context, namespace='index')
            with running_graph(motion, ear.context, others=[operator]):
                operator.home_guide()
                advance_rig(rig, REST_S)  # the detection first needs the tension at rest
                operator.run_trial(TrialRequest('stiffness', 'flexion', '', 'pressed'))
                window = ear.wait_for_messages(FEATURES)[-1]
                answer = ear.wait_for_messages(ANSWERS)[-1]
        self.assertEqual(window.outcome, TactileFeatures.OUTCOME_OK, window.reason)
        self.assertTrue(window.simulated)
        self.assertEqual(window.trial_id == 'pressed', phases == 'stated')
        self.assertLess(window.values[0], 0.0, 'the tension of a held object relaxes')
        self.assertEqual(answer.trial_id, window.trial_id)
        self.assertEqual(answer.outcome, Classification.OUTCOME_LABEL, answer.reason)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    def test_every_process_exits_with_code_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
