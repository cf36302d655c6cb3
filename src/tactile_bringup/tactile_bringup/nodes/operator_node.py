# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Node of the operator: requests trials and waits for the classifications."""

from __future__ import annotations

from collections.abc import Collection
import concurrent.futures
import dataclasses
import threading
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.context import Context
from rclpy.node import Node
from std_srvs.srv import Trigger

from linear_guide_driver.motion_node import STATES, stop_state_from_msg, STOP_TOPIC
from linear_guide_driver.stop_latch import StopState
from tactile_bringup.trial_protocols import longest_trial_s, TrialConfig, TrialRequest
from tactile_classifier.conversions import classification_from_msg, model_infos_from_msg
from tactile_classifier.types import ModelInfo, WindowPrediction
from tactile_msgs.action import HomeGuide, RunTrial
from tactile_msgs.msg import Classification, ModelInfos
from tactile_msgs.msg import StopState as StopStateMsg
from tactile_ros.errors import TactileError
from tactile_ros.goal_client import GoalClient, GoalLostError, SentGoal
from tactile_ros.health import Diagnostics, Health, OK, watch_rivals
from tactile_ros.lifecycle import MessageGuard
from tactile_ros.process import INTERRUPT_TIMEOUT_S
from tactile_ros.qos import LATEST, RESULTS
from tactile_ros.topics import CLASSIFICATION_TOPIC, MODELS_TOPIC

HOMING_TIMEOUT_S = 120.0
ANSWER_TIMEOUT_S = 5.0

END_TIMEOUT_S = 30.0
"""Longest wait for a cancelled goal to end [s]."""


class StoppedError(TactileError):
    """The goal was cancelled by another node or user, so no further goal may be sent."""


