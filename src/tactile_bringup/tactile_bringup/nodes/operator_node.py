# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Asks for trials and waits for what the classifiers say: the experimenter's part."""

from __future__ import annotations

import concurrent.futures
import threading
import time
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.node import Node

from tactile_bringup.errors import BringupError
from tactile_bringup.recording.bags import classification_topic
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.conversions import classification_from_msg
from tactile_classifier.records import ClassificationResult
from tactile_msgs.action import HomeGuide, RunTrial
from tactile_msgs.msg import Classification
from tactile_ros.message_guard import MessageGuard
from tactile_ros.qos import RESULTS
from tactile_ros.requests import send

TRIAL_TIMEOUT_S = 120.0
ANSWER_TIMEOUT_S = 5.0


class OperatorNode(Node):  # type: ignore[misc]
    """Blocking calls for a thread that does not spin; the executor runs elsewhere."""

    def __init__(
        self, classifiers: tuple[str, ...], context: Context, namespace: str = ''
    ) -> None:
        super().__init__('operator', context=context, namespace=namespace)
        self._home = ActionClient(self, HomeGuide, 'linear_guide/home')
        self._run = ActionClient(self, RunTrial, 'trial_runner/run_trial')
        self._arrived = threading.Condition()
        self._answers: list[ClassificationResult] = []
        guard = MessageGuard(self)
        for name in classifiers:
            topic = classification_topic(name).name
            on_message = guard.wrap(topic, self._on_classification)
            self.create_subscription(Classification, topic, on_message, RESULTS)

    def _on_classification(self, message: Classification) -> None:
        answer = classification_from_msg(message)
        with self._arrived:
            self._answers.append(answer)
            self._arrived.notify_all()

    def home_guide(self) -> str:
        """Home the guide; return what the action says at its end.

        Raises
        ------
        BringupError
            When it does not end as asked.
        """
        return str(self._call(self._home, 'homing the guide', HomeGuide.Goal()).message)

    def run_trial(self, request: TrialRequest) -> str:
        """Run one trial; return its id.

        Raises
        ------
        BringupError
            When it does not end as planned.
        """
        goal = RunTrial.Goal(
            protocol=request.protocol,
            contact=request.contact,
            object_label=request.object_label,
            trial_id=request.trial_id,
            session_id=request.session_id,
            glide_speed_m_s=request.glide_speed_m_s,
            hold_s=request.hold_s,
        )
        return str(self._call(self._run, 'the trial', goal).trial_id)

    def wait_for_answer(self, trial_id: str) -> ClassificationResult:
        """Wait for the classification of a trial.

        Raises
        ------
        BringupError
            When none comes.
        """
        deadline = time.monotonic() + ANSWER_TIMEOUT_S
        with self._arrived:
            while True:
                for answer in self._answers:
                    if answer.trial_id == trial_id:
                        return answer
                left_s = deadline - time.monotonic()
                if left_s <= 0:
                    raise BringupError(
                        f'no classification of trial {trial_id} within {ANSWER_TIMEOUT_S:.0f} s'
                    )
                self._arrived.wait(left_s)

    def _call(self, client: ActionClient, what: str, goal: Any) -> Any:
        if not client.wait_for_server(timeout_sec=ANSWER_TIMEOUT_S):
            raise BringupError(f'{what}: the action server does not answer; is the rig running?')
        try:
            handle = send(self, lambda: client.send_goal_async(goal)).result(ANSWER_TIMEOUT_S)
        except concurrent.futures.TimeoutError:
            raise BringupError(f'{what}: the goal was not taken') from None
        if not handle.accepted:
            raise BringupError(f'{what}: the goal was rejected')
        try:
            reply = send(self, handle.get_result_async).result(TRIAL_TIMEOUT_S)
        except concurrent.futures.TimeoutError:
            raise BringupError(f'{what}: no end within {TRIAL_TIMEOUT_S:.0f} s') from None
        if reply.status != GoalStatus.STATUS_SUCCEEDED:
            raise BringupError(f'{what}: {reply.result.message}')
        return reply.result
