# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig of an experiment: real nodes, on simulated devices or yours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from tactile_bringup.nodes.operator_node import StoppedError
from tactile_bringup.records import TrialConfig
from tactile_bringup.trial_protocols import (
    GuideStep,
    TendonStep,
    trial_steps,
    TrialRequest,
    WaitStep,
)
from tactile_classifier.records import Outcome as AnswerOutcome
from tactile_features.records import FeatureWindow, Outcome
from tactile_lab.commands.output import Output
from tactile_lab.commands.running.live_trials import live_rig, LiveRig, LiveSetup, LiveTrial
from tactile_lab.experiment.loop import TrialOrder, TrialResult
from tactile_lab.experiment.observer_node import ObserverNode
from tactile_lab.experiment.plan import ExperimentError, ExperimentPlan
from tactile_lab.experiment.quality import summarise_tension
from tactile_ros.errors import TactileError
from tactile_sim.rig_process import SimulatedRig

OVERHEAD_S = 1.0
"""What a trial takes besides its motions and waits, roughly."""


@dataclass
class LiveBench:
    """The rig.

    Parameters
    ----------
    setup : LiveSetup
        Its bag is replaced for each session.
    plan : ExperimentPlan
    simulated_rig : SimulatedRig or None
        Puts each object under the simulated finger.
    output : Output, optional
        Prints the address of the live page.
    """

    setup: LiveSetup
    plan: ExperimentPlan
    simulated_rig: SimulatedRig | None
    output: Output | None = None

    @property
    def trial_s(self) -> float:
        parameters = self.setup.parameters.get('trial_runner', {})
        return estimate_trial_s(TrialConfig(**parameters), request_of(self.plan))

    @contextmanager
    def session(self, bag: Path) -> Iterator[RunningLiveBench]:
        setup = replace(self.setup, bag=bag)
        with live_rig(setup, [ObserverNode], self.output) as rig:
            yield RunningLiveBench(self, rig)


@dataclass
class RunningLiveBench:
    """The rig while its nodes run."""

    bench: LiveBench
    rig: LiveRig

    def run(self, order: TrialOrder) -> TrialResult:
        """See `tactile_lab.experiment.loop.RunningBench`."""
        planned, recorder = order.planned, self.rig.recorder
        if recorder.has_failed:
            raise ExperimentError(recorder.failure)
        if self.bench.simulated_rig is not None:
            session = self.bench.plan.session_ids.index(planned.session_id)
            self.bench.simulated_rig.mount(
                self.bench.plan.protocol,
                planned.object_label,
                planned.contact,
                (session, order.mounting_number, order.number_in_mounting),
            )
        request = replace(
            request_of(self.bench.plan),
            contact=planned.contact,
            object_label=planned.object_label,
            trial_id=order.trial_id,
            session_id=planned.session_id,
            mounting_id=order.mounting_id,
        )
        observer: ObserverNode = self.rig.others[0]
        observer.begin()
        try:
            self.rig.operator.tell_progress(order.number, order.count, request)
            trial = self.rig.run(request)
            window, tension_n = observer.end(order.trial_id)
        except StoppedError as error:  # a person said so: it is not offered again by itself
            raise ExperimentError(f'{error}; run the same command to continue') from error
        finally:
            observer.stop()
            self._save()
        return judge(trial, window, summarise_tension(tension_n))

    def _save(self) -> None:
        try:
            self.rig.recorder.save()
        except TactileError as error:
            raise ExperimentError(str(error)) from error


def request_of(plan: ExperimentPlan) -> TrialRequest:
    """Return what all trials of a plan have in common."""
    return TrialRequest(
        plan.protocol,
        plan.contacts[0],
        glide_speed_m_s=plan.glide_speed_m_s,
        hold_s=plan.hold_s,
    )


def judge(
    trial: LiveTrial, window: FeatureWindow | None, statistics: dict[str, float]
) -> TrialResult:
    """Return whether a trial's recording can be used, with a sentence about it."""
    audit, answer = trial.audit, trial.answer
    if audit is None:
        return TrialResult('no sample came after the trial, so its recording was not audited')
    if not audit.passed:
        return TrialResult('; '.join(audit.findings))
    if window is None:
        return TrialResult('the features node gave no window; its log says why')
    if window.outcome != Outcome.OK:
        return TrialResult(f'no features: {window.reason}')
    parts = [f'{audit.sample_count} samples, all there']
    if statistics:
        parts.append(f'{statistics["mean_n"]:.2f} N ± {statistics["deviation_n"]:.2g} N')
    if answer is not None:
        said = answer.label if answer.outcome == AnswerOutcome.LABEL else answer.reason
        parts.append(f'the model says {said}')
    return TrialResult('', ', '.join(parts), statistics)


def estimate_trial_s(config: TrialConfig, request: TrialRequest) -> float:
    """Return how long a trial takes, roughly [s]: its motions and waits."""
    total_s, at_m = OVERHEAD_S, config.guide_start_m
    for step in trial_steps(config, request):
        if isinstance(step, WaitStep):
            total_s += step.duration_s
        elif isinstance(step, TendonStep):
            total_s += config.displacement_m(request.contact) / step.speed_m_s
        elif isinstance(step, GuideStep):
            total_s += abs(step.position_m - at_m) / step.speed_m_s
            at_m = step.position_m
    return total_s
