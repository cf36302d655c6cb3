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

"""The state of one trial of the trial runner."""

from __future__ import annotations

import time
from typing import Any

from tactile_bringup.trial_protocols import TrialRequest
from tactile_ros.node.goals import Goal, GoalAborted


class ContactLost(GoalAborted):
    """The tendon has left its displacement; its driver may say why."""


class RunningTrial:
    """What is known of one trial while it runs, and what its result will state."""

    def __init__(self, request: TrialRequest, goal: Goal) -> None:
        self.request, self.goal = request, goal
        self.phase = ''
        self.stamp_ns = 0  # of the last event
        self.has_moved = self.needs_strain = False
        self.glide_end_ns: int | None = None
        self.glide_speed_m_s = self.glide_lag_s = self.displacement_error_m = 0.0
        self._started_s = time.monotonic()

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self._started_s

    def numbers(self) -> dict[str, Any]:
        """Return what the result says of the trial's motion."""
        return {
            'trial_id': self.request.trial_id,
            'glide_speed_m_s': self.glide_speed_m_s,
            'glide_lag_s': self.glide_lag_s,
            'displacement_error_m': self.displacement_error_m,
        }
