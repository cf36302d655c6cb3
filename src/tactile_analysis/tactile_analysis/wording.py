# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results of evaluation and training as sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from tactile_classifier.coverage import format_coverage
from tactile_classifier.evaluation.cross_validation import Evaluation, Score
from tactile_classifier.evaluation.intervals import Interval
from tactile_classifier.types import CLASSIFIER_TITLES, PROBABILITY, short_scaling

if TYPE_CHECKING:
    from tactile_classifier.model_file.manifest import Manifest
    from tactile_classifier.training.feature_choice import Candidate, FeatureChoice


def format_interval(interval: Interval) -> str:
    """Return an interval of accuracies in %, or the reason why there is none."""
    if interval.reason:
        return f'none: {interval.reason}'
    return f'{100 * interval.low:.1f} to {100 * interval.high:.1f}'


def name_candidate(candidate: Candidate) -> str:
    """Return a display name that contains feature set, classifier and scaling."""
    title = CLASSIFIER_TITLES[candidate.classifier]
    return f'{candidate.feature_set} with {title}, {short_scaling(candidate.scaling)}'


def format_span(interval: Interval) -> str:
    """Return an interval of accuracies as text, or the reason why there is none."""
    if interval.reason:
        return f'no interval: {interval.reason}'
    return f'95 % interval {format_interval(interval)} %'


def format_nested(choice: FeatureChoice) -> str:
    """Return a text with the accuracy of the automatic choice in nested cross-validation."""
    nested = choice.nested
    coverage = format_coverage(nested.spread_of, [nested.mean], chosen=True)
    return (
        f'accuracy of this selection procedure: {100 * nested.mean:.1f} % '
        f'({nested.split}; {format_span(nested.interval)}{coverage}); '
        f'chance {100 * choice.evaluation.chance:.1f} %'
    )


def format_mean(score: Score) -> str:
    """Return a mean accuracy in %, with its spread if there are several groups or repetitions."""
    mean = f'{100 * score.mean:.1f}'
    return f'{mean} ± {100 * score.spread:.1f}' if _has_spread(score) else mean


def _has_spread(score: Score) -> bool:
    """Return True if the spread is over several groups or repetitions, not a single one."""
    if score.spread_of == 'groups':
        return score.fold_accuracies.size > 1
    return len(score.fold_accuracies) > 1


def accuracy_caption(evaluation: Evaluation, *, intervals: bool = False) -> str:
    """Return the caption of `accuracy_table`."""
    first = evaluation.scores[0]
    parts = [
        f'accuracy in %: {evaluation.split}, {evaluation.trials} trials',
        f'chance {100 * evaluation.chance:.1f}',
    ]
    if _has_spread(first):
        parts.insert(1, f'± standard deviation over {first.spread_of}')
    if intervals and any(not score.interval.reason for score in evaluation.scores):
        coverage = format_coverage(first.spread_of, [score.mean for score in evaluation.scores])
        parts.insert(-1, f'in brackets: 95 % interval{coverage}')
    return '; '.join(parts)


def format_warnings(evaluations: Sequence[Evaluation]) -> list[str]:
    """Return the distinct warnings of several evaluations of one table."""
    found = [warning for evaluation in evaluations for warning in evaluation.warnings]
    return [f'warning: {warning}' for warning in dict.fromkeys(found)]


def describe_answers(manifest: Manifest) -> list[str]:
    """Return sentences about a model's probabilities and its threshold for unknown objects.

    The numbers in them were measured on held-out trials.
    """
    from tactile_classifier.model_file.manifest import (
        describe_scope,
        describe_thresholds,
        format_scores,
        warn_of_few_groups,
    )

    if 'reason' in manifest.calibration:
        return [
            f'no probabilities, and no detection of unknown objects: '
            f'{manifest.calibration["reason"]}'
        ]
    whole = manifest.confidence
    sentences = [
        f'probabilities: expected calibration error {100 * whole.calibration_error_before:.1f} % '
        f'before calibration, {100 * whole.calibration_error_after:.1f} % after it '
        f'({manifest.calibration["split"]})'
    ]
    if manifest.score_kind != PROBABILITY:
        sentences.append(f'scores: {format_scores(manifest)}')
    sentences += [f'{name}: {fact}' for name, fact in describe_thresholds(manifest).items()]
    sentences.append(describe_scope(manifest))
    if manifest.score_kind == PROBABILITY:
        sentences += warn_of_few_groups(manifest)
    return sentences
