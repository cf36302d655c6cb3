# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""CPU time and memory of `tactile sense` and `tactile hand`, as a user starts them."""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path
import signal
import subprocess
import tempfile
import threading
import time
from typing import NamedTuple

from ament_index_python.packages import get_package_prefix

SETTLE_S = 3.0
END_S = 30.0
COMMANDS = {
    'tactile sense, 60 Hz': (1, ('sense',)),
    'tactile hand, five fingers, 60 Hz': (5, ('hand', '--fingers', 'a,b,c,d,e')),
}


class Cost(NamedTuple):
    """Cost of one process: CPU time in % of a core, and resident memory [MB]."""

    cpu_percent: float
    rss_mb: float
    private_mb: float


def tactile(*arguments: str) -> list[str]:
    """Return the command line of the ``tactile`` program."""
    program = Path(get_package_prefix('tactile_lab'), 'bin', 'tactile')
    return [str(program), *arguments]


def make_models(folder: Path) -> Path:
    """Return a folder with four models, trained on a few SIMULATED trials."""
    for protocol in ('texture', 'stiffness'):
        _run(('simulate', protocol, '-o', str(folder / 'bags'), '--trials', '6', '--jobs', '1'))
    bags = [str(bag) for bag in sorted((folder / 'bags').iterdir())]
    _run(('train', *bags, '-o', str(folder / 'models'), '--classifier', 'knn'))
    return folder / 'models'


def measure_command(arguments: Sequence[str], domain: int, seconds: float) -> Cost:
    """Start a command that runs until a signal, let it settle, and measure its process."""
    process = subprocess.Popen(
        tactile(*arguments),
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
        before_s, start_s = cpu_s(process.pid), time.monotonic()
        time.sleep(seconds)
        spent_s = cpu_s(process.pid) - before_s
        return Cost(100 * spent_s / (time.monotonic() - start_s), *memory_mb(process.pid))
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(END_S)


def cpu_s(pid: int) -> float:
    """Return the CPU time of a process's threads [s], to the microsecond."""
    spent_ns = 0
    for thread in Path(f'/proc/{pid}/task').iterdir():
        spent_ns += int((thread / 'schedstat').read_text().split()[0])
    return spent_ns / 1e9


def memory_mb(pid: int) -> tuple[float, float]:
    """Return resident and private memory of a process [MB]."""
    rows = dict(
        line.split()[:2] for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()[1:]
    )
    private_kb = int(rows['Private_Clean:']) + int(rows['Private_Dirty:'])
    return int(rows['Rss:']) / 1024, private_kb / 1024


def _run(arguments: Sequence[str]) -> None:
    subprocess.run(tactile(*arguments), check=True, stdout=subprocess.DEVNULL)


def measure_commands(domain: int, seconds: float) -> dict[str, Cost]:
    """Measure each of `COMMANDS` with simulated sensors and four models a finger."""
    with tempfile.TemporaryDirectory() as scratch:
        models = str(make_models(Path(scratch)))
        return {
            name: measure_command((*arguments, '--simulated', '--models', models), domain, seconds)
            for name, (_, arguments) in COMMANDS.items()
        }
