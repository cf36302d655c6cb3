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

"""The tendon actuator as a ROS 2 node: actions to pull and to home, guarded by the tension."""

from __future__ import annotations

import time
from typing import Any

from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from linear_guide_driver.conversions import joint_state_to_msg
from linear_guide_driver.errors import (
    LinearGuideDriverError,
    MotionRefusedError,
    MotionStoppedError,
)
from linear_guide_driver.needs import Needs
from linear_guide_driver.records import TendonActuatorConfig, TendonState
from linear_guide_driver.tendon_client import TendonActuatorClient
from linear_guide_driver.tension_guard import TensionGuard, Verdict
from linear_guide_driver.throttle import Throttle
from tactile_msgs.action import HomeTendon, PullTendon
from tactile_msgs.msg import StrainBlock
from tactile_ros.diagnostics import Diagnostics, ERROR, Health, OK, WARN
from tactile_ros.goals import Goal, GoalAborted, GoalCanceled, GoalRunner
from tactile_ros.heartbeat import HeartbeatPublisher
from tactile_ros.lifecycle import TactileNode
from tactile_ros.node_group import run_node
from tactile_ros.qos import STREAM

FEEDBACK_PERIOD_S = 0.1
WARM_C = 10.0
FULL_CURRENT = 0.95
NO_MEASUREMENT = StrainBlock.STATUS_STUCK | StrainBlock.STATUS_DEVICE_ERROR


