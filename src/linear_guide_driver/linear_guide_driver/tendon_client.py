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

"""The tendon actuator: a Dynamixel XM430 in current-based position mode, and its motions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import threading
import time

from linear_guide_driver import dynamixel_registers as registers
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
)
from linear_guide_driver.records import TendonActuatorConfig, TendonState
from linear_guide_driver.servo_goals import ServoGoals
from linear_guide_driver.tendon_homing import find_taut
from linear_guide_driver.tension_control import TensionController
from linear_guide_driver.tension_keeper import TensionKeeper

POSITION_TOLERANCE_M = 0.0005
"""How far from its goal a finished pull may rest: the loop yields a little under load."""

REACH_S = 30.0
"""Added to the time to wind all the way before a tension counts as not to be reached."""

HOMING_REACH_M = 0.005
"""At least so much slack is looked through, also by an actuator for small displacements."""

SLACK_S = 1.0
"""Added to the computed duration of a pull before it counts as stuck."""


def _never() -> bool:
    return False


class TendonActuatorClient:
    """Blocking, thread-safe client of the tendon's servo; one pull at a time.

    The displacement is 0 where the servo stands when `connect` returns: connect
    with the tendon slack. `close` switches the torque off, so the tendon goes slack.

    Parameters
    ----------
    config : TendonActuatorConfig
    on_state : callable, optional
        Called with each `TendonState`, on the poll thread.
    clock_ns : callable, optional
        Clock that stamps states [ns].
    on_trouble : callable, optional
        Called with a reason as soon as a fault is noticed, also while nothing moves.
    """

    def __init__(
        self,
        config: TendonActuatorConfig,
        on_state: Callable[[TendonState], None] = lambda _: None,
        clock_ns: Callable[[], int] = time.time_ns,
        on_trouble: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._config = config
        self._on_trouble = on_trouble
        self._goals = ServoGoals(config, on_state, clock_ns, on_trouble)
        self._slot = threading.Lock()  # held by the one pull

    @property
    def state(self) -> TendonState | None:
        """The last state; None before the first poll."""
        return self._goals.state

    @property
    def trouble(self) -> str:
        """The fault that has ended motion; empty when there is none."""
        return self._goals.trouble

    @property
    def identification(self) -> str:
        """Model and firmware of the servo; empty before the first `connect`."""
        return self._goals.identification

    @property
    def temperature_limit_c(self) -> float:
        """Temperature at which the servo shuts down [degree Celsius]."""
        return self._goals.temperature_limit_c

    def connect(self) -> None:
        """Open the bus, set the servo up and hold the tendon where it is, as slack.

        Raises
        ------
        DeviceConnectionError
            When the servo does not answer.
        DeviceRefusedError
            When it is not a supported servo, too old, or has a fault that a restart
            does not end.
        """
        self._goals.connect()

    def close(self) -> None:
        """Switch the torque off, so that the tendon goes slack; harmless when called twice."""
        self._goals.close()

    def pull_to(
        self,
        displacement_m: float,
        speed_m_s: float = 0.0,
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = _never,
    ) -> TendonState:
        """Wind the tendon to a displacement and keep it there; return the state at rest.

        Parameters
        ----------
        displacement_m : float
            From the slack reference [m].
        speed_m_s : float
            [m/s]; 0: the configured default.
        on_state : callable
            Called with each new state while the tendon moves.
        should_stop : callable
            Ends the pull when it returns True; the tendon is held where it is.

        Raises
        ------
        MotionRefusedError
            Out of range, busy, or the driver must be connected anew; nothing has moved.
        MotionFailedError
            Ended by a fault.
        MotionStoppedError
            Ended by ``should_stop``, `hold_here` or `request_release`.
        """
        self._check_reach(displacement_m)
        speed_m_s = self._check_speed(speed_m_s)
        with self._one_pull():
            return self._wind(displacement_m, speed_m_s, on_state, should_stop)

    def pull_to_tension(
        self,
        tension_n: float,
        limit_n: float,
        max_displacement_m: float,
        speed_m_s: float,
        read_tension: Callable[[], float | None],
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = _never,
    ) -> TendonState:
        """Wind the tendon until the sensor reads a tension; return the state then.

        Afterwards the tension is kept, until the next command, a fault, or until
        ``read_tension`` knows none any more; then the tendon is held where it is.

        Parameters
        ----------
        tension_n, limit_n : float
            Tension to reach, and the limit that sets the pace [N].
        max_displacement_m : float
            No further than this [m].
        speed_m_s : float
            Fastest winding [m/s]; 0: the configured default.
        read_tension : callable
            Returns the present tension [N]; None when no valid sample arrives.
        on_state, should_stop : callable
            As in `pull_to`.

        Raises
        ------
        MotionRefusedError, MotionFailedError, MotionStoppedError
        """
        self._check_reach(max_displacement_m)
        speed_m_s = self._check_speed(speed_m_s)
        with self._one_pull():
            goals = self._goals
            goal, start_m = goals.begin(None, speed_m_s, should_stop)
            keeper = TensionKeeper(
                TensionController(tension_n, limit_n, speed_m_s, start_m, max_displacement_m),
                goals.monitor,
                read_tension,
                lambda displacement_m: goals.follow(goal, displacement_m),
                lambda: goals.hold(goal),
                self._on_trouble,
            )
            keeper.start()
            deadline_s = time.monotonic() + max_displacement_m / speed_m_s + REACH_S
            while True:
                state = goals.watch(goal, f'{tension_n:.2f} N', should_stop)
                if keeper.end:
                    raise MotionFailedError(keeper.end)
                if state is not None:
                    on_state(state)
                    if keeper.controller.is_near:
                        return state
                if keeper.controller.is_at_end or time.monotonic() > deadline_s:
                    goals.hold(goal)
                    end = goals.describe_end(f'{tension_n:.2f} N')
                    raise MotionFailedError(
                        f'{end} The tension was not reached within {max_displacement_m} m and in '
                        'time; the tendon is held there.'
                    )

    def home(
        self,
        taut_tension_n: float,
        read_tension: Callable[[], float | None],
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = _never,
    ) -> float:
        """Wind in slowly until the tendon is just taut; displacements count from there.

        A tendon that is taut already is let out first. The fingertip must be free.

        Parameters
        ----------
        taut_tension_n : float
            Tension at which it counts as taut [N].
        read_tension, on_state, should_stop : callable
            As in `pull_to_tension`.

        Returns
        -------
        float
            By how much the zero has moved [m].

        Raises
        ------
        MotionRefusedError, MotionFailedError, MotionStoppedError
        """
        reach_m = max(self._config.max_displacement_m, HOMING_REACH_M)

        def wind(direction: int, until: Callable[[TendonState], bool]) -> TendonState:
            start = self.state
            if start is None:
                raise MotionRefusedError('The servo has not answered yet; try again.')
            target_m = start.displacement_m + direction * reach_m
            speed_m_s = self._config.homing_speed_m_s
            return self._wind(target_m, speed_m_s, on_state, should_stop, until)

        with self._one_pull():
            shift_m = find_taut(wind, read_tension, taut_tension_n).displacement_m
            self._goals.shift_zero(shift_m)
            return shift_m

    def release(self) -> TendonState:
        """Let the tendon out to the slack reference at the default speed."""
        return self.pull_to(0.0)

    def hold_here(self) -> None:
        """Hold the tendon where it is, at once; ends a running pull.

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        self._goals.hold_here()

    stop = hold_here

    def request_release(self) -> None:
        """Begin to let the tendon out as fast as the servo can; ends a running pull.

        Raises
        ------
        DeviceConnectionError, DeviceRefusedError, MotionRefusedError
        """
        self._goals.request_release()

    # -- inside --------------------------------------------------------------------------

    @contextmanager
    def _one_pull(self) -> Iterator[None]:
        if not self._slot.acquire(blocking=False):
            raise MotionRefusedError('The tendon is busy with another pull; stop it first.')
        try:
            yield
        except (DeviceConnectionError, DeviceRefusedError) as error:
            self._goals.monitor.fail(str(error))
            raise MotionFailedError(f'The pull failed: {error}.') from error
        except LinearGuideDriverError:
            raise
        except BaseException:  # a fault of the caller's functions: nobody watches the pull now
            with suppress(LinearGuideDriverError):
                self.hold_here()
            raise
        finally:
            self._slot.release()

    def _check_reach(self, displacement_m: float) -> None:
        if not 0.0 <= displacement_m <= self._config.max_displacement_m:
            raise MotionRefusedError(
                f'Displacement {displacement_m} m must be between 0 and max_displacement_m, '
                f'{self._config.max_displacement_m} m.'
            )

    def _check_speed(self, speed_m_s: float) -> float:
        speed_m_s = speed_m_s or self._config.speed_m_s
        if not 0.0 < speed_m_s <= self._goals.max_speed_m_s * (1 + 1e-9):
            raise MotionRefusedError(
                f"Speed {speed_m_s} m/s must be above 0 and at most the servo's limit of "
                f'{self._goals.max_speed_m_s:.4f} m/s.'
            )
        return speed_m_s

    def _wind(
        self,
        displacement_m: float,
        speed_m_s: float,
        on_state: Callable[[TendonState], None],
        should_stop: Callable[[], bool],
        until: Callable[[TendonState], bool] = lambda _: False,
    ) -> TendonState:
        """Wind until there, or until ``until`` says so, and then hold."""
        goals = self._goals
        goal, start_m = goals.begin(displacement_m, speed_m_s, should_stop)
        deadline_s = time.monotonic() + abs(displacement_m - start_m) / speed_m_s + SLACK_S
        one_unit_m_s = registers.velocity_to_m_s(1, self._config.pulley_radius_m)
        while True:
            state = goals.watch(goal, f'{displacement_m:.4f} m', should_stop)
            if state is not None:
                on_state(state)
                if until(state):
                    goals.hold(goal)
                    return state
                if (
                    abs(state.displacement_m - displacement_m) <= POSITION_TOLERANCE_M
                    and abs(state.velocity_m_s) <= 1.5 * one_unit_m_s
                ):
                    return state
            if time.monotonic() > deadline_s:
                end = goals.describe_end(f'{displacement_m:.4f} m')
                self.request_release()
                raise MotionFailedError(
                    f'{end} It got no further with {self._config.current_limit_a} A; '
                    'the tendon is released.'
                )
