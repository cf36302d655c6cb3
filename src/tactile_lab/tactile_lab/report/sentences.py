# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the numbers say, in sentences that follow from them by rule."""

from __future__ import annotations

from collections.abc import Sequence

from tactile_classifier.estimators.classifiers import CLASSIFIERS
from tactile_classifier.evaluation.cross_validation import Evaluation, Score
from tactile_classifier.evaluation.intervals import Interval
from tactile_lab.datasets.tables import CLASSIFIER_TITLES, short_scaling
from tactile_lab.report.analysis import SetResult
from tactile_lab.report.answers import Answers
from tactile_lab.report.figures.accuracy import distance_shares
from tactile_lab.report.published import AGREES, Comparison, DISAGREES, UNTESTED


def tell_interval(interval: Interval) -> str:
    """Return an interval of accuracies in %, or why there is none."""
    if interval.reason:
        return f'none: {interval.reason}'
    return f'{100 * interval.low:.1f} to {100 * interval.high:.1f}'


def tell_score(score: Score) -> str:
    """Return a score in one line: classifier, scaling, accuracy."""
    return (
        f'{CLASSIFIER_TITLES[score.classifier]}, {short_scaling(score.scaling)}: '
        f'{100 * score.mean:.1f} %'
    )


def tell_choice(evaluation: Evaluation) -> str:
    """Return how well a classifier does that was chosen inside the folds, and which that was."""
    chance = f'chance {100 * evaluation.chance:.1f} %'
    nested = evaluation.nested
    if nested is None:
        return (
            f'{evaluation.split}: too few trials to choose a classifier inside the folds. The '
            f'best of {len(evaluation.scores)} afterwards would flatter ({chance}).'
        )
    folds = sum(count for *_, count in nested.picks)
    picks = ', '.join(
        f'{CLASSIFIER_TITLES[classifier]}, {short_scaling(scaling)} ({count} of {folds})'
        for classifier, scaling, count in nested.picks
    )
    return (
        f'Chosen inside the folds, {evaluation.split}: {100 * nested.mean:.1f} % (95 % interval '
        f'{tell_interval(nested.interval)}; {chance}); chosen: {picks}.'
    )


def summarise_set(result: SetResult) -> list[str]:
    """Return the findings on one set: best, scaling, groups, selection."""
    best = max(result.plain.scores, key=lambda score: score.mean)
    found = [tell_choice(evaluation) for evaluation in result.evaluations]
    changes = {
        name: result.plain.score(name, 'standard').mean - result.plain.score(name, 'none').mean
        for name in CLASSIFIERS
    }
    largest = max(changes, key=lambda name: abs(changes[name]))
    found.append(
        f'Scaling moves {CLASSIFIER_TITLES[largest]} by {100 * changes[largest]:+.1f} '
        'points, more than any other classifier.'
    )
    for evaluation in result.evaluations[1:]:
        # The same classifier and scaling on both sides: the best there may be another one.
        held_out = evaluation.score(best.classifier, best.scaling)
        found.append(
            f'With {evaluation.split}, {tell_score(held_out)}, which is '
            f'{100 * (held_out.mean - best.mean):+.1f} points from plain folds.'
        )
    for split in dict.fromkeys(selection.split for selection in result.selections):
        here = [selection for selection in result.selections if selection.split == split]
        verdicts = [selection.verdict for selection in here]
        found.append(
            f'Keeping the features with the lowest mean p helps '
            f'{verdicts.count("helps")} and hurts {verdicts.count("hurts")} of {len(here)} '
            f'combinations of classifier and scaling ({split}).'
        )
    if result.answers is not None:
        found += summarise_answers(result.answers)
    return found


def summarise_answers(answers: Answers) -> list[str]:
    """Return what became of unknown labels, of probabilities, and of answering sooner."""
    found = []
    if (unknown := answers.open_set) is not None:
        found.append(
            f'Unknown labels ({unknown.split}): AUROC {100 * unknown.auroc:.1f} %, '
            f'{100 * unknown.miss_rate:.1f} % missed on average; false alarms '
            f'{100 * unknown.realised_false_alarm_rate:.1f} % where '
            f'{100 * unknown.false_alarm_rate:g} % were asked for. Calibration error '
            f'{100 * unknown.calibration_error_before:.1f} % before, '
            f'{100 * unknown.calibration_error_after:.1f} % after.'
        )
    if answers.stopping is not None:
        found += [
            f'Sooner ({answers.stopping.split}), {100 * rule.error_rate:g} % wrong early answers '
            f'asked for: '
            + (
                f'{100 * rule.early_share:.1f} % decided early, '
                f'{100 * rule.early_error:.1f} % of these wrong; {rule.mean_s:.2f} s of '
                f'{rule.full_s:.3g} s behind an answer on average.'
                if rule.early_share
                else 'no threshold could be shown to keep it, so nothing is decided early.'
            )
            for rule in answers.stopping.rules
        ]
    return found


def summarise_comparison(comparisons: Sequence[Comparison]) -> str:
    """Return how many of the paper's statements hold here."""
    tested = [c for c in comparisons if c.verdict != UNTESTED]
    agree = sum(c.verdict == AGREES for c in tested)
    disagree = sum(c.verdict == DISAGREES for c in tested)
    return (
        f'Of {len(tested)} checks of what the paper states (accuracies with and without scaling), '
        f'on these trials {agree} agree, '
        f'{disagree} do not, and {len(tested) - agree - disagree} agree in part.'
    )


def explain_scaling(result: SetResult) -> str:
    """Return what happens to the RBF machine without scaling, from this set's numbers."""
    names = [name.rpartition('__')[2] for name in result.recordings.table.spec.names]
    shares = distance_shares(result)
    largest = int(shares.argmax())
    unscaled = result.plain.score('svm_rbf', 'none').mean
    scaled = result.plain.score('svm_rbf', 'standard').mean
    accuracies = [point.accuracy for point in result.units]
    gains = {
        name: result.plain.score(name, 'standard').mean - result.plain.score(name, 'none').mean
        for name in CLASSIFIERS
    }
    others = ', '.join(
        f'{CLASSIFIER_TITLES[name]} by {100 * gains[name]:+.1f}'
        for name in CLASSIFIERS
        if name != 'svm_rbf'
    )
    return (
        f'{result.recordings.title}: unscaled, {names[largest]} makes up '
        f'{100 * shares[largest]:.1f} % of the squared distance between trials. The RBF machine '
        f'names {100 * unscaled:.1f} % unscaled and {100 * scaled:.1f} % scaled; unscaled, the '
        f'choice of the unit of force alone moves it between {100 * min(accuracies):.1f} % and '
        f'{100 * max(accuracies):.1f} %. Scaling moves it by {100 * gains["svm_rbf"]:+.1f} '
        f'points, {others}.'
    )
