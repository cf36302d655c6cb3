# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials run one after the other on a rig, recorded, and classified where there are models."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, field, replace
import os
from pathlib import Path
import time
from typing import Any

from rclpy.context import Context
from rclpy.node import Node

from tactile_bags.auditing.audit import Audit
from tactile_bringup.launch_config.graph import ModelChoice, Ports, recorder_node, rig_graph
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_bringup.nodes.operator_node import OperatorNode, StoppedError
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.records import ClassificationResult, ModelInfo, Outcome
from tactile_lab.commands.output import Output
from tactile_lab.commands.replay import print_audits
from tactile_lab.commands.rig_requests import ExperimentRequest, TrialsRequest
from tactile_lab.running import open_ports, read_rig_parameters, say_address
from tactile_lab.watch.access import WatchOptions
from tactile_lab.watch.watching import watching
from tactile_ros.errors import TactileError
from tactile_sim.rig_process import SimulatedRig

WINDOW_TIMEOUT_S = 1.0
AUDIT_TIMEOUT_S = 2.0
"""Longest wait for the first sample after a trial [s]; the audit of the trial needs it."""


@dataclass(frozen=True)
class LiveTrial:
    """A trial with the answers of its models, and the audit of its recording."""

    request: TrialRequest
    answers: tuple[ClassificationResult, ...] = ()
    audit: Audit | None = None

    @property
    def answer(self) -> ClassificationResult | None:
        """The answer of the first model; None: no model is for this task and contact."""
        return self.answers[0] if self.answers else None

    @property
    def is_right(self) -> bool:
        return self.answer is not None and self.is_label(self.answer)

    def is_label(self, answer: ClassificationResult) -> bool:
        """Return whether an answer names what lay under the finger."""
        return answer.label == self.request.object_label

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        request, answer = self.request, self.answer
        return {
            'trial_id': request.trial_id,
            'session_id': request.session_id,
            'mounting_id': request.mounting_id,
            'protocol': request.protocol,
            'contact': request.contact,
            'object_label': request.object_label,
            'answer': answer.label if answer else '',
            'reason': answer.reason if answer else 'no model for this task and contact',
            'right': self.is_right,
            'model_id': answer.model_id if answer else '',
            'further_answers': [
                {
                    'answer': each.label,
                    'reason': each.reason,
                    'right': self.is_label(each),
                    'model_id': each.model_id,
                }
                for each in self.answers[1:]
            ],
            'audit': self.audit.to_dict() if self.audit else None,
        }


@dataclass(frozen=True)
class LiveSetup:
    """A rig to run trials on.

    Attributes
    ----------
    ports : Ports
    bag : pathlib.Path
        Where to record; must not exist yet.
    models : pathlib.Path or None
        Folder of model files, or one file; None runs without a classifier.
    simulated_rig : SimulatedRig or None
        The rig is this one. It gets what each trial names under its finger; on a real rig that is
        the experimenter's part.
    parameters : mapping
        ROS parameters by node name.
    domain_id : int or None
        ROS domain; None takes the environment's.
    watch : WatchOptions or None
        Serve a live page meanwhile.
    """

    ports: Ports
    bag: Path
    models: Path | None
    simulated_rig: SimulatedRig | None
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    domain_id: int | None = None
    watch: WatchOptions | None = None


@dataclass(frozen=True)
class LiveRig:
    """A rig whose nodes run in this process, homed, and recorded.

    ``models`` are those that answer, ``others`` the further nodes.
    """

    operator: OperatorNode
    recorder: Any
    models: tuple[ModelInfo, ...] = ()
    others: tuple[Node, ...] = ()

    def run(self, request: TrialRequest) -> LiveTrial:
        """Run a trial to its end, its audit and its answer.

        Raises
        ------
        TactileError
            When the trial or the recording fails.
        StoppedError
            When somebody has pressed Stop on a live page.
        """
        check_recording(self.recorder)
        listening = [
            model
            for model in self.models
            if model.task == request.protocol and model.contact in ('', request.contact)
        ]
        # One for each specification; without a model that of the feature node.
        windows = max(1, len({model.specification_digest for model in listening}))
        wanted = self.recorder.window_count + windows
        try:
            self.operator.run_trial(request)
        finally:
            audit = self.wait_for_audit(request.trial_id)
            self.wait_for_windows(wanted)
        check_recording(self.recorder)
        names = [model.model_id for model in listening]
        return LiveTrial(request, self.operator.wait_for_answers(request.trial_id, names), audit)

    def wait_for_windows(self, count: int) -> None:
        """Wait until the recording has so many windows; a trial without a phase has none.

        The windows of a trial come some tenths of a second after its last event, also of one that
        was interrupted.
        """
        deadline = time.monotonic() + WINDOW_TIMEOUT_S
        while self.recorder.window_count < count and not self.recorder.has_failed:
            if time.monotonic() > deadline:
                return
            time.sleep(0.02)

    def wait_for_audit(self, trial_id: str) -> Audit | None:
        """Wait until a trial's last samples are recorded; return its audit, if it comes."""
        deadline = time.monotonic() + AUDIT_TIMEOUT_S
        while True:
            audits: list[Audit] = list(self.recorder.audits)
            found = next((audit for audit in audits if audit.trial_id == trial_id), None)
            if found is not None:
                return found
            if time.monotonic() > deadline or self.recorder.has_failed:
                return None
            time.sleep(0.02)


