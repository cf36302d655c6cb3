# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""`tactile replay`: replay a recording and compare the results with the recorded ones."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Optional, TYPE_CHECKING

import typer

from tactile_lab import options
from tactile_lab.output import Output
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_bags import RecordedBag
    from tactile_bags.audit import Audit
    from tactile_bags.replay import ReplayComparison, TactileResults
    from tactile_bringup.launch_config.graph import NodeDescription

POLL_S = 0.1
LINGER_S = 3.0
"""Time for which the live page stays open after the recording has been played [s]."""


class NoFeaturesError(TactileError):
    """A recording has no features, so a replay has nothing to compare with."""


@dataclass(frozen=True)
class ReplayReport:
    """Comparisons of the recording of one finger with its replays.

    The keys of ``comparisons`` name the two compared results, such as "plain core and nodes". If a
    replay differs, the comparisons are those of the first such replay, otherwise of the last
    replay. ``audits`` has an audit of each trial, then one of the whole recording.
    """

    namespace: str
    comparisons: dict[str, 'ReplayComparison']
    audits: 'tuple[Audit, ...]' = ()
    replay_count: int = 1

    @property
    def is_equal(self) -> bool:
        return all(c.is_equal for c in self.comparisons.values())

    def to_dict(self) -> dict[str, Any]:
        """Return the report as a dictionary for JSON."""
        from tactile_bags.audit import summarise_audits

        return {
            'namespace': self.namespace,
            'equal': self.is_equal,
            'replays': self.replay_count,
            'comparisons': {name: asdict(c) for name, c in self.comparisons.items()},
            'audit': summarise_audits(self.audits),
        }


def replay(
    bag: Annotated[
        Path,
        typer.Argument(exists=True, help='The recording: a bag, or the folder of an experiment.'),
    ],
    models: Annotated[
        Optional[Path],
        typer.Option(
            exists=True,
            help='Folder with the model files. Default: the files used during the recording.',
        ),
    ] = None,
    nodes: Annotated[
        bool,
        typer.Option(
            help='Also replay through ROS nodes, not only through the same code without nodes '
            '(the plain core).'
        ),
    ] = True,
    times: Annotated[
        int,
        typer.Option(
            min=1, max=100_000, help='Number of replays; stops after the first difference.'
        ),
    ] = 1,
    watch: options.WatchOption = False,
    as_json: options.JsonOption = False,
) -> None:
    """Run a recording through features and classification again, and compare.

    Prints *equal*, or the first difference between the recorded results and the replay. If there
    is a difference, the exit code is 1. Also prints whether samples of the recording are missing,
    duplicate or out of order. With ``--watch``, the recording is first played in real time on a
    live page.
    """
    output = Output(as_json)
    bags = _list_bags(bag)
    equal = True
    fingers: list[dict[str, Any]] = []
    for path in bags:
        if len(bags) > 1:
            output.say(f'{path}:')
        if watch:
            play_and_watch(path, models, output)
        try:
            reports = replay_and_compare(path, models, through_nodes=nodes, times=times)
        except NoFeaturesError as error:
            if path == bags[-1] and not fingers:
                raise
            output.say(str(error))
            continue
        for report in reports:
            print_report(report, output)
            fingers.append({'bag': str(path), **report.to_dict()})
        equal = equal and all(report.is_equal for report in reports)
    output.result({'bag': str(bag), 'equal': equal, 'fingers': fingers})
    raise typer.Exit(0 if equal else 1)


def _list_bags(path: Path) -> list[Path]:
    """Return the bags with trials in the folder of an experiment; for a bag, the bag itself."""
    from tactile_analysis.trial_set import TrialSet
    from tactile_bags.experiment_journal import is_experiment

    if not is_experiment(path):
        return [path]
    with TrialSet.load(path) as recording:  # omits bags without trials
        return [bag.path for bag in recording.bags]


def play_and_watch(path: Path, models: Optional[Path], output: Output) -> None:
    """Play a bag in real time, and show it on a live page.

    New nodes on a separate ROS domain classify the played samples.
    """
    from contextlib import ExitStack
    import tempfile
    import time

    from domain_coordinator import domain_id

    from tactile_bringup.launch_config.graph import PLAYER
    from tactile_bringup.nodes.graph_runner import ros_context, running_graph  # imports rclpy
    from tactile_lab.running import say_address
    from tactile_lab.watch.access import WatchOptions
    from tactile_lab.watch.watching import watching

    with (
        tempfile.TemporaryDirectory(prefix='tactile_') as scratch,
        domain_id() as domain,
        ros_context(int(domain)) as context,
        watching(context, WatchOptions()) as watch,
        ExitStack() as stack,
    ):
        graph = replay_graph(path, models, Path(scratch))
        nodes = stack.enter_context(running_graph(graph, context, quiet=True))
        say_address(watch, output)
        player = nodes[PLAYER]
        while not player.is_finished:
            player.ending.wait(POLL_S)
        if player.has_failed:
            raise TactileError(f'{path} cannot be played; see the log for the reason')
        time.sleep(LINGER_S)  # so that the last prediction can be seen


