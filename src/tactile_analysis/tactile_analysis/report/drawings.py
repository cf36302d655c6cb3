# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figures of the report; each has a text alternative with its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from tactile_analysis.plots import (
    draw_spectrum,
    draw_strain,
    label_axis,
    MARK_COLOUR,
    TRACE_COLOUR,
    UNKNOWN_UNITS,
)
from tactile_analysis.report.analysis import SetResult
from tactile_analysis.report.significance import (
    Components,
    find_components,
    format_least_p,
    format_tested_values,
    LEVEL,
    list_alike_pairs,
    short_name,
)
from tactile_analysis.report.summary import (
    confusion_shares,
    format_classifier,
    format_confusion,
    format_percent,
    format_reliability,
    usual_score,
)
from tactile_analysis.report.svg import (
    CLASSIFIER_COLOURS,
    Drawing,
    INK,
    legend_below,
    render,
    WIDTH_IN,
)
from tactile_bags.trial import Trial
from tactile_classifier.evaluation.cross_validation import Score
from tactile_classifier.evaluation.learning_curve import LearningCurve
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_classifier.evaluation.reliability import Reliability
from tactile_classifier.types import (
    CLASSIFIER_TITLES,
    CLASSIFIERS,
    SCALING_TITLES,
    SCALINGS,
    short_scaling,
)
from tactile_features.spec import FeatureSpec

_CELL_RGB = to_rgb('#1f5f9e')
_GROUP_MARKS = 'Dovs'
_SMALLEST_P = 1e-16


# -- first section ----------------------------------------------------------------------


def draw_split_accuracies(result: SetResult) -> Drawing:
    """Draw the accuracy of the chosen model, and the accuracy of `CLASSIFIER` in each split."""
    usual = [usual_score(result, evaluation) for evaluation in result.evaluations]
    scores = [*reversed(usual), result.headline]
    chosen = result.headline.classifier
    names = [*(score.split for score in reversed(usual)), f'chosen, {result.headline.split}']

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for y, each in enumerate(scores):
            colour = CLASSIFIER_COLOURS[each.classifier]
            mean = 100 * each.mean
            if not each.interval.reason:
                span = (100 * each.interval.low, 100 * each.interval.high)
                axes.plot(span, (y, y), '-', color=colour, lw=2)
            axes.plot(mean, y, 'o', color=colour, ms=6)
            axes.text(mean, y + 0.12, f'{mean:.1f}', ha='center', va='bottom')
            chance = 100 * result.plain.chance
            axes.plot((chance, chance), (y - 0.3, y + 0.3), ':', color=INK, lw=1)
        axes.set_yticks(range(len(scores)), [fill(name, 16) for name in names])
        axes.set(xlim=(0, 106), ylim=(-0.5, len(scores) - 0.3), xlabel='accuracy [%]')

    means = '; '.join(f'{format_percent(score.mean)}, {score.split}' for score in usual)
    headline = f'{format_percent(result.headline.mean)}, {result.headline.split}'
    return render(
        draw,
        (3.4, 0.8 + 0.6 * len(scores)),
        f'Accuracy of the chosen model ({CLASSIFIER_TITLES[chosen]}), and accuracy of '
        f'{format_classifier(usual[0])} for each split. Points: mean over {result.tested} trials; '
        'lines: 95 % interval, if available; dotted: chance '
        f'({format_percent(result.plain.chance)}).',
        f'Accuracy of the chosen model: {headline}. Accuracy of {format_classifier(usual[0])}: '
        f'{means}. '
        f'Chance: {format_percent(result.plain.chance)}.',
        simulated=result.recordings.simulated,
    )


