# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""An answer of a classifier as JSON for the page, and as one line."""

from __future__ import annotations

from typing import Any

from tactile_classifier.records import ClassificationResult, Outcome


def rounded(value: float) -> float:
    """Return a number with four significant digits, as the page gets it."""
    return float(f'{value:.4g}')


def describe_answer(answer: ClassificationResult, true_label: str) -> dict[str, Any]:
    """Return an answer as what JSON can hold, with the likeliest labels first."""
    scores = sorted(zip(answer.labels, answer.scores, strict=False), key=lambda x: -x[1])
    is_right = None
    if true_label and answer.outcome == Outcome.LABEL and not answer.partial:
        is_right = answer.label == true_label
    return {
        'task': answer.task,
        'contact': answer.contact,
        'trial': answer.trial_id,
        'outcome': answer.outcome.name.lower(),
        'label': answer.label,
        'true': true_label,
        'right': is_right,
        'reason': answer.reason,
        'scores': [[label, rounded(score)] for label, score in scores],
        'kind': answer.score_kind,
        'partial': answer.partial,
        'decided': answer.decided,
        'model': answer.model_id,
        'simulated': answer.simulated,
    }


def format_answer(
    finger: str, answer: ClassificationResult, true_label: str, *, names_model: bool = False
) -> str:
    """Return one line about an answer: finger, task, label with its score or *unknown*."""
    parts = [finger] if finger else []
    parts.append(f'{answer.task:9} {answer.contact or "any contact":9}')
    if answer.outcome == Outcome.LABEL:
        score = f'({max(answer.scores):.2f} {answer.score_kind})' if answer.scores else ''
        parts.append(f'{answer.label:13} {score}')
        if true_label:
            parts.append('right' if answer.label == true_label else f'wrong, it is {true_label}')
    elif answer.outcome == Outcome.UNKNOWN:
        parts.append(f'unknown: {answer.reason}')
    else:
        parts.append(f'no answer: {answer.reason}')
    if names_model:
        parts.append(answer.model_id)
    if answer.simulated:
        parts.append('SIMULATED')
    return '  '.join(parts)
