# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report's sections on what a model says besides a label."""

from __future__ import annotations

from collections.abc import Sequence

from tactile_classifier.evaluation.early_answers import StoppingEvaluation
from tactile_classifier.evaluation.open_set import OpenSetEvaluation
from tactile_classifier.names import CLASSIFIER_TITLES, short_scaling
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.answers import MeasureSummary
from tactile_lab.report.figures.answers import draw_open_set, draw_stopping
from tactile_lab.report.page import Page
from tactile_lab.report.summary import tell_raw_scores

_SHOWN = {'m': ('mm', 1e3), 'N/m': ('N/mm', 1e-3)}


def add_answers(page: Page, results: Sequence[SetResult]) -> None:
    """Add the sections for which there are results; none where they were not asked for."""
    answered = [(r, r.answers) for r in results if r.answers is not None]
    open_sets = [(r, a.open_set) for r, a in answered if a.open_set is not None]
    stopping = [(r, a.stopping) for r, a in answered if a.stopping is not None]
    measures = [(r, a.measures) for r, a in answered if a.measures]
    if open_sets:
        _add_open_sets(page, open_sets)
    if stopping:
        _add_stopping(page, stopping)
    if measures:
        _add_measures(page, measures)


def _add_open_sets(page: Page, found: Sequence[tuple[SetResult, OpenSetEvaluation]]) -> None:
    page.heading('Unknown objects', folded=True)
    page.paragraph(
        'A trial whose novelty lies above a threshold gets no label. Each label is left out of '
        'the training in turn and tested as something unknown. AUROC: probability that a trial '
        'of it is more novel than one of a known label. Missed: given the name of a known '
        'label. False rejection: share of trials of known labels that are rejected; asked for is '
        'its mean over trials like those of the calibration, and single folds may have far '
        'more. Calibration error: mean distance of stated probabilities from the share of right '
        'answers, before probabilities are fitted to held-out trials and after. Threshold and '
        'probabilities come from folds of the training alone.'
    )
    rows = [
        [
            result.recordings.title,
            f'{100 * each.auroc:.1f}',
            f'{100 * each.miss_rate:.1f}',
            f'{100 * each.realised_false_alarm_rate:.1f}',
            f'{100 * max(each.group_false_alarm_rates):.1f}',
            f'{100 * each.calibration_error_before:.1f}',
            f'{100 * each.calibration_error_after:.1f}',
        ]
        for result, each in found
    ]
    splits = '; '.join(dict.fromkeys(_tell_split(r, each) for r, each in found))
    page.table(
        f'in %, AUROC and missed as means over the labels left out; asked for are '
        f'{100 * found[0][1].false_alarm_rate:g} % false rejection: {splits}',
        [
            'set',
            'AUROC',
            'missed',
            'false rejection',
            'in the worst fold',
            'calibration error before',
            'after',
        ],
        rows,
    )
    for result, each in found:
        page.subheading(result.recordings.title)
        if result.answers is not None and result.answers.raw_scores:
            page.paragraph(f'{tell_raw_scores(result.answers)}.')
        page.drawing(draw_open_set(result, each))
        page.table(
            f'each label unknown in turn, in %, at {100 * each.false_alarm_rate:g} % false '
            f'rejection asked for: {_tell_split(result, each)}',
            ['unknown label', 'AUROC', 'missed', 'trials'],
            [
                [
                    unknown.label,
                    f'{100 * unknown.auroc:.1f}',
                    f'{100 * unknown.miss_rate:.1f}',
                    f'{unknown.trials}',
                ]
                for unknown in each.unknown
            ],
        )


def _tell_split(result: SetResult, each: OpenSetEvaluation | StoppingEvaluation) -> str:
    return (
        f'{result.recordings.table.task}: {CLASSIFIER_TITLES[each.classifier]}, '
        f'{short_scaling(each.scaling)}, {each.split}'
    )


