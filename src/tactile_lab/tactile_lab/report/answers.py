# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers of a model besides a label: unknown objects, early predictions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ClassifierError
from tactile_classifier.evaluation.plans import Task
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.records import PROTOCOL_TEXTURE
from tactile_features.spec import spec_for
from tactile_lab.datasets.feature_tables import RecordingFeatures
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_classifier.evaluation.early_answers import StoppingEvaluation
    from tactile_classifier.evaluation.open_set import OpenSetEvaluation

CLASSIFIER = 'knn'
"""Default classifier of `tactile train`; it uses the default scaling."""

FALSE_ALARM_RATE = 0.05
STEPS = 6
"""Number of equal parts of the window; an early prediction follows each."""


@dataclass(frozen=True)
class Answers:
    """Answers on one set of trials; ``not_done`` says why one is None."""

    open_set: OpenSetEvaluation | None
    stopping: StoppingEvaluation | None
    not_done: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the answers as what JSON can hold."""
        return {
            'open_set': self.open_set and self.open_set.to_dict(),
            'stopping': self.stopping and self.stopping.to_dict(),
            'not_done': list(self.not_done),
        }


PartialTables = dict[int, FeatureTable] | str
"""Features of the first part of each window by samples, or a sentence why there are none."""


def read_partial(features: RecordingFeatures, table: FeatureTable) -> PartialTables:
    """Read the features of parts of the windows from an open recording."""
    partial, no_partial = _try(_read_partial, features, table)
    return no_partial or partial


def _read_partial(features: RecordingFeatures, table: FeatureTable) -> dict[int, FeatureTable]:
    if table.task != PROTOCOL_TEXTURE:
        raise TactileError('only texture has them; a hold is answered when it is over')
    if not features.recording.is_own:
        raise TactileError('needs the stream of a bag; an archive has windows alone')
    spec = table.spec
    found = find_feature_set(spec.feature_set)
    if found is None or not found.has_parts:
        raise TactileError(f'{spec.feature_set} has no early predictions')
    config = FeatureConfig(**spec.config_values(), buffer_s=600.0)
    if spec.names != spec_for(table.task, config).names:
        raise TactileError('some of the features alone have no early predictions')
    full_s = spec.sample_count / spec.rate_hz
    return features.partial_tables(table, [full_s * step / STEPS for step in range(1, STEPS)])


class AnswersPlan:
    """The work on one set of trials, in two tasks; see `Plan`.

    Trials that agree in the columns ``hold_out`` are held out together; empty: single trials.
    """

    def __init__(
        self, table: FeatureTable, hold_out: Sequence[str], partial: PartialTables
    ) -> None:
        self._table = table
        self._hold_out = tuple(hold_out)
        self._partial = partial

    def tasks(self) -> list[Task]:
        """Return the tasks."""
        table, hold_out = self._table, self._hold_out
        return [
            (_try, (_evaluate_open_set, table, hold_out)),
            (_try, (_evaluate_stopping, table, hold_out, self._partial)),
        ]

    def finish(self, answers: Sequence[tuple[Any, str]]) -> Answers:
        """Put their results together."""
        (open_set, stopping), reasons = zip(*answers, strict=True)
        names = ('unknown objects', 'early predictions')
        told = zip(names, reasons, strict=True)
        not_done = tuple(f'{name}: {reason}' for name, reason in told if reason)
        return Answers(open_set, stopping, not_done)


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


def _evaluate_stopping(
    table: FeatureTable, hold_out: Sequence[str], partial: PartialTables
) -> StoppingEvaluation:
    from tactile_classifier.evaluation.early_answers import evaluate_stopping

    if isinstance(partial, str):
        raise TactileError(partial)
    return evaluate_stopping(
        table, partial, CLASSIFIER, hold_out=hold_out, false_alarm_rate=FALSE_ALARM_RATE
    )