def draw_headline_confusion(result: SetResult) -> Drawing:
    """Draw the confusion matrix of the chosen model."""
    score = result.headline
    size_in = max(1.6, 0.26 * len(score.labels))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        draw_matrix(axes, confusion_shares(score), score.labels)
        axes.set(xlabel='predicted', ylabel='true')

    return render(
        draw,
        (0.9 + size_in, 0.9 + size_in),
        'Confusion matrix of the chosen model: predicted labels in % of the trials of each true '
        f'label; {result.tested} trials, {score.split}.',
        f'Confusion matrix, {score.split}. {_format_right(score)}',
        simulated=result.recordings.simulated,
    )


def draw_matrix(
    axes: Axes,
    shares: NDArray[np.float64],
    labels: Sequence[str],
    texts: Sequence[Sequence[str]] | None = None,
) -> None:
    """Draw a matrix of numbers from 0 to 1, with a text in each cell.

    By default, the text is the number in percent.
    """
    edges = np.arange(len(shares) + 1) - 0.5
    # Zero is transparent, because the background of the page may be light or dark.
    shades = LinearSegmentedColormap.from_list('shares', [(*_CELL_RGB, 0.0), (*_CELL_RGB, 1.0)])
    axes.pcolormesh(edges, edges, shares, cmap=shades, vmin=0.0, vmax=1.0)
    axes.set_aspect('equal')
    axes.set_ylim(len(shares) - 0.5, -0.5)
    for (i, j), share in np.ndenumerate(shares):
        percent = f'{100 * share:.0f}' if share else ''
        if text := percent if texts is None else texts[i][j]:
            colour = 'white' if share > 0.6 else INK
            cell = axes.text(j, i, text, ha='center', va='center', fontsize=6, color=colour)
            cell.set_in_layout(False)  # saves time: the text is inside the axes
    axes.tick_params(length=0, labelsize=7)
    axes.spines[:].set_visible(True)
    axes.spines[:].set_alpha(0.3)
    axes.spines[:].set_linewidth(0.5)
    axes.set_xticks(range(len(labels)), labels, rotation=90)
    axes.set_yticks(range(len(labels)), labels)


# -- learning curve, calibration --------------------------------------------------------


def draw_learning_curve(result: SetResult, curve: LearningCurve) -> Drawing:
    """Draw the accuracy against the number of training groups."""
    groups = [point.groups for point in curve.points]
    means = [100 * point.mean for point in curve.points]
    chance = 100 * result.chance
    colour = CLASSIFIER_COLOURS[curve.classifier]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for point in curve.points:
            if not point.interval.reason:
                span = (100 * point.interval.low, 100 * point.interval.high)
                axes.plot((point.groups, point.groups), span, '-', color=colour, lw=2, alpha=0.5)
        axes.plot(groups, means, 'o-', color=colour, ms=5, lw=1)
        axes.axhline(chance, ls=':', lw=1, color=INK)
        axes.set(xlabel=f'training groups ({curve.group})', ylabel='accuracy [%]', ylim=(0, 104))
        axes.set_xticks(groups)
        axes.grid(axis='y', alpha=0.2, lw=0.5)

    found = '; '.join(
        f'{format_percent(point.mean)} with {point.groups}' for point in curve.points
    )
    return render(
        draw,
        (3.4, 2.6),
        f'{result.recordings.title}: accuracy of {format_classifier(curve)} against the number '
        f'of training groups ({curve.group}). Points: mean over the test groups, which are not '
        f'used for training; bars: 95 % interval; dotted: chance ({chance:.1f} %).',
        f'Accuracy against the number of training groups ({curve.group}): {found}.',
        simulated=result.recordings.simulated,
    )


