# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""From publish to callback over DDS, between two processes."""

from __future__ import annotations

import multiprocessing
import time
from typing import Any

from builtin_interfaces.msg import Time
from domain_coordinator import domain_id
import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header

from benchmarks.measuring import Report, Row
from tactile_bringup.nodes.graph_runner import ros_context
from tactile_features.tactile_features_node import TactileFeaturesNode
from tactile_msgs.msg import StrainBlock
from tactile_ros.qos import STREAM

TOPIC = 'tendon_sensor/strain'
TURNS = 2
STARTUP_S = 20.0


def run_messages(quick: bool) -> Report:
    """Measure latencies, bare subscriber and features node in turns."""
    rows = []
    with domain_id() as domain:
        for rate_hz, seconds in ((60, 5.0), (1000, 2.0)):
            count = round(rate_hz * seconds / (3 if quick else 1))
            latencies: dict[str, list[float]] = {'bare': [], 'node': []}
            for _ in range(TURNS):
                for who in latencies:
                    latencies[who] += _receive(who, int(domain), rate_hz, count)
            bare = np.percentile(latencies['bare'], (50, 99))
            node = np.percentile(latencies['node'], (50, 99))
            lost = 2 * TURNS * count - sum(map(len, latencies.values()))
            more = {
                'median ratio': node[0] / bare[0],
                'p99 ratio': node[1] / bare[1],
                'node median ms': 1e3 * node[0],
                'node p99 ms': 1e3 * node[1],
                'floor median ms': 1e3 * bare[0],
                'floor p99 ms': 1e3 * bare[1],
            }
            rows.append(Row(f'{rate_hz} Hz', None, lost, 0, more=more))
    return Report(
        'message path: publish to callback of a StrainBlock of one sample',
        'a bare rclpy subscriber; ours: the features node, until its extractor has the sample. '
        'The publisher is another process, the two subscribers take turns',
        'messages lost',
        rows,
    )


def _receive(who: str, domain: int, rate_hz: int, count: int) -> list[float]:
    """Return the latencies of one run [s]."""
    latencies: list[float] = []
    with ros_context(domain) as context:
        if who == 'bare':
            node = Node('bare', context=context)
            node.create_subscription(
                StrainBlock,
                TOPIC,
                lambda msg: latencies.append(_age_s(msg.header.stamp)),
                STREAM,
            )
        else:
            node = TactileFeaturesNode(context=context)
            node.bring_up()
            _note_arrivals(node.extractor, latencies)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        processes = multiprocessing.get_context('spawn')
        is_over = processes.Event()
        publisher = processes.Process(target=publish, args=(domain, rate_hz, count, is_over))
        publisher.start()
        try:
            deadline_s = time.monotonic() + STARTUP_S + count / rate_hz
            while len(latencies) < count and time.monotonic() < deadline_s:
                executor.spin_once(timeout_sec=0.1)
        finally:
            is_over.set()
            publisher.join(STARTUP_S)
            publisher.kill()
            executor.shutdown()
            node.destroy_node() if who == 'bare' else node.take_down()
    return latencies


def _note_arrivals(extractor: Any, latencies: list[float]) -> None:
    """Let the extractor note how old each block is once it has taken it in."""
    add_block = extractor.add_block

    def add_and_note(block: Any) -> Any:
        windows = add_block(block)
        latencies.append((time.time_ns() - block.stamp_ns) / 1e9)
        return windows

    extractor.add_block = add_and_note


def _age_s(stamp: Any) -> float:
    return (time.time_ns() - (stamp.sec * 10**9 + stamp.nanosec)) / 1e9


def publish(domain: int, rate_hz: int, count: int, is_over: Any) -> None:
    """Publish blocks of one sample at a rate; runs in a process of its own."""
    with ros_context(domain) as context:
        node = Node('publisher', context=context)
        publisher = node.create_publisher(StrainBlock, TOPIC, STREAM)
        deadline_s = time.monotonic() + STARTUP_S
        while not publisher.get_subscription_count():
            if time.monotonic() > deadline_s:
                return
            time.sleep(0.01)
        period_ns = round(1e9 / rate_hz)
        next_s = time.monotonic()
        for sequence in range(count):
            next_s += 1 / rate_hz
            time.sleep(max(0.0, next_s - time.monotonic()))
            sec, nanosec = divmod(time.time_ns(), 10**9)
            publisher.publish(
                StrainBlock(
                    header=Header(stamp=Time(sec=sec, nanosec=nanosec)),
                    sequence=sequence,
                    period_ns=period_ns,
                    tension_n=[5.0],
                )
            )
        is_over.wait(STARTUP_S)  # what was published last may still have to be sent again
        node.destroy_node()
