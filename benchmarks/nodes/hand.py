# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Latency of five fingers from samples to classification, and resources of `tactile hand`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
import multiprocessing
import os
from pathlib import Path
import signal
import subprocess
import tempfile
import threading
import time
from typing import Any

from ament_index_python.packages import get_package_prefix
from builtin_interfaces.msg import Time
from domain_coordinator import domain_id
import numpy as np
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from benchmarks.measuring import read_processor_s, Report, Row
from tactile_bringup.nodes.finger_node import connect_fingers
from tactile_bringup.nodes.graph_runner import ros_context
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.spec import spec_for
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_msgs.msg import Classification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.strain import StrainBlock as StrainRecord
from tendon_sensor_driver.conversions import to_strain_msg

STRAIN, TRIALS = 'tendon_sensor/strain', 'trial_runner/events'
FEATURES, ANSWER = 'tactile_features/features', 'tactile_classifier/classification'
FINGERS = tuple(f'finger{i}' for i in range(1, 6))
TURNS = 2
STARTUP_S = 60.0
SETTLE_S = 3.0
DRAIN_S = 1.0

processes = multiprocessing.get_context('spawn')


@dataclass(frozen=True)
class Case:
    """Sample rate, number of samples per block, and number of blocks per window."""

    rate_hz: int
    block: int
    blocks_a_window: int

    @property
    def period_ns(self) -> int:
        return round(1e9 / self.rate_hz)

    def feature_parameters(self) -> dict[str, Any]:
        """Return parameters of the feature node, so that each glide is one whole window."""
        return {
            'rate_hz': float(self.rate_hz),
            'texture_samples': self.block * self.blocks_a_window,
            'texture_crop_start_s': 0.0,
            'texture_crop_end_s': 0.0,
            'stiffness_min_s': 0.5,
            'buffer_s': 20.0,
        }


CASE = Case(rate_hz=60, block=1, blocks_a_window=30)


@dataclass
class Run:
    """Result of one run of the nodes, or of the relays that only pass on messages."""

    latencies_s: list[float]
    wanted: int
    cpu_s: float
    rss_mb: float


def run_hand(quick: bool) -> Report:
    """Measure the nodes alternately with relays that only pass on messages.

    After that, measure `tactile hand`.
    """
    seconds = 3.0 if quick else 8.0
    runs: dict[str, list[Run]] = {'bare': [], 'ours': []}
    with make_model(CASE) as model, domain_id() as domain:
        for _ in range(TURNS):
            for who, done in runs.items():
                done.append(_run(int(domain), who, model, seconds))
        command = _measure_command(int(domain), 3.0 if quick else 20.0)
    ours, bare = (
        np.percentile(np.concatenate([r.latencies_s for r in runs[who]]), (50, 99))
        for who in ('ours', 'bare')
    )
    missing = {who: sum(r.wanted - len(r.latencies_s) for r in runs[who]) for who in runs}
    cpu = {who: 100 * sum(r.cpu_s for r in runs[who]) / (TURNS * seconds) for who in runs}
    chain = Row(
        'one process with the sources',
        error=missing['ours'],
        bound=0,
        floor_error=missing['bare'],
        more={
            'median ms': 1e3 * ours[0],
            'p99 ms': 1e3 * ours[1],
            'floor median ms': 1e3 * bare[0],
            'floor p99 ms': 1e3 * bare[1],
            'CPU %': cpu['ours'],
            'floor CPU %': cpu['bare'],
            'RSS MB': max(r.rss_mb for r in runs['ours']),
            'floor RSS MB': max(r.rss_mb for r in runs['bare']),
        },
    )
    return Report(
        'five fingers at 60 Hz: block of samples to classification',
        'bare rclpy relays of messages with the same types and sizes over two hops, in one '
        'process with the sources. The sink is another process',
        'windows without a classification; a lost sample invalidates its window',
        [chain, command],
    )


def _run(domain: int, who: str, model: str, seconds: float) -> Run:
    """Start a process that receives classifications, then a process of nodes; return the result.

    If ``who`` is ``ours``, these are the nodes of this repository, otherwise relays.
    """
    ready, over = processes.Event(), processes.Event()
    reports, sunk = processes.Queue(), processes.Queue()
    sink = processes.Process(target=_collect, args=(domain, ready, over, sunk))
    nodes = processes.Process(target=_work, args=(domain, who, model, seconds, reports))
    try:
        sink.start()
        if not ready.wait(STARTUP_S):
            raise RuntimeError('a process of the benchmark did not start')
        nodes.start()
        published, cpu_s, rss_mb = reports.get(timeout=seconds + 3 * STARTUP_S)
        over.set()
        arrived = sunk.get(timeout=STARTUP_S)
    finally:
        over.set()
        for process in (sink, nodes):
            if process.pid is not None:
                process.join(STARTUP_S)
                process.kill()
    latencies_s = [(at_ns - published[key]) / 1e9 for key, at_ns in arrived.items()]
    return Run(latencies_s, len(published), cpu_s, rss_mb)


