# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon actuator: a Dynamixel XM430 in current-based position mode, and its motions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import time

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.servo_goals import ServoGoals
from linear_guide_driver.dynamixel.tendon_homing import find_taut
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
    MotionFailedError,
    MotionRefusedError,
)
from linear_guide_driver.records import TendonState
from linear_guide_driver.safety.pull import check_pull, check_reach, Pull
from linear_guide_driver.safety.states import Ending, Zero

POSITION_TOLERANCE_M = 0.0005
"""How far from its goal a finished pull may rest: the loop yields a little under load."""

HOMING_REACH_M = 0.005
"""At least so much slack is looked through, also by an actuator for small displacements."""

SLACK_S = 1.0
"""Added to the computed duration of a pull before it counts as stuck."""


class TendonActuatorClient(ServoGoals):
    """Blocking, thread-safe client of the tendon's servo; one pull at a time.

    Every command passes `TendonSafety`, and the poll carries its orders out. `connect` lets a
    tendon out that was left taut. `close` lets it out, too, and switches the torque off.

    Parameters and attributes are those of `ServoGoals`.
    """

    def pull_to(
        self,
        displacement_m: float,
        speed_m_s: float = 0.0,
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
        *,
        contact: str = 'flexion',
        stop_tension_n: float = 0.0,
    ) -> TendonState:
        """Wind the tendon to a displacement and keep it there; return the state at rest.

        Parameters
        ----------
        displacement_m : float
            From the slack reference [m]; 0 lets the tendon out to slack.
        speed_m_s : float
            [m/s]; 0: the configured default.
        on_state : callable
            Called with each new state while the tendon moves.
        should_stop : callable
            Ends the pull when it returns True; the tendon is held where it is.
        contact : str
            flexion or abduction: chooses the limit of the tension.
        stop_tension_n : float
            The pull ends and holds when the tension reaches this [N]; 0: it does not.
            ``safety.ending`` says which end it was.

        Raises
        ------
        MotionRefusedError
            Out of range, busy, not safe, or not connected; nothing has moved.
        MotionFailedError
            Ended by a fault or by safety.
        MotionStoppedError
            Ended by ``should_stop``, `hold_here`, `request_release` or `close`.
        """
        if displacement_m == 0.0:  # letting out is always accepted
            with self._one_pull():
                return self._release(speed_m_s, on_state, should_stop)
        check_reach(displacement_m, self._config.max_displacement_m)
        speed_m_s = self._check_speed(speed_m_s)
        with self._one_pull():
            pull = Pull(displacement_m, contact, stop_tension_n)
            return self._wind(pull, speed_m_s, on_state, should_stop)

    def home(
        self,
        taut_tension_n: float,
        on_state: Callable[[TendonState], None] = lambda _: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> float:
        """Wind in slowly until the tendon is just taut; displacements count from there.

        A tendon that is taut already is let out first. The fingertip must be free.

        Parameters
        ----------
        taut_tension_n : float
            Tension at which it counts as taut [N].
        on_state, should_stop : callable
            As in `pull_to`.

        Returns
        -------
        float
            By how much the zero has moved [m].

        Raises
        ------
        MotionRefusedError, MotionFailedError, MotionStoppedError
        """
        reach_m = max(self._config.max_displacement_m, HOMING_REACH_M)
        contact = self.safety.strictest_contact
        # A pull would not be allowed to stop above the limit; so it is here.
        check_pull(Pull(0.0, contact, stop_tension_n=taut_tension_n), self.safety.limits_n)

        def wind(direction: int, until: Callable[[TendonState], bool]) -> TendonState:
            start = self.state
            if start is None:
                raise MotionRefusedError('The servo has not answered yet; try again.')
            pull = Pull(start.displacement_m + direction * reach_m, contact, is_homing=True)
            return self._wind(pull, self._config.homing_speed_m_s, on_state, should_stop, until)

        with self._one_pull():
            taut = find_taut(wind, self._read_tension, taut_tension_n)
            self._shift_zero(taut.displacement_m)
            return taut.displacement_m

    # -- inside --------------------------------------------------------------------------

    @contextmanager
    def _one_pull(self) -> Iterator[None]:
        if not self._slot.acquire(blocking=False):
            raise MotionRefusedError('The tendon is busy with another pull; stop it first.')
        try:
            yield
        except (DeviceConnectionError, DeviceRefusedError) as error:
            self._require_connection()[1].fail(str(error))
            raise MotionFailedError(f'The pull failed: {error}.') from error
        except LinearGuideDriverError:
            raise
        except BaseException:  # a fault of the caller's functions: nobody watches the pull now
            with suppress(LinearGuideDriverError):
                self.hold_here()
            raise
        finally:
            self.safety.finish()
            self._slot.release()

    def _read_tension(self) -> float | None:
        return self.safety.live_tension_n(time.monotonic_ns())

    def _check_speed(self, speed_m_s: float) -> float:
        speed_m_s = speed_m_s or self._config.speed_m_s
        if not 0.0 < speed_m_s <= self._max_speed_m_s * (1 + 1e-9):
            raise MotionRefusedError(
                f"Speed {speed_m_s} m/s must be above 0 and at most the servo's limit of "
                f'{self._max_speed_m_s:.4f} m/s.'
            )
        return speed_m_s

    def _release(
        self,
        speed_m_s: float,
        on_state: Callable[[TendonState], None],
        should_stop: Callable[[], bool],
    ) -> TendonState:
        """Let out to the zero; without a known zero, until the sensor reads a slack tendon."""
        safety = self.safety
        wanted_m_s = speed_m_s if speed_m_s > 0.0 else self._config.speed_m_s
        speed_m_s = min(wanted_m_s, self._max_speed_m_s)
        pull = Pull(safety.slack_m)

        def until(state: TendonState) -> bool:
            is_known = safety.zero is not Zero.UNKNOWN
            return not is_known and safety.is_slack(state.displacement_m, time.monotonic_ns())

        return self._wind(pull, speed_m_s, on_state, should_stop, until)

    def _wind(
        self,
        pull: Pull,
        speed_m_s: float,
        on_state: Callable[[TendonState], None],
        should_stop: Callable[[], bool],
        until: Callable[[TendonState], bool] = lambda _: False,
    ) -> TendonState:
        """Wind until there, or until ``until`` says so, and then hold."""
        goal, start_m, goal_m = self._begin(pull, speed_m_s, should_stop)
        target = f'{goal_m:.4f} m'
        deadline_s = time.monotonic() + abs(goal_m - start_m) / speed_m_s + SLACK_S
        one_unit_m_s = registers.velocity_to_m_s(1, self._config.pulley_radius_m)
        while True:
            state = self._watch(goal, target, should_stop)
            if state is not None:
                on_state(state)
                if self.safety.ending is Ending.REACHED:
                    return state
                if until(state):
                    self._hold(goal)
                    return state
                if (
                    abs(state.displacement_m - goal_m) <= POSITION_TOLERANCE_M
                    and abs(state.velocity_m_s) <= 1.5 * one_unit_m_s
                ):
                    return state
            if time.monotonic() > deadline_s:
                end = self._describe_end(target)
                self.request_release(reason=end)
                raise MotionFailedError(
                    f'{end} It got no further with {self._config.current_limit_a} A; '
                    'the tendon is let out.'
                )
