# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sensor nodes, from bytes to published blocks: processor time, loss and latency."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack
import multiprocessing
import os
from pathlib import Path
import sys
import threading
import time
import tty
from typing import Any

from domain_coordinator import domain_id
import numpy as np
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from benchmarks.measuring import Report, Row
from tactile_bringup.nodes.graph_runner import ros_context
from tactile_msgs.msg import StrainBlock
from tactile_ros.qos import STREAM
from tendon_sensor_driver.line_sensor import encode_reading
from tendon_sensor_driver.tendon_sensor_node import TendonSensorNode

sys.path.append(str(Path(__file__).parents[2] / 'src/tendon_sensor_driver/test/peers'))
from net_ft_device import HOST, NetFtBox, NetFtDevice

STARTUP_S = 20.0
SETTLE_S = 1.0
BLOCK_HZ = 100


def run_sensors(quick: bool) -> Report:
    """Measure the sensor node with lines of text at two rates, then with one and five Net F/T."""
    seconds = 3.0 if quick else 8.0
    with domain_id() as domain:
        rows = [
            _measure_lines(int(domain), rate_hz, samples_per_block, seconds)
            for rate_hz, samples_per_block in ((60, 1), (1000, 10))
        ]
        rows += [_measure_net_ft(int(domain), sensors, seconds) for sensors in (1, 5)]
    return Report(
        'sensor node: bytes to published blocks and wrenches, another process subscribing',
        '',
        'samples lost. Processor time of the process with the nodes; 7 kHz: simulated Net F/T',
        rows,
    )


def _measure_lines(domain: int, rate_hz: int, samples_per_block: int, seconds: float) -> Row:
    count = round(rate_hz * seconds) // samples_per_block * samples_per_block
    sent_s: dict[int, float] = {}
    with ExitStack() as stack:
        master, slave = os.openpty()
        stack.callback(os.close, master)
        stack.callback(os.close, slave)
        tty.setraw(slave)
        parameters = {
            'port': os.ttyname(slave),
            'unit': 'N',
            'time_unit_s': 1e-6,
            'rate_hz': float(rate_hz),
            'samples_per_block': samples_per_block,
        }
        child = stack.enter_context(_running_nodes(domain, [parameters]))
        heard = stack.enter_context(_Subscriber(domain, 1))
        heard.wait_for_publishers()
        os.write(master, b'\n')
        writer = threading.Thread(target=_write, args=(master, rate_hz, count, sent_s))
        writer.start()
        deadline_s = time.monotonic() + count / rate_hz + STARTUP_S
        while heard.samples < count and time.monotonic() < deadline_s:
            heard.spin()
        writer.join()
        used = child()
    delays_s = [at_s - sent_s[round(n * 1e3)] for n, at_s in heard.last_samples]
    median, most = 1e3 * np.percentile(delays_s, (50, 99))
    more = {'CPU of a core %': 100 * used, 'median ms': median, 'p99 ms': most}
    case = f'lines, {rate_hz} Hz, {samples_per_block} a block'
    return Row(case, error=count - heard.samples, bound=0, more=more)


def _measure_net_ft(domain: int, sensors: int, seconds: float) -> Row:
    with ExitStack() as stack:
        processes = multiprocessing.get_context('spawn')
        ports, is_over = processes.Queue(), processes.Event()
        boxes = processes.Process(target=_serve_boxes, args=(sensors, ports, is_over))
        boxes.start()
        stack.callback(boxes.join, STARTUP_S)
        stack.callback(is_over.set)
        parameters = [
            {
                'sensor': 'net_ft',
                'host': HOST,
                'rdt_port': rdt_port,
                'http_port': http_port,
                'rate_hz': 7000.0,
                'low_pass_hz': 0,
                'samples_per_block': 7000 // BLOCK_HZ,
            }
            for rdt_port, http_port in ports.get(timeout=STARTUP_S)
        ]
        child = stack.enter_context(_running_nodes(domain, parameters))
        heard = stack.enter_context(_Subscriber(domain, sensors))
        heard.wait_for_publishers()
        deadline_s = time.monotonic() + SETTLE_S + seconds
        while time.monotonic() < deadline_s:
            heard.spin()
        used = child()
    more = {'CPU of a core %': 100 * used, 'samples': heard.samples}
    case = f'{sensors} Net F/T, 7 kHz, 70 a block'
    return Row(case, error=heard.lost, bound=0, more=more)


