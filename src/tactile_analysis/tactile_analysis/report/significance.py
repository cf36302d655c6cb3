# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rank-sum tests of single features as sentences about Fourier components and pairs of labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.report.analysis import SetResult
from tactile_classifier.datasets.conditions import states_mountings
from tactile_features.spec import FeatureSpec

LEVEL = 0.05
"""Significance level, as in Fig. 9 of the paper."""

_KINDS = (
    ('__spectrum__hz_', 1.0, 'frequency', 'Hz'),
    ('__spatial_spectrum__per_m_', 1e-3, 'spatial frequency', 'cycles/mm'),
)


@dataclass(frozen=True)
class Components:
    """The features that are Fourier components, without the component at frequency zero.

    ``columns`` are their columns in the table of features, shape (k,). ``frequency`` are their
    frequencies in ``unit``, shape (k,).
    """

    columns: NDArray[np.intp]
    frequency: NDArray[np.float64]
    name: str
    unit: str

    @property
    def title(self) -> str:
        """Label of an axis."""
        return f'{self.name} [{self.unit}]'


def find_components(spec: FeatureSpec) -> Components | None:
    """Find the Fourier components by the names of the features; None if there are fewer than two.

    The component at frequency zero is omitted, because the mean has been subtracted.
    """
    for mark, factor, name, unit in _KINDS:
        found = {
            i: factor * float(feature.rpartition(mark)[2])
            for i, feature in enumerate(spec.names)
            if mark in feature
        }
        above = {i: value for i, value in found.items() if value > 0}
        if len(above) > 1:
            columns = np.array(list(above), dtype=np.intp)
            return Components(columns, np.array(list(above.values())), name, unit)
    return None


def format_tested_values(result: SetResult) -> str:
    """Return a text that states what the tests compare: single trials, or means of mountings."""
    table, significance = result.recordings.table, result.significance
    values, strata = sum(significance.counts), significance.strata
    within = f', compared within {strata} sessions (van Elteren)' if strata > 1 else ''
    remark = ''
    if values < len(table):
        least, most = min(significance.counts), max(significance.counts)
        each = f'{least}' if least == most else f'{least} to {most}'
        tested = f'means of {values} mountings ({each} of each label; {len(table)} trials)'
        if not states_mountings(table):
            remark = (
                '. The mountings are not stated, so each label is assumed to have one mounting '
                'per session'
            )
    else:
        tested = f'{values} trials as independent samples'
        if not states_mountings(table):
            remark = '. The mountings are not stated; if trials share a mounting, p is too small'
    return f'{tested}{within}{remark}'


def format_least_p(result: SetResult) -> str | None:
    """Return a warning if there are too few values for a p-value below `LEVEL`, or None."""
    least = result.significance.least_p
    if least <= LEVEL:
        return None
    return (
        f'With so few values, p cannot be below {least:.2g} for every pair, even if the '
        'difference is large. Record each label in more mountings and sessions.'
    )


def format_alike_pairs(result: SetResult, components: Components) -> str:
    """Return how many pairs of labels have high p-values, which explains a high mean p-value."""
    significance = result.significance
    one, other = np.triu_indices(len(significance.labels), 1)
    p = significance.p[components.columns][:, one, other]
    alike = p > LEVEL
    pairs, worst = alike.shape[1], int(alike.sum(axis=0).argmax())
    counts = alike.sum(axis=1)
    # Bonferroni correction: with many components, some p is below the level by chance.
    differ = (p.min(axis=0) <= LEVEL / len(p)).sum()
    return (
        f'{result.recordings.title}: there are {pairs} pairs of labels. In the median component, '
        f'{np.median(counts):g} of them have p above {LEVEL}. '
        f'{int((2 * counts < pairs).sum())} of {len(counts)} components have p up to {LEVEL} for '
        f'more than half of the pairs. {int(differ)} pairs differ in at least one component after '
        f'Bonferroni correction. The most similar pair is {significance.labels[one[worst]]} and '
        f'{significance.labels[other[worst]]}: p is above {LEVEL} in '
        f'{int(alike[:, worst].sum())} components.'
    )


def list_alike_pairs(result: SetResult) -> list[str]:
    """Return a text for each feature, with the pairs of labels that it does not distinguish."""
    significance = result.significance
    found = []
    for name, p in zip(result.recordings.table.spec.names, significance.p, strict=True):
        pairs = [
            f'{significance.labels[i]} and {significance.labels[j]} (p = {p[i, j]:.2g})'
            for i, j in zip(*np.triu_indices(len(p), 1), strict=True)
            if p[i, j] > LEVEL
        ]
        if pairs:
            found.append(f'{short_name(name)} of {", ".join(pairs)}')
    return found


def short_name(feature: str) -> str:
    """Return the name of a feature without its channel and feature set."""
    return feature.rpartition('__')[2]
