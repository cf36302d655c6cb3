# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers and statements in the text of the paper, and rules for agreement with them.

Numbers that are only in the figures of the paper are not used. If the text contains a word instead
of a number ("dramatically lower"), the rule states our interpretation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.protocol import STIFFNESS_FEATURES, Trials
from tactile_classifier.evaluation.significance import rank_sum_p_values

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

LEVEL = 0.05
"""Significance level in Fig. 9 of the paper."""

PERFECT = 0.995
"""An accuracy of at least this counts as the paper's 100 % [1]."""

STIFFNESS_LEAST = 0.972
DRAMATIC = 0.10
EQUALLY = 0.03
FEW = 0.10
HIGH = 0.95

BEST = {
    ('texture', 'flexion'): 1.0,
    ('texture', 'abduction'): 1.0,
    ('stiffness', 'flexion'): 0.994,
    ('stiffness', 'abduction'): 0.997,
}
"""Best published accuracy for each task and contact [1].

Section I of the paper states four numbers; it is assumed that they are in this order.
"""

CLASSIFIERS = {
    'texture': ('100', 'lower', '100', 'high'),
    'stiffness': ('> 97.2', '> 97.2', 'dramatically lower', '> 97.2'),
}
"""Accuracy of each classifier according to section IV [%], in the order of
`protocol.CLASSIFIERS`."""

HOLD = (-0.90, 12.62, -0.99)
"""Slope [N/s], intercept [N] and correlation of the flexion trial of Fig. 7."""

EXCUSED = {'correlation pla/solid_rubber', 'correlation pla/rubber_shell'}
"""Features and pairs of objects whose difference is not significant in the paper either."""


class Statement(NamedTuple):
    """One statement about a task in section IV of the paper.

    ``agrees`` takes accuracies of shape (..., 4), in the order of `protocol.CLASSIFIERS`, and
    results of `measure_alike`, shape (...). It returns booleans of shape (...).
    """

    task: str
    name: str
    text: str
    rule: str
    agrees: Callable[[FloatArray, FloatArray], BoolArray]


STATEMENTS = (
    Statement(
        'texture',
        'neighbours, RBF 100',
        'Texture: neighbours and the RBF SVM reach 100 %',
        f'both at least {100 * PERFECT:.1f} %',
        lambda accuracies, alike: accuracies[..., [0, 2]].min(axis=-1) >= PERFECT,
    ),
    Statement(
        'texture',
        'tree high',
        'Texture: the tree stably reaches high accuracy',
        f'at least {100 * HIGH:.0f} %',
        lambda accuracies, alike: accuracies[..., 3] >= HIGH,
    ),
    Statement(
        'texture',
        'linear lower',
        'Texture: the SVM depends on its kernel; the linear one is lower',
        f'linear {100 * EQUALLY:.0f} points or more below RBF',
        lambda accuracies, alike: accuracies[..., 2] - accuracies[..., 1] >= EQUALLY,
    ),
    Statement(
        'texture',
        'few components',
        'Besides 0 Hz, only few Fourier components have a mean p above 0.05',
        f'at most {100 * FEW:.0f} % of them',
        lambda accuracies, alike: alike <= FEW,
    ),
    Statement(
        'stiffness',
        'others 97.2',
        'Stiffness: neighbours, the linear SVM and the tree reach above 97.2 %',
        'all at least 97.2 %',
        lambda accuracies, alike: accuracies[..., [0, 1, 3]].min(axis=-1) >= STIFFNESS_LEAST,
    ),
    Statement(
        'stiffness',
        'RBF lower',
        'Stiffness: the RBF SVM is dramatically lower',
        f'{100 * DRAMATIC:.0f} points or more below each of the others',
        lambda accuracies, alike: (
            accuracies[..., [0, 1, 3]].min(axis=-1) - accuracies[..., 2] >= DRAMATIC
        ),
    ),
    Statement(
        'stiffness',
        'all differ',
        'The three stiffness features differ between all objects, except the correlation between '
        'rubber and PLA',
        'p above 0.05 for no other pair',
        lambda accuracies, alike: alike == 0,
    ),
)

CONTACTS_AGREE = 'Flexion and abduction do equally well'
CONTACTS_RULE = f'best classifiers within {100 * EQUALLY:.0f} points'


def contacts_agree(best: tuple[float, float]) -> bool:
    """Return True if the best accuracies of the two contacts are nearly equal [1]."""
    return abs(best[0] - best[1]) <= EQUALLY


def measure_alike(task: str, trials: Trials) -> float:
    """Return how many of the rank-sum tests do not show a difference.

    For textures, the result is the fraction of the Fourier components above 0 Hz whose mean
    p-value over the pairs of plates is above 0.05 [1]. For stiffness, it is the number of
    combinations of a feature and a pair of objects whose p-value is above 0.05, without those in
    `EXCUSED`.
    """
    if task == 'texture':
        mean_p = rank_sum_p_values(trials.values, trials.labels).mean_p
        return float((mean_p[1:] > LEVEL).mean())
    return float(len(find_alike(trials) - EXCUSED))


def find_alike(trials: Trials) -> set[str]:
    """Return each stiffness feature and pair of objects whose p-value is above 0.05, as a text."""
    found = rank_sum_p_values(trials.values, trials.labels)
    return {
        f'{name} {found.labels[j]}/{found.labels[i]}'
        for name, p in zip(STIFFNESS_FEATURES, found.p, strict=True)
        for i in range(len(found.labels))
        for j in range(i)
        if p[i, j] > LEVEL
    }
