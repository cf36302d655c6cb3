# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accuracies as figures: all classifiers on all sets, confusion, scaling."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from tactile_classifier.estimators.classifiers import CLASSIFIERS, SCALINGS
from tactile_classifier.names import CLASSIFIER_TITLES, SCALING_TITLES, short_scaling
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.figures.drawing import (
    CLASSIFIER_COLOURS,
    Drawing,
    INK,
    legend_below,
    render,
)
from tactile_lab.report.published import lowest_published
from tactile_lab.report.summary import confusion_shares, tell_confusion

FloatArray = NDArray[np.float64]

_GROUP_MARKS = 'Dovs'


def draw_accuracies(results: Sequence[SetResult]) -> Drawing:
    """Draw the accuracy of each classifier on each set, after the paper's Fig. 8."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(SCALINGS), 1, sharex=True)
        for axes, scaling in zip(panels, reversed(SCALINGS), strict=True):
            _draw_bars(axes, results, scaling)
        legend_below(figure, panels[0], 3)

    marks = '; '.join(
        f'{mark}: {name}' for mark, name in zip('◆●▼■', _split_names(results), strict=False)
    )
    return render(
        draw,
        (6.6, 5.4),
        f'Accuracy of each classifier: bars are the mean of {results[0].plain.split} cross-'
        'validation with its standard deviation over the repetitions; '
        + (f'marks the mean with whole groups held out ({marks}); ' if marks else '')
        + 'dashes are what the paper gives for the same classifier; dots are chance.',
        simulated=any(result.recordings.simulated for result in results),
    )


def _split_names(results: Sequence[SetResult]) -> list[str]:
    return list(dict.fromkeys(e.split for result in results for e in result.evaluations[1:]))


def _draw_bars(axes: Axes, results: Sequence[SetResult], scaling: str) -> None:
    names = _split_names(results)
    for i, result in enumerate(results):
        for j, classifier in enumerate(CLASSIFIERS):
            x = i + 0.2 * (j - 1.5)
            score = result.plain.score(classifier, scaling)
            axes.bar(
                x,
                100 * score.mean,
                0.18,
                yerr=100 * score.spread,
                color=CLASSIFIER_COLOURS[classifier],
                alpha=0.85,
                error_kw={'elinewidth': 0.9, 'ecolor': INK},
                label=CLASSIFIER_TITLES[classifier] if i == 0 else None,
            )
            for evaluation in result.evaluations[1:]:
                axes.plot(
                    x,
                    100 * evaluation.score(classifier, scaling).mean,
                    _GROUP_MARKS[names.index(evaluation.split) % len(_GROUP_MARKS)],
                    ms=4,
                    mec=INK,
                    mfc='white',
                    mew=0.8,
                )
            published = lowest_published(result, classifier)
            if published is not None:
                axes.plot([x - 0.09, x + 0.09], [100 * published] * 2, '--', color=INK, lw=1.1)
        chance = 100 * result.plain.chance
        axes.plot([i - 0.42, i + 0.42], [chance, chance], ':', color=INK, lw=1)
    axes.set_xticks(range(len(results)), [_short_title(r) for r in results])
    axes.set(ylim=(0, 104), ylabel='accuracy [%]', title=SCALING_TITLES[scaling])
    axes.grid(axis='y', alpha=0.2, lw=0.5)


def _short_title(result: SetResult) -> str:
    recordings = result.recordings
    if recordings.contact:
        return f'{recordings.table.task},\n{recordings.contact}'
    return recordings.title.replace(', ', ',\n', 1)


def draw_confusion(result: SetResult) -> Drawing:
    """Draw the confusion matrices of plain folds: classifiers by scalings."""
    labels = result.plain.labels
    best = max(result.plain.scores, key=lambda score: score.mean)
    size_in = max(1.3, 0.2 * len(labels))

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(SCALINGS), len(CLASSIFIERS), sharex=True, sharey=True)
        for row, scaling in zip(grid, SCALINGS, strict=True):
            for axes, classifier in zip(row, CLASSIFIERS, strict=True):
                score = result.plain.score(classifier, scaling)
                draw_matrix(axes, confusion_shares(score), labels)
                axes.set_title(
                    f'{CLASSIFIER_TITLES[classifier]},\n{short_scaling(scaling)}', fontsize=7.5
                )
        figure.supxlabel('answer', fontsize=8.5)
        figure.supylabel('true', fontsize=8.5)

    return render(
        draw,
        (1.2 + len(CLASSIFIERS) * size_in, 1.6 + len(SCALINGS) * (size_in + 0.4)),
        f'{result.recordings.title}: confusion in % of each true class, {result.plain.split}. '
        f'Most frequent of the best ({CLASSIFIER_TITLES[best.classifier]}, '
        f'{short_scaling(best.scaling)}): {tell_confusion(best)}.',
        simulated=result.recordings.simulated,
    )


def draw_matrix(
    axes: Axes,
    shares: FloatArray,
    labels: Sequence[str],
    texts: Sequence[Sequence[str]] | None = None,
) -> None:
    """Draw a matrix of numbers from 0 to 1 with a text in each cell: by default in percent."""
    edges = np.arange(len(shares) + 1) - 0.5
    axes.pcolormesh(edges, edges, shares, cmap='Blues', vmin=0.0, vmax=1.0)
    axes.set_aspect('equal')
    axes.set_ylim(len(shares) - 0.5, -0.5)
    for (i, j), share in np.ndenumerate(shares):
        colour = 'white' if share > 0.5 else '#222222'
        percent = f'{100 * share:.0f}' if share else ''
        text = percent if texts is None else texts[i][j]
        axes.text(j, i, text, ha='center', va='center', fontsize=6, color=colour)
    axes.tick_params(length=0, labelsize=7)
    axes.spines[:].set_visible(False)
    axes.set_xticks(range(len(labels)), labels, rotation=90)
    axes.set_yticks(range(len(labels)), labels)


def draw_scaling_cause(results: Sequence[SetResult]) -> Drawing:
    """Draw why the RBF SVM needs scaling on stiffness features."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.2))
        names = [name.rpartition('__')[2] for name in results[0].recordings.table.spec.names]
        for i, result in enumerate(results):
            # How much of the mean squared distance between trials each feature makes up.
            variances = result.recordings.table.values.var(axis=0)
            shares = variances / variances.sum()
            at = np.arange(len(shares)) + 0.8 * ((i + 0.5) / len(results) - 0.5)
            left.bar(
                at,
                100 * shares,
                0.8 / len(results),
                color=f'C{i}',
                label=result.recordings.contact or 'not scaled',
            )
            accuracies = [100 * accuracy for accuracy in result.units.values()]
            right.plot(list(result.units), accuracies, 'o-', ms=3, lw=1.2, color=f'C{i}')
            scaled = 100 * result.plain.score('svm_rbf', 'standard').mean
            right.axhline(scaled, ls='--', lw=1, color=f'C{i}')
        left.axhline(100 / len(names), ls='--', lw=1, color=INK, label='each, scaled')
        left.set_xticks(range(len(names)), names)
        left.set(ylim=(0, 104), ylabel='share of squared distance [%]', title='unscaled')
        legend_below(figure, left, 3)
        right.set(
            ylim=(0, 104),
            ylabel='accuracy [%]',
            xlabel='unit of force',
            title='RBF SVM: unscaled (line), scaled (dashes)',
        )

    return render(
        draw,
        (6.6, 3.0),
        'Why scaling decides on stiffness: slope [N/s], intercept [N] and correlation [1] differ '
        'in unit and size. Left: how much of the squared distance between trials, which is all '
        'that the RBF kernel sees, each feature makes up. Right: the same trials with forces in '
        'other units; a result that moves with the unit says more about the unit than about '
        'touch, and scaling (dashes) takes it out.',
        simulated=any(result.recordings.simulated for result in results),
    )
