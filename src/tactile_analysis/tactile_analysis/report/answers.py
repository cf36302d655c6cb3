# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers of a model besides a label: unknown objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ClassifierError
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_classifier.evaluation.open_set import OpenSetEvaluation

CLASSIFIER = 'knn'
"""Default classifier of `tactile train`; it uses the default scaling."""

FALSE_ALARM_RATE = 0.05


@dataclass(frozen=True)
class Answers:
    """Answers on one set of trials, or the reasons why there are none (``not_done``)."""

    open_set: OpenSetEvaluation | None
    not_done: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the answers as what JSON can hold."""
        return {
            'open_set': self.open_set and self.open_set.to_dict(),
            'not_done': list(self.not_done),
        }


def answer(table: FeatureTable, hold_out: Sequence[str]) -> Answers:
    """Return the answers of a model on one set of trials.

    Trials that agree in the columns ``hold_out`` are held out together; without columns, folds are
    random.
    """
    from tactile_classifier.evaluation.open_set import evaluate_open_set  # builds models: slow

    try:
        open_set = evaluate_open_set(
            table, CLASSIFIER, hold_out=hold_out, false_alarm_rate=FALSE_ALARM_RATE
        )
    except (TactileError, ClassifierError) as error:
        return Answers(None, (f'unknown objects: {error}',))
    return Answers(open_set, ())
