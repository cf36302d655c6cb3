# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rig for live trials: real nodes in this process, with simulated or real devices."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import asdict, dataclass, field, replace
import os
from pathlib import Path
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.node import Node

from tactile_bags.audit import Audit
from tactile_bringup.launch_config.graph import ModelChoice, Ports, recorder_node, rig_graph
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_bringup.nodes.operator_node import OperatorNode, StoppedError
from tactile_bringup.trial_protocols import TrialRequest
from tactile_classifier.types import ModelInfo, PredictionOutcome, WindowPrediction
from tactile_features.conversions import (
    feature_window_from_msg,
    specifications_from_msg,
    strain_block_from_msg,
)
from tactile_features.spec import FeatureSpec
from tactile_features.types import FeatureWindow, WindowOutcome
from tactile_lab.experiment.journal import EntryLog, Progress
from tactile_lab.experiment.loop import (
    Operator,
    summarise_tension,
    TrialLoop,
    TrialOrder,
    TrialResult,
)
from tactile_lab.experiment.plan import ExperimentError, PlannedTrial
from tactile_lab.options import RigOptions
from tactile_lab.output import Output
from tactile_lab.running import open_ports, read_rig_parameters, say_address
from tactile_lab.watch.access import WatchOptions
from tactile_lab.watch.watching import watching
from tactile_msgs.msg import FeatureSpecifications, TactileFeatures
from tactile_msgs.msg import StrainBlock as StrainBlockMsg
from tactile_ros.errors import TactileError
from tactile_ros.lifecycle import MessageGuard
from tactile_ros.qos import LATEST, RESULTS, STREAM
from tactile_ros.strain import StrainBlock
from tactile_ros.topics import FEATURES_TOPIC, SPECIFICATIONS_TOPIC, STRAIN_TOPIC
from tactile_sim.errors import RigError, TautTendonError
from tactile_sim.rig_process import SimulatedRig

WINDOW_TIMEOUT_S = 1.0
"""Longest wait until the feature windows of a trial are recorded [s]."""

AUDIT_TIMEOUT_S = 2.0
"""Longest wait for the audit of a trial [s], which needs the first sample after the trial."""

DEVICES_TIMEOUT_S = 3.0
"""Longest wait for the diagnostics of the devices [s]; they are published once per second."""

FEATURES_TIMEOUT_S = 5.0
"""Longest wait for the feature window of a trial after its end [s]."""

SLACK_TIMEOUT_S = 5.0
"""Longest wait for a slack tendon before a trial on the simulated rig [s].

After a fault, the tendon driver holds the tendon for 2 s and then slackens it."""

DEVICES = ('tendon_sensor', 'linear_guide', 'tendon_actuator')
SETUP_NODES = (*DEVICES, 'trial_runner')
"""Nodes whose parameters are part of an experiment's set-up."""


@dataclass(frozen=True)
class LiveTrial:
    """A trial that was run, with the predictions of the models and the audit of its recording."""

    request: TrialRequest
    answers: tuple[WindowPrediction, ...] = ()
    audit: Audit | None = None

    @property
    def answer(self) -> WindowPrediction | None:
        """The prediction of the first model; None if no model has this task and contact."""
        return self.answers[0] if self.answers else None

    @property
    def is_right(self) -> bool:
        return self.answer is not None and self.is_label(self.answer)

    def is_label(self, answer: WindowPrediction) -> bool:
        """Return True if a prediction equals the label of the object under the finger."""
        return answer.label == self.request.object_label

    def format_answers(self) -> list[str]:
        """Return a text per model: the predicted label and its score, or why there is none."""
        lines = []
        for answer in self.answers:
            several = len(self.answers) > 1
            name = f' ({answer.model_id}, {answer.window_s:.1f} s)' if several else ''
            if answer.outcome != PredictionOutcome.LABEL:
                lines.append(f'no label: {answer.reason}{name}')
                continue
            verdict = 'correct' if self.is_label(answer) else 'wrong'
            score = f'{max(answer.scores):.2f} {answer.score_kind}'
            lines.append(f'predicted {answer.label} ({score}), {verdict}{name}')
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        names = ('trial_id', 'session_id', 'mounting_id', 'protocol', 'contact', 'object_label')
        no_answer = {'answer': '', 'reason': 'no model for this task and contact', 'model_id': ''}
        first, *further = [
            {
                'answer': answer.label,
                'reason': answer.reason,
                'right': self.is_label(answer),
                'model_id': answer.model_id,
            }
            for answer in self.answers
        ] or [{**no_answer, 'right': False}]
        return {
            **{name: getattr(self.request, name) for name in names},
            **first,
            'further_answers': further,
            'audit': self.audit.to_dict() if self.audit else None,
        }


