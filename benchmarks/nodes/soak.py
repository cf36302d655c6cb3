# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Soak test: five fingers at 1 kHz for an hour, with one fault per minute and a recording.

Five SIMULATED sensors send 1000 lines per second over ptys, in blocks of ten samples. Sensors,
features and classifiers of four fingers and the recorder run in one process, like `tactile hand
--record`. The fifth finger runs in a separate process. Every minute one of three faults occurs, in
rotation: a sensor is unplugged for two seconds, a feature node is cleaned up and activated again,
or the process of the fifth finger is killed and restarted.

    ./tactile run python -m benchmarks.nodes.soak --minutes 60 --plot soak.png

The exit status is 1 in each of these cases: a missing sample was not reported; a trial has no
window, although its process was not killed; a window has no classification; memory grows by 1 MB
per hour or more after the first ten minutes.
"""

from __future__ import annotations

import argparse
from collections import Counter
from itertools import pairwise
import json
import math
import multiprocessing
import os
from pathlib import Path
import sys
import tempfile
import threading
import time
from typing import Any

from domain_coordinator import domain_id
import numpy as np
from rclpy.node import Node

from benchmarks.measuring import read_processor_s
from benchmarks.nodes.hand import Case, FINGERS, make_event, make_model, memory_mb, TRIALS
from tactile_bags.bag_reader import TactileBag
from tactile_bringup.launch_config.graph import NodeDescription
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_msgs.msg import TrialEvent
from tactile_ros.qos import EVENTS
from tactile_ros.strain import StrainStatus
from tactile_ros.topics import CLASSIFICATION, FEATURES, STRAIN
from tactile_sim.pty_server import PtyPort

CASE = Case(rate_hz=1000, block=10, blocks_a_window=20)
BURST = CASE.block
SENSOR = {'rate_hz': 1000.0, 'time_unit_s': 1e-6, 'samples_per_block': CASE.block}
TRIAL_S = 5.0
UNPLUGGED_S = 2.0
KILLED = FINGERS[-1]
START_S = 60.0
SETTLED_S = 600.0
MOST_GROWTH_MB_H = 1.0
MARKED = StrainStatus.RECONNECTED | StrainStatus.RESTARTED | StrainStatus.CLOCK_STEP

processes = multiprocessing.get_context('spawn')


def run_nodes(
    folder: Path, fingers: tuple[str, ...], model: str, domain: int, orders: Any, is_up: Any
) -> None:
    """Run the nodes of some fingers, and restart each node whose name arrives in ``orders``.

    The process of the first four fingers also runs the recorder.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    descriptions = [
        NodeDescription(name, parameters, namespace=finger)
        for finger in fingers
        for name, parameters in (
            ('tendon_sensor', SENSOR | {'port': str(folder / finger)}),
            ('tactile_features', {**CASE.feature_parameters(), 'models': model}),
            ('tactile_classifier', {'models': model}),
        )
    ]
    recorder = {
        'bag': str(folder / 'bag'),
        'namespaces': FINGERS,
        'classifier': True,
        'rig': False,
    }
    if KILLED not in fingers:
        descriptions.append(NodeDescription('bag_recorder', recorder))
    with ros_context(domain) as context, running_graph(descriptions, context, quiet=True) as nodes:
        is_up.set()
        for name in iter(orders.get, None):
            for step in ('deactivate', 'cleanup', 'configure', 'activate'):
                getattr(nodes[name], f'trigger_{step}')()


