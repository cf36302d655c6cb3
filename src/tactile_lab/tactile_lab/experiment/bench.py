# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig of an experiment: real nodes, on simulated devices or yours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from tactile_bringup.nodes.operator_node import StoppedError
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.records import Outcome as AnswerOutcome
from tactile_features.records import FeatureWindow, Outcome
from tactile_lab.commands.output import Output
from tactile_lab.commands.running.live_trials import live_rig, LiveRig, LiveSetup, LiveTrial
from tactile_lab.experiment.loop import TrialOrder, TrialResult
from tactile_lab.experiment.observer_node import ObserverNode
from tactile_lab.experiment.plan import ExperimentError, ExperimentPlan
from tactile_lab.experiment.quality import summarise_tension
from tactile_ros.errors import TactileError


@dataclass
class LiveBench:
    """The rig; see `tactile_lab.experiment.loop.Bench`.

    Parameters
    ----------
    setup : LiveSetup
        Its bag is replaced for each session.
    plan : ExperimentPlan
    output : Output
        Prints the address of the live page.
    """

    setup: LiveSetup
    plan: ExperimentPlan
    output: Output

    @contextmanager
    def session(self, bag: Path) -> Iterator[Callable[[TrialOrder], TrialResult]]:
        with live_rig(replace(self.setup, bag=bag), self.output, [ObserverNode]) as rig:
            yield partial(self.run_trial, rig)

    def run_trial(self, rig: LiveRig, order: TrialOrder) -> TrialResult:
        """Run a trial on the rig while its nodes run."""
        plan, planned = self.plan, order.planned
        if rig.recorder.has_failed:
            raise ExperimentError(rig.recorder.failure)
        if self.setup.simulated_rig is not None:
            session = plan.session_ids.index(planned.session_id)
            self.setup.simulated_rig.mount(
                plan.protocol,
                planned.object_label,
                planned.contact,
                (session, order.mounting_number, order.number_in_mounting),
            )
        request = TrialRequest(
            plan.protocol,
            planned.contact,
            planned.object_label,
            order.trial_id,
            planned.session_id,
            glide_speed_m_s=plan.glide_speed_m_s,
            hold_s=plan.hold_s,
            mounting_id=order.mounting_id,
        )
        observer: ObserverNode = rig.others[0]
        observer.begin()
        try:
            rig.operator.tell_progress(order.number, order.count, request)
            trial = rig.run(request)
            window, tension_n = observer.end(order.trial_id)
        except StoppedError as error:  # a person said so: it is not offered again by itself
            raise ExperimentError(f'{error}; run the same command to continue') from error
        finally:
            observer.stop()
            _save(rig)
        return judge(trial, window, summarise_tension(tension_n))


def _save(rig: LiveRig) -> None:
    try:
        rig.recorder.save()
    except TactileError as error:
        raise ExperimentError(str(error)) from error


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
