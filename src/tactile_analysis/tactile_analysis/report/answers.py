# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers of a model besides a label: unknown objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ClassifierError
from tactile_classifier.evaluation.plans import Task
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


class AnswersPlan:
    """The work on one set of trials, in one task; see `Plan`.

    Trials that agree in the columns ``hold_out`` are held out together; without columns, folds are
    random.
    """

    def __init__(self, table: FeatureTable, hold_out: Sequence[str]) -> None:
        self._table = table
        self._hold_out = tuple(hold_out)

    def tasks(self) -> list[Task]:
        """Return the tasks."""
        return [(_try, (_evaluate_open_set, self._table, self._hold_out))]

    def finish(self, answers: Sequence[tuple[Any, str]]) -> Answers:
        """Put their results together."""
        ((open_set, reason),) = answers
        return Answers(open_set, (f'unknown objects: {reason}',) if reason else ())


def _try(work: Callable[..., Any], *arguments: Any) -> tuple[Any, str]:
    """Return the result, or None and why there is none."""
    try:
        return work(*arguments), ''
    except (TactileError, ClassifierError) as error:
        return None, str(error)


def _evaluate_open_set(table: FeatureTable, hold_out: Sequence[str]) -> OpenSetEvaluation:
    from tactile_classifier.evaluation.open_set import evaluate_open_set  # builds models: slow

    return evaluate_open_set(
        table, CLASSIFIER, hold_out=hold_out, false_alarm_rate=FALSE_ALARM_RATE
    )
