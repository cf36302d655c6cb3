# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random convolutions beside aeon's: cost of a whole training, and accuracy on other public sets.

``pip install aeon`` into the environment that runs this. aeon brings the other sets with it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import importlib.util

import numpy as np

from benchmarks.accuracy.peers import Array, fit_aeon, ridge, ROCKETS, SEEDS
from benchmarks.measuring import Report, Row
from benchmarks.recordings import FABRIC_SLIDE, find_recording, PHAC_HOLD, say_missing
from benchmarks.simulator.trials import time_in_turns
from tactile_classifier.datasets.archive import load_archive
from tactile_classifier.estimators.random_convolution_classifier import RandomConvolutionClassifier

PUBLIC = ('arrow_head', 'gunpoint', 'italy_power_demand', 'basic_motions', 'osuleaf')
"""Sets of the UCR and UEA archives whose files come with aeon 1.6."""

MISSING = Row('aeon is not installed: pip install aeon')

Answer = Callable[[Array], Array]
Train = Callable[[Array, Array, int], Answer]


def train_ours(x: Array, label: Array, seed: int) -> Answer:
    """Train on signals of shape (trials, channels, samples), as `tactile train` does."""
    fitted = RandomConvolutionClassifier(x.shape[1], 2 * seed).fit(x.reshape(len(x), -1), label)
    return lambda rows: fitted.predict(rows.reshape(len(rows), -1))


def train_aeon(name: str, x: Array, label: Array, seed: int) -> Answer:
    """Train the ridge classifier on a transformation of aeon's."""
    transform = fit_aeon(name, x, seed)
    fitted = ridge().fit(transform(x), label)
    return lambda rows: np.asarray(fitted.predict(transform(rows)))


WAYS: dict[str, Train] = {'rocket': train_ours} | {
    name: partial(train_aeon, name) for name in ROCKETS
}


def run_training_cost(quick: bool) -> Report:
    """Time whole trainings on the public recordings, in turns on one core."""
    rows = []
    fabrics, holds = find_recording(FABRIC_SLIDE), find_recording(PHAC_HOLD)
    if importlib.util.find_spec('aeon') is None:
        rows = [MISSING]
    elif fabrics is None or holds is None:
        rows = [Row(say_missing(FABRIC_SLIDE if fabrics is None else PHAC_HOLD))]
    else:
        slides = load_archive(fabrics).where('balanced')
        holding = load_archive(holds).between(1.0, 5.0)
        cases = {
            'fabrics, channel 0': (slides.signal(0)[:, np.newaxis], slides.label),
            'fabrics, 16 channels': (np.asarray(slides.x, dtype=np.float64), slides.label),
            'holds': (holding.signal(0)[:, np.newaxis], holding.label),
        }
        for case, (x, label) in cases.items():
            works = [partial(train, x, label, 0) for train in WAYS.values()]
            times_s = time_in_turns(works, 2 if quick else 5)
            more = {'rocket, s': float(np.median(times_s[0]))}
            for name, ratios in zip(ROCKETS, times_s[0] / times_s[1:], strict=True):
                low, median, high = np.quantile(ratios, (0.0, 0.5, 1.0))
                more[f'over {name}'] = f'{median:.2f} ({low:.2f} to {high:.2f})'
            rows.append(Row(f'{case}, {" x ".join(map(str, x.shape))}', more=more))
    return Report(
        'training-cost: fit, transformation and ridge classifier; processor time of one core',
        'the same training with a transformation of aeon; median (range) of the rounds',
        'none',
        rows,
    )


def run_public_sets(quick: bool) -> Report:
    """Accuracy on the train and test parts of other sets, on which nothing was chosen."""
    rows = []
    for name in PUBLIC[:2] if quick else PUBLIC:
        if importlib.util.find_spec('aeon') is None:
            rows = [MISSING]
            break
        import aeon.datasets

        load = getattr(aeon.datasets, f'load_{name}', None)
        if load is None:
            rows.append(Row(f'{name} does not come with this version of aeon'))
            continue
        (x, label), (others, truth) = load(split='train'), load(split='test')
        more = {}
        for way, train in WAYS.items():
            shares = [
                100 * float(np.mean(train(x, label, seed)(others) == truth))
                for seed in range(SEEDS)
            ]
            more[way] = f'{np.mean(shares):.1f} ({min(shares):.1f} to {max(shares):.1f})'
        rows.append(Row(f'{name}, {" x ".join(map(str, x.shape))}', more=more))
    return Report(
        f'public-sets: accuracy in %, mean (range) of {SEEDS} seeds',
        'none: this topic is about accuracy',
        'none',
        rows,
    )
