# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processor time of one prediction, compared with another checkout.

The environment variable ``TACTILE_OTHER_CHECKOUT`` must name the root of the other checkout. Each
checkout trains on the same numbers in a separate environment. Then the two checkouts predict the
same window alternately.
"""

from __future__ import annotations

from pathlib import Path
import statistics
import subprocess
from typing import Any

from benchmarks.measuring import (
    find_other_checkout,
    OTHER_CHECKOUT,
    Ratio,
    Report,
    Row,
    start_in,
)
from tactile_classifier.types import CLASSIFIERS, ROCKET

ROOT = Path(__file__).resolve().parents[2]

CASES = {'texture': CLASSIFIERS, 'texture waveform': (ROCKET,), 'stiffness': CLASSIFIERS}

PROGRAM = """
from pathlib import Path
import sys
import tempfile
import time

from benchmarks.kernels import inference
from tactile_classifier import train, write_model

spectra, waveforms = inference._texture_tables()
tables = {'texture': spectra, 'texture waveform': waveforms}
tables['stiffness'] = inference._stiffness_table()
models = {}
print('ready', flush=True)
for line in sys.stdin:
    task, classifier, loops = line.strip().split('/')
    if (task, classifier) not in models:
        with tempfile.TemporaryDirectory() as folder:
            trained = train(tables[task], classifier)
            models[task, classifier] = write_model(Path(folder) / 'model', trained)
    predict, row = models[task, classifier].predict, tables[task].values[:1]
    predict(row)
    started_s = time.process_time()
    for _ in range(int(loops)):
        predict(row)
    print((time.process_time() - started_s) / int(loops), flush=True)
"""


class Predictor:
    """A process that trains and predicts with the code of one checkout."""

    def __init__(self, checkout: Path) -> None:
        pipes: dict[str, Any] = {'stdin': subprocess.PIPE, 'stdout': subprocess.PIPE}
        self._process = start_in(checkout, 'python', '-c', PROGRAM, text=True, **pipes)
        self._read()

    def measure_s(self, task: str, classifier: str, loops: int) -> float:
        """Return the processor time of one prediction [s]."""
        self._process.stdin.write(f'{task}/{classifier}/{loops}\n')
        self._process.stdin.flush()
        return float(self._read())

    def close(self) -> None:
        """Close the standard input of the process, which ends it, and wait."""
        self._process.stdin.close()
        self._process.wait()

    def _read(self) -> str:
        line: str = self._process.stdout.readline()
        if not line:
            raise RuntimeError('a prediction process has ended; its error is above')
        return line


def run_predictions(quick: bool) -> Report:
    """Measure this checkout and the other one alternately, for every classifier."""
    other = find_other_checkout()
    if other is None:
        raise SystemExit(f'set {OTHER_CHECKOUT} to the root of the checkout to compare with')
    rounds, loops = (5, 50) if quick else (15, 200)
    ours, theirs = Predictor(ROOT), Predictor(other)
    rows = []
    try:
        for task, classifiers in CASES.items():
            for classifier in classifiers:
                case = task, classifier, loops
                times = [(ours.measure_s(*case), theirs.measure_s(*case)) for _ in range(rounds)]
                low, median, high = statistics.quantiles((a / b for a, b in times), n=4)
                more = {
                    'us': 1e6 * statistics.median(a for a, _ in times),
                    'us of the other': 1e6 * statistics.median(b for _, b in times),
                }
                rows.append(Row(f'{task}, {classifier}', Ratio(median, low, high), more=more))
    finally:
        ours.close()
        theirs.close()
    return Report(
        'predictions: one window through a model file, in processor time',
        f'the checkout in {OTHER_CHECKOUT}, measured alternately',
        '',
        rows,
    )
