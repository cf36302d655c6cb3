# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Share of 95 % intervals that hold the true accuracy of a new session, by simulation.

Usage: ./tactile run python -m benchmarks.sessions.interval_coverage [--quick]

The accuracies of sessions are normal on the logit scale, and trials are binomial. Beside the
intervals of `tactile evaluate` stands, in brackets, the bootstrap of session means.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from tactile_classifier.evaluation.intervals import accuracy_interval

TRIALS = 60
GROUPS = (2, 4, 6, 12)
POPULATIONS = ((0.5, 0.5), (1.0, 1.0), (2.0, 1.0), (3.0, 1.5))
"""Mean and standard deviation of the logits of accuracy."""


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='200 repetitions instead of 4000')
    repetitions = 200 if parser.parse_args().quick else 4000
    counts = ' | '.join(f'{count} sessions' for count in GROUPS)
    sys.stdout.write(f'| accuracies, mean (SD) [%] | {counts} |\n{"|---" * (1 + len(GROUPS))}|\n')
    for centre, spread in POPULATIONS:
        generator = np.random.default_rng(1)
        population = expit(centre + spread * generator.standard_normal(1_000_000))
        cells = []
        for count in GROUPS:
            logits = centre + spread * generator.standard_normal((repetitions, count))
            means = generator.binomial(TRIALS, expit(logits)) / TRIALS
            ours, theirs = (_cover(kind, means, population.mean()) for kind in (_ours, _bootstrap))
            cells.append(f'{ours:.0f} ({theirs:.0f})')
        mean, sd = 100 * population.mean(), 100 * population.std()
        sys.stdout.write(f'| {mean:.0f} ({sd:.0f}) | {" | ".join(cells)} |\n')


def _cover(kind: object, means: NDArray[np.float64], true: float) -> float:
    assert callable(kind)
    found = [kind(row) for row in means if np.ptp(row) > 0.0]
    return float(100.0 * np.mean([low <= true <= high for low, high in found]))


def _ours(means: NDArray[np.float64]) -> tuple[float, float]:
    interval = accuracy_interval(means, 'groups')
    return interval.low, interval.high


def _bootstrap(means: NDArray[np.float64]) -> tuple[float, float]:
    count = len(means)
    times = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), size=1000)
    low, high = np.percentile(times @ means / count, [2.5, 97.5])
    return float(low), float(high)


if __name__ == '__main__':
    main()