class _Subscriber:
    """Counts the samples of all sensors, and records the arrival time of each block."""

    def __init__(self, domain: int, sensors: int) -> None:
        self._domain, self._sensors = domain, sensors
        self.samples = self.lost = 0
        self.last_samples: list[tuple[float, float]] = []
        self._next: dict[int, int] = {}

    def __enter__(self) -> _Subscriber:
        self._stack = ExitStack()
        context = self._stack.enter_context(ros_context(self._domain))
        self._node = Node('subscriber', context=context)
        for i in range(self._sensors):
            self._node.create_subscription(
                StrainBlock,
                f'/s{i}/tendon_sensor/strain',
                lambda message, i=i: self._take(i, message),
                STREAM,
            )
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        return self

    def __exit__(self, *exception: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._stack.close()

    def spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.1)

    def wait_for_publishers(self) -> None:
        deadline_s = time.monotonic() + STARTUP_S
        topics = [f'/s{i}/tendon_sensor/strain' for i in range(self._sensors)]
        while not all(self._node.count_publishers(topic) for topic in topics):
            if time.monotonic() > deadline_s:
                raise TimeoutError('the sensor nodes do not publish')
            self.spin()
        time.sleep(SETTLE_S)  # wait until the publishers have matched this subscription, too

    def _take(self, sensor: int, message: Any) -> None:
        at_s = time.perf_counter()
        count = len(message.tension_n)
        expected = self._next.get(sensor, message.sequence)
        self.lost += message.sequence - expected
        self._next[sensor] = message.sequence + count
        self.samples += count
        self.last_samples.append((message.tension_n[-1], at_s))


def _write(master: int, rate_hz: int, count: int, sent_s: dict[int, float]) -> None:
    """Write sensor lines at a rate. The tension in a line is the number of the line [mN]."""
    next_s = time.perf_counter()
    for number in range(count):
        next_s += 1 / rate_hz
        time.sleep(max(0.0, next_s - time.perf_counter()))
        line = encode_reading(round(next_s * 1e6), number / 1e3, 'N')
        sent_s[number] = time.perf_counter()
        os.write(master, line)


@contextmanager
def _running_nodes(domain: int, parameters: list[dict[str, Any]]) -> Iterator[Callable[[], float]]:
    """Run sensor nodes in a separate process within the ``with`` block.

    Yield a function that ends the process, and returns its processor time divided by wall time.
    """
    processes = multiprocessing.get_context('spawn')
    load, is_over = processes.Queue(), processes.Event()
    process = processes.Process(target=_serve_nodes, args=(domain, parameters, load, is_over))
    process.start()

    def end() -> float:
        is_over.set()
        return float(load.get(timeout=STARTUP_S))

    try:
        yield end
    finally:
        is_over.set()
        process.join(STARTUP_S)
        process.kill()


def _serve_nodes(domain: int, parameters: list[dict[str, Any]], load: Any, is_over: Any) -> None:
    with ros_context(domain) as context:
        nodes = [
            TendonSensorNode(
                context=context,
                namespace=f's{i}',
                parameter_overrides=[Parameter(name, value=v) for name, v in values.items()],
            )
            for i, values in enumerate(parameters)
        ]
        executor = SingleThreadedExecutor(context=context)
        for node in nodes:
            if not node.bring_up():
                raise RuntimeError('a sensor node does not start')
            executor.add_node(node)
        time.sleep(SETTLE_S)
        wall_s, used_s = time.perf_counter(), time.process_time()
        while not is_over.is_set():
            executor.spin_once(timeout_sec=0.1)
        load.put((time.process_time() - used_s) / (time.perf_counter() - wall_s))
        for node in nodes:
            node.take_down()
        executor.shutdown()


def _serve_boxes(sensors: int, ports: Any, is_over: Any) -> None:
    with ExitStack() as stack:
        force_n = 5.0 + np.sin(np.arange(7000) / 100.0)
        devices = [
            stack.enter_context(NetFtDevice(NetFtBox(force_n, noise_counts=0.0)))
            for _ in range(sensors)
        ]
        ports.put([(device.rdt_port, device.http_port) for device in devices])
        is_over.wait()
