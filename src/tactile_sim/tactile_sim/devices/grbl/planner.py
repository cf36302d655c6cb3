# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Grbl's queue of moves along one axis: look-ahead, feed hold, resume.

Units are millimetres and seconds, in one frame of the caller's choice.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
import math

from tactile_sim.physics.motion import Motion, plan_ramp, plan_stop, Segment


@dataclass
class _Block:
    target: float
    speed: float
    end_s: float = math.inf


class Planner:
    """Moves from where it is through the queued targets.

    Parameters
    ----------
    position
        Where it stands at the start.
    """

    def __init__(self, position: float) -> None:
        self.acceleration = 1.0
        self._blocks: deque[_Block] = deque()
        self._motion = Motion(position, [], position)
        self._held = False

    @property
    def queued(self) -> int:
        """Moves that are planned and not yet done."""
        return len(self._blocks)

    @property
    def end_s(self) -> float:
        """When it will be at rest as things stand; in the past if it is."""
        return self._motion.end_s

    @property
    def next_end_s(self) -> float:
        """When the first queued move will be done; never during a hold."""
        return self._blocks[0].end_s if self._blocks else math.inf

    @property
    def held(self) -> bool:
        """True while a feed hold is on."""
        return self._held

    @property
    def target(self) -> float:
        """Where the last queued move ends."""
        return self._blocks[-1].target if self._blocks else self._motion.target

    def state_at(self, time_s: float) -> tuple[float, float]:
        """Position and velocity."""
        return self._motion.state_at(time_s)

    def settle(self, time_s: float) -> None:
        """Drop the moves that are done by ``time_s``."""
        while self._blocks and self._blocks[0].end_s <= time_s:
            self._blocks.popleft()

    def append(self, time_s: float, target: float, speed: float) -> None:
        """Queue a move; one of no length is nothing."""
        self.settle(time_s)
        if abs(target - self.target) < 1e-9:
            return
        self._blocks.append(_Block(target, speed))
        if not self._held:
            self._replan(time_s)

    def run(self, time_s: float, segments: list[Segment], target: float) -> None:
        """Do a ready-made motion (homing) instead of the queue."""
        self.place(self.state_at(time_s)[0])
        self._motion = Motion(self.state_at(time_s)[0], segments, target)

    def hold(self, time_s: float) -> None:
        """Brake to rest and keep the queue."""
        self.settle(time_s)
        position, velocity = self.state_at(time_s)
        stop = plan_stop(time_s, position, velocity, self.acceleration)
        self._motion = Motion(position, stop, stop[-1].end_position if stop else position)
        self._held = True
        for block in self._blocks:
            block.end_s = math.inf

    def resume(self, time_s: float) -> None:
        """Go on with the queue after a hold."""
        self._held = False
        self._replan(time_s)

    def drop_queue(self) -> None:
        """Forget the queue, once at rest after a hold."""
        self._blocks.clear()
        self._held = False

    def place(self, position: float) -> None:
        """Stand still at ``position``, at once, with nothing queued."""
        self.drop_queue()
        self._motion = Motion(position, [], position)

    def _replan(self, time_s: float) -> None:
        position, velocity = self.state_at(time_s)
        blocks = list(self._blocks)
        if not blocks:
            self._motion = Motion(position, [], position)
            return
        targets = [position] + [b.target for b in blocks]
        lengths = [b - a for a, b in pairwise(targets)]
        # Back to front: how fast may each block end so that the rest can still stop in time.
        exits = [0.0] * len(blocks)
        for i in range(len(blocks) - 2, -1, -1):
            if lengths[i] * lengths[i + 1] > 0.0:
                reachable = math.sqrt(
                    exits[i + 1] ** 2 + 2 * self.acceleration * abs(lengths[i + 1])
                )
                exits[i] = min(blocks[i].speed, blocks[i + 1].speed, reachable)
        segments: list[Segment] = []
        entry, start_s = abs(velocity), time_s
        for block, length, fastest in zip(blocks, lengths, exits, strict=True):
            reachable = math.sqrt(entry**2 + 2 * self.acceleration * abs(length))
            leave = min(fastest, reachable)
            ramp = plan_ramp(
                start_s,
                block.target - length,
                block.target,
                block.speed,
                self.acceleration,
                entry,
                leave,
            )
            segments += ramp
            entry = leave
            start_s = block.end_s = ramp[-1].end_s if ramp else start_s
        self._motion = Motion(position, segments, blocks[-1].target)