def _work(domain: int, who: str, model: str, seconds: float, reports: Any) -> None:
    """Run the nodes of all fingers, and send them samples.

    Put three values into ``reports``: the completion time of each window, the processor time [s]
    and the memory [MB].
    """
    with ros_context(domain) as context:
        source = Node('source', context=context)
        trials = {f: source.create_publisher(TrialEvent, f'{f}/{TRIALS}', EVENTS) for f in FINGERS}
        nodes: list[Any] = []
        send: dict[str, Callable[[StrainRecord], None]] = {}
        wanted = list(trials.values()) if who == 'ours' else []
        for finger in FINGERS:
            if who == 'ours':
                features, classifier = _our_nodes(model, finger, context)
                nodes += [features, classifier]
                send[finger] = features.add_block
            else:
                nodes += _bare_nodes(finger, context)
                strain = source.create_publisher(StrainBlock, f'{finger}/{STRAIN}', STREAM)
                send[finger] = partial(_send, strain)
                wanted.append(strain)
        with NodeGroup(nodes, context=context):
            deadline_s = time.monotonic() + STARTUP_S
            while not all(p.get_subscription_count() for p in wanted):
                if time.monotonic() > deadline_s:
                    raise TimeoutError('the nodes do not subscribe')
                time.sleep(0.01)
            time.sleep(2 * DRAIN_S)  # wait until the other process has matched the publishers
            before_s = time.process_time()
            published = _publish(seconds, trials, send)
            reports.put((published, time.process_time() - before_s, memory_mb(os.getpid())[0]))
        source.destroy_node()


def _our_nodes(model: str, finger: str, context: Context) -> list[Any]:
    models = {'models': model}
    nodes: list[Any] = [
        kind(
            namespace=finger,
            context=context,
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()],
        )
        for kind, values in (
            (TactileFeaturesNode, CASE.feature_parameters() | models),
            (TactileClassifierNode, models),
        )
    ]
    connect_fingers(nodes)
    nodes[0].is_fed_by_calls = True
    for node in nodes:
        node.get_logger().set_level(LoggingSeverity.ERROR)
        if not node.bring_up():
            raise RuntimeError(f'{node.get_name()} did not start')
    return nodes


