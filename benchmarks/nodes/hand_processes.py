# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The processes of the benchmark of a hand: nodes under test, publisher, sink."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import threading
import time
from typing import Any

from builtin_interfaces.msg import Time
import numpy as np
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from tactile_bringup.nodes.finger_node import connect_fingers
from tactile_bringup.nodes.graph_runner import ros_context
from tactile_classifier.tactile_classifier_node import TactileClassifierNode
from tactile_features.config import FeatureConfig
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_msgs.msg import Classification, StrainBlock, TactileFeatures, TrialEvent
from tactile_ros.node_group import NodeGroup
from tactile_ros.qos import EVENTS, RESULTS, STREAM
from tactile_ros.strain import StrainBlock as StrainRecord
from tendon_sensor_driver.conversions import to_strain_msg

STRAIN, TRIALS = 'tendon_sensor/strain', 'trial_runner/events'
FEATURES, ANSWER = 'tactile_features/features', 'tactile_classifier/classification'
STARTUP_S = 60.0
DRAIN_S = 1.0


@dataclass(frozen=True)
class Case:
    """A rate, and how its samples are grouped."""

    name: str
    rate_hz: int
    block: int
    blocks_a_window: int

    @property
    def period_ns(self) -> int:
        return round(1e9 / self.rate_hz)

    @property
    def samples_a_window(self) -> int:
        return self.block * self.blocks_a_window

    def feature_config(self) -> FeatureConfig:
        """Return the configuration whose texture window is this case's."""
        return FeatureConfig(**self.feature_parameters())

    def feature_parameters(self) -> dict[str, Any]:
        """Return the feature node's parameters: windows without crops, one after the other."""
        return {
            'rate_hz': float(self.rate_hz),
            'texture_samples': self.samples_a_window,
            'texture_crop_start_s': 0.0,
            'texture_crop_end_s': 0.0,
            'measures': False,  # milliseconds of arithmetic a window, which are not the path's
            'stiffness_min_s': 0.5,
            'buffer_s': 20.0,
        }


@dataclass(frozen=True)
class Work:
    """Work of a process: ours or the bare chain.

    ``within``: the sources of the samples are nodes of the same process, as a driver is.
    """

    domain: int
    who: str
    case: Case
    model: str
    within: bool = False


def work(
    what: Work,
    fingers: Sequence[str],
    ready: Any,
    go: Any,
    over: Any,
    reports: Any,
    seconds: float,
    sent: Any,
) -> None:
    """Run the nodes of some fingers until it is over; report CPU time and memory."""
    make = _our_nodes if what.who == 'ours' else _bare_nodes
    with ros_context(what.domain) as context:
        nodes = [node for finger in fingers for node in make(what, finger, context)]
        sources: dict[str, Callable[[StrainRecord], None]] = {}
        if what.within and what.who == 'ours':
            features = [node for node in nodes if isinstance(node, TactileFeaturesNode)]
            sources = {f: n.add_block for f, n in zip(fingers, features, strict=True)}
        with NodeGroup(nodes, context=context):
            ready.release()
            if what.within:
                threading.Thread(
                    target=_publish,
                    args=(what, fingers, seconds, go, over, sent, context, sources),
                    daemon=True,
                ).start()
            go.wait(2 * STARTUP_S)
            before_s = time.process_time()
            over.wait()
            reports.put(
                {
                    'cpu_s': time.process_time() - before_s,
                    'rss_mb': _resident_mb(),
                }
            )


def _our_nodes(what: Work, finger: str, context: Context) -> list[Any]:
    models = {'models': what.model}
    of_features = {**what.case.feature_parameters(), **models}
    nodes: list[Any] = [
        TactileFeaturesNode(
            namespace=finger, context=context, parameter_overrides=_overrides(of_features)
        ),
        TactileClassifierNode(
            namespace=finger, context=context, parameter_overrides=_overrides(models)
        ),
    ]
    connect_fingers(nodes)
    nodes[0].is_fed_by_calls = what.within
    for node in nodes:
        node.get_logger().set_level(LoggingSeverity.ERROR)
        if not node.bring_up():
            raise RuntimeError(f'{node.get_name()} did not start')
    return nodes


def _overrides(values: dict[str, Any]) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