@dataclass(frozen=True)
class LiveSetup:
    """A rig on which trials can be run; `live_rig` starts its nodes.

    Attributes
    ----------
    ports : Ports
        Ports of the devices.
    models : Path or None
        Folder of model files, or one file; None to run without a classifier.
    simulated_rig : SimulatedRig or None
        The simulated rig, which mounts the object of each trial; on a real rig, a person does
        this.
    parameters : dict
        ROS parameters of each node; the keys are the names of the nodes.
    domain_id : int or None
        ROS domain; None for the domain in the environment.
    watch : WatchOptions or None
        Options of the live page; None if no page is served.
    """

    ports: Ports
    models: Path | None
    simulated_rig: SimulatedRig | None
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    domain_id: int | None = None
    watch: WatchOptions | None = None


@contextmanager
def open_rig(
    given: RigOptions, models: Path | None, output: Output, *, seed: int, watch: bool
) -> Iterator[LiveSetup]:
    """Provide the rig for the trials of a command, from its options.

    A simulated rig is started, and ends with the block. Raises `TactileError` when ports are
    missing, or parameters are invalid.
    """
    with ExitStack() as stack:
        ports, simulated_rig = open_ports(given, seed, stack)
        if simulated_rig is not None:
            output.say('SIMULATED rig: no number is a measurement.')
        parameters = read_rig_parameters(given.params, '')
        page = WatchOptions() if watch else None
        yield LiveSetup(ports, models, simulated_rig, parameters, watch=page)


@dataclass(frozen=True)
class LiveRig:
    """A rig whose nodes run in this process. The guide is homed, and the recorder is recording.

    ``models`` are the models that the classifier has loaded. ``nodes`` are the nodes by name.
    """

    operator: OperatorNode
    recorder: Any
    observer: ObserverNode
    models: tuple[ModelInfo, ...] = ()
    nodes: dict[str, Any] = field(default_factory=dict)

    def run(self, request: TrialRequest) -> LiveTrial:
        """Run a trial, and wait for its audit and its predictions.

        Raises `TactileError` when the trial or the recording fails, and `StoppedError` when Stop
        was pressed on a live page.
        """
        listening = [
            model
            for model in self.models
            if model.task == request.protocol and model.contact in ('', request.contact)
        ]
        # Expect one window per specification of the models, or one window if there are no models.
        windows = max(1, len({model.specification_digest for model in listening}))
        wanted = self.recorder.window_count + windows
        try:
            self.operator.run_trial(request)
        finally:
            audit = self.wait_for_audit(request.trial_id)
            # Windows arrive some tenths of a second after a trial, even if it was interrupted. A
            # trial that ended before its hold or glide has no window.
            wait_for(
                lambda: self.recorder.window_count >= wanted or self.recorder.has_failed,
                WINDOW_TIMEOUT_S,
            )
        check_recording(self.recorder)
        names = [model.model_id for model in listening]
        return LiveTrial(request, self.operator.wait_for_answers(request.trial_id, names), audit)

    def wait_for_audit(self, trial_id: str) -> Audit | None:
        """Wait for the audit of a trial, and return it; return None after `AUDIT_TIMEOUT_S`."""

        def find() -> Audit | None:
            audits: list[Audit] = list(self.recorder.audits)
            return next((audit for audit in audits if audit.trial_id == trial_id), None)

        wait_for(lambda: find() is not None or self.recorder.has_failed, AUDIT_TIMEOUT_S)
        return find()

    def read_setup(self) -> dict[str, str]:
        """Return the set-up: parameters of the nodes, and identification of the devices.

        A device is identified by its model and firmware, or by its serial number, as far as it
        provides them.
        """
        devices = self.observer.wait_for_devices(DEVICES)
        found: dict[str, str] = {}
        for name in SETUP_NODES:
            values = asdict(self.nodes[name].config)
            found |= {
                f'{name}.{key}': str(value) for key, value in values.items() if key != 'port'
            }
            # Without a serial number, the identification is the port, which may change.
            if (device := devices.get(name)) and device != values.get('port'):
                found[f'{name} device'] = device
        return found


