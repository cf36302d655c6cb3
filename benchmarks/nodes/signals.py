# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""SIGINT and SIGTERM at random moments, to every node's program and to one-process commands.

A program must end with exit code 0, without a traceback, however early or late in its life the
signal comes, and whether or not a second one follows.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
import json
import os
from pathlib import Path
import queue
import random
import select
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from ament_index_python.packages import get_package_prefix
from domain_coordinator import domain_id
import numpy as np

from benchmarks.measuring import Report, Row
from tactile_bringup.launch_config.graph import (
    NodeDescription,
    Ports,
    recorder_node,
    rig_graph,
    slip_node,
)
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.spec import spec_for
from tactile_lab.commands.output import Output
from tactile_lab.commands.simulate import make_bags
from tactile_lab.simulation.simulated_bags import SimulationPlan
from tactile_sim.rig_process import SimulatedRig

NODE_RUNS, COMMAND_RUNS = 210, 40
QUICK_RUNS = 4
AT_ONCE = 3
NODE_S, COMMAND_S = 3.0, 8.0
"""A signal counted from the start of the process comes within this time."""
AFTER_LINE_S = 1.0
"""One counted from the first printed line comes within this time after it."""
SECOND_SHARE, SECOND_S = 0.25, 0.3
HANG_S = 30.0
COMMANDS = {
    'tactile rig': ['rig'],
    'tactile sense': ['sense', '--slip'],
    'tactile hand': ['hand', '--fingers', 'index,middle'],
}
CLASSIFIER = 'texture_flexion_classifier'


@dataclass(frozen=True)
class Moment:
    """When signals are sent.

    Attributes
    ----------
    delay_s : float
        From the start of the process, or from its first line.
    second_s : float or None
        When another one follows.
    """

    numbers: tuple[int, int]
    after_line: bool
    delay_s: float
    second_s: float | None


@dataclass(frozen=True)
class End:
    """How a program ended."""

    moment: Moment
    code: int | None
    was_up: bool
    had_ended: bool
    seconds: float
    output: str

    @property
    def kind(self) -> str:
        """One word for the table."""
        if self.code is None:
            return 'hang'
        if not self.was_up:
            return 'too early'
        if self.code:
            return 'exit code'
        return 'traceback' if 'Traceback' in self.output else 'ok'


def run_signals(quick: bool) -> Report:
    """Send the signals, and count what ended how."""
    # A shell starts what runs in the background with SIGINT ignored, and children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    ends: dict[str, list[End]] = {}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        rigs = [stack.enter_context(SimulatedRig(seed)) for seed in range(AT_ONCE)]
        slots: queue.Queue[tuple[SimulatedRig, int]] = queue.Queue()
        for rig in rigs:
            slots.put((rig, int(stack.enter_context(domain_id()))))
        model, bag = _make_model(folder), _make_bag(folder)
        names = [node.name for node in _describe(rigs[0], folder, 0, model, bag)]

        def work(number: int, name: str, moment: Moment) -> tuple[str, End]:
            rig, domain = slots.get()
            try:
                arguments = _arguments(name, rig, folder, number, model, bag)
                return name, _end(arguments, domain, moment)
            finally:
                slots.put((rig, domain))

        plan = _draw_all((*names, *COMMANDS), quick)
        with ThreadPoolExecutor(AT_ONCE) as pool:
            for name, end in pool.map(lambda job: work(*job), plan):
                ends.setdefault(name, []).append(end)
                _tell(name, end, ends)
    rows = [_row(name, of_one) for name, of_one in ends.items()]
    return Report(
        'signals at random moments',
        'none',
        'hangs, exit codes other than 0 and tracebacks; "too early": the program had not run its '
        'first line, so that the signal met the interpreter',
        rows,
    )


def _draw_all(names: Sequence[str], quick: bool) -> list[tuple[int, str, Moment]]:
    """Return a number, the program and the moment of every run, the programs in turns."""
    counts = {name: COMMAND_RUNS if name in COMMANDS else NODE_RUNS for name in names}
    if quick:
        counts = dict.fromkeys(names, QUICK_RUNS)
    moments = {name: _draw(name, count) for name, count in counts.items()}
    turns = sorted(
        ((i + 0.5) / count, name, i) for name, count in counts.items() for i in range(count)
    )
    return [(number, name, moments[name][i]) for number, (_, name, i) in enumerate(turns)]


def _tell(name: str, end: End, ends: dict[str, list[End]]) -> None:
    """Print what went wrong at once, and where the runs are now and then."""
    if end.kind not in ('ok', 'too early'):
        sys.stderr.write(f'{name}: {end.kind} {end.code}, {end.moment}\n{end.output}\n')
    kinds = Counter(end.kind for of_one in ends.values() for end in of_one)
    if sum(kinds.values()) % 100 == 0:
        sys.stderr.write(f'{sum(kinds.values())} signals: {dict(kinds)}\n')