class OperatorNode(Node):  # type: ignore[misc]
    """Node with blocking calls; an executor on another thread must spin it.

    The service ``~/stop`` ends the session: the running goal is cancelled, and no further goal is
    sent. A stop of the rig has the same effect.

    Calls raise `TactileError` if a goal fails or an answer does not arrive, and `StoppedError`
    if the goal, the rig or this node was stopped.

    Parameters
    ----------
    context : Context
        ROS context.
    namespace, name : str
        Namespace and name of the node.
    answers : bool
        Subscribe to classifications, for `wait_for_models` and `wait_for_answers`.

    Attributes
    ----------
    trial_config : TrialConfig
        Configuration of the trial runner, which determines the longest duration of a trial.
    """

    def __init__(
        self,
        context: Context,
        namespace: str = '',
        *,
        name: str = 'operator',
        answers: bool = False,
    ) -> None:
        super().__init__(name, context=context, namespace=namespace)
        self.trial_config = TrialConfig()
        self._progress = Health(OK, '', {})
        self._diagnostics: Diagnostics | None = None
        self._home = GoalClient(self, HomeGuide, 'linear_guide/home')
        self._run = GoalClient(self, RunTrial, 'trial_runner/run_trial')
        self._rivals = {
            self._home: watch_rivals(self, 'linear_guide'),
            self._run: watch_rivals(self, 'trial_runner'),
        }
        self._stopped = threading.Event()
        self._goals: list[SentGoal] = []  # running goals
        self.create_service(Trigger, '~/stop', self._on_stop)
        self._stop_state = StopState()  # state of the rig
        self._arrived = threading.Condition()
        self._answers: list[WindowPrediction] = []
        self._models: tuple[ModelInfo, ...] | None = None
        guard = MessageGuard(self)
        take_stop = guard.wrap(STOP_TOPIC, self._on_stop_state)
        self.create_subscription(StopStateMsg, STOP_TOPIC, take_stop, STATES)
        wanted = (
            (Classification, CLASSIFICATION_TOPIC.name, self._on_classification, RESULTS),
            (ModelInfos, MODELS_TOPIC.name, self._on_models, LATEST),
        )
        for kind, topic, take, qos in wanted if answers else ():
            self.create_subscription(kind, topic, guard.wrap(topic, take), qos)

    def destroy_node(self) -> None:
        if self._diagnostics is not None:
            self._diagnostics.close()
        for client, rivals in self._rivals.items():
            rivals.close()
            client.close()
        super().destroy_node()

    def stop(self) -> None:
        """Cancel the running goal, and send no further goal until `resume`."""
        self._stopped.set()
        for goal in list(self._goals):
            goal.cancel()

    def resume(self) -> None:
        """Allow goals again after a stop."""
        self._stopped.clear()

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.stop()
        response.success = True
        response.message = 'The running goal is cancelled, and no further goal is sent.'
        return response

    def _on_stop_state(self, message: StopStateMsg) -> None:
        # The newest state is used, even if its number is lower: restarted nodes begin at 0.
        self._stop_state = stop_state_from_msg(message)

    def publish_progress(
        self, number: int, count: int, request: TrialRequest, following: str = ''
    ) -> None:
        """Publish the number of the present trial, and a text on the next one, as diagnostics."""
        then = f'; next: {following}' if following else ''
        self._progress = Health(
            OK,
            f'trial {number} of {count}{then}',
            {'trial': number, 'trials': count, 'trial_id': request.trial_id},
        )
        if self._diagnostics is None:
            self._diagnostics = Diagnostics(self, lambda: '', lambda: self._progress)
        self._diagnostics.publish()

    def _on_classification(self, message: Classification) -> None:
        answer = classification_from_msg(message)
        with self._arrived:
            self._answers.append(answer)
            self._arrived.notify_all()

    def _on_models(self, message: ModelInfos) -> None:
        infos = model_infos_from_msg(message)
        with self._arrived:
            self._models = infos.models
            self._arrived.notify_all()

    def wait_for_models(self) -> tuple[ModelInfo, ...]:
        """Wait for the classifier; return its loaded models."""
        with self._arrived:
            if not self._arrived.wait_for(lambda: self._models is not None, ANSWER_TIMEOUT_S):
                raise TactileError(
                    f'no message on {MODELS_TOPIC.name} within {ANSWER_TIMEOUT_S:.0f} s; check '
                    'that the classifier is running'
                )
            return self._models or ()

    def home_guide(self) -> str:
        """Home the guide; return the message of the action's result."""
        end = self._call(self._home, 'homing the guide', HomeGuide.Goal(), HOMING_TIMEOUT_S)
        return str(end.message)

    def run_trial(self, request: TrialRequest) -> str:
        """Run one trial; return its id."""
        goal = RunTrial.Goal(**dataclasses.asdict(request))
        timeout_s = longest_trial_s(self.trial_config, request) + END_TIMEOUT_S
        return str(self._call(self._run, 'the trial', goal, timeout_s).trial_id)

    def wait_for_answers(
        self, trial_id: str, models: Collection[str]
    ) -> tuple[WindowPrediction, ...]:
        """Wait until each of the models has classified a trial; return the classifications.

        ``models`` are values of ``model_id``. The classifications have the same order.
        """

        def found() -> dict[str, WindowPrediction]:
            of_trial = (answer for answer in self._answers if answer.trial_id == trial_id)
            return {answer.model_id: answer for answer in of_trial if answer.model_id in models}

        with self._arrived:
            self._arrived.wait_for(lambda: len(found()) == len(models), ANSWER_TIMEOUT_S)
            answers = found()
        if missing := [name for name in models if name not in answers]:
            raise TactileError(
                f'no classification of trial {trial_id} by {", ".join(missing)} within '
                f'{ANSWER_TIMEOUT_S:.0f} s'
            )
        return tuple(answers[name] for name in models)

    def _call(self, client: GoalClient, what: str, message: Any, timeout_s: float) -> Any:
        is_there = not self._stopped.is_set() and client.wait_for_server(ANSWER_TIMEOUT_S)
        if self._stopped.is_set():
            raise StoppedError(f'{what}: Stop was pressed on a live page')
        if refusal := self._stop_state.refusal:
            raise StoppedError(f'{what}: {refusal}')
        if not is_there:
            raise TactileError(
                f'{what}: the action server does not answer; check that the rig is running'
            )
        # If two nodes have the name of the action server, it is unknown which one would answer.
        if rivals := self._rivals[client].find_loss():
            raise TactileError(f'{what}: {rivals}')
        goal = client.send(message)
        self._goals.append(goal)
        try:
            reply = self._wait_for_end(goal, what, timeout_s)
        except GoalLostError as error:
            raise TactileError(f'{what}: {error}') from None
        finally:
            self._goals.remove(goal)
        if reply.status == GoalStatus.STATUS_SUCCEEDED:
            return reply.result
        is_stop = reply.status == GoalStatus.STATUS_CANCELED or self._stopped.is_set()
        is_stop = is_stop or self._stop_state.is_stopped
        if is_stop:
            raise StoppedError(f'{what}: {self._describe_stop()}; {reply.result.message}')
        raise TactileError(f'{what}: {reply.result.message}')

    def _describe_stop(self) -> str:
        """Return a sentence that describes the cause of a stop."""
        if self._stop_state.is_stopped:
            return f'the rig was stopped: {self._stop_state.reason}'
        if self._stopped.is_set():
            return 'Stop was pressed on a live page'
        return 'another program cancelled it'

    def _wait_for_end(self, goal: SentGoal, what: str, timeout_s: float) -> Any:
        """Return the answer at the end of a goal; cancel the goal after a timeout [s]."""
        if self._stopped.is_set():  # stopped while the goal was being sent
            goal.cancel()
        try:
            goal.taken.result(ANSWER_TIMEOUT_S)
        except concurrent.futures.TimeoutError:
            goal.cancel()
            raise TactileError(
                f'{what}: the goal was not accepted within {ANSWER_TIMEOUT_S:g} s; check the log '
                'of its node'
            ) from None
        try:
            return goal.end.result(timeout_s)
        except concurrent.futures.TimeoutError:
            goal.cancel()
            rest = _wait_for_rest(goal, END_TIMEOUT_S)
            raise TactileError(f'{what}: no end within {timeout_s:.0f} s; {rest}') from None
        except KeyboardInterrupt:
            # Wait until the rig is at rest and the end of the trial has been recorded.
            goal.cancel()
            _wait_for_rest(goal, INTERRUPT_TIMEOUT_S)
            raise


def _wait_for_rest(goal: SentGoal, timeout_s: float) -> str:
    """Wait for the end of a cancelled goal; return a message about it."""
    try:
        return f'cancelled: {goal.end.result(timeout_s).result.message}'
    except GoalLostError as error:
        return f'cancelled: {error}'
    except concurrent.futures.TimeoutError:
        return (
            f'cancelled, but not at rest after {timeout_s:g} s; bring the rig to rest by hand, '
            'then restart its nodes'
        )