def draw_reliability(result: SetResult, found: Reliability) -> Drawing:
    """Draw the fraction of correct predictions against the predicted probability."""
    stated = [100 * each.stated for each in found.bins]
    colour = CLASSIFIER_COLOURS[found.classifier]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot((0, 100), (0, 100), ':', color=INK, lw=1)
        for each, x in zip(found.bins, stated, strict=True):
            if not each.interval.reason:
                span = (100 * each.interval.low, 100 * each.interval.high)
                axes.plot((x, x), span, '-', color=colour, lw=2, alpha=0.5)
            axes.plot(x, 100 * each.right, 'o', color=colour, ms=5)
            axes.annotate(
                f'{each.trials}',
                (x, 100 * each.right),
                (-4, 3),
                textcoords='offset points',
                ha='right',
                fontsize=7,
            )
        axes.set(
            xlim=(0, 104),
            ylim=(0, 104),
            xlabel='probability [%]',
            ylabel='correct predictions [%]',
        )
        axes.set_aspect('equal')
        axes.grid(alpha=0.2, lw=0.5)

    bins = '; '.join(
        f'{format_percent(each.right)} of {each.trials} trials at {format_percent(each.stated)}'
        for each in found.bins
    )
    return render(
        draw,
        (3.4, 3.3),
        f'{result.recordings.title}: reliability of the probabilities of '
        f'{format_classifier(found)}, {found.split}. Points: fraction of correct predictions '
        'against their mean probability, in bins of 10 %, with the number of trials in each bin; '
        'bars: 95 % interval, if trials are independent; dotted: perfect calibration. Expected '
        f'calibration error {format_percent(found.error)} with {found.trials} trials.',
        f'Correct predictions by probability: {bins}. {format_reliability(result)}.',
        simulated=result.recordings.simulated,
    )


# -- signals ----------------------------------------------------------------------------


def draw_signals(result: SetResult) -> Iterable[Drawing]:
    """Draw the window of one trial per label, and one whole stiffness trial.

    Signals that are not known are not drawn.
    """
    recordings = result.recordings
    components = find_components(recordings.table.spec)
    if recordings.examples and components is not None:
        yield draw_textures(result, components)
    if recordings.examples and result.of_holds:
        steepest = min(recordings.examples, key=lambda each: recordings.table.values[each.row, 0])
        if steepest.trial is not None and steepest.trial.phases:
            yield draw_trial(result, steepest.row, steepest.trial)
        yield draw_holds(result)


def draw_textures(result: SetResult, components: Components) -> Drawing:
    """Draw one window per texture, with its mean subtracted, and its spectrum."""
    recordings = result.recordings
    table = recordings.table
    factor, unit = (1e3, 'mN') if recordings.unit == 'N' else (1.0, recordings.unit)
    rows = [each.row for each in recordings.examples]
    amplitudes = factor * table.values[rows][:, components.columns]
    windows = [each.window.values[0] for each in recordings.examples]
    signals = [factor * (values - values.mean()) for values in windows]

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(len(rows), 2, sharex='col', sharey='col', squeeze=False).T
        for i, example in enumerate(recordings.examples):
            left[i].plot(example.window.time_s, signals[i], color=TRACE_COLOUR, lw=0.8)
            left[i].set_ylabel(table.labels[example.row], rotation=0, ha='right', va='center')
            left[i].grid(alpha=0.2, lw=0.5)
            draw_spectrum(right[i], components.frequency, amplitudes[i])
        left[0].set_title(label_axis('signal without its mean', unit))
        right[0].set_title(label_axis('amplitude', unit))
        left[-1].set_xlabel('time [s]')
        right[-1].set_xlabel(components.title)

    strongest = '; '.join(
        f'{table.labels[row]}: {_quantity(np.std(signal), unit)}, '
        f'{components.frequency[np.argmax(amplitude)]:.3g} {components.unit}'
        for row, signal, amplitude in zip(rows, signals, amplitudes, strict=True)
    )
    return render(
        draw,
        (WIDTH_IN, 0.9 + 0.75 * len(rows)),
        f'{recordings.title}: the first trial of each label. Left: signal over time, with its '
        'mean subtracted. Right: amplitudes of its Fourier components (logarithmic scale).',
        'Signals of one trial of each label. Standard deviation of the signal, and '
        f'{components.name} of the largest component: {strongest}.',
        simulated=recordings.simulated,
    )


