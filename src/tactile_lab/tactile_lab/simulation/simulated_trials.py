# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated trials as messages: planning, simulation and conversion to bytes, in chunks.

Worker processes run `simulate_chunk`. Therefore its arguments and its result are small and can be
pickled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from tactile_bags.message_types import message_store
from tactile_bringup.trial_protocols import (
    glide_speed_m_s,
    GuideStep,
    TendonStep,
    trial_steps,
    TrialConfig,
    TrialRequest,
    WaitStep,
)
from tactile_ros.strain import StrainStatus
from tactile_ros.topics import EVENT, STRAIN
from tactile_sim.descriptions.catalogue import Catalogue
from tactile_sim.physics.motion import Move, move_duration_s, Timeline
from tactile_sim.physics.trials import simulate_trials

SAMPLES_PER_BLOCK = 60
"""Number of samples per strain block. Long blocks are faster to write and to read."""

EPOCH_NS = 1_600_000_000_000_000_000
"""Stamp of the first sample [ns]. It is constant, so that the same seed gives the same bytes."""

IDLE_S = 0.2
"""Time at rest before and after each trial [s]."""


@dataclass(frozen=True)
class TrialSchedule:
    """Plan of a trial: start of each phase [s], motion of the devices, number of samples."""

    phases: tuple[tuple[str, float], ...]
    timeline: Timeline
    rate_hz: float
    sample_count: int


def plan_trial(
    config: TrialConfig, request: TrialRequest, catalogue: Catalogue | None = None
) -> TrialSchedule:
    """Compute the times of the steps of a trial, for devices that respond immediately.

    The guide begins at the start position. Its return at the end is omitted, because nothing is
    measured during the return.
    """
    now_s = IDLE_S
    guide_m, tendon_m = config.guide_start_m, 0.0
    rig = (catalogue or Catalogue(None)).rig()
    guide_m_s2, tendon_m_s2 = rig.guide.acceleration_m_s2, rig.tendon.max_acceleration_m_s2
    guide_moves: list[Move] = []
    tendon_moves: list[Move] = []
    phases: list[tuple[str, float]] = []
    for step in trial_steps(config, request):
        if step.phase == 'return':
            continue
        if not phases or phases[-1][0] != step.phase:
            phases.append((step.phase, now_s))
        if isinstance(step, WaitStep):
            now_s += step.duration_s
        elif isinstance(step, GuideStep):
            guide_moves.append(Move(now_s, step.position_m, step.speed_m_s))
            now_s += move_duration_s(abs(step.position_m - guide_m), step.speed_m_s, guide_m_s2)
            guide_m = step.position_m
        elif isinstance(step, TendonStep):
            tendon_moves.append(Move(now_s, step.displacement_m, step.speed_m_s))
            distance_m = abs(step.displacement_m - tendon_m)
            now_s += move_duration_s(distance_m, step.speed_m_s, tendon_m_s2)
            tendon_m = step.displacement_m
    phases.append(('done', now_s))
    # A trial lasts a whole number of sample periods, so that the next one follows without a gap.
    period_s = rig.load_cell.period_s
    sample_count = math.ceil((now_s + IDLE_S) / period_s)
    timeline = Timeline(guide_moves, tendon_moves, sample_count * period_s, config.guide_start_m)
    return TrialSchedule(tuple(phases), timeline, rig.load_cell.rate_hz, sample_count)


@dataclass(frozen=True)
class SimulationPlan:
    """Plan of a bag of simulated trials, with every label of a protocol.

    Attributes
    ----------
    trials_per_label : int
        Trials of each label in each session.
    seed : int
        The same seed gives the same bag.
    sessions : int
        Number of sessions. Trials of a session share the random deviations of the set-up.
    glide_speed_m_s : float or None
        Sliding speed over the plate [m/s]; None for the speed in the `TrialConfig`.
    trials_per_mounting : int
        Number of consecutive trials of a label that share one mounting.
    """

    protocol: str
    contact: str
    trials_per_label: int
    seed: int
    sessions: int = 1
    glide_speed_m_s: float | None = None
    trials_per_mounting: int = 1

    @property
    def name(self) -> str:
        name = f'{self.protocol}_{self.contact}'
        if self.glide_speed_m_s is None:
            return name
        return f'{name}_{1e3 * self.glide_speed_m_s:g}mm_s'

    def configure(self, config: TrialConfig) -> TrialConfig:
        """Return the configuration with the sliding speed of this plan."""
        if self.glide_speed_m_s is None:
            return config
        return replace(config, glide_speed_m_s=self.glide_speed_m_s)

    @property
    def request(self) -> TrialRequest:
        return TrialRequest(self.protocol, self.contact)


@dataclass(frozen=True)
class TrialChunk:
    """Consecutive trials on one plate or object in one session.

    The chunk has the trials ``first`` to ``first + count - 1`` of the label and session. ``row``
    is the index of the first of them in the bag; from one trial to the next, the index increases
    by ``row_step``.
    """

    label: str
    session: int
    first: int
    count: int
    row: int
    row_step: int