def _add_stopping(page: Page, found: Sequence[tuple[SetResult, StoppingEvaluation]]) -> None:
    page.heading('Early predictions', folded=True)
    page.paragraph(
        'Answers on the first part of a window, while the finger still glides. A rule stops as '
        'soon as the stated probability passes a threshold, which was shown on held-out trials '
        'of the training to keep wrong answers among the early ones below the share asked for. '
        'Where nothing can be shown, it decides nothing early. A short stage knows at which place '
        'of the surface it began: where all trials begin at the same place, as in a rig, it may '
        'do better than it would elsewhere. What was shown holds for trials like those of the '
        'calibration; a fold that is unlike them may have more wrong answers.'
    )
    page.drawing(draw_stopping(found))
    for result, each in found:
        page.subheading(result.recordings.title)
        page.table(
            f'accuracy in % after so much of the window: {_tell_split(result, each)}; '
            f'{each.trials} trials',
            [f'{second:.3g} s' for second in each.seconds],
            [[f'{100 * accuracy:.1f}' for accuracy in each.accuracies]],
            words=0,
        )
        page.table(
            f'stopping rules: {_tell_split(result, each)}; window of {each.seconds[-1]:.3g} s',
            [
                'wrong early answers asked for',
                'decided early',
                'of these wrong',
                'in the worst fold',
                'all answers right',
                'mean signal seen',
                'folds without a rule',
            ],
            [
                [
                    f'{100 * rule.error_rate:g} %',
                    f'{100 * rule.early_share:.1f} %',
                    f'{100 * rule.early_error:.1f} %' if rule.early_share else 'none decided',
                    f'{100 * rule.worst_part_error:.1f} %' if rule.early_share else '',
                    f'{100 * rule.accuracy:.1f} %',
                    f'{rule.mean_s:.2f} s',
                    f'{rule.parts_without_rule}',
                ]
                for rule in each.rules
            ],
            words=0,
        )


def _add_measures(page: Page, found: Sequence[tuple[SetResult, Sequence[MeasureSummary]]]) -> None:
    page.heading('Measures', folded=True)
    page.paragraph(
        'Physical quantities of the same windows; nothing is trained. The stated uncertainty is '
        'the median of the standard uncertainties that the values come with. The spread is half '
        'the width of the range of the middle 68 % of the values. It contains differences between '
        'trials, but no error that all trials share, such as a wrong speed. The stiffness of a '
        'press is measured at the tendon: see docs/measures.md.'
    )
    for result, summaries in found:
        page.subheading(result.recordings.title)
        page.table(
            f'medians over the trials of a label; {len(result.recordings.table)} trials, nothing '
            'is fitted or held out',
            ['measure', 'label', 'measured', 'median', 'spread', 'stated uncertainty'],
            [_tell_measure(each) for each in summaries],
            words=2,
        )
        page.items(list_unmeasured(summaries))


def _tell_measure(each: MeasureSummary) -> list[str]:
    unit, factor = _SHOWN.get(each.unit, (each.unit, 1.0))
    numbers = (each.median, each.spread, each.standard_uncertainty)
    absent = 'too few' if each.measured else 'none'
    return [
        f'{each.name.replace("_", " ")} [{unit}]',
        each.label,
        f'{each.measured} of {each.trials}',
        *(absent if number is None else f'{factor * number:.3f}' for number in numbers),
    ]


def list_unmeasured(summaries: Sequence[MeasureSummary]) -> list[str]:
    """Return why there are trials without a value: a sentence for each measure and reason."""
    labels: dict[tuple[str, str], list[str]] = {}
    for each in summaries:
        if each.reason:
            missing = f'{each.label} ({each.trials - each.measured} of {each.trials})'
            labels.setdefault((each.name.replace('_', ' '), each.reason), []).append(missing)
    return [
        f'No {name} of {", ".join(found)}, most often because: {reason}.'
        for (name, reason), found in labels.items()
    ]
