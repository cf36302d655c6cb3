# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processor time of `tactile train` and `tactile evaluate --report` in two checkouts.

The environment variable ``TACTILE_OTHER_CHECKOUT`` must name the root of the other checkout. The
commands of both checkouts run alternately on the same archive of generated windows and the same
bag of SIMULATED trials.
"""

from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path
import statistics
import subprocess
import tempfile
import time
from typing import NamedTuple

import numpy as np

from benchmarks.measuring import (
    find_other_checkout,
    OTHER_CHECKOUT,
    Ratio,
    Report,
    Row,
    start_in,
)

ROOT = Path(__file__).resolve().parents[2]

TACTILE = ('python', '-m', 'tactile_lab')

REFUSED = 2
"""Exit code of `tactile train` if it trained a model, and then refused to write it.

The other checkout may end with this code. Its time is used, because only the writing is missing.
"""


class Times(NamedTuple):
    """Processor time and wall time of a command [s], and its exit code."""

    processor_s: float
    wall_s: float
    exit_code: int


def run_training(quick: bool) -> Report:
    """Run `tactile train` and `tactile evaluate`, each alternately in both checkouts."""
    other = find_other_checkout()
    if other is None:
        raise SystemExit(f'set {OTHER_CHECKOUT} to the root of the checkout to compare with')
    trials, rounds = (120, 1) if quick else (800, 3)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        archive, bags = Path(folder, 'windows.npz'), Path(folder, 'bags')
        _write_windows(archive, trials)
        simulate = ('simulate', 'texture', '--contact', 'flexion', '--trials', '3')
        _run(other, [*simulate, '--sessions', '4', '-o', str(bags)])
        for case, command, output in (
            (f'train, {trials} x 1 x 400', ['train', str(archive), '--task', 'texture'], '-o'),
            ('evaluate --report, 96 trials', ['evaluate', str(bags)], '--report'),
        ):
            times = []
            for i in range(rounds):
                of_round = []
                for name, checkout in (('ours', ROOT), ('other', other)):
                    result = Path(folder, f'{output.strip("-")}-{name}-{i}')
                    of_round.append(_run(checkout, [*command, output, str(result)]))
                times.append(of_round)
            rows.append(_make_row(case, times))
    return Report(
        'training: tactile train and tactile evaluate --report, in processor time',
        f'the checkout in {OTHER_CHECKOUT}, measured alternately',
        '',
        rows,
    )


def _make_row(case: str, times: Sequence[Sequence[Times]]) -> Row:
    ratios = [ours.processor_s / other.processor_s for ours, other in times]
    more = {
        f'{what} of {whose} [s]': f'{statistics.median(each[i][j] for each in times):.1f}'
        for i, whose in enumerate(('ours', 'the other'))
        for j, what in enumerate(('processor time', 'wall time'))
    }
    more['exit code of the other'] = str(max(other.exit_code for _, other in times))
    return Row(case, Ratio(statistics.median(ratios), min(ratios), max(ratios)), more=more)


def _run(checkout: Path, arguments: Sequence[str]) -> Times:
    started_s = time.monotonic()
    process = start_in(checkout, *TACTILE, *arguments, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = code = os.waitstatus_to_exitcode(status)
    if code and (checkout == ROOT or code != REFUSED):
        raise RuntimeError(f'{" ".join(arguments)} failed in {checkout}; its error is above')
    return Times(usage.ru_utime + usage.ru_stime, time.monotonic() - started_s, code)


def _write_windows(path: Path, trials: int) -> None:
    """Write an archive with windows of four textures.

    Each window is a sine with drift and noise.
    """
    rng = np.random.default_rng(0)
    label = np.resize(['a', 'b', 'c', 'd'], trials)
    frequency_hz = np.resize([4.0, 5.0, 7.0, 9.0], trials)
    frequency_hz *= 1.0 + 0.03 * rng.normal(size=trials)
    cycles = frequency_hz[:, np.newaxis] * np.arange(400) / 60.0 + rng.random((trials, 1))
    drift = rng.normal(0.0, 0.01, (trials, 400)).cumsum(axis=1)
    noise = rng.normal(0.0, 0.08, (trials, 400))
    x = 3.0 + 0.05 * np.sin(2.0 * np.pi * cycles) + drift + noise
    np.savez(path, x=x[:, np.newaxis], label=label, rate_hz=60.0)
