# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The picture at the top of the report: accuracy by split, and the confusion matrix."""

from __future__ import annotations

from matplotlib.figure import Figure

from tactile_classifier.names import CLASSIFIER_TITLES, short_scaling
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.figures.accuracy import draw_matrix
from tactile_lab.report.figures.drawing import CLASSIFIER_COLOURS, Drawing, INK, render
from tactile_lab.report.summary import confusion_shares, hardest_evaluation, shown_score


def draw_summary(result: SetResult) -> Drawing:
    """Draw accuracy by split with its interval, and the confusion matrix of the hardest split."""
    score = shown_score(result, hardest_evaluation(result))
    scores = [shown_score(result, evaluation) for evaluation in result.evaluations]
    size_in = max(1.6, 0.28 * len(score.labels))

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
        for y, each in enumerate(scores):
            mean = 100 * each.mean
            if not each.interval.reason:
                span = (100 * each.interval.low, 100 * each.interval.high)
                left.plot(span, (y, y), '-', color=CLASSIFIER_COLOURS[score.classifier], lw=2)
            left.plot(mean, y, 'o', color=CLASSIFIER_COLOURS[score.classifier], ms=6)
            left.text(mean, y + 0.12, f'{mean:.1f}', ha='center', va='bottom')
        for y, evaluation in enumerate(result.evaluations):
            chance = 100 * evaluation.chance
            left.plot((chance, chance), (y - 0.3, y + 0.3), ':', color=INK, lw=1)
        left.set_yticks(range(len(scores)), [s.split.replace(' ', '\n', 1) for s in scores])
        left.set(xlim=(0, 104), ylim=(-0.5, len(scores) - 0.3), xlabel='accuracy [%]')
        draw_matrix(right, confusion_shares(score), score.labels)
        right.set(xlabel='answer', ylabel='true')

    return render(
        draw,
        (6.4, 1.2 + size_in),
        f'{CLASSIFIER_TITLES[score.classifier]}, {short_scaling(score.scaling)}. '
        'Left: accuracy by split, with its 95 % interval; dots are chance. '
        f'Right: answers in % of each true label, {score.split}.',
        simulated=result.recordings.simulated,
    )