def _bare_nodes(finger: str, context: Context) -> list[Any]:
    """Return two nodes that pass on messages of the same types and sizes without computing."""
    features, classifier = (
        Node(name, namespace=finger, context=context)
        for name in ('tactile_features', 'tactile_classifier')
    )
    features_out = features.create_publisher(TactileFeatures, FEATURES, RESULTS)
    answers_out = classifier.create_publisher(Classification, ANSWER, RESULTS)
    values = [0.0] * (CASE.block * CASE.blocks_a_window // 2 + 1)
    labels, scores = [f'plate {i}' for i in range(8)], [0.0] * 8
    count = 0

    def on_block(message: Any) -> None:
        nonlocal count
        count += 1
        if count % CASE.blocks_a_window == 0:
            last_ns = _to_ns(message.header.stamp) + (CASE.block - 1) * CASE.period_ns
            features_out.publish(TactileFeatures(values=values, window_end=_to_time(last_ns)))

    def on_features(message: Any) -> None:
        answers_out.publish(
            Classification(window_end=message.window_end, labels=labels, scores=scores)
        )

    features.create_subscription(StrainBlock, STRAIN, on_block, STREAM)
    classifier.create_subscription(TactileFeatures, FEATURES, on_features, RESULTS)
    return [features, classifier]


def _publish(
    seconds: float, trials: dict[str, Any], send: dict[str, Callable[[StrainRecord], None]]
) -> dict[tuple[str, int], int]:
    """Send the samples and events of all fingers in real time.

    Return the time at which each window was complete [ns], by finger and end of the window.
    """
    published: dict[tuple[str, int], int] = {}
    block_s = CASE.block / CASE.rate_hz
    tension_n = np.random.default_rng(6).normal(5.0, 0.1, CASE.block)
    windows = round(seconds / block_s / CASE.blocks_a_window)
    next_s, first_ns = time.monotonic(), time.time_ns()
    for number in range(windows * CASE.blocks_a_window):
        next_s += block_s
        time.sleep(max(0.0, next_s - time.monotonic()))
        window, place = divmod(number, CASE.blocks_a_window)
        sequence = number * CASE.block
        start_ns = first_ns + sequence * CASE.period_ns
        end_ns = start_ns + (CASE.block - 1) * CASE.period_ns
        record = StrainRecord(start_ns, sequence, CASE.period_ns, tension_n)
        for finger in FINGERS:
            if place == 0:
                trials[finger].publish(make_event(start_ns, window, 'glide'))
            if place == CASE.blocks_a_window - 1:
                trials[finger].publish(make_event(end_ns, window, 'done'))
                published[finger, end_ns] = time.time_ns()
            send[finger](record)
    time.sleep(DRAIN_S)
    return published


def _send(publisher: Any, record: StrainRecord) -> None:
    publisher.publish(to_strain_msg(record, ''))


def make_event(stamp_ns: int, window: int, phase: str) -> Any:
    return TrialEvent(
        header=Header(stamp=_to_time(stamp_ns)),
        trial_id=f'w{window}',
        protocol='texture',
        contact='flexion',
        phase=phase,
    )


def _collect(domain: int, ready: Any, over: Any, sunk: Any) -> None:
    """Record the arrival time of each classification, by finger and end of the window."""
    arrived: dict[tuple[str, int], int] = {}
    with ros_context(domain) as context:
        node = Node('sink', context=context)
        for finger in FINGERS:

            def on_answer(message: Any, finger: str = finger) -> None:
                if message.outcome != Classification.OUTCOME_NO_FEATURES:
                    arrived[finger, _to_ns(message.window_end)] = time.time_ns()

            node.create_subscription(Classification, f'{finger}/{ANSWER}', on_answer, RESULTS)
        executor = EventsExecutor(context=context)  # executor with the lowest latency
        executor.add_node(node)
        ready.set()
        while not over.is_set():
            executor.spin_once(timeout_sec=0.2)
        sunk.put(arrived)
        executor.shutdown()
        node.destroy_node()


def _to_ns(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _to_time(stamp_ns: int) -> Any:
    sec, nanosec = divmod(stamp_ns, 10**9)
    return Time(sec=sec, nanosec=nanosec)


@contextmanager
def make_model(case: Case) -> Iterator[str]:
    """Create a model file for the sample rate and window length of a case; yield its path."""
    rng = np.random.default_rng(5)
    labels = np.repeat([f'plate {i}' for i in range(8)], 12)
    config = FeatureConfig(**case.feature_parameters())
    windows = rng.normal(5.0, 0.1, (len(labels), config.texture_samples))
    values = compute_spectrum(windows, config.spectrum_detrend)
    table = FeatureTable(values, labels, spec_for('texture', config))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'model.npz')
        write_model(path, train(table, 'knn'))
        yield str(path)


def _measure_command(domain: int, seconds: float) -> Row:
    """Measure `tactile hand` with simulated sensors."""
    with tempfile.TemporaryDirectory() as scratch:
        models = _make_models(Path(scratch))
        arguments = ('--fingers', 'a,b,c,d,e', '--simulated', '--models', str(models))
        process = subprocess.Popen(
            _tactile('hand', *arguments),
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        assert process.stdout is not None
        try:
            for line in process.stdout:
                if 'Ctrl-C' in line:
                    break
            threading.Thread(target=process.stdout.read, daemon=True).start()
            time.sleep(SETTLE_S)
            before_s, start_s = read_processor_s(process.pid), time.monotonic()
            time.sleep(seconds)
            spent_s = read_processor_s(process.pid) - before_s
            load = spent_s / (time.monotonic() - start_s)
            rss_mb, private_mb = memory_mb(process.pid)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(STARTUP_S)
    more = {'CPU %': 100 * load, 'RSS MB': rss_mb, 'private MB': private_mb}
    return Row('tactile hand, four models', more=more)


def _make_models(folder: Path) -> Path:
    """Train four models on a few SIMULATED trials, and return their folder."""

    def run(*arguments: str) -> None:
        subprocess.run(_tactile(*arguments), check=True, stdout=subprocess.DEVNULL)

    bags = folder / 'bags'
    for protocol in ('texture', 'stiffness'):
        run('simulate', protocol, '-o', str(bags), '--trials', '6', '--jobs', '1')
    recorded = [str(bag) for bag in sorted(bags.iterdir())]
    run('train', *recorded, '-o', str(folder / 'models'), '--classifier', 'knn')
    return folder / 'models'


def _tactile(*arguments: str) -> list[str]:
    """Return the command line of the ``tactile`` program."""
    return [str(Path(get_package_prefix('tactile_lab'), 'bin', 'tactile')), *arguments]


def memory_mb(pid: int) -> tuple[float, float]:
    """Return resident and private memory of a process [MB]."""
    rows = dict(
        line.split()[:2] for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()[1:]
    )
    private_kb = int(rows['Private_Clean:']) + int(rows['Private_Dirty:'])
    return int(rows['Rss:']) / 1024, private_kb / 1024