def _draw(name: str, runs: int) -> list[Moment]:
    generator = random.Random(name)
    numbers = (signal.SIGINT, signal.SIGTERM)
    longest_s = COMMAND_S if name in COMMANDS else NODE_S
    moments = []
    for i in range(runs):
        after_line = i % 2 == 1
        moments.append(
            Moment(
                (generator.choice(numbers), generator.choice(numbers)),
                after_line,
                generator.uniform(0.0, AFTER_LINE_S if after_line else longest_s),
                generator.uniform(0.0, SECOND_S) if generator.random() < SECOND_SHARE else None,
            )
        )
    return moments


def _end(arguments: Sequence[str], domain: int, moment: Moment) -> End:
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONFAULTHANDLER': '1'}
    process = subprocess.Popen(
        arguments,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        bufsize=0,
        start_new_session=True,
    )
    assert process.stdout is not None
    if moment.after_line:
        # A quiet node prints nothing: then it is the time from its start, and a while more.
        select.select([process.stdout], [], [], NODE_S)
    time.sleep(moment.delay_s)
    was_up, had_ended = _catches_signals(process.pid), process.poll() is not None
    started_s = time.monotonic()
    process.send_signal(moment.numbers[0])
    if moment.second_s is not None:
        time.sleep(moment.second_s)
        process.send_signal(moment.numbers[1])
    code: int | None
    try:
        output, _ = process.communicate(timeout=HANG_S)
        code = process.returncode
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)  # prints what every thread does
        output, _ = process.communicate(timeout=HANG_S)
        code = None
    text = output.decode(errors='replace')
    return End(moment, code, was_up or had_ended, had_ended, time.monotonic() - started_s, text)


def _catches_signals(pid: int) -> bool:
    try:
        status = Path(f'/proc/{pid}/status').read_text()
    except OSError:
        return False
    fields = dict(line.split(':', 1) for line in status.splitlines())
    caught = int(fields.get('SigCgt', '0'), 16) | int(fields.get('SigIgn', '0'), 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def _row(name: str, ends: Sequence[End]) -> Row:
    kinds = Counter(end.kind for end in ends)
    seconds = sorted(end.seconds for end in ends if end.kind == 'ok')
    early = Counter(str(end.code) for end in ends if end.kind == 'too early')
    return Row(
        name,
        error=float(kinds['hang'] + kinds['exit code'] + kinds['traceback']),
        bound=0.0,
        more={
            'runs': len(ends),
            'ok': kinds['ok'],
            'hangs': kinds['hang'],
            'exit codes': kinds['exit code'],
            'tracebacks': kinds['traceback'],
            'too early': ', '.join(f'{n} x {code}' for code, n in early.items()),
            'had ended': sum(end.had_ended for end in ends),
            'median [s]': seconds[len(seconds) // 2] if seconds else None,
            'longest [s]': seconds[-1] if seconds else None,
        },
    )


def _arguments(
    name: str, rig: SimulatedRig, folder: Path, number: int, model: str, bag: str
) -> list[str]:
    if name in COMMANDS:
        program = Path(get_package_prefix('tactile_lab'), 'bin', 'tactile')
        return [str(program), *COMMANDS[name], '--simulated']
    nodes = {node.name: node for node in _describe(rig, folder, number, model, bag)}
    node = nodes[name]
    program = Path(get_package_prefix(node.package), 'lib', node.package, node.executable)
    arguments = [str(program), '--ros-args', '-r', f'__node:={node.name}']
    for key, value in node.parameters.items():
        if value not in ((), '') and key != 'facts':  # its JSON is no YAML of a command line
            arguments += ['-p', f'{key}:={_yaml(value)}']
    return arguments


def _yaml(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _describe(
    rig: SimulatedRig, folder: Path, number: int, model: str, bag: str
) -> list[NodeDescription]:
    """Return every node with parameters with which it comes up."""
    ports = Ports(rig.ports.guide, rig.ports.tendon, rig.ports.sensor)
    recording = folder / f'recording-{rig.ports.guide.replace("/", "_")}-{number}'
    return [
        *rig_graph(ports, {CLASSIFIER: model}, {}, simulated=True),
        slip_node({}, simulated=True),
        recorder_node(recording, None, (), {}, simulated=True),
        NodeDescription('tactile_bags', 'bag_player_node', 'bag_player', {'bag': bag}),
    ]


def _make_model(folder: Path) -> str:
    rng = np.random.default_rng(5)
    labels = np.repeat([f'plate {i}' for i in range(8)], 12)
    config = FeatureConfig()
    windows = rng.normal(5.0, 0.1, (len(labels), config.texture_samples))
    values = compute_spectrum(windows, config.spectrum_detrend)
    path = folder / 'texture_flexion.onnx'
    write_model(path, train(FeatureTable(values, labels, spec_for('texture', config)), 'knn'))
    return str(path)


def _make_bag(folder: Path) -> str:
    plan = SimulationPlan('texture', 'flexion', 1, 0, 1)
    (bag,) = make_bags(folder / 'bags', [plan], Output(as_json=True), jobs=1)
    return str(bag.path)
