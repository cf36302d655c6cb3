# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The state of one trial of the trial runner."""

from __future__ import annotations

import math
import time
from typing import Any

from tactile_bringup.trial_protocols import TrialRequest
from tactile_ros.node.goals import Goal, GoalAborted


class ContactLost(GoalAborted):
    """The tendon has left its displacement; its driver may say why."""


class RunningTrial:
    """State of one running trial, and the numbers for its result.

    Attributes
    ----------
    is_watched : bool
        The thread of the trial looks at it again and again, and gives the runner's sign of life.
    """

    def __init__(self, request: TrialRequest, goal: Goal) -> None:
        self.request, self.goal = request, goal
        self.phase = ''
        self.stamp_ns = 0  # of the last event
        self.has_moved = self.needs_strain = self.is_watched = False
        self.glide_end_ns: int | None = None
        self.glide_speed_m_s = self.glide_lag_s = self.displacement_error_m = 0.0
        self._started_s = self._looked_s = time.monotonic()

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self._started_s

    def look(self, most_s: float = math.inf) -> None:
        """Note that somebody watches the trial now.

        Parameters
        ----------
        most_s : float
            Longest time since the last look [s].

        Raises
        ------
        GoalAborted
            When nobody has looked for longer: the process was stopped, or got no core.
        """
        now_s = time.monotonic()
        away_s, self._looked_s = now_s - self._looked_s, now_s
        if away_s > most_s:
            raise GoalAborted(
                f'the trial runner stood still for {away_s:.2f} s in the {self.phase}, and nobody '
                f'watched it meanwhile; heartbeat_timeout_s allows {most_s:g} s. Repeat the '
                'trial, and see what else its computer runs'
            )

    def numbers(self) -> dict[str, Any]:
        """Return what the result says of the trial's motion."""
        return {
            'trial_id': self.request.trial_id,
            'glide_speed_m_s': self.glide_speed_m_s,
            'glide_lag_s': self.glide_lag_s,
            'displacement_error_m': self.displacement_error_m,
        }