def _bare_nodes(what: Work, finger: str, context: Context) -> list[Any]:
    """Two relays with our types and sizes, that compute nothing."""
    case = what.case
    features, classifier = (
        Node(name, namespace=finger, context=context)
        for name in ('tactile_features', 'tactile_classifier')
    )
    features_out = features.create_publisher(TactileFeatures, FEATURES, RESULTS)
    answers_out = classifier.create_publisher(Classification, ANSWER, RESULTS)
    values = [0.0] * (case.samples_a_window // 2 + 1)
    labels, scores = [f'plate {i}' for i in range(8)], [0.0] * 8
    count = 0

    def on_block(message: Any) -> None:
        nonlocal count
        count += 1
        if count % case.blocks_a_window == 0:
            last_ns = _to_ns(message.header.stamp) + (case.block - 1) * case.period_ns
            features_out.publish(TactileFeatures(values=values, window_end=_to_time(last_ns)))

    def on_features(message: Any) -> None:
        answers_out.publish(
            Classification(window_end=message.window_end, labels=labels, scores=scores)
        )

    features.create_subscription(StrainBlock, STRAIN, on_block, STREAM)
    classifier.create_subscription(TactileFeatures, FEATURES, on_features, RESULTS)
    return [features, classifier]


def _resident_mb() -> float:
    with open('/proc/self/status', encoding='ascii') as status:
        line = next(line for line in status if line.startswith('VmRSS'))
    return int(line.split()[1]) / 1024


def publish(
    what: Work, fingers: Sequence[str], seconds: float, go: Any, over: Any, sent: Any
) -> None:
    """Publish windows for all fingers in real time; report when each was complete."""
    with ros_context(what.domain) as context:
        _publish(what, fingers, seconds, go, over, sent, context, {})


def _publish(
    what: Work,
    fingers: Sequence[str],
    seconds: float,
    go: Any,
    over: Any,
    sent: Any,
    context: Context,
    sources: dict[str, Callable[[StrainRecord], None]],
) -> None:
    case = what.case
    published: dict[tuple[str, int], int] = {}
    node = Node('publisher', context=context)
    trials = {f: node.create_publisher(TrialEvent, f'{f}/{TRIALS}', EVENTS) for f in fingers}
    wanted = list(trials.values()) if what.who == 'ours' else []
    send = dict(sources)
    for finger in fingers if not sources else ():
        strain = node.create_publisher(StrainBlock, f'{finger}/{STRAIN}', STREAM)
        send[finger] = lambda record, strain=strain: strain.publish(_to_message(record))
        wanted.append(strain)
    deadline_s = time.monotonic() + STARTUP_S
    while not all(p.get_subscription_count() for p in wanted):
        if over.is_set() or time.monotonic() > deadline_s:
            return
        time.sleep(0.01)
    time.sleep(2 * DRAIN_S)  # answers must find their way, too
    go.set()
    block_s = case.block / case.rate_hz
    tension_n = np.random.default_rng(6).normal(5.0, 0.1, case.block)
    windows = round(seconds / block_s / case.blocks_a_window)
    next_s, first_ns = time.monotonic(), time.time_ns()
    for number in range(windows * case.blocks_a_window):
        next_s += block_s
        time.sleep(max(0.0, next_s - time.monotonic()))
        window, place = divmod(number, case.blocks_a_window)
        sequence = number * case.block
        start_ns = first_ns + sequence * case.period_ns
        end_ns = start_ns + (case.block - 1) * case.period_ns
        record = StrainRecord(start_ns, sequence, case.period_ns, tension_n)
        for finger in fingers:
            if place == 0:
                trials[finger].publish(make_event(start_ns, window, 'glide'))
            if place == case.blocks_a_window - 1:
                trials[finger].publish(make_event(end_ns, window, 'done'))
                published[finger, end_ns] = time.time_ns()
            send[finger](record)
    time.sleep(DRAIN_S)
    sent.put(published)
    over.wait(STARTUP_S)
    node.destroy_node()


def _to_message(block: StrainRecord) -> StrainBlock:
    return to_strain_msg(block, '')


def make_event(stamp_ns: int, window: int, phase: str) -> Any:
    return TrialEvent(
        header=Header(stamp=_to_time(stamp_ns)),
        trial_id=f'w{window}',
        protocol='texture',
        contact='flexion',
        phase=phase,
    )


def collect(what: Work, fingers: Sequence[str], ready: Any, over: Any, sunk: Any) -> None:
    """Note when each answer came, by finger and end of window."""
    arrived: dict[tuple[str, int], int] = {}
    with ros_context(what.domain) as context:
        node = Node('sink', context=context)
        for finger in fingers:

            def on_answer(message: Any, finger: str = finger) -> None:
                if message.outcome != Classification.OUTCOME_NO_FEATURES:
                    arrived[finger, _to_ns(message.window_end)] = time.time_ns()

            node.create_subscription(Classification, f'{finger}/{ANSWER}', on_answer, RESULTS)
        executor = EventsExecutor(context=context)  # it adds least to the latency
        executor.add_node(node)
        ready.release()
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
