# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processor time and memory of the nodes of an idle rig, each in a separate process.

The nodes are those of ``texture.launch.py`` with its parameters. They are connected to a SIMULATED
rig that does not move. If the environment variable ``TACTILE_OTHER_CHECKOUT`` is set, the nodes of
another checkout are measured alternately on the same rig.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import os
from pathlib import Path
import signal
import statistics
import subprocess
import time
from typing import NamedTuple

from benchmarks.measuring import (
    find_other_checkout,
    OTHER_CHECKOUT,
    Ratio,
    read_memory_mb,
    read_processor_s,
    Report,
    Row,
    start_in,
)
from tactile_sim.rig_process import SimulatedRig

ROOT = Path(__file__).resolve().parents[2]

NODES = {
    'tendon_actuator': 'linear_guide_driver/tendon_actuator_node',
    'tendon_sensor': 'tendon_sensor_driver/tendon_sensor_node',
    'tactile_features': 'tactile_features/tactile_features_node',
    'trial_runner': 'tactile_bringup/trial_runner_node',
    'linear_guide': 'linear_guide_driver/linear_guide_node',
}
DEVICES = {'tendon_actuator': 'tendon', 'tendon_sensor': 'sensor', 'linear_guide': 'guide'}

SETTLE_S = 15.0
"""Time from the start of the nodes to the measurement [s], for imports and discovery."""

END_S = 30.0
"""Longest time from SIGINT to the end of a node [s]."""

HANG_S = 10.0
"""Value of the parameter ``hang_timeout_s`` of the tendon actuator [s]. It is long, because on a
busy computer the node may be suspended for a second, and nothing restarts it here."""


class Use(NamedTuple):
    """Resources used by one node."""

    share: float  # processor time of the process and its children, divided by wall time
    memory_mb: float  # a page of memory that n processes share counts as 1/n


def run_rig_nodes(quick: bool) -> Report:
    """Measure every node, alternately with another checkout if `OTHER_CHECKOUT` is set."""
    other = find_other_checkout()
    rounds, duration_s = (2, 10.0) if quick else (3, 30.0)
    ours, theirs = [], []
    with SimulatedRig() as rig:
        for _ in range(rounds):
            if other is not None:
                theirs.append(_measure(other, rig, duration_s))
            ours.append(_measure(ROOT, rig, duration_s))
    rows = []
    for name in (*NODES, 'all'):
        more = _columns('', [each[name] for each in ours])
        ratio = None
        if theirs:
            more |= _columns(' of the other', [each[name] for each in theirs])
            ratios = [a[name].share / b[name].share for a, b in zip(ours, theirs, strict=True)]
            low, median, high = statistics.quantiles(ratios, n=4)
            ratio = Ratio(median, low, high)
        rows.append(Row(name, ratio, more=more))
    return Report(
        'processor time and memory of the nodes of an idle SIMULATED rig',
        f'the checkout in {OTHER_CHECKOUT}, measured alternately' if other else '',
        '',
        rows,
    )


def _columns(suffix: str, uses: list[Use]) -> dict[str, float]:
    return {
        '% of a core' + suffix: 100 * statistics.median(use.share for use in uses),
        'MB' + suffix: statistics.median(use.memory_mb for use in uses),
    }


def _measure(checkout: Path, rig: SimulatedRig, duration_s: float) -> dict[str, Use]:
    with ExitStack() as stack:
        processes = {
            name: stack.enter_context(_started(checkout, name, rig)).pid for name in NODES
        }
        time.sleep(SETTLE_S)
        before, started_s = {n: _spent_s(p) for n, p in processes.items()}, time.monotonic()
        time.sleep(duration_s)
        passed_s = time.monotonic() - started_s
        uses = {
            name: Use(
                (_spent_s(pid) - before[name]) / passed_s,
                sum(map(read_memory_mb, _with_children(pid))),
            )
            for name, pid in processes.items()
        }
    return {**uses, 'all': Use(*map(sum, zip(*uses.values(), strict=True)))}


@contextmanager
def _started(checkout: Path, name: str, rig: SimulatedRig) -> Iterator[subprocess.Popen[bytes]]:
    """Run a node of a checkout in the environment of that checkout."""
    distro = os.environ['ROS_DISTRO']
    program = checkout / '.tactile' / distro / 'install' / 'lib' / NODES[name]
    config = checkout / 'src/tactile_bringup/config/rig.yaml'
    arguments = ['-r', f'__node:={name}', '--params-file', str(config)]
    if name in DEVICES:
        arguments += ['-p', f'port:={getattr(rig.ports, DEVICES[name])}']
    if name == 'tendon_actuator':
        arguments += ['-p', f'hang_timeout_s:={HANG_S}']
    node = start_in(
        checkout,
        *(str(program), '--ros-args', *arguments),
        variables={'ROS_DOMAIN_ID': str(60 + os.getpid() % 30)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield node
        if node.poll() is not None:
            raise RuntimeError(f'{name} of {checkout} has ended with exit code {node.returncode}')
    finally:
        node.send_signal(signal.SIGINT)
        try:
            node.wait(END_S)
        except subprocess.TimeoutExpired:
            node.kill()
            node.wait()


def _spent_s(pid: int) -> float:
    return sum(map(read_processor_s, _with_children(pid)))


def _with_children(pid: int) -> list[int]:
    """Return a process and all of its descendants."""
    found = [pid]
    for path in Path(f'/proc/{pid}/task').glob('*/children'):
        for child in path.read_text().split():
            found += _with_children(int(child))
    return found
