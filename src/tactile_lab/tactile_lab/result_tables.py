# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results of evaluation and training as tables for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_analysis.wording import format_interval, format_mean
from tactile_classifier.evaluation.cross_validation import Evaluation, Score
from tactile_classifier.evaluation.learning_curve import LearningCurve
from tactile_classifier.types import CLASSIFIER_TITLES, SCALING_TITLES, short_scaling
from tactile_lab.console import Table

if TYPE_CHECKING:
    from tactile_analysis.datasets.model_accuracy import ModelEvaluation
    from tactile_classifier.evaluation.model_accuracy import AccuracyDifference
    from tactile_classifier.training.feature_choice import FeatureChoice


def choice_table(choice: FeatureChoice, title: str) -> Table:
    """Return the accuracies [%] of all candidates of an automatic choice, with their spread.

    The last row is the nested accuracy of the selection procedure.
    """
    columns = ('features', 'classifier', 'scaling', 'accuracy')
    table = Table(*columns, title=title, right_from=3, spare=['scaling'])
    for each in choice.ranking:
        names = each.candidate.feature_set, CLASSIFIER_TITLES[each.candidate.classifier]
        scaling = short_scaling(each.candidate.scaling)
        table.add_row(*names, scaling, format_mean(each.score))
    table.add_row('this selection procedure', '', '', format_mean(choice.nested))
    return table


def recall_table(score: Score) -> Table:
    """Return the recall [%] of each label, with the number of its tests."""
    table = Table('label', 'tests', 'recall', title='recall by label in %', right_from=1)
    counts = score.confusion.sum(axis=1)
    for label, count, share in zip(score.labels, counts, score.recall, strict=True):
        table.add_row(label, str(count), f'{100 * share:.1f}' if count else '')
    return table


def learning_table(curve: LearningCurve) -> Table:
    """Return the accuracy [%] for each number of training groups, with its interval."""
    group = f'training groups ({curve.group})'
    title = f'learning curve in %, {curve.split}'
    table = Table(group, 'trials', 'accuracy', '95 % interval', title=title, right_from=1)
    for point in curve.points:
        mean, interval = f'{100 * point.mean:.1f}', format_interval(point.interval)
        table.add_row(str(point.groups), f'{point.trials:.0f}', mean, interval)
    return table


def accuracy_table(evaluation: Evaluation, title: str, *, intervals: bool = False) -> Table:
    """Return the accuracy [%] for each classifier and scaling, with its spread.

    If ``intervals`` is True, confidence intervals are included.
    """
    scalings = list(dict.fromkeys(score.scaling for score in evaluation.scores))
    headings = (short_scaling(s) if intervals else SCALING_TITLES[s] for s in scalings)
    table = Table('classifier', *headings, title=title, right_from=1)
    for classifier in dict.fromkeys(score.classifier for score in evaluation.scores):
        cells = []
        of_it = [score for score in evaluation.scores if score.classifier == classifier]
        found = {score.scaling: score for score in of_it}
        for scaling in scalings:
            if scaling not in found:
                cells.append('')
                continue
            score = found[scaling]
            cell = format_mean(score)
            if intervals and not score.interval.reason:
                low, high = score.interval.low, score.interval.high
                cell += f'  ({100 * low:.0f} to {100 * high:.0f})'
            cells.append(cell)
        table.add_row(CLASSIFIER_TITLES[classifier], *cells)
    return table


def format_evaluation(found: ModelEvaluation) -> list[str | Table]:
    """Return the accuracy of one or two models as a table, followed by sentences."""
    sides = 'AB'[: len(found.models)]
    table = Table('', *sides, title=found.title, right_from=1)
    scores = found.scores
    table.add_row('features', *(model['feature_set'] for model in found.models))
    table.add_row('accuracy', *(f'{100 * score.accuracy:.1f} %' for score in scores))
    table.add_row('95 % interval', *(format_interval(score.interval) for score in scores))
    table.add_row(
        'accuracy of labelled predictions',
        *(
            'no labels' if s.answered_accuracy is None else f'{100 * s.answered_accuracy:.1f} %'
            for s in scores
        ),
    )
    table.add_row('unknown', *(f'{100 * score.unknown_rate:.1f} %' for score in scores))
    table.add_row('no answer', *(f'{100 * score.no_answer_rate:.1f} %' for score in scores))
    table.add_row(
        'excluded training trials', *(str(model['training_trials']) for model in found.models)
    )
    over = f'{found.trials} trials' + (f' of {found.sessions} sessions' if found.sessions else '')
    lines = [
        *(f'{side}: {m["path"]}' for side, m in zip(sides, found.models, strict=True)),
        f'{over}; interval: {scores[0].interval.method or scores[0].interval.reason}',
    ]
    if found.difference:
        lines.append(_format_difference(found.difference))
    if found.new_labels:
        new = found.new_labels
        rates = ', '.join(
            f'{side} {100 * rate:.0f} %'
            for side, rate in zip(sides, new.unknown_rates, strict=True)
        )
        lines.append(
            f'excluded: {new.trials} trials with labels that the models do not know '
            f'({", ".join(new.labels)}); predicted as unknown: {rates}'
        )
    if found.left_out:
        lines.append(
            f'trials without features: {len(found.left_out)}; the first: {found.left_out[0]}'
        )
    lines += (f'warning: {warning}' for warning in found.warnings)
    return [table, *(f'  {line}' for line in lines)]


def _format_difference(found: AccuracyDifference) -> str:
    interval = found.interval
    if interval.reason:
        span = f'no interval: {interval.reason}'
    else:
        low, high = 100 * interval.low, 100 * interval.high
        span = f'95 % interval {low:+.1f} to {high:+.1f}, {interval.method}'
    return (
        f'B - A: {100 * found.difference:+.1f} points ({span}); trials that only A predicts '
        f'correctly: {found.only_a}, only B: {found.only_b}; exact McNemar p = {found.p_value:.2g}'
    )
