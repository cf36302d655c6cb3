# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Training recordings from the simulated rig, made without waiting in real time.

The bags hold the messages that a live recording holds: strain blocks and trial
events. All of them are marked as simulated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_bringup.bags import EVENT, EVENT_TOPIC, STRAIN, STRAIN_TOPIC, BagWriter
from tactile_bringup.records import CONTACTS, PROTOCOLS, TrialConfig
from tactile_bringup.trial_protocols import (
    GuideStep,
    TendonStep,
    TrialRequest,
    WaitStep,
    glide_speed_m_s,
    trial_steps,
)
from tactile_features.records import FeatureConfig
from tactile_sim.description import list_objects, load_rig
from tactile_sim.fast_trials import (
    Move,
    SimulatedTrials,
    Timeline,
    move_duration_s,
    simulate_trials,
)

SAMPLES_PER_BLOCK = 12
EPOCH_NS = 1_600_000_000_000_000_000
"""Where simulated time begins, so that the same seed gives the same bytes."""

IDLE_S = 0.2
"""Rest before and after a trial."""


@dataclass(frozen=True)
class PlannedTrial:
    """A trial on paper: when each phase begins, and what the devices do."""

    phases: tuple[tuple[str, float], ...]
    timeline: Timeline
    rate_hz: float

    @property
    def sample_count(self) -> int:
        return round(self.timeline.duration_s * self.rate_hz)


def plan_trial(config: TrialConfig, request: TrialRequest) -> PlannedTrial:
    """Compute when each step of a trial begins and ends on devices that obey at once.

    The guide is at the start already; the way back is left out, since nothing is
    measured on it.
    """
    now_s = IDLE_S
    guide_m, tendon_m = config.guide_start_m, 0.0
    rig = load_rig()
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
            now_s += move_duration_s(
                abs(step.displacement_m - tendon_m),
                step.speed_m_s,
                tendon_m_s2,
            )
            tendon_m = step.displacement_m
    phases.append(('done', now_s))
    # Whole blocks, so that trials follow each other without a gap in the sequence.
    block_s = SAMPLES_PER_BLOCK / rig.load_cell.rate_hz
    duration_s = np.ceil((now_s + IDLE_S) / block_s) * block_s
    timeline = Timeline(guide_moves, tendon_moves, duration_s, config.guide_start_m)
    return PlannedTrial(tuple(phases), timeline, rig.load_cell.rate_hz)


@dataclass(frozen=True)
class SimulationPlan:
    """One bag of simulated trials: every label of a protocol, so many times.

    Attributes
    ----------
    protocol, contact : str
    trials_per_label : int
    seed : int
        The same seed gives the same bag.
    """

    protocol: str
    contact: str
    trials_per_label: int
    seed: int

    @property
    def name(self) -> str:
        return f'{self.protocol}_{self.contact}'


def simulate_label(plan: SimulationPlan, label: str, config: TrialConfig) -> SimulatedTrials:
    """Simulate a plan's trials on one plate or object; other labels do not change them."""
    return simulate_trials(
        plan.protocol,
        label,
        plan.contact,
        plan_trial(config, TrialRequest(plan.protocol, plan.contact)).timeline,
        plan.trials_per_label,
        plan.seed,
    )


def write_simulated_bag(
    folder: Path,
    plan: SimulationPlan,
    trial_config: TrialConfig,
    feature_config: FeatureConfig,
    simulated: Mapping[str, SimulatedTrials] | None = None,
) -> Path:
    """Write a plan's trials as one bag below ``folder``.

    Parameters
    ----------
    folder : pathlib.Path
    plan : SimulationPlan
    trial_config : TrialConfig
    feature_config : FeatureConfig
    simulated : mapping of str to SimulatedTrials, optional
        What `simulate_label` gave for each label; simulated here when left out.

    Returns
    -------
    pathlib.Path
        The bag.

    Raises
    ------
    BagError
        When the bag exists already or cannot be written.
    """
    planned = plan_trial(trial_config, TrialRequest(plan.protocol, plan.contact))
    labels = list_objects(plan.protocol)
    facts = {
        'simulated': True,
        'seed': plan.seed,
        'protocol': plan.protocol,
        'contact': plan.contact,
        'trials_per_label': plan.trials_per_label,
        'feature_config': asdict(feature_config),
        'trial_config': asdict(trial_config),
    }
    with BagWriter(folder / plan.name, facts) as writer:
        strain = writer.add_topic(STRAIN_TOPIC)
        events = writer.add_topic(EVENT_TOPIC)
        trials = simulated or {
            label: simulate_label(plan, label, trial_config) for label in labels
        }
        clock = _TrialClock(writer.store.types, trial_config, plan, planned)
        for index in range(plan.trials_per_label):
            for label in labels:
                for stamp_ns, type_name, message in clock.messages(label, index, trials[label]):
                    writer.write(strain if type_name == STRAIN else events, stamp_ns, message)
    return folder / plan.name