class ObserverNode(Node):  # type: ignore[misc]
    """Receives the samples and the feature windows of a trial, and the diagnostics of devices.

    The tension in the window of a trial is compared with earlier trials. The methods block, and
    another thread must spin the node.
    """

    def __init__(self, context: Context) -> None:
        super().__init__('trial_observer', context=context)
        self._arrived = threading.Condition()
        self._blocks: list[StrainBlock] = []
        self._windows: dict[str, FeatureWindow] = {}
        # For each task, the specification of the window that is compared with earlier trials.
        self._judged: dict[str, FeatureSpec] = {}
        self._devices: dict[str, str] = {}
        self._is_on = False
        guard = MessageGuard(self)
        for topic, kind, take, qos in (
            (STRAIN_TOPIC.name, StrainBlockMsg, self._on_block, STREAM),
            (FEATURES_TOPIC.name, TactileFeatures, self._on_window, RESULTS),
            (SPECIFICATIONS_TOPIC.name, FeatureSpecifications, self._on_specifications, LATEST),
            ('/diagnostics', DiagnosticArray, self._on_diagnostics, 10),
        ):
            self.create_subscription(kind, topic, guard.wrap(topic, take), qos)

    def _on_block(self, message: StrainBlockMsg) -> None:
        with self._arrived:
            if self._is_on:
                self._blocks.append(strain_block_from_msg(message))

    def _on_window(self, message: TactileFeatures) -> None:
        window = feature_window_from_msg(message)
        with self._arrived:
            judged = {spec.digest for spec in self._judged.values()}
            if self._is_on and window.specification_digest in judged:
                self._windows[window.trial_id] = window
                self._arrived.notify_all()

    def _on_specifications(self, message: FeatureSpecifications) -> None:
        """Choose a specification for each task: the first full one, else the first early one."""
        specs = specifications_from_msg(message).specs
        with self._arrived:
            self._judged = {}
            for spec in sorted(specs, key=lambda spec: spec.is_early):
                self._judged.setdefault(spec.task, spec)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        with self._arrived:
            for status in message.status:
                self._devices[status.name.strip('/')] = status.hardware_id
            self._arrived.notify_all()

    def wait_for_devices(self, names: Sequence[str]) -> dict[str, str]:
        """Wait for the diagnostics of these nodes; return the identification of all devices."""
        with self._arrived:
            self._arrived.wait_for(
                lambda: all(self._devices.get(name) for name in names), DEVICES_TIMEOUT_S
            )
            return dict(self._devices)

    def restart(self, *, is_on: bool) -> None:
        """Discard all data. Receive new data only if ``is_on`` is True.

        Between trials, nothing is received, because a prompt may take hours.
        """
        with self._arrived:
            self._blocks, self._windows, self._is_on = [], {}, is_on

    def end(self, trial_id: str) -> tuple[FeatureWindow | None, NDArray[np.float64]]:
        """Wait for the feature window of a trial; return it with the tension in it [N].

        If no window arrives within `FEATURES_TIMEOUT_S`, return None and an empty array.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: trial_id in self._windows, FEATURES_TIMEOUT_S)
            window = self._windows.get(trial_id)
            values = [
                value
                for block in self._blocks
                for i, value in enumerate(block.tension_n)
                if window is not None
                and window.window_start_ns
                <= block.stamp_ns + i * block.period_ns
                <= window.window_end_ns
            ]
        return window, np.array(values, dtype=np.float64)


@contextmanager
def live_rig(setup: LiveSetup, bag: Path, output: Output) -> Iterator[LiveRig]:
    """Start the nodes of the rig and the recorder, and home the guide.

    The nodes end with the block. ``bag`` is the path of the new bag, which must not exist.
    ``output`` prints the address of the live page.

    Raises `TactileError` when a node cannot be started or a topic has no publisher.
    """
    models = ModelChoice.of_finger(str(setup.models or ''), setup.parameters)
    simulated = setup.simulated_rig is not None
    graph = rig_graph(setup.ports, models, setup.parameters, simulated=simulated)
    graph.append(recorder_node(bag, classifier=models is not None))
    with ExitStack() as stack:
        context = stack.enter_context(ros_context(setup.domain_id))
        watch = None
        if setup.watch is not None:
            watch = stack.enter_context(watching(context, setup.watch, simulated=simulated))
            say_address(watch, output)
        operator = OperatorNode(context, answers=models is not None)
        observer = ObserverNode(context)
        with running_graph(graph, context, others=[operator, observer], quiet=True) as nodes:
            recorder = nodes['bag_recorder']
            operator.trial_config = nodes['trial_runner'].config
            wait_until_matched(recorder)
            # Stop was pressed before the operator node existed.
            if watch is not None and watch.state.was_stopped:
                operator.stop()
            answering = operator.wait_for_models() if models else ()
            operator.home_guide()
            yield LiveRig(operator, recorder, observer, answering, nodes)


def wait_until_matched(recorder: Any) -> None:
    """Wait until the recorder has found a publisher of every recorded topic."""
    if not wait_for(lambda: not recorder.unmatched_topics(), recorder.config.match_timeout_s):
        missing = ', '.join(recorder.unmatched_topics())
        raise TactileError(
            f'nothing is recorded, because these topics have no publisher: {missing}'
        )


def wait_for(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Wait until a condition is true; return False if it is not true after ``timeout_s``."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.02)
    return True


def check_recording(recorder: Any) -> None:
    """Raise `ExperimentError` if the recording has failed; further trials would be lost."""
    if recorder.has_failed:
        raise ExperimentError(recorder.failure)


@dataclass
class LiveTrialBackend:
    """Runs trials on the nodes of a rig; a `tactile_lab.experiment.loop.TrialBackend`.

    Attributes
    ----------
    output : Output
        Prints the address of the live page.
    make_request : callable
        Returns the request to the trial runner for a `TrialOrder`.
    numbers : callable
        Returns the numbers of session, mounting and trial for a `TrialOrder`. They select the
        random deviations of a simulated rig.
    needs_features : bool
        True if a trial without features is unusable.
    trials : dict
        Completely recorded trials; the keys are trial ids.
    audits : list
        Audits of the last session's recording.
    """

    setup: LiveSetup
    output: Output
    make_request: Callable[[TrialOrder], TrialRequest]
    numbers: Callable[[TrialOrder], tuple[int, int, int] | None] = lambda order: None
    needs_features: bool = True
    trials: dict[str, LiveTrial] = field(default_factory=dict)
    audits: list[Audit] = field(default_factory=list)
    _rig: LiveRig | None = None

    @contextmanager
    def session(self, bag: Path) -> Iterator[Callable[[TrialOrder], TrialResult]]:
        try:
            with ExitStack() as stack:
                with self._explained_load():
                    self._rig = stack.enter_context(live_rig(self.setup, bag, self.output))
                yield self.run_trial
        finally:
            if self._rig is not None:
                self.audits = list(self._rig.recorder.audits)
            self._rig = None

    def read_setup(self) -> dict[str, str]:
        return {} if self._rig is None else self._rig.read_setup()

    def run_trial(self, order: TrialOrder) -> TrialResult:
        """Run a trial of a `session`, and check its recording."""
        rig = self._rig
        assert rig is not None
        check_recording(rig.recorder)
        request = self.make_request(order)
        if self.setup.simulated_rig is not None:
            mount(self.setup.simulated_rig, request, self.numbers(order))
        rig.observer.restart(is_on=True)
        try:
            rig.operator.publish_progress(order.number, order.count, request, order.following)
            with self._explained_load():
                trial = rig.run(request)
            window, tension_n = rig.observer.end(order.trial_id)
        except StoppedError as error:  # a person has stopped the trial, so it is not repeated
            raise ExperimentError(str(error)) from error
        finally:
            rig.observer.restart(is_on=False)
            _save(rig.recorder)
        self.trials[order.trial_id] = trial
        return judge(trial, window, summarise_tension(tension_n), self.needs_features)

    @contextmanager
    def _explained_load(self) -> Iterator[None]:
        """If this computer is busy, add this to errors, because it can disturb a simulated rig."""
        try:
            yield
        except (StoppedError, ExperimentError):
            raise
        except TactileError as error:
            if self.setup.simulated_rig is not None and (load := format_load()):
                raise TactileError(f'{error} {load}') from error
            raise


def mount(rig: SimulatedRig, request: TrialRequest, numbers: tuple[int, int, int] | None) -> None:
    """Put the object of a trial under the simulated finger, once the tendon is slack.

    ``numbers`` are session, mounting and trial, see `LiveTrialBackend`. Raises `TactileError` when
    the tendon is still taut after `SLACK_TIMEOUT_S`, or when the rig refuses for another reason.
    """
    deadline_s = time.monotonic() + SLACK_TIMEOUT_S
    while True:
        try:
            rig.mount(request.protocol, request.object_label, request.contact, numbers)
            return
        except RigError as error:
            if not isinstance(error, TautTendonError) or time.monotonic() > deadline_s:
                raise TactileError(str(error)) from error
        time.sleep(0.1)


def _save(recorder: Any) -> None:
    try:
        recorder.save()
    except TactileError as error:
        raise ExperimentError(str(error)) from error


def judge(
    trial: LiveTrial,
    window: FeatureWindow | None,
    statistics: dict[str, float],
    needs_features: bool = True,
) -> TrialResult:
    """Return the result of a trial: whether its recording is usable, and a summary.

    ``statistics`` are those of `summarise_tension`.
    """
    audit = trial.audit
    if audit is None:
        return TrialResult('no sample arrived after the trial, so its recording was not audited')
    if not audit.passed:
        return TrialResult('; '.join(audit.findings))
    parts = [f'{audit.sample_count} samples, complete']
    lack: str | None = None
    if window is None:
        lack = 'the feature node published no window for this trial; see its log for the reason'
    elif window.outcome != WindowOutcome.OK:
        lack = f'no features: {window.reason}'
    if lack is not None:
        if needs_features:
            return TrialResult(lack)
        parts.append(lack)
    if statistics:
        parts.append(f'{statistics["mean_n"]:.2f} N ± {statistics["deviation_n"]:.2g} N')
    parts += trial.format_answers()
    return TrialResult(None, ', '.join(parts), statistics)


def run_live_trials(
    setup: LiveSetup,
    bag: Path,
    requests: Sequence[TrialRequest],
    output: Output,
    live: list[LiveTrial] | None = None,
) -> list[LiveTrial]:
    """Home the guide, run and record the trials, and print a line for each trial.

    Parameters
    ----------
    bag : Path
        Path of the new bag, which must not exist.
    requests : sequence of TrialRequest
        The trials, each with a unique trial id.
    live : list of LiveTrial
        The recorded trials are appended to this list, even if an error occurs later.

    Raises
    ------
    TactileError
        When a node cannot be started, a topic has no publisher, a trial fails twice, or the
        recording has failed.
    """
    live = [] if live is None else live
    rig = setup.simulated_rig
    if rig is not None:
        for request in requests:
            rig.check_mount(request.protocol, request.object_label, request.contact)
    of_trial = {request.trial_id: request for request in requests}
    order = [
        PlannedTrial(r.trial_id, r.session_id, number, number, r.contact, r.object_label)
        for number, r in enumerate(requests, 1)
    ]
    bench = LiveTrialBackend(
        setup,
        output,
        lambda order: replace(of_trial[order.planned.key], trial_id=order.trial_id),
        needs_features=False,
    )
    progress = Progress(order, [])
    loop = TrialLoop(progress, Operator(output), EntryLog())
    try:
        with bench.session(bag) as run_trial:
            for session_id in progress.sessions_left():
                loop.run_session(session_id, run_trial)
    finally:
        kept = (progress.kept(trial.key) for trial in order)
        live += [bench.trials[attempt.trial_id] for attempt in kept if attempt]
        output.say_audits(bench.audits)
    return live


def format_load() -> str | None:
    """Return a warning if this computer may be too busy for live trials, or None."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load <= cores:
        return None
    return (
        f'This computer is busy (load {load:.1f}, {cores} cores), but live trials run in real '
        'time; end other programs and try again.'
    )