def replay_graph(path: Path, models: Optional[Path], scratch: Path) -> 'list[NodeDescription]':
    """Return the nodes that play a recording in real time and classify it."""
    from tactile_bags import TactileBag
    from tactile_bags.recorded_setup import recorded_features
    from tactile_bringup.launch_config.graph import (
        FEATURES_NODE,
        ModelChoice,
        NO_PORT,
        NodeDescription,
        PLAYER,
        player_parameters,
        sensing_graph,
    )

    nodes: list[NodeDescription] = []
    with TactileBag(path) as bag:
        for namespace in bag.namespaces:
            choice = ModelChoice.of_recording(bag, namespace, models, scratch)
            recorded = {FEATURES_NODE: asdict(recorded_features(bag, namespace).config)}
            nodes += sensing_graph(NO_PORT, choice, recorded, namespace=namespace)
    nodes = [replace(n, parameters={**n.parameters, 'use_sim_time': True}) for n in nodes]
    player = player_parameters(path, 1.0)
    return [*nodes, NodeDescription(PLAYER, player)]


def print_report(report: ReplayReport, output: Output) -> None:
    """Print one line for each comparison, and the findings of the audits."""
    finger = f'{report.namespace}: ' if report.namespace else ''
    times = f', {report.replay_count} times' if report.replay_count > 1 else ''
    for name, comparison in report.comparisons.items():
        equal = 'equal, bit for bit' if comparison.is_exact else 'equal, apart from rounding'
        verdict = comparison.first_difference or f'{equal}{times}'
        output.say(
            f'{finger}{name}: {verdict} ({comparison.window_count} feature windows, '
            f'{comparison.classification_count} classifications)'
        )
        if comparison.left_out:
            output.say(f'{finger}{name}, not compared: {comparison.left_out}')
    output.say_audits(report.audits)


def replay_and_compare(
    path: Path, models: Optional[Path], *, through_nodes: bool, times: int = 1
) -> list[ReplayReport]:
    """Replay a bag, and compare the results with the recorded ones.

    The bag is replayed through the plain core, and if ``through_nodes`` is True also through
    nodes. ``models`` is a folder of model files, or one file; None selects the models that were
    used during the recording. Returns a report for each finger.
    """
    import tempfile

    from tactile_bags import RecordedBag
    from tactile_bags.audit import audit_open_bag
    from tactile_bags.recorded_setup import find_models, gather_models

    with RecordedBag(path) as bag, tempfile.TemporaryDirectory(prefix='tactile_') as scratch:
        audits = audit_open_bag(bag)
        return [
            _replay_finger(
                bag,
                namespace,
                models or gather_models(find_models(bag, namespace), Path(scratch)),
                tuple(audit for audit in audits if audit.finger == namespace),
                is_chosen=models is not None,
                through_nodes=through_nodes,
                times=times,
            )
            for namespace in bag.namespaces
        ]


def _replay_finger(
    bag: 'RecordedBag',
    namespace: str,
    models: Optional[Path],
    audits: 'tuple[Audit, ...]',
    *,
    is_chosen: bool,
    through_nodes: bool,
    times: int,
) -> ReplayReport:
    from tactile_bags.recorded_setup import recorded_features, recorded_models, RecordedFeatures
    from tactile_bags.replay import (
        compare,
        compare_with_recorded,
        first_sample_ns,
        recorded_results,
        replay_through_core,
    )
    from tactile_classifier.model_set import ModelSet
    from tactile_features.model_contract import read_contracts

    if through_nodes:
        from domain_coordinator import domain_id

        from tactile_bringup.nodes.graph_runner import ros_context  # imports rclpy
        from tactile_lab.replay_nodes import replay_through_nodes

    features = recorded_features(bag, namespace)
    if is_chosen and models is not None:
        contracts, _ = read_contracts(models)
        features = RecordedFeatures(features.config, tuple(each.spec for each in contracts))
    recorded = recorded_results(bag, namespace)
    _check_has_features(bag, recorded)
    infos = recorded_models(bag, namespace)
    contact = next((info.contact_filter for info in infos), '')
    comparisons: dict[str, ReplayComparison] = {}
    count = 0
    while count < times and all(c.is_equal for c in comparisons.values()):
        count += 1
        loaded = ModelSet.load(models, contact) if models else None
        core = replay_through_core(bag, loaded, features, namespace)
        comparisons['recorded and plain core'] = compare_with_recorded(
            recorded, core, bag.end_ns, first_sample_ns(bag, namespace) or 0
        )
        if through_nodes:
            with domain_id() as domain, ros_context(int(domain)) as context:
                nodes = replay_through_nodes(
                    bag,
                    models,
                    features.config,
                    context,
                    expected=core,
                    namespace=namespace,
                    contact=contact,
                )
            names = ('the core', 'the nodes')
            comparisons['plain core and nodes'] = compare(core, nodes, names)
    return ReplayReport(namespace, comparisons, audits, count)


def _check_has_features(bag: 'RecordedBag', recorded: 'TactileResults') -> None:
    if recorded.windows:
        return
    raise NoFeaturesError(
        f'{bag.path} contains no features, so a replay has nothing to compare with. '
        'No trial ended during the recording, or the bag was written by tactile simulate. '
        'tactile train and tactile evaluate can use it anyway'
    )
