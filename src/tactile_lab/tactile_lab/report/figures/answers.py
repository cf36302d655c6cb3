# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Unknown labels, and accuracy against seconds seen, as figures."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from tactile_classifier.evaluation.early_answers import StoppingEvaluation
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.figures.drawing import Drawing, INK, render


def draw_open_set(result: SetResult, found: OpenSetEvaluation) -> Drawing:
    """Draw how each label fares that is left out, and false rejection of each fold."""
    names = [unknown.label for unknown in found.unknown]
    rate = 100 * found.false_alarm_rate

    def draw(figure: Figure) -> None:
        left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 0.8))
        at = range(len(names))
        areas = [100 * unknown.auroc for unknown in found.unknown]
        left.barh(at, areas, 0.65, color='#2a78b8')
        left.axvline(50, ls=':', lw=1, color=INK)
        left.set(title='told from known', xlabel='AUROC [%]')
        misses = [100 * unknown.miss_rate for unknown in found.unknown]
        middle.barh(at, misses, 0.65, color='#c0392b')
        middle.set(title='missed', xlabel='of unknown trials [%]')
        for axes in (left, middle):
            axes.set(xlim=(0, 104), ylim=(len(names) - 0.5, -0.5))
        left.set_yticks(at, names)
        middle.set_yticks(at, [])
        folds = range(1, len(found.group_false_alarm_rates) + 1)
        rejected = [100 * share for share in found.group_false_alarm_rates]
        right.bar(folds, rejected, 0.65, color='#d98c00')
        right.axhline(rate, ls='--', lw=1, color=INK)
        right.set(title='false rejection', xlabel='fold', ylabel='of known trials [%]')
        right.set_xticks(folds)
        for axes, along in ((left, 'x'), (middle, 'x'), (right, 'y')):
            axes.grid(axis=along, alpha=0.2, lw=0.5)

    return render(
        draw,
        (6.6, 1.1 + 0.19 * max(len(names), 6)),
        f'{result.recordings.title}: each label left out of the training in turn, '
        f'{found.split}. Left: how well novelty tells its trials from those of known labels '
        '(dots: chance). Middle: its trials that are given the name of a known label. Right: '
        f'known trials rejected in each fold (dashes: the {rate:g} % asked for).',
        simulated=result.recordings.simulated,
    )


def draw_stopping(found: Sequence[tuple[SetResult, StoppingEvaluation]]) -> Drawing:
    """Draw accuracy against seconds seen, and where the stopping rules stand."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for i, (result, stopping) in enumerate(found):
            axes.plot(
                stopping.seconds,
                [100 * accuracy for accuracy in stopping.accuracies],
                'o-',
                ms=3,
                lw=1.2,
                color=f'C{i}',
                label=result.recordings.contact or result.recordings.title,
            )
            for rule, mark in zip(stopping.rules, 'sD^v', strict=False):
                axes.plot(
                    rule.mean_s,
                    100 * rule.accuracy,
                    mark,
                    ms=6,
                    ls='none',
                    mec=f'C{i}',
                    mfc='none',
                    mew=1.4,
                    label=f'rule for {100 * rule.error_rate:g} %',
                )
        axes.set(ylim=(0, 104), xlim=(0, None), xlabel='signal seen [s]', ylabel='accuracy [%]')
        axes.grid(alpha=0.2, lw=0.5)
        figure.legend(loc='outside right upper', fontsize=8)

    splits = ', '.join(dict.fromkeys(stopping.split for _, stopping in found))
    return render(
        draw,
        (6.2, 2.8),
        f'Accuracy after so much of the window has been seen (lines), {splits}; hollow marks: '
        'mean signal behind an answer, and accuracy of all answers, where a rule stops at the '
        'stated share of wrong early answers.',
        simulated=any(result.recordings.simulated for result, _ in found),
    )
