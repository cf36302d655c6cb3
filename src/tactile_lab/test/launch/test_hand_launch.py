# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two fingers in one process, each on a simulated sensor that the launch file starts."""

import os
import signal
import unittest

import pytest

from tactile_testing.waiting import wait_until

pytest.importorskip(
    'launch_testing.actions', reason='launch_testing comes with an ordinary ROS 2, not from PyPI'
)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import launch_testing
import launch_testing.asserts
import launch_testing.markers
from launched import Ear, launched, new_folder, trained_model
from rclpy.time import Time

from tactile_msgs.msg import Classification, StrainBlock, TrialEvent
from tactile_ros.qos import EVENTS

FINGERS = ('index', 'middle')
HAND = """
/**/index/tendon_sensor: {ros__parameters: {scale: 1.0}}
/**/middle/tendon_sensor: {ros__parameters: {scale: -1.0}}
"""
ANSWERS = 'tactile_classifier/classification'
HOLD_NS = 3_000_000_000


@pytest.mark.launch_test
@launch_testing.markers.keep_alive
def generate_test_description():
    folder = new_folder()
    params_file = folder / 'hand.yaml'
    params_file.write_text(HAND)
    return launched(
        'hand',
        rig='simulated',
        params_file=str(params_file),
        models=str(trained_model(folder, 'stiffness')),
        namespace='left',
        log_level='warn',
    )


class TestHold(unittest.TestCase):
    def test_each_finger_is_classified_separately_also_after_the_hand_was_killed(self, proc_info):
        for lives in (1, 2):
            self.let_each_finger_answer(f'in life {lives}')
            hands = [name for name in proc_info.process_names() if 'finger_node' in name]
            self.assertEqual(len(hands), 1, 'one process for all fingers')
            if lives == 1:
                (action,) = [p for p in proc_info.processes() if 'finger_node' in str(p.cmd)]
                os.kill(action.process_details['pid'], signal.SIGKILL)

    def let_each_finger_answer(self, when):
        topics = {'/diagnostics': DiagnosticArray}
        for finger in FINGERS:
            topics[f'left/{finger}/tendon_sensor/strain'] = StrainBlock
            topics[f'left/{finger}/{ANSWERS}'] = Classification
        with Ear(topics) as ear:
            ear.wait_for_publishers(*topics)
            for finger in FINGERS:
                self.hold(ear, finger, when)
            for finger in FINGERS:
                answers = ear.heard[f'left/{finger}/{ANSWERS}']
                self.assertEqual([a.trial_id for a in answers], [f'held by {finger} {when}'])
                self.assertEqual(answers[0].reason, '')

    def hold(self, ear, finger, when):
        """Publish the events of a hold, as the program that moves the finger does."""
        strain = ear.heard[f'left/{finger}/tendon_sensor/strain']
        publisher = ear.node.create_publisher(
            TrialEvent, f'left/{finger}/trial_runner/events', EVENTS
        )
        wait_until(lambda: strain, lambda: f'no samples of {finger}')
        # The feature node refuses a window that begins before the first sample it has received.
        features = f'left/{finger}/tactile_features'
        wait_until(
            lambda: any(
                features in status.name and status.level == DiagnosticStatus.OK
                for array in ear.heard['/diagnostics']
                for status in array.status
            ),
            lambda: f'{features} hears no samples',
        )
        start_ns = Time.from_msg(strain[-1].header.stamp).nanoseconds
        for phase, after_ns in (('hold', 0), ('release', HOLD_NS), ('done', HOLD_NS + 1)):
            event = TrialEvent(
                trial_id=f'held by {finger} {when}',
                protocol=TrialEvent.PROTOCOL_STIFFNESS,
                contact=TrialEvent.CONTACT_FLEXION,
                phase=phase,
                simulated=True,
            )
            event.header.stamp = Time(nanoseconds=start_ns + after_ns).to_msg()
            publisher.publish(event)
        ear.wait_for_messages(f'left/{finger}/{ANSWERS}')


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    def test_every_process_exits_with_code_0(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info)