class _TrialClock:
    """Lays trials end to end in simulated time and turns them into messages."""

    def __init__(
        self,
        types: Any,
        config: TrialConfig,
        plan: SimulationPlan,
        planned: PlannedTrial,
    ) -> None:
        self._types = types
        self._config = config
        self._plan = plan
        self._planned = planned
        self._first_sample = 0

    def messages(
        self, label: str, index: int, trials: SimulatedTrials
    ) -> Iterator[tuple[int, str, Any]]:
        """Yield (time, type, message) of one trial in the order of time."""
        # The sample at the very end is the first one of the next trial.
        tension_n = trials.tension_n[index, : self._planned.sample_count]
        begin_ns = self._stamp_ns(0)
        trial_id = f'{self._plan.name}-{self._plan.seed}-{label}-{index:04d}'
        items: list[tuple[int, str, Any]] = []
        for phase, at_s in self._planned.phases:
            stamp_ns = begin_ns + round(at_s * 1e9)
            items.append((stamp_ns, EVENT, self._event(stamp_ns, trial_id, label, phase)))
        for first in range(0, len(tension_n), SAMPLES_PER_BLOCK):
            values = tension_n[first : first + SAMPLES_PER_BLOCK]
            # A block is published when its last sample is there.
            items.append((self._stamp_ns(first + len(values)), STRAIN, self._block(first, values)))
        self._first_sample += len(tension_n)
        yield from sorted(items, key=lambda item: item[0])

    def _stamp_ns(self, sample: int) -> int:
        return EPOCH_NS + round((self._first_sample + sample) * 1e9 / self._planned.rate_hz)

    def _header(self, stamp_ns: int, frame_id: str) -> Any:
        time_class = self._types['builtin_interfaces/msg/Time']
        stamp = time_class(sec=stamp_ns // 1_000_000_000, nanosec=stamp_ns % 1_000_000_000)
        return self._types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame_id)

    def _block(self, first: int, values: np.ndarray[Any, Any]) -> Any:
        return self._types[STRAIN](
            header=self._header(self._stamp_ns(first), 'tendon_sensor_link'),
            sequence=self._first_sample + first,
            period_ns=round(1e9 / self._planned.rate_hz),
            tension_n=np.ascontiguousarray(values, dtype=np.float64),
            lost_before=0,
            stamp_error_s=0.0,
            status=0,
        )

    def _event(self, stamp_ns: int, trial_id: str, label: str, phase: str) -> Any:
        request = TrialRequest(self._plan.protocol, self._plan.contact)
        return self._types[EVENT](
            header=self._header(stamp_ns, ''),
            trial_id=trial_id,
            session_id=f'simulated-{self._plan.seed}',
            protocol=self._plan.protocol,
            contact=self._plan.contact,
            object_label=label,
            phase=phase,
            message='',
            glide_speed_m_s=glide_speed_m_s(self._config, request),
            simulated=True,
        )


def paper_plans(trials_per_label: int, seed: int) -> Sequence[SimulationPlan]:
    """Return the paper's four sets: texture and stiffness, flexion and abduction."""
    return [
        SimulationPlan(protocol, contact, trials_per_label, seed)
        for protocol in PROTOCOLS
        for contact in CONTACTS
    ]
