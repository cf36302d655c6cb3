# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a comparison of two models says, in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tactile_classifier.evaluation.model_comparison import Answered, Comparison
from tactile_lab.datasets.tables import tell_interval


def tell_verdict(comparison: Comparison, caution: str = '') -> str:
    """Return which model is better, by how much and on what, in one sentence."""
    over = f'{comparison.trials} trials{caution}'
    if comparison.groups:
        over = f'{comparison.groups} {comparison.parts_are}, {over}'
    interval = comparison.interval
    if interval.reason:
        return f'Not told apart: {interval.reason}; {over}.'
    points, low, high = (100 * n for n in (comparison.difference, interval.low, interval.high))
    if not comparison.better:
        span = f'{points:+.1f} points ({low:+.1f} to {high:+.1f})'
        return f'Not told apart: B less A is {span}, {over}.'
    if comparison.better == 'A':
        points, low, high = -points, -high, -low
    return (
        f'{comparison.better} is better by {points:.1f} points ({low:.1f} to {high:.1f}), {over}.'
    )


def tell_difference(comparison: Comparison) -> str:
    """Return where the interval of the difference comes from."""
    if comparison.interval.reason:
        return f'difference: no interval, {comparison.interval.reason}'
    over = comparison.interval.method
    p = '' if over.startswith('t over') else f', p {comparison.p_value:.2g} (exact McNemar)'
    return f'difference: 95 % interval of paired trials, {over}{p}'


def _tell_accuracy(side: Answered) -> str:
    accuracy = f'{100 * side.accuracy:.1f} %'
    return accuracy if side.interval.reason else f'{accuracy}  ({tell_interval(side.interval)})'


def _tell_answered(side: Answered) -> str:
    share = side.answered_accuracy
    return 'it gives none' if share is None else f'{100 * share:.1f} %'


ROWS: Mapping[str, Callable[[Answered], str]] = MappingProxyType(
    {
        'named correctly': _tell_accuracy,
        'right, where it gives a label': _tell_answered,
        'unknown': lambda side: f'{100 * side.unknown_rate:.1f} %',
        'no answer': lambda side: f'{100 * side.no_answer_rate:.1f} %',
    }
)
"""Rows of the table: what each says of one model."""