class TendonActuatorNode(TactileNode):
    """Drives the tendon actuator.

    Actions ``~/pull`` and ``~/home``, service ``~/stop``, topics ``~/joint_states`` and
    ``~/heartbeat`` (while active and sound), health on ``/diagnostics``. Listens to
    ``tendon_sensor/strain`` and releases the tendon when the tension exceeds the limit of
    the contact, also between goals; holds it when a topic that it needs falls silent.
    """

    def __init__(self, node_name: str = 'tendon_actuator', **node_options: Any) -> None:
        super().__init__(node_name, TendonActuatorConfig, **node_options)
        self._client: TendonActuatorClient | None = None
        self._guard: TensionGuard | None = None
        self._runners: list[GoalRunner] = []
        self._needs: Needs | None = None
        self._heartbeat: HeartbeatPublisher | None = None
        self._is_homed = False
        self._joint_states: Any = None
        self._strain: Any = None
        self._stop_service: Any = None
        self._diagnostics: Diagnostics | None = None
        self._release_is_due = False

    def set_up(self, config: TendonActuatorConfig) -> None:
        self._joint_states = self.create_stream_publisher(JointState, '~/joint_states')
        self._guard = TensionGuard(
            {'flexion': config.flexion_limit_n, 'abduction': config.abduction_limit_n},
            config.guard_timeout_s,
            config.unguarded,
        )
        self._is_homed = False
        self._client = TendonActuatorClient(
            config,
            self._on_state,
            lambda: int(self.get_clock().now().nanoseconds),
            self._on_trouble,
        )
        self._client.connect()
        self._strain = self.create_subscription(
            StrainBlock, 'tendon_sensor/strain', self._on_strain, STREAM
        )
        self._needs = Needs(self, self._on_loss)
        for topic in config.heartbeat_topics:
            self._needs.add(Empty, topic, config.heartbeat_timeout_s, qos_profile_sensor_data)
        self._heartbeat = HeartbeatPublisher(self, self._is_well)
        self._runners = [
            GoalRunner(self, PullTendon, '~/pull', self._pull, accepting=self._accepting),
            GoalRunner(self, HomeTendon, '~/home', self._home, accepting=self._accepting),
        ]
        self._stop_service = self.create_service(Trigger, '~/stop', self._on_stop)
        self._diagnostics = Diagnostics(self, self._hardware_id, self._health)

    def stop(self) -> None:
        self._end_motion()

    def tear_down(self) -> None:
        for runner in self._runners:
            runner.close()
        self._runners = []
        if self._client is not None:
            self._client.close()
            self._client = None
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        if self._needs is not None:
            self._needs.close()
            self._needs = None
        if self._heartbeat is not None:
            self._heartbeat.close()
            self._heartbeat = None
        if self._stop_service is not None:
            self.destroy_service(self._stop_service)
            self._stop_service = None
        if self._strain is not None:
            self.destroy_subscription(self._strain)
            self._strain = None
        if self._joint_states is not None:
            self.destroy_lifecycle_publisher(self._joint_states)
            self._joint_states = None

    # -- goals -------------------------------------------------------------------------------

    def _accepting(self) -> str:
        if not self.is_active:
            return 'The actuator is not active; activate its node first.'
        if any(runner.is_busy for runner in self._runners):
            return 'The tendon is busy with another motion; stop it first.'
        return '' if self._needs is None else self._needs.describe_silence()

    def _pull(self, goal: Goal) -> PullTendon.Result:
        client, guard, request = self._client, self._guard, goal.request
        assert client is not None
        assert guard is not None
        throttle = Throttle(FEEDBACK_PERIOD_S)
        started_s = time.monotonic()
        limit_before_n = guard.limit_n

        def on_state(state: TendonState) -> None:
            if throttle.is_due():
                goal.feedback(displacement_m=state.displacement_m, current_a=state.current_a)

        def should_stop() -> bool:
            return goal.end_requested or guard.check(time.monotonic_ns()) is not Verdict.CONTINUE

        def rest() -> dict[str, float]:
            reached_m = 0.0 if client.state is None else client.state.displacement_m
            asks = bool(request.stop_tension_n or request.target_tension_n)
            return {
                'displacement_m': reached_m,
                'duration_s': time.monotonic() - started_s,
                'tension_n': (guard.tension_n or 0.0) if asks else 0.0,
            }

        try:
            present_m = 0.0 if client.state is None else client.state.displacement_m
            is_release = request.displacement_m <= max(0.0, present_m)
            target_n = request.target_tension_n
            guard.begin(
                request.contact,
                request.stop_tension_n,
                is_release and not target_n,
                time.monotonic_ns(),
                target_n,
            )
            if target_n:
                client.pull_to_tension(
                    target_n,
                    guard.limit_n,
                    request.displacement_m,
                    request.speed_m_s,
                    self._read_tension,
                    on_state,
                    should_stop,
                )
                message = f'The tension is {guard.tension_n:.2f} N and is kept.'
            else:
                state = client.pull_to(
                    request.displacement_m, request.speed_m_s, on_state, should_stop
                )
                message = f'The tendon rests at {state.displacement_m:.4f} m.'
            return PullTendon.Result(message=message, **rest())
        except MotionRefusedError as error:
            guard.put_back(limit_before_n)  # the tendon still holds for the contact before
            raise GoalAborted(str(error)) from error
        except MotionStoppedError as error:
            verdict = guard.check(time.monotonic_ns())
            if goal.end_requested:
                raise GoalCanceled(f'{error} The tendon is held there.', **rest()) from error
            if verdict is Verdict.REACHED:
                message = f'{guard.describe()} The tendon is held there.'
                return PullTendon.Result(message=message, stopped_by_tension=True, **rest())
            if verdict is Verdict.CONTINUE:
                raise GoalAborted(str(error), **rest()) from error
            if verdict is Verdict.NO_SAMPLES:
                message = f'{guard.describe()} The tendon is held there.'
                raise GoalAborted(message, **rest()) from error
            self._release()
            message = f'{guard.describe()} The tendon is released.'
            raise GoalAborted(message, **rest()) from error
        except LinearGuideDriverError as error:
            raise GoalAborted(str(error), **rest()) from error
        finally:
            guard.end()

    def _home(self, goal: Goal) -> HomeTendon.Result:
        client, guard = self._client, self._guard
        assert client is not None
        assert guard is not None
        throttle = Throttle(FEEDBACK_PERIOD_S)
        taut_n = goal.request.taut_tension_n or self.config.taut_tension_n
        limit_before_n = guard.limit_n

        def on_state(state: TendonState) -> None:
            if throttle.is_due():
                goal.feedback(
                    displacement_m=state.displacement_m, tension_n=guard.tension_n or 0.0
                )

        def should_stop() -> bool:
            return goal.end_requested or guard.check(time.monotonic_ns()) is not Verdict.CONTINUE

        try:
            # As a target: refused without samples and beyond the limit.
            guard.begin(guard.strictest_contact, 0.0, False, time.monotonic_ns(), taut_n)
            shift_m = client.home(taut_n, self._read_tension, on_state, should_stop)
        except MotionStoppedError as error:
            verdict = guard.check(time.monotonic_ns())
            if goal.end_requested:
                raise GoalCanceled(f'{error} The tendon is held there.') from error
            if verdict is Verdict.OVER_LIMIT:
                self._release()
                message = f'{guard.describe()} The tendon is released; is the fingertip free?'
                raise GoalAborted(message) from error
            raise GoalAborted(f'{guard.describe()} {error}') from error
        except LinearGuideDriverError as error:
            raise GoalAborted(str(error)) from error
        finally:
            guard.end()
            guard.put_back(limit_before_n)
        self._is_homed = True
        return HomeTendon.Result(
            message=f'The tendon is just taut at its new zero, {shift_m:.4f} m from the old one.',
            shift_m=shift_m,
        )

    def _read_tension(self) -> float | None:
        guard = self._guard
        return None if guard is None else guard.live_tension_n(time.monotonic_ns())

    # -- the rest ----------------------------------------------------------------------------

    def _on_strain(self, block: StrainBlock) -> None:
        guard = self._guard
        if guard is None or block.status & NO_MEASUREMENT:
            return
        now_ns = time.monotonic_ns()
        is_saturated = bool(block.status & StrainBlock.STATUS_SATURATED)
        if guard.add_samples(block.tension_n, is_saturated, now_ns):
            self.get_logger().error(f'{guard.describe()} Releasing the tendon.')
            self._release()
        elif self._release_is_due:
            self._release()

    def _release(self) -> None:
        """Begin to release; what fails is tried again with the next strain block."""
        client = self._client
        if client is None:
            return
        try:
            client.request_release()
        except LinearGuideDriverError as error:
            if not self._release_is_due:  # else it has been said already
                self.get_logger().error(f'cannot release the tendon, trying on: {error}')
            self._release_is_due = True
        else:
            self._release_is_due = False

    def _end_motion(self) -> str:
        """End the goal and hold the tendon; return what went wrong, or nothing."""
        self._release_is_due = False
        for runner in self._runners:
            runner.end_goal()
        if self._client is not None:
            try:
                self._client.hold_here()
            except LinearGuideDriverError as error:
                return str(error)
        return ''

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self._end_motion()
        response.success = not problem
        response.message = problem or 'The tendon is held where it is.'
        return response

    def _on_loss(self, sentence: str) -> None:
        self.get_logger().error(f'{sentence} The tendon is held where it is.')
        self._end_motion()

    def _is_well(self) -> bool:
        return self.is_active and self._client is not None and not self._client.trouble

    def _on_trouble(self, reason: str) -> None:
        self.get_logger().error(reason)
        if self._diagnostics is not None:
            self._diagnostics.publish()  # at once: a hold is not the time to wait for a second

    def _on_state(self, state: TendonState) -> None:
        if self._joint_states is not None:
            self._joint_states.publish(
                joint_state_to_msg(
                    self.config.joint_name,
                    self.config.frame_id,
                    state.displacement_m,
                    state.velocity_m_s,
                    state.received_at_ns,
                )
            )

    def _hardware_id(self) -> str:
        return '' if self._client is None else self._client.identification

    def _health(self) -> Health:
        client, guard = self._client, self._guard
        state = None if client is None else client.state
        if client is None or guard is None or state is None:
            return Health(ERROR, 'The tendon actuator is not connected.', {})
        values = {
            'displacement_m': f'{state.displacement_m:.6f}',
            'current_a': f'{state.current_a:.3f}',
            'voltage_v': f'{state.voltage_v:.1f}',
            'temperature_c': f'{state.temperature_c:.0f}',
            'tension_limit_n': guard.limit_n,
            'tension_n': 'unknown' if guard.tension_n is None else f'{guard.tension_n:.3f}',
            'zero': 'where it was homed' if self._is_homed else 'where it was connected',
            'port': self.config.port,
        }
        if client.trouble:
            return Health(ERROR, client.trouble, values)
        if state.temperature_c >= client.temperature_limit_c - WARM_C:
            sentence = f'The servo is hot; it shuts down at {client.temperature_limit_c:.0f} C.'
            return Health(WARN, sentence, values)
        if abs(state.current_a) >= FULL_CURRENT * self.config.current_limit_a:
            return Health(WARN, 'The servo pulls with all the current that it may.', values)
        if guard.tension_n is None:
            return Health(WARN, 'No strain sample yet: the tension is not guarded.', values)
        if not guard.is_alive(time.monotonic_ns()):
            sentence = 'Valid strain samples have ceased: the tension is not guarded.'
            return Health(WARN, sentence, values)
        return Health(OK, 'The actuator is ready.', values)


def main() -> int:
    """Run the node; return the process's exit code."""
    return run_node(TendonActuatorNode)
