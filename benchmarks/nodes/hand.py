# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five fingers at once: from a block of samples to a classification, over two hops of DDS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import multiprocessing
from pathlib import Path
import tempfile

from domain_coordinator import domain_id
import numpy as np

from benchmarks.measuring import Report, Row
from benchmarks.nodes.hand_commands import COMMANDS, measure_commands
from benchmarks.nodes.hand_processes import Case, collect, publish, STARTUP_S, Work, work
from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.training.model_writer import write_model
from tactile_classifier.training.trainer import train
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.spec import spec_for

FINGERS = tuple(f'finger{i}' for i in range(1, 6))
TURNS = 2

CASES = (
    Case('60 Hz, 1 sample a block', rate_hz=60, block=1, blocks_a_window=30),
    Case('1 kHz, 10 a block', rate_hz=1000, block=10, blocks_a_window=20),
    Case('7 kHz, 117 a block', rate_hz=7000, block=117, blocks_a_window=6),
)

WITHIN = 'one process with the sources'
LAYOUTS = {
    WITHIN: (FINGERS,),
    'one process': (FINGERS,),
    'a process each': tuple((name,) for name in FINGERS),
}

processes = multiprocessing.get_context('spawn')


@dataclass
class Run:
    """Result of one run of the chain, or of the bare one."""

    latencies_s: list[float]
    wanted: int
    cpu_s: float
    seconds: float
    rss_mb: float


def run_hand(quick: bool) -> Report:
    """Measure each rate and layout, the bare chain in turns with ours."""
    seconds = 3.0 if quick else 8.0
    cases = CASES[:1] if quick else CASES
    rows = [_measure(case, layout, seconds) for case in cases for layout in LAYOUTS]
    rows += _measure_commands(3.0 if quick else 20.0)
    return Report(
        'five fingers: block of samples to classification, two hops',
        'bare rclpy relays that pass on messages of the same types and sizes over the same two '
        'hops, in as many processes. The sink is one more process, and the publisher another one '
        'unless the sources are within. Own us: CPU time of ours above that of the bare relays, '
        'for each block',
        'windows without an answer; a lost sample costs its window',
        rows,
    )


def _measure_commands(seconds: float) -> list[Row]:
    """Measure the commands that run a finger and a hand, beside bare chains that do less.

    The floor is a source and two relays a finger at the same rate, without serial lines.
    """
    rows = []
    with domain_id() as domain, make_model(CASES[0]) as model:
        for name, cost in measure_commands(int(domain), seconds).items():
            group = FINGERS[: COMMANDS[name][0]]
            bare = _run(Work(int(domain), 'bare', CASES[0], model, True), (group,), seconds)
            more = {
                'CPU %': cost.cpu_percent,
                'floor CPU %': 100 * bare.cpu_s / bare.seconds,
                'RSS MB': cost.rss_mb,
                'private MB': cost.private_mb,
                'floor RSS MB': bare.rss_mb,
            }
            rows.append(Row(name, more=more))
    return rows


def _measure(case: Case, layout: str, seconds: float) -> Row:
    runs: dict[str, list[Run]] = {'bare': [], 'ours': []}
    with make_model(case) as model, domain_id() as domain:
        for _ in range(TURNS):
            for who, done in runs.items():
                what = Work(int(domain), who, case, model, layout == WITHIN)
                done.append(_run(what, LAYOUTS[layout], seconds))
    ours, bare = (
        np.percentile(np.concatenate([r.latencies_s for r in runs[who]]), (50, 99))
        for who in ('ours', 'bare')
    )
    blocks = sum(r.seconds for r in runs['ours']) * len(FINGERS) * case.rate_hz / case.block
    cpu = {who: sum(r.cpu_s for r in done) for who, done in runs.items()}
    spent_s = sum(r.seconds for r in runs['ours'])
    missing = sum(r.wanted - len(r.latencies_s) for r in runs['ours'])
    return Row(
        f'{case.name}, {layout}',
        None,
        missing,
        0,
        sum(r.wanted - len(r.latencies_s) for r in runs['bare']),
        more={
            'median ms': 1e3 * ours[0],
            'p99 ms': 1e3 * ours[1],
            'floor median ms': 1e3 * bare[0],
            'floor p99 ms': 1e3 * bare[1],
            'own us': 1e6 * (cpu['ours'] - cpu['bare']) / blocks,
            'CPU % a finger': 100 * cpu['ours'] / spent_s / len(FINGERS),
            'floor CPU %': 100 * cpu['bare'] / spent_s / len(FINGERS),
            'RSS MB': max(r.rss_mb for r in runs['ours']),
            'floor RSS MB': max(r.rss_mb for r in runs['bare']),
        },
    )


def _run(what: Work, groups: tuple[tuple[str, ...], ...], seconds: float) -> Run:
    """Start workers, publisher and sink, and wait for what they report."""
    ready, go, over = processes.Semaphore(0), processes.Event(), processes.Event()
    reports, sunk, sent = processes.Queue(), processes.Queue(), processes.Queue()
    started = [
        processes.Process(target=work, args=(what, group, ready, go, over, reports, seconds, sent))
        for group in groups
    ]
    started.append(processes.Process(target=collect, args=(what, FINGERS, ready, over, sunk)))
    for process in started:
        process.start()
    publisher = processes.Process(
        target=publish, args=(what, FINGERS, seconds, go, over, sent), daemon=True
    )
    try:
        for _ in started:
            if not ready.acquire(timeout=STARTUP_S):
                raise RuntimeError('a process of the benchmark did not start')
        if not what.within:
            publisher.start()
        published = sent.get(timeout=seconds + 3 * STARTUP_S)
        over.set()
        worked = [reports.get(timeout=STARTUP_S) for _ in groups]
        arrived = sunk.get(timeout=STARTUP_S)
    finally:
        over.set()
        for process in (*started, publisher):
            if process.pid is not None:
                process.join(STARTUP_S)
                process.kill()
    return Run(
        [(at_ns - published[key]) / 1e9 for key, at_ns in arrived.items() if key in published],
        len(published),
        sum(report['cpu_s'] for report in worked),
        seconds,
        max(report['rss_mb'] for report in worked),
    )


@contextmanager
def make_model(case: Case) -> Iterator[str]:
    """Give a model file for windows of this case."""
    rng = np.random.default_rng(5)
    labels = np.repeat([f'plate {i}' for i in range(8)], 12)
    config = case.feature_config()
    windows = rng.normal(5.0, 0.1, (len(labels), config.texture_samples))
    values = compute_spectrum(windows, config.spectrum_detrend)
    table = FeatureTable(values, labels, spec_for('texture', config))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, 'model.onnx')
        write_model(path, train(table, 'knn'))
        yield str(path)
