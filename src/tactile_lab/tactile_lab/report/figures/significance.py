# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rank-sum p-values as figures: per Fourier component, and as matrices of classes."""

from __future__ import annotations

from matplotlib.figure import Figure
import numpy as np

from tactile_lab.report.analysis import SetResult
from tactile_lab.report.components import Components
from tactile_lab.report.figures.accuracy import draw_matrix
from tactile_lab.report.figures.drawing import Drawing, INK, render

LEVEL = 0.05
"""The paper's line of significance (Fig. 9)."""

_SMALLEST = 1e-16


def draw_mean_p(result: SetResult, components: Components) -> Drawing:
    """Draw the mean p-value of each Fourier component, after the paper's Fig. 9."""
    all_mean_p = result.significance.mean_p[components.columns]
    mean_p = np.maximum(all_mean_p, _SMALLEST)
    above = all_mean_p > LEVEL

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for chosen, colour in ((~above, '#2a78b8'), (above, '#c0392b')):
            axes.semilogy(components.frequency[chosen], mean_p[chosen], 'o', ms=3, color=colour)
        axes.axhline(LEVEL, ls='--', lw=1, color=INK)
        axes.set(xlabel=components.title, ylabel='mean p over pairs of classes', ylim=(None, 1.0))
        axes.grid(alpha=0.2, lw=0.5)

    return render(
        draw,
        (6.2, 2.6),
        f'{result.recordings.title}: rank-sum test of every two classes, mean p-value of each '
        f'Fourier component, {_tell_comparison(result)}. '
        f'{int(above.sum())} of the {len(mean_p)} components above zero lie over 0.05 '
        '(dashes; red). Low means that between most pairs of classes the amplitude is shifted by '
        'more than chance, which many trials show even where single trials overlap.',
        simulated=result.recordings.simulated,
    )


def _tell_comparison(result: SetResult) -> str:
    """Return which trials the tests compare, in words."""
    trials, strata = len(result.recordings.table), result.significance.strata
    if strata == 1:
        return f'over all {trials} trials'
    return f'of {trials} trials within their {strata} sessions (van Elteren)'


def explain_mean_p(result: SetResult, components: Components) -> str:
    """Return what lifts the mean p-values of a set, by counting pairs instead of averaging."""
    significance = result.significance
    one, other = np.triu_indices(len(significance.labels), 1)
    p = significance.p[components.columns][:, one, other]
    alike = p > LEVEL
    pairs, worst = alike.shape[1], int(alike.sum(axis=0).argmax())
    counts = alike.sum(axis=1)
    # Of many components one is below the level by chance alone: Bonferroni's bound.
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


def draw_p_matrices(result: SetResult) -> Drawing:
    """Draw the p-value matrix of each stiffness feature, after the paper's Fig. 10."""
    significance = result.significance
    names = [name.rpartition('__')[2] for name in result.recordings.table.spec.names]
    labels = significance.labels

    def draw(figure: Figure) -> None:
        panels = np.ravel(figure.subplots(1, len(names), sharey=True, squeeze=False))
        for axes, name, p in zip(panels, names, significance.p, strict=True):
            texts = [
                ['' if i == j else _short(p[i, j]) for j in range(len(p))] for i in range(len(p))
            ]
            # Inverse, as in the paper: dark where classes differ.
            draw_matrix(axes, 1.0 - p, labels, texts)
            axes.set_title(name)

    pairs = _list_similar(result)
    return render(
        draw,
        (1.6 + 1.9 * len(names), 3.4),
        f'{result.recordings.title}: p-values of the rank-sum test between every two objects, '
        f'{_tell_comparison(result)}; dark where they differ. '
        + (f'Over 0.05: {"; ".join(pairs)}.' if pairs else 'Every pair differs in each feature.'),
        simulated=result.recordings.simulated,
    )


def _list_similar(result: SetResult) -> list[str]:
    """Return the pairs of classes that a feature does not tell apart, in words."""
    significance = result.significance
    found = []
    for name, p in zip(result.recordings.table.spec.names, significance.p, strict=True):
        pairs = [
            f'{significance.labels[i]} and {significance.labels[j]} (p = {p[i, j]:.2g})'
            for i, j in zip(*np.triu_indices(len(p), 1), strict=True)
            if p[i, j] > LEVEL
        ]
        if pairs:
            found.append(f'{name.rpartition("__")[2]} of {", ".join(pairs)}')
    return found


def _short(p: float) -> str:
    if p >= 0.01:
        return f'{p:.2f}'
    return f'{p:.0e}'.replace('e-0', 'e-') if p > 0 else '0'
