# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rank-sum tests of single features in words: Fourier components, pairs of classes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.report.analysis import SetResult
from tactile_classifier.datasets.conditions import states_mountings
from tactile_features.spec import FeatureSpec

LEVEL = 0.05
"""Line of significance, as in Fig. 9 of the paper."""

_KINDS = (
    ('__spectrum__hz_', 1.0, 'frequency', 'Hz'),
    ('__spatial_spectrum__per_m_', 1e-3, 'spatial frequency', 'cycles/mm'),
)


@dataclass(frozen=True)
class Components:
    """The Fourier components above zero among the features of a set.

    ``columns`` are theirs in the table, shape (k,); ``frequency`` is in ``unit``, shape (k,).
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
    """Return the components by the features' names, or None where there are fewer than two.

    The one at zero is left out: the mean has been taken off.
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
    """Return what the tests compare, in words: trials or means of mountings."""
    table, significance = result.recordings.table, result.significance
    values, strata = sum(significance.counts), significance.strata
    if values < len(table):
        least, most = min(significance.counts), max(significance.counts)
        each = f'{least}' if least == most else f'{least} to {most}'
        tested = f'means of {values} mountings ({each} of each label; {len(table)} trials)'
        if not states_mountings(table):
            tested += (
                '. The mountings are not stated, so that each label counts as mounted once '
                'a session'
            )
    else:
        tested = f'{values} trials as independent samples'
        if not states_mountings(table):
            tested += ' (their mountings are not stated; if trials share one, p is too small)'
    within = f', compared within {strata} sessions (van Elteren)' if strata > 1 else ''
    return f'{tested}{within}'


def format_least_p(result: SetResult) -> str:
    """Return one sentence where the tested values are too few for p below `LEVEL`, or nothing."""
    least = result.significance.least_p
    if least <= LEVEL:
        return ''
    return (
        f'So few cannot give p below {least:.2g} for every pair, however large the difference: '
        'record each label in more mountings and sessions.'
    )


def format_alike_pairs(result: SetResult, components: Components) -> str:
    """Return the causes of high mean p-values, by counting pairs instead of averaging."""
    significance = result.significance
    one, other = np.triu_indices(len(significance.labels), 1)
    p = significance.p[components.columns][:, one, other]
    alike = p > LEVEL
    pairs, worst = alike.shape[1], int(alike.sum(axis=0).argmax())
    counts = alike.sum(axis=1)
    # Bonferroni's bound: among many components, some p is below the level without any effect.
    differ = (p.min(axis=0) <= LEVEL / len(p)).sum()
    return (
        f'{result.recordings.title}: of the {pairs} pairs of classes, {np.median(counts):g} have '
        f'p over {LEVEL} in the median component; {int((2 * counts < pairs).sum())} of '
        f'{len(counts)} components differ between more than half of the pairs at that level. '
        f'{int(differ)} pairs differ in some component at {LEVEL} over the number of components. '
        f'Most alike are {significance.labels[one[worst]]} and '
        f'{significance.labels[other[worst]]}: over {LEVEL} in {int(alike[:, worst].sum())} '
        'components.'
    )


def list_alike_pairs(result: SetResult) -> list[str]:
    """Return the pairs of classes between which a feature does not differ, in words."""
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
    """Return the name of a feature without its channel and set."""
    return feature.rpartition('__')[2]