def draw_holds(result: SetResult) -> Drawing:
    """Draw one hold window per object with its regression line."""
    recordings = result.recordings
    table = recordings.table
    examples = recordings.examples
    columns = min(3, len(examples))
    rows = -(-len(examples) // columns)
    windows = [(np.asarray(each.window.time_s), each.window.values[0]) for each in examples]
    lines = [np.polynomial.Polynomial.fit(*window, 1) for window in windows]

    def draw(figure: Figure) -> None:
        grid = np.ravel(figure.subplots(rows, columns, sharex=True, squeeze=False))
        for axes, example, (time_s, values), line in zip(
            grid, examples, windows, lines, strict=False
        ):
            axes.plot(time_s, values, color=TRACE_COLOUR, lw=0.9)
            axes.plot(time_s, line(time_s), color=MARK_COLOUR, lw=1)
            axes.set_title(table.labels[example.row])
            axes.grid(alpha=0.2, lw=0.5)
        for axes in grid[len(examples) :]:
            axes.set_visible(False)
        figure.supxlabel('time [s]', fontsize=8.5)
        figure.supylabel(label_axis('signal', recordings.unit), fontsize=8.5)

    per_second = '1/s' if recordings.unit in UNKNOWN_UNITS else f'{recordings.unit}/s'
    slopes = '; '.join(
        f'{table.labels[each.row]} {_quantity(line.convert().coef[-1], per_second)}, '
        f'{_quantity(line.convert().coef[0], recordings.unit)}'
        for each, line in zip(examples, lines, strict=True)
    )
    return render(
        draw,
        (WIDTH_IN, 0.6 + 1.5 * rows),
        f'{recordings.title}: the first hold of each object with its regression line. Each panel '
        f'has its own scale. Slope and intercept: {slopes}.',
        f'One hold of each object, slope and intercept of its regression line: {slopes}.',
        simulated=recordings.simulated,
    )


def draw_trial(result: SetResult, row: int, trial: Trial) -> Drawing:
    """Draw one stiffness trial with its phases; ``row`` is its row in the table of features."""
    table, signal = result.recordings.table, trial.signal
    time_s = np.asarray(signal.time_s)
    assert trial.begin_ns is not None
    start_s, end_s = (
        (int(table.column(name)[row]) - trial.begin_ns) * 1e-9
        for name in ('window_start_ns', 'window_end_ns')
    )
    names = [short_name(name) for name in table.spec.names]
    named = dict(zip(names, table.values[row], strict=True))
    line = (named['slope'], named['intercept']) if {'slope', 'intercept'} <= set(named) else None

    def draw(figure: Figure) -> None:
        draw_strain(
            figure.subplots(),
            time_s,
            signal.values[0],
            trial.phases,
            (start_s, end_s),
            line,
        )

    found = _format_values(table.spec, table.values[row])
    phases = ', '.join(f'{name} from {start:.1f} s' for name, start, _ in trial.phases)
    return render(
        draw,
        (WIDTH_IN, 3.1),
        f'{result.recordings.title}: tension over time of one trial on '
        f'{table.labels[row]}. In the phase contact, the tendon is tightened (dynamic '
        'deformation). In hold, it is still (static deformation). In release, it is slackened. '
        f'The features are computed from the window between the dashed lines: {found}.',
        f'Tension of one trial on {table.labels[row]}: up to {np.max(signal.values):.3g} '
        f'N; {phases}. Features of the window: {found}.',
        simulated=result.recordings.simulated,
    )


# -- all classifiers --------------------------------------------------------------------


def draw_accuracies(results: Sequence[SetResult]) -> Drawing:
    """Draw the accuracy of each classifier on each set."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(SCALINGS), 1, sharex=True)
        for axes, scaling in zip(panels, reversed(SCALINGS), strict=True):
            _draw_bars(axes, results, scaling)
        legend_below(figure, panels[0])

    marks = '; '.join(
        f'{mark}: {name}' for mark, name in zip('◇○▽□', _split_names(results), strict=False)
    )
    best = '; '.join(
        f'{result.recordings.title}: best {format_percent(score.mean)}, {format_classifier(score)}'
        for result in results
        for score in [max(result.plain.scores, key=lambda each: each.mean)]
    )
    return render(
        draw,
        (WIDTH_IN, 5.4),
        f'Accuracy of each classifier. Bars: mean of {results[0].plain.split}, with the standard '
        'deviation over repetitions. '
        + (f'Markers: mean with whole groups held out ({marks}). ' if marks else '')
        + 'Dotted: chance.',
        f'Accuracy of each classifier, {results[0].plain.split}. {best}. The tables below contain '
        'all numbers.',
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
        chance = 100 * result.plain.chance
        axes.plot([i - 0.42, i + 0.42], [chance, chance], ':', color=INK, lw=1)
    axes.set_xticks(range(len(results)), [_short_title(r) for r in results])
    axes.set(ylim=(0, 104), ylabel='accuracy [%]', title=SCALING_TITLES[scaling])
    axes.grid(axis='y', alpha=0.2, lw=0.5)


def draw_confusion(result: SetResult) -> Drawing:
    """Draw the confusion matrices of the evaluation `SetResult.plain`.

    The figure has a row per classifier and a column per scaling.
    """
    labels = result.plain.labels
    best = max(result.plain.scores, key=lambda score: score.mean)
    size_in = max(1.3, 0.2 * len(labels))

    def draw(figure: Figure) -> None:
        grid = figure.subplots(len(CLASSIFIERS), len(SCALINGS), sharex=True, sharey=True)
        for row, classifier in zip(grid, CLASSIFIERS, strict=True):
            for axes, scaling in zip(row, SCALINGS, strict=True):
                score = result.plain.score(classifier, scaling)
                draw_matrix(axes, confusion_shares(score), labels)
                axes.set_title(
                    f'{CLASSIFIER_TITLES[classifier]},\n{short_scaling(scaling)}', fontsize=7.5
                )
        figure.supxlabel('predicted', fontsize=8.5)
        figure.supylabel('true', fontsize=8.5)

    most = '; '.join(
        f'{format_classifier(score)}: {format_confusion(score)}' for score in result.plain.scores
    )
    return render(
        draw,
        (1.2 + len(SCALINGS) * size_in, 1.2 + len(CLASSIFIERS) * (size_in + 0.4)),
        f'{result.recordings.title}: confusion matrix of each classifier, in % of the trials of '
        f'each true label, {result.plain.split}. Most frequent confusion of the best '
        f'({format_classifier(best)}): {format_confusion(best)}.',
        f'Confusion matrices, {result.plain.split}. Most frequent confusion of each classifier: '
        f'{most}.',
        simulated=result.recordings.simulated,
    )


# -- significance -----------------------------------------------------------------------


def draw_significance(results: Sequence[SetResult]) -> Iterable[Drawing]:
    """Draw the rank-sum tests of each set, over frequency or as matrices of pairs of labels."""
    for result in results:
        components = find_components(result.recordings.table.spec)
        if result.of_holds:
            yield draw_p_matrices(result)
        elif components is not None:
            yield draw_mean_p(result, components)


def draw_mean_p(result: SetResult, components: Components) -> Drawing:
    """Draw the mean p-value and the effect size of each Fourier component."""
    all_mean_p = result.significance.mean_p[components.columns]
    mean_p = np.maximum(all_mean_p, _SMALLEST_P)
    separation = result.significance.separation[components.columns]
    above = all_mean_p > LEVEL

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True)
        for chosen, colour in ((~above, '#2a78b8'), (above, '#c0392b')):
            at = components.frequency[chosen]
            upper.semilogy(at, mean_p[chosen], 'o', ms=3, color=colour)
            lower.plot(at, separation[chosen], 'o', ms=3, color=colour)
        upper.axhline(LEVEL, ls='--', lw=1, color=INK)
        upper.set(ylabel='mean p', ylim=(None, 1.0))
        lower.set(xlabel=components.title, ylabel='mean AUC', ylim=(0.48, 1.02))
        for axes in (upper, lower):
            axes.grid(alpha=0.2, lw=0.5)

    count = f'{int(above.sum())} of the {len(mean_p)} components have a mean p above {LEVEL}'
    least = components.frequency[np.argmin(all_mean_p)]
    return render(
        draw,
        (WIDTH_IN, 4.2),
        f'{result.recordings.title}: rank-sum tests of all pairs of labels, for each Fourier '
        f'component above frequency zero. The tests compare {format_tested_values(result)}. '
        f'Above: mean p-value over the pairs; dashed: {LEVEL}. {count} (red). '
        f'{format_least_p(result) or ""} Below: area under the ROC curve (AUC), averaged over the '
        'pairs: 0.5 if the component does not separate single trials, 1 if it separates them '
        'completely. p also decreases with the number of compared values, the AUC does not.',
        f'Mean p-value by {components.name}: {count}; the lowest is at {least:.3g} '
        f'{components.unit}. Mean AUC: {separation.min():.2f} to {separation.max():.2f}.',
        simulated=result.recordings.simulated,
    )


def draw_p_matrices(result: SetResult) -> Drawing:
    """Draw p-values and effect sizes of each stiffness feature."""
    significance = result.significance
    names = [short_name(name) for name in result.recordings.table.spec.names]
    labels = significance.labels

    def draw(figure: Figure) -> None:
        panels = np.ravel(figure.subplots(len(names), 1, sharex=True, squeeze=False))
        for axes, name, p, auc in zip(
            panels, names, significance.p, significance.auc, strict=True
        ):
            # The texts above the diagonal are p-values, and the texts below it are AUCs.
            texts = [
                [_short_p(p[i, j]) if i < j else f'{auc[i, j]:.2f}' for j in range(len(p))]
                for i in range(len(p))
            ]
            for i in range(len(p)):
                texts[i][i] = ''
            # A small p-value, which means that the labels differ, gets a dark cell.
            draw_matrix(axes, 1.0 - p, labels, texts)
            axes.set_title(name)

    pairs = list_alike_pairs(result)
    found = format_least_p(result) or (
        f'p is above {LEVEL} for: {"; ".join(pairs)}.'
        if pairs
        else 'Every pair of objects differs in each feature.'
    )
    return render(
        draw,
        (3.4, 0.6 + 2.2 * len(names)),
        f'{result.recordings.title}: rank-sum tests of all pairs of objects, for '
        f'{_list_features(result.recordings.table.spec)}. The tests compare '
        f'{format_tested_values(result)}. Above the diagonal: p-value; a small p has a dark cell. '
        'Below the diagonal: probability that a trial of the object in the row has a larger value '
        'than a trial of the object in the column (AUC; 0.5 means no difference). '
        f'{found}',
        f'Matrices of p-values and AUC between objects, for {", ".join(names)}. {found}',
        simulated=result.recordings.simulated,
    )


def _short_p(p: float) -> str:
    if p >= 0.01:
        return f'{p:.2f}'
    return f'{p:.0e}'.replace('e-0', 'e-') if p > 0 else '0'


# -- unknown objects --------------------------------------------------------------------


def draw_open_set(result: SetResult, found: OpenSetEvaluation) -> Drawing:
    """Draw the results of the evaluation of unknown objects.

    These are the AUROC and the rate of misses of each left-out label, and the rate of false
    rejection of each fold.
    """
    names = [unknown.label for unknown in found.unknown]
    rate = 100 * found.false_alarm_rate
    areas = [100 * unknown.auroc for unknown in found.unknown]
    misses = [100 * unknown.miss_rate for unknown in found.unknown]
    rejected = [100 * share for share in found.group_false_alarm_rates]

    def draw(figure: Figure) -> None:
        left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 0.8))
        at = range(len(names))
        left.barh(at, areas, 0.65, color='#2a78b8')
        for y, unknown in zip(at, found.unknown, strict=True):
            if not unknown.interval.reason:
                span = (100 * unknown.interval.low, 100 * unknown.interval.high)
                left.plot(span, (y, y), '-', color=INK, lw=1)
        left.axvline(50, ls=':', lw=1, color=INK)
        left.set(title='known or unknown', xlabel='AUROC [%]')
        middle.barh(at, misses, 0.65, color='#c0392b')
        middle.set(title='missed', xlabel='of unknown trials [%]')
        for axes in (left, middle):
            axes.set(xlim=(0, 104), ylim=(len(names) - 0.5, -0.5))
        left.set_yticks(at, names)
        middle.set_yticks(at, [])
        folds = range(1, len(rejected) + 1)
        right.bar(folds, rejected, 0.65, color='#d98c00')
        right.axhline(rate, ls='--', lw=1, color=INK)
        right.set(title='false rejection', xlabel='fold', ylabel='of known trials [%]')
        right.set_xticks(folds)
        for axes, along in ((left, 'x'), (middle, 'x'), (right, 'y')):
            axes.grid(axis=along, alpha=0.2, lw=0.5)

    of_labels = '; '.join(
        f'{name}: AUROC {area:.0f} %, missed {miss:.0f} %'
        for name, area, miss in zip(names, areas, misses, strict=True)
    )
    return render(
        draw,
        (WIDTH_IN, 1.1 + 0.19 * max(len(names), 6)),
        f'{result.recordings.title}: rejection of unknown objects, {found.split}. Each label is '
        'left out of the training once, so that its trials are unknown. Left: how well novelty '
        'separates unknown from known trials, as area under the ROC curve (AUROC) with 95 % '
        'interval (dotted: chance). Middle: fraction of the unknown trials that are classified '
        'as a known label (missed). Right: fraction of the known trials that are rejected in each '
        f'fold (dashed: stated rate of {rate:g} %).',
        f'Labels left out of the training: {of_labels}. False rejection by fold: '
        f'{min(rejected):.0f} to {max(rejected):.0f} %, stated rate {rate:g} %.',
        simulated=result.recordings.simulated,
    )


# -- texts ------------------------------------------------------------------------------


def _format_values(spec: FeatureSpec, values: NDArray[np.float64]) -> str:
    """Return the names and values of one trial's features, with units, as text."""
    return ', '.join(
        f'{short_name(name)} {_quantity(value, unit)}'
        for name, value, unit in zip(spec.names, values, spec.units, strict=True)
    )


def _list_features(spec: FeatureSpec) -> str:
    """Return the names of the features, with units, as text."""
    return ', '.join(
        f'{short_name(name)}{"" if unit in UNKNOWN_UNITS else f" [{unit}]"}'
        for name, unit in zip(spec.names, spec.units, strict=True)
    )


def _quantity(value: float, unit: str) -> str:
    return f'{value:.3g}' if unit in (*UNKNOWN_UNITS, '1') else f'{value:.3g} {unit}'


def _format_right(score: Score) -> str:
    right = np.diag(confusion_shares(score))
    found = ', '.join(
        f'{label} {100 * share:.0f} %' for label, share in zip(score.labels, right, strict=True)
    )
    return f'Correct predictions: {found}. Most frequent confusion: {format_confusion(score)}.'


def _short_title(result: SetResult) -> str:
    recordings = result.recordings
    if recordings.contact:
        return f'{recordings.table.task},\n{recordings.contact}'
    return recordings.title.replace(', ', ',\n', 1)