def open_rig(
    request: TrialsRequest | ExperimentRequest, bag: Path, output: Output, stack: ExitStack
) -> LiveSetup:
    """Return the rig that a command is to run trials on; the stack ends a simulated one.

    Raises
    ------
    TactileError
        When ports are missing, or the parameters do not fit.
    """
    named = request.ports
    given = Ports(named.guide, named.tendon, named.sensor, named.sensor_topic)
    ports, simulated_rig = open_ports(given, named.simulated, request.seed, stack)
    if simulated_rig is not None:
        output.say('SIMULATED rig: no number is a measurement.')
    return LiveSetup(
        ports=ports,
        bag=bag,
        models=request.models,
        simulated_rig=simulated_rig,
        parameters=read_rig_parameters(request.params, ''),
        watch=WatchOptions() if request.watch else None,
    )


@contextmanager
def live_rig(
    setup: LiveSetup, output: Output, others: Sequence[Callable[[Context], Node]] = ()
) -> Iterator[LiveRig]:
    """Start the rig's nodes and its recorder, home the guide, and end them after the block.

    Parameters
    ----------
    setup : LiveSetup
    output : Output
        Prints the address of the live page.
    others : sequence of callable
        Each makes a further node for the context that it is given.

    Raises
    ------
    TactileError
        When a node cannot be started or a topic has no publisher.
    """
    models = ModelChoice.of_finger(str(setup.models or ''), setup.parameters)
    simulated = setup.simulated_rig is not None
    graph = rig_graph(setup.ports, models, setup.parameters, simulated=simulated)
    graph.append(recorder_node(setup.bag, classifier=models is not None))
    with ExitStack() as stack:
        context = stack.enter_context(ros_context(setup.domain_id))
        watch = None
        if setup.watch is not None:
            watch = stack.enter_context(watching(context, setup.watch, simulated=simulated))
            say_address(watch, output)
        operator = OperatorNode(context, answers=models is not None)
        made = [make(context) for make in others]
        with running_graph(graph, context, others=[operator, *made], quiet=True) as nodes:
            recorder = nodes['bag_recorder']
            operator.trial_config = nodes['trial_runner'].config
            wait_until_matched(recorder)
            if watch is not None and watch.state.was_stopped:  # before there was an operator
                operator.stop()
            answering = operator.wait_for_models() if models else ()
            operator.home_guide()
            yield LiveRig(operator, recorder, answering, tuple(made))


def run_live_trials(
    setup: LiveSetup,
    requests: Sequence[TrialRequest],
    output: Output,
    live: list[LiveTrial] | None = None,
) -> list[LiveTrial]:
    """Home the guide, run the trials, record them; print a line for each.

    A trial that fails is said and run once more; one that fails again ends the session.

    Parameters
    ----------
    setup : LiveSetup
    requests : sequence of TrialRequest
        Each with a trial id of its own.
    output : Output
    live : list of LiveTrial, optional
        Gets each trial as soon as it is recorded, for who must know them if this raises.

    Raises
    ------
    TactileError
        When a node cannot be started, a topic has no publisher, a trial fails twice, or the
        recording has failed: no trial is run that would not be recorded.
    """
    live = [] if live is None else live
    simulated_rig = setup.simulated_rig
    if simulated_rig is not None:
        for request in requests:
            simulated_rig.check_mount(request.protocol, request.object_label, request.contact)
    rig = None
    try:
        with live_rig(setup, output) as rig:
            for number, request in enumerate(requests, 1):
                rig.operator.tell_progress(number, len(requests), request)
                if simulated_rig is not None:
                    simulated_rig.mount(request.protocol, request.object_label, request.contact)
                try:
                    live.append(run_with_second_try(rig, request, output))
                except TactileError as error:
                    if simulated_rig is not None and (burden := describe_load()):
                        raise TactileError(f'{error} {burden}') from error
                    raise
                output.say(describe_trial(live[-1]))
    finally:
        if rig is not None:
            print_audits(rig.recorder.audits, output)
    return live


def run_with_second_try(rig: LiveRig, request: TrialRequest, output: Output) -> LiveTrial:
    """Run a trial, once more if it fails, and not if somebody has stopped it."""
    try:
        return rig.run(request)
    except StoppedError:
        raise
    except TactileError as error:
        check_recording(rig.recorder)
        output.say(f'   {error}; once more')
        return rig.run(replace(request, trial_id=f'{request.trial_id}-again'))


def describe_load() -> str:
    """Return that this computer may be too busy for live trials; empty where it is not."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load <= cores:
        return ''
    return (
        f'This computer is busy (load {load:.1f}, {cores} cores), and live trials keep real time; '
        'try again when less runs beside them.'
    )


def wait_until_matched(recorder: Any) -> None:
    """Wait until every recorded topic has its publisher."""
    deadline = time.monotonic() + recorder.config.match_timeout_s
    while missing := recorder.unmatched_topics():
        if time.monotonic() > deadline:
            raise TactileError(f'no publisher on {", ".join(missing)}; not recording without it')
        time.sleep(0.02)


def check_recording(recorder: Any) -> None:
    """Raise `TactileError` when the recording has failed: a trial without it is worthless."""
    if recorder.has_failed:
        raise TactileError(recorder.failure)


def describe_trial(trial: LiveTrial) -> str:
    """Return a line with what was under the finger and the answer, and one a further model."""
    request = trial.request
    what = f'   {request.protocol:9} {request.contact:9} true {request.object_label:13}'
    if not trial.answers:
        return f'{what} recorded'
    lines = []
    for answer in trial.answers:
        if answer.outcome != Outcome.LABEL:
            line = f'{what} no answer: {answer.reason}'
        else:
            right = trial.is_label(answer)
            verdict = '[green]right[/green]' if right else '[red]wrong[/red]'
            score = f'{max(answer.scores):.2f} {answer.score_kind}'
            line = f'{what} says {answer.label:13} ({score}) {verdict}'
        lines.append(line if len(trial.answers) == 1 else f'{line}  {answer.model_id}')
    return '\n'.join(lines)
