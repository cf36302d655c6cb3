# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures 8 to 10 of the paper for SIMULATED trials, and the effect of scaling on the RBF SVM.

./tactile run python -m benchmarks.paper.figures paper.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from benchmarks.paper.protocol import CLASSIFIERS, CONTACTS, STIFFNESS_FEATURES, TASKS
from benchmarks.paper.reproduction import (
    find_scaling_cause,
    RBF,
    reproduce,
    Result,
    SCALINGS,
    UNITS,
)
from benchmarks.paper.statements import BEST, LEVEL, STIFFNESS_LEAST
from tactile_analysis.report.drawings import draw_matrix
from tactile_classifier.evaluation.significance import rank_sum_p_values

Results = dict[tuple[str, str], Result]

PUBLISHED = {
    'texture': (1.0, None, 1.0, None),
    'stiffness': (STIFFNESS_LEAST, STIFFNESS_LEAST, None, STIFFNESS_LEAST),
}
"""Accuracies in the text of the paper, in the order of `CLASSIFIERS` [1]; None if not stated."""

SMALLEST_P = 1e-16


def main() -> None:
    """Draw the figures to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('picture', type=Path, help='PNG file to write')
    picture = parser.parse_args().picture
    draw_figures(reproduce()).savefig(picture, dpi=110)


def draw_figures(results: Results) -> Figure:
    """Draw accuracies, p-values, and the effect of the unit of force on the RBF SVM."""
    figure = Figure(figsize=(11, 15), layout='constrained')
    top, strip, *rows = figure.subfigures(5, 1, height_ratios=(1.3, 0.08, 0.8, 1.7, 0.9))
    figure.suptitle("SIMULATED: the paper's protocol; no number is a measurement")
    for axes, scaling in zip(top.subplots(1, 2, sharey=True), SCALINGS, strict=True):
        _draw_accuracies(axes, results, scaling)
    # The legend is below the panels, because the bars fill the panels.
    strip.legend(*axes.get_legend_handles_labels(), loc='center', ncols=4, fontsize=8)
    for axes, contact in zip(rows[0].subplots(1, 2, sharey=True), CONTACTS, strict=True):
        _draw_mean_p(axes, results['texture', contact], contact)
    grid = rows[1].subplots(2, len(STIFFNESS_FEATURES))
    for panels, contact in zip(grid, CONTACTS, strict=True):
        _draw_p_matrices(panels, results['stiffness', contact], contact)
    _draw_scaling_cause(*rows[2].subplots(1, 2), results)
    return figure


def _draw_accuracies(axes: Axes, results: Results, scaling: str) -> None:
    sets = [(task, contact) for task in TASKS for contact in CONTACTS]
    for i, (task, contact) in enumerate(sets):
        result = results[task, contact]
        means, spreads = result.means(scaling), result.accuracies[scaling].std(axis=1)
        for j, name in enumerate(CLASSIFIERS):
            x = i + 0.2 * (j - 1.5)
            label = name if i == 0 else None
            axes.bar(x, 100 * means[j], 0.18, yerr=100 * spreads[j], color=f'C{j}', label=label)
            if (published := PUBLISHED[task][j]) is not None:
                axes.plot([x - 0.09, x + 0.09], [100 * published] * 2, 'k--', lw=1.2)
        axes.plot([i - 0.4, i + 0.4], [100 * BEST[task, contact]] * 2, 'k:', lw=1)
    axes.set_xticks(range(len(sets)), [f'{task},\n{contact}' for task, contact in sets])
    axes.set(ylim=(50, 101), ylabel='accuracy [%]')
    axes.set_title(
        f'Fig. 8, {scaling}. Dashes: the paper, by classifier; dots: its best', fontsize=10
    )


def _draw_mean_p(axes: Axes, result: Result, contact: str) -> None:
    mean_p = rank_sum_p_values(*result.trials).mean_p[1:]
    axes.semilogy(np.arange(1, len(mean_p) + 1) / 3, np.maximum(mean_p, SMALLEST_P), 'o', ms=3)
    axes.axhline(LEVEL, color='k', ls='--', lw=1)
    axes.set(xlabel='frequency [Hz]', ylabel='mean p over pairs of plates')
    title = f'Fig. 9, {contact}: {100 * result.alike:.0f} % of the components above {LEVEL}'
    axes.set_title(title, fontsize=10)


def _draw_p_matrices(panels: list[Axes], result: Result, contact: str) -> None:
    found = rank_sum_p_values(*result.trials)
    for axes, name, p in zip(panels, STIFFNESS_FEATURES, found.p, strict=True):
        count = range(len(p))
        texts = [[f'{p[i, j]:.2g}' if i != j else '' for j in count] for i in count]
        draw_matrix(axes, 1.0 - p, found.labels, texts)
        axes.set_title(f'Fig. 10, {contact}: p-values of the {name}', fontsize=10)


def _draw_scaling_cause(left: Axes, right: Axes, results: Results) -> None:
    for i, contact in enumerate(CONTACTS):
        result = results['stiffness', contact]
        shares, accuracies = find_scaling_cause(result.trials)
        left.bar(np.arange(len(shares)) + 0.4 * (i - 0.5), 100 * shares, 0.4, label=contact)
        right.plot(list(UNITS), [100 * each for each in accuracies.values()], 'o-', color=f'C{i}')
        scaled = 100 * result.means('scaled')[RBF]
        right.axhline(scaled, ls='--', color=f'C{i}', label=f'{contact}, scaled')
    left.set_xticks(range(len(STIFFNESS_FEATURES)), STIFFNESS_FEATURES)
    left.set_ylabel('share of squared distance [%]')
    left.set_title('stiffness features, not scaled', fontsize=10)
    right.set(xlabel='unit of force', ylabel='accuracy of the RBF SVM [%]')
    right.set_title('RBF SVM by unit of force: not scaled (line), scaled (dashes)', fontsize=10)
    for axes in (left, right):
        axes.legend(fontsize=8)


if __name__ == '__main__':
    main()