@dataclass(frozen=True)
class SimulatedTrial:
    """One trial of a bag.

    Attributes
    ----------
    messages : list
        Time [ns], type and serialized bytes (CDR) of each message, in the order of time.
    missing_samples : int
        Number of samples at the end of the trial that the simulator could not compute.
    failed_at_s : float or None
        Time since the first sample at which the simulator found no equilibrium [s]; None if the
        trial is complete.
    """

    trial_id: str
    messages: tuple[tuple[int, str, bytes], ...]
    missing_samples: int
    failed_at_s: float | None


def simulate_chunk(
    plan: SimulationPlan,
    planned: TrialSchedule,
    config: TrialConfig,
    catalogue: Catalogue,
    chunk: TrialChunk,
) -> list[SimulatedTrial]:
    """Simulate the trials of a chunk and convert them to bytes; runs in a worker."""
    trials = simulate_trials(
        plan.protocol,
        chunk.label,
        plan.contact,
        planned.timeline,
        chunk.count,
        plan.seed,
        session=chunk.session,
        first=chunk.first,
        trials_per_mounting=plan.trials_per_mounting,
        catalogue=catalogue,
    )
    done = []
    for i in range(chunk.count):
        failed_at_s = float(trials.failed_at_s[i]) if np.isfinite(trials.failed_at_s[i]) else None
        times_s = trials.sample_times_s
        # The last sample is also the first sample of the next trial, and is omitted here.
        count = planned.sample_count
        if failed_at_s is not None:
            count = min(count, int(np.searchsorted(times_s, failed_at_s)))
        recorder = _TrialRecorder(plan, planned, config, chunk, i)
        messages = recorder.messages(trials.tension_n[i, :count], failed_at_s)
        missing = planned.sample_count - count
        done.append(SimulatedTrial(recorder.trial_id, tuple(messages), missing, failed_at_s))
    return done


class _TrialRecorder:
    """Converts one trial to messages. In simulated time, trials follow each other without gaps."""

    def __init__(
        self,
        plan: SimulationPlan,
        planned: TrialSchedule,
        config: TrialConfig,
        chunk: TrialChunk,
        i: int,
    ) -> None:
        self._store: Typestore = message_store()
        self._plan = plan
        self._planned = planned
        self._config = config
        self._label = chunk.label
        self._first_sample = (chunk.row + i * chunk.row_step) * planned.sample_count
        self.session_id = f'simulated-{plan.seed}-{chunk.session}'
        number = chunk.first + i
        mounting = number // plan.trials_per_mounting
        self.mounting_id = f'{self.session_id}-{plan.contact}-{chunk.label}-{mounting}'
        self.trial_id = f'{plan.name}-{plan.seed}-{chunk.session}-{chunk.label}-{number:04d}'

    def messages(
        self, tension_n: NDArray[np.float64], failed_at_s: float | None
    ) -> list[tuple[int, str, bytes]]:
        """Return (time, type, bytes) of each message in the order of time."""
        items: list[tuple[int, str, bytes]] = []
        phases = [(phase, at_s, '') for phase, at_s in self._planned.phases]
        if failed_at_s is not None:
            why = f'the simulation found no equilibrium at {failed_at_s:.3f} s'
            phases = [phase for phase in phases if phase[1] < failed_at_s and phase[0] != 'done']
            phases.append(('aborted', failed_at_s, why))
        for phase, at_s, message in phases:
            stamp_ns = self._stamp_ns(0) + round(at_s * 1e9)
            items.append((stamp_ns, EVENT, self._event(stamp_ns, phase, message)))
        for first in range(0, len(tension_n), SAMPLES_PER_BLOCK):
            values = tension_n[first : first + SAMPLES_PER_BLOCK]
            # A block is published when its last sample is available.
            items.append((self._stamp_ns(first + len(values)), STRAIN, self._block(first, values)))
        return sorted(items, key=lambda item: item[0])

    def _stamp_ns(self, sample: int) -> int:
        return EPOCH_NS + round((self._first_sample + sample) * 1e9 / self._planned.rate_hz)

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        types = self._store.types
        time_class = types['builtin_interfaces/msg/Time']
        stamp = time_class(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)
        return types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id)

    def _block(self, first: int, values: NDArray[np.float64]) -> bytes:
        block = self._store.types[STRAIN](
            header=self._header(self._stamp_ns(first), 'tendon_sensor_link'),
            sequence=self._first_sample + first,
            period_ns=round(1e9 / self._planned.rate_hz),
            tension_n=np.ascontiguousarray(values, dtype=np.float64),
            lost_before=0,
            stamp_error_s=0.0,
            status=int(StrainStatus.SIMULATED),
        )
        return bytes(self._store.serialize_cdr(block, STRAIN))

    def _event(self, stamp_ns: int, phase: str, message: str) -> bytes:
        event = self._store.types[EVENT](
            header=self._header(stamp_ns, ''),
            trial_id=self.trial_id,
            session_id=self.session_id,
            mounting_id=self.mounting_id,
            protocol=self._plan.protocol,
            contact=self._plan.contact,
            object_label=self._label,
            phase=phase,
            message=message,
            glide_speed_m_s=glide_speed_m_s(self._config, self._plan.request),
            pull_speed_m_s=self._config.pull_speed_m_s,
            pull_displacement_m=self._config.displacement_m(self._plan.contact),
            detected=False,
            simulated=True,
        )
        return bytes(self._store.serialize_cdr(event, EVENT))
