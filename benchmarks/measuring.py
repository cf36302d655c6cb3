# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reports of benchmarks, with speeds as ratios and errors with their bounds.

The speed of this code is compared with a floor: the minimum work for the task, or a comparable
library.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import os
from pathlib import Path
import statistics
import subprocess
import time
from typing import Any

OTHER_CHECKOUT = 'TACTILE_OTHER_CHECKOUT'
"""Environment variable: root of another checkout, which is measured alternately with this one."""


@dataclass(frozen=True)
class Ratio:
    """Time of this code divided by the time of the floor.

    The median and the quartiles are over the rounds of the measurement.
    """

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Row:
    """One row of a report.

    It contains the ratio of times, the error with its bound, and the error of the floor for the
    same input. ``more`` contains additional columns.
    """

    case: str
    ratio: Ratio | None = None
    error: float | None = None
    bound: float | None = None
    floor_error: float | None = None
    more: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """Table of one benchmark.

    ``floor`` and ``error`` describe the floor and the error; each is empty if the table does not
    have this column. ``more`` contains further tables of the benchmark.
    """

    title: str
    floor: str
    error: str
    rows: list[Row]
    more: list[Report] = field(default_factory=list)


def measure_ratio(
    ours: Callable[[], object],
    floor: Callable[[], object],
    rounds: int = 15,
    round_s: float = 0.02,
) -> Ratio:
    """Measure two functions alternately, and return the ratio of their times.

    Both run in each round, so that other load on the machine affects both.

    ``rounds`` is the number of ratios for the median, at least 2. ``round_s`` is the approximate
    time of each function in a round [s].
    """
    our_loops, floor_loops = _count_loops(ours, round_s), _count_loops(floor, round_s)
    ratios = []
    for _ in range(rounds):
        floor_s = _time_loops(floor, floor_loops)
        ratios.append(_time_loops(ours, our_loops) / floor_s)
    low, median, high = statistics.quantiles(ratios, n=4)
    return Ratio(median, low, high)


def _count_loops(work: Callable[[], object], round_s: float) -> int:
    first_s = _time_loops(work, 1)  # the first call also imports modules and fills caches
    if first_s > 10 * round_s:
        return 1
    return max(1, round(round_s / max(_time_loops(work, 1), 1e-7)))


def _time_loops(work: Callable[[], object], loops: int) -> float:
    start_s = time.perf_counter()
    for _ in range(loops):
        work()
    return (time.perf_counter() - start_s) / loops


def find_other_checkout() -> Path | None:
    """Return the checkout that `OTHER_CHECKOUT` names, or None if the variable is not set."""
    if OTHER_CHECKOUT not in os.environ:
        return None
    other = Path(os.environ[OTHER_CHECKOUT]).resolve()
    if not (other / 'src/tactile_sim').is_dir():
        raise SystemExit(f'{OTHER_CHECKOUT} is {other}; it must be the root of a checkout')
    return other


def start_in(checkout: Path, *command: str, **options: Any) -> subprocess.Popen[Any]:
    """Start a program in the environment of a checkout, which is set up if necessary."""
    # Other variables are not passed on, because they refer to the packages of this checkout.
    kept = ('PATH', 'HOME', 'LANG', 'TMPDIR', 'CMAKE_C_COMPILER_LAUNCHER', 'XDG_CACHE_HOME')
    environment = {name: os.environ[name] for name in kept if name in os.environ}
    environment['TACTILE_DISTRO'] = os.environ['ROS_DISTRO']
    environment |= options.pop('variables', {})
    program = str(checkout / 'tactile')
    return subprocess.Popen([program, 'run', *command], cwd=checkout, env=environment, **options)


def read_processor_s(pid: int) -> float:
    """Return the processor time of all running threads of a process [s]."""
    threads = Path(f'/proc/{pid}/task').iterdir()
    return sum(int((each / 'schedstat').read_text().split()[0]) for each in threads) / 1e9


def read_memory_mb(pid: int) -> float:
    """Return the memory of a process [MB]. A page that n processes share counts as 1/n."""
    for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines():
        if line.startswith('Pss:'):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f'/proc/{pid}/smaps_rollup has no line Pss')