def _end_with_parent() -> None:
    """End this process if its parent is killed; otherwise it would keep the ports open."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


class Running:
    """A process with the nodes of some fingers."""

    def __init__(self, *what: Any) -> None:
        self.orders, self.is_up = processes.Queue(), processes.Event()
        self.process = processes.Process(target=run_nodes, args=(*what, self.orders, self.is_up))
        self.process.start()

    def wait(self) -> None:
        """Wait until the nodes of the process are active."""
        if not self.is_up.wait(START_S):
            raise RuntimeError('a process of the soak did not start')

    def end(self) -> int | None:
        """End the process, and return its exit code."""
        self.orders.put(None)
        self.process.join(START_S)
        return self.process.exitcode


class Hand:
    """The processes of the nodes, the ports of the sensors, and the injected faults."""

    def __init__(self, folder: Path, model: str, domain: int) -> None:
        self._what = folder, model, domain
        self.ports = {finger: PtyPort(folder / finger) for finger in FINGERS}
        self.main = Running(folder, FINGERS[:-1], model, domain)
        self.fifth = Running(folder, (KILLED,), model, domain)
        for running in (self.main, self.fifth):
            running.wait()
        self._faults: Counter[str] = Counter()
        self._unplugged, self._plug_at_s = '', math.inf
        self.trials_without: set[tuple[str, str]] = set()

    def meet_fault(self, now_s: float) -> None:
        """Inject the next fault: unplug a sensor, restart a feature node, or kill a process."""
        turn, kind = divmod(self._faults.total(), 3)
        finger = FINGERS[turn % 4]
        if kind == 0:
            self.ports[finger].close()
            self._unplugged, self._plug_at_s = finger, now_s + UNPLUGGED_S
        elif kind == 1:
            self.main.orders.put(f'{finger}/tactile_features')
        else:
            self.fifth.process.kill()
            self.fifth = Running(self._what[0], (KILLED,), *self._what[1:])
        self._faults[('unplugged', 'taken down', 'killed')[kind]] += 1

    def look(self, now_s: float, trial: int) -> None:
        """Plug a sensor in again when its time is over; note trials without a running process."""
        if now_s > self._plug_at_s:
            self.ports[self._unplugged].open()
            self._plug_at_s = math.inf
        if not self.fifth.is_up.is_set():
            self.trials_without.add((KILLED, f'w{trial}'))

    def end(self) -> dict[str, int]:
        """End the processes; return the number of faults of each kind, and the exit code."""
        codes = [abs(running.end() or 0) for running in (self.main, self.fifth)]
        for port in self.ports.values():
            port.close()
        return {**self._faults, 'exit code': max(codes)}


def soak(minutes: float, fault_s: float, folder: Path) -> dict[str, Any]:
    """Run the soak test; return memory and CPU over time, and the contents of the recording."""
    with make_model(CASE) as model, domain_id() as domain, ros_context(int(domain)) as context:
        hand = Hand(folder, model, int(domain))
        node = Node('operator', context=context)
        trials = {f: node.create_publisher(TrialEvent, f'{f}/{TRIALS}', EVENTS) for f in FINGERS}
        trial_count, series = _feed(minutes, fault_s, hand, trials)
        faults = hand.end()
        node.destroy_node()
    found = count_recording(folder / 'bag', trial_count, hand.trials_without)
    return {'series': series, 'found': found, 'faults': faults}


def _feed(
    minutes: float, fault_s: float, hand: Hand, trials: dict[str, Any]
) -> tuple[int, list[dict[str, float]]]:
    """Send sensor lines and trial events, and inject faults, in real time.

    Return the number of trials, and a series of measurements of memory and processor time.
    """
    rng = np.random.default_rng(15)
    series: list[dict[str, float]] = []
    pid = hand.main.process.pid
    assert pid is not None
    start_s, number, trial = time.monotonic(), 0, 0
    next_trial_s, next_fault_s, next_look_s, is_gliding = 2.0, fault_s / 2, 0.0, False
    while (now_s := time.monotonic() - start_s) < 60 * minutes:
        values = 0.5 + 0.01 * rng.standard_normal((len(hand.ports), BURST))
        for port, row in zip(hand.ports.values(), values, strict=True):
            if port.is_open:
                lines = (f'{1000 * (number + i)},{v:.5f},kg,\r\n' for i, v in enumerate(row))
                port.write(''.join(lines).encode('ascii'))
        number += BURST
        if now_s > next_trial_s:
            phase = 'done' if is_gliding else 'glide'
            for publisher in trials.values():
                publisher.publish(make_event(time.time_ns(), trial, phase))
            trial += is_gliding
            is_gliding = not is_gliding
            next_trial_s += 0.5 if is_gliding else TRIAL_S - 0.5
        if now_s > next_fault_s:
            hand.meet_fault(now_s)
            next_fault_s += fault_s
        hand.look(now_s, trial)
        if now_s > next_look_s:
            rss_mb, private_mb = memory_mb(pid)
            series.append(
                {
                    's': now_s,
                    'rss_mb': rss_mb,
                    'private_mb': private_mb,
                    'cpu_s': read_processor_s(pid),
                }
            )
            next_look_s += 10.0
        time.sleep(max(0.0, start_s + number / CASE.rate_hz - time.monotonic()))
    time.sleep(3.0)  # wait for the time-out of the last window
    return trial, series


def count_recording(path: Path, trials: int, excused: set[tuple[str, str]]) -> dict[str, int]:
    """Count the contents of a recording, and the missing samples that were not reported.

    A gap in the sequence numbers must be reported by the field ``lost_before`` of the next block,
    and a gap in time by ``lost_before`` or by ``status``. If sequence numbers restart, the process
    of the sensor was restarted. ``excused`` has the trials during which a process was not running.
    """
    counts: Counter[str] = Counter()
    windows: set[tuple[str, str]] = set()
    answers: set[tuple[str, str]] = set()
    ends: dict[str, tuple[int, int]] = {}
    with TactileBag(path) as bag:
        for message in bag.messages(STRAIN, FEATURES, CLASSIFICATION):
            data, finger = message.decode(), message.topic.split('/')[1]
            if message.type_name == STRAIN:
                stamp_ns = data.header.stamp.sec * 10**9 + data.header.stamp.nanosec
                size, first = len(data.tension_n), int(data.sequence - data.lost_before)
                sequence, end_ns = ends.get(finger, (first, stamp_ns))
                gap = round((stamp_ns - end_ns) / data.period_ns)
                counts['samples'] += size
                counts['lost and reported'] += int(data.lost_before)
                if first < sequence:
                    counts['sequence restarts'] += 1
                    counts['lost while killed'] += gap
                else:
                    counts['unaccounted'] += first - sequence
                    is_told = data.lost_before or data.status & MARKED
                    if not is_told and stamp_ns - end_ns > data.period_ns:
                        counts['unaccounted'] += gap
                ends[finger] = (
                    int(data.sequence) + size,
                    int(stamp_ns + size * data.period_ns),
                )
            elif message.type_name == FEATURES:
                counts['windows of features'] += data.outcome == 0
                counts['windows refused with a reason'] += data.outcome != 0 and bool(data.reason)
                windows.add((finger, data.trial_id))
            else:
                answers.add((finger, data.trial_id))
    expected = {(finger, f'w{trial}') for finger in FINGERS for trial in range(trials)}
    counts['trials'] = len(expected)
    counts['trials with a window'] = len(windows)
    counts['trials without: their process was killed'] = len((expected - windows) & excused)
    counts['trials without a window'] = len(expected - windows - excused)
    counts['windows without an answer'] = len(windows - answers - excused)
    return {name: int(value) for name, value in counts.items()}


def memory_growth_mb_h(series: list[dict[str, float]]) -> float:
    """Return the growth of private memory after the first ten minutes [MB/h].

    It is NaN if the run was shorter.
    """
    late = [(row['s'], row['private_mb']) for row in series if row['s'] > SETTLED_S]
    if len(late) < 6:
        return math.nan
    times_s, private_mb = np.array(late).T
    return float(3600 * np.polyfit(times_s, private_mb, 1)[0])


def draw(series: list[dict[str, float]], path: Path) -> None:
    """Draw memory and processor load over the duration of the test."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout='constrained')
    upper, lower = figure.subplots(2, 1, sharex=True)
    minutes = [row['s'] / 60 for row in series]
    upper.plot(minutes, [row['rss_mb'] for row in series], label='resident')
    upper.plot(minutes, [row['private_mb'] for row in series], label='private')
    upper.set(ylabel='memory [MB]', ylim=(0, None), title='Five SIMULATED fingers at 1 kHz')
    upper.legend()
    shares = [100 * (b['cpu_s'] - a['cpu_s']) / (b['s'] - a['s']) for a, b in pairwise(series)]
    lower.plot(minutes[1:], shares)
    lower.set(xlabel='time [min]', ylabel='CPU [% of a core]', ylim=(0, None))
    figure.savefig(path, dpi=120)


def main() -> int:
    """Run the soak test."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--minutes', type=float, default=60.0, help='duration [default: 60]')
    parser.add_argument(
        '--fault-every', type=float, default=60.0, help='seconds between faults [default: 60]'
    )
    parser.add_argument('--plot', type=Path, help='PNG file for a plot of memory and CPU time')
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='soak_') as scratch:
        result = soak(arguments.minutes, arguments.fault_every, Path(scratch))
    growth_mb_h = memory_growth_mb_h(result['series'])
    found, faults = result['found'], result['faults']
    document = {**found, **faults, 'growth MB/h': growth_mb_h}
    sys.stdout.write(json.dumps(document, indent=1) + '\n')
    if arguments.plot:
        draw(result['series'], arguments.plot)
    bad = (
        found['unaccounted'],
        found['trials without a window'],
        found['windows without an answer'],
        found.get('sequence restarts', 0) != faults.get('killed', 0),
        faults['exit code'],
        growth_mb_h >= MOST_GROWTH_MB_H,
    )
    return int(any(bad))


if __name__ == '__main__':
    sys.exit(main())
