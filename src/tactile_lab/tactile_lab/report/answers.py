# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Answers of a model besides a label: unknown objects, early predictions, physical measures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ClassifierError
from tactile_classifier.evaluation.plans import Task
from tactile_features.config import FeatureConfig
from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.records import Measure, PROTOCOL_TEXTURE
from tactile_features.spec import spec_for
from tactile_lab.datasets.feature_tables import RecordingFeatures
from tactile_ros.errors import TactileError

if TYPE_CHECKING:
    from tactile_classifier.evaluation.early_answers import StoppingEvaluation
    from tactile_classifier.evaluation.open_set import OpenSetEvaluation

CLASSIFIER = 'knn'
"""Default classifier of `tactile train`; it uses the default scaling."""

FALSE_ALARM_RATE = 0.05
SPREAD_NEEDS = 5
"""Of fewer values no spread is told."""

STEPS = 6
"""Number of equal parts of the window; an early prediction follows each."""


@dataclass(frozen=True)
class MeasureSummary:
    """One measure on the trials of one label, of which ``measured`` gave a value.

    Numbers are in ``unit``, and None without values. ``spread`` is half the width of the range of
    the middle 68 % of the values, which is one standard deviation where they are normal; None
    below `SPREAD_NEEDS` values. ``standard_uncertainty`` is the median of those that the measures
    state. ``reason`` is the most frequent reason for no value; empty where each trial has one.
    """

    name: str
    unit: str
    label: str
    trials: int
    measured: int
    median: float | None
    spread: float | None
    standard_uncertainty: float | None
    reason: str


@dataclass(frozen=True)
class Answers:
    """Answers on one set of trials; ``not_done`` says why one is None or empty."""

    open_set: OpenSetEvaluation | None
    stopping: StoppingEvaluation | None
    measures: tuple[MeasureSummary, ...]
    not_done: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the answers as what JSON can hold."""
        return {
            'open_set': self.open_set and self.open_set.to_dict(),
            'stopping': self.stopping and self.stopping.to_dict(),
            'measures': [asdict(measure) for measure in self.measures],
            'not_done': list(self.not_done),
        }


@dataclass(frozen=True)
class WindowExtras:
    """Features of the first parts of each window by samples, and measures of each trial.

    A sentence says why there are none.
    """

    partial: dict[int, FeatureTable] | str
    measures: tuple[tuple[Measure, ...], ...] | str


def read_extras(features: RecordingFeatures, table: FeatureTable) -> WindowExtras:
    """Read parts of the windows and measures from an open recording."""
    partial, no_partial = _try(_read_partial, features, table)
    measures, no_measures = _try(features.measures, table)
    return WindowExtras(no_partial or partial, no_measures or tuple(measures))


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
    """The work on one set of trials, in three tasks; see `Plan`.

    Trials that agree in the columns ``hold_out`` are held out together; empty: single trials.
    """

    def __init__(self, table: FeatureTable, hold_out: Sequence[str], extras: WindowExtras) -> None:
        self._table = table
        self._hold_out = tuple(hold_out)
        self._extras = extras

    def tasks(self) -> list[Task]:
        """Return the tasks."""
        table, hold_out, extras = self._table, self._hold_out, self._extras
        return [
            (_try, (_evaluate_open_set, table, hold_out)),
            (_try, (_evaluate_stopping, table, hold_out, extras.partial)),
            (_try, (_summarise_measures, table, extras.measures)),
        ]

    def finish(self, answers: Sequence[tuple[Any, str]]) -> Answers:
        """Put their results together."""
        (open_set, stopping, measures), reasons = zip(*answers, strict=True)
        names = ('unknown objects', 'early predictions', 'measures')
        told = zip(names, reasons, strict=True)
        not_done = tuple(f'{name}: {reason}' for name, reason in told if reason)
        return Answers(open_set, stopping, measures or (), not_done)


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
    table: FeatureTable, hold_out: Sequence[str], partial: dict[int, FeatureTable] | str
) -> StoppingEvaluation:
    from tactile_classifier.evaluation.early_answers import evaluate_stopping

    if isinstance(partial, str):
        raise TactileError(partial)
    return evaluate_stopping(
        table, partial, CLASSIFIER, hold_out=hold_out, false_alarm_rate=FALSE_ALARM_RATE
    )


def _summarise_measures(
    table: FeatureTable, measures: tuple[tuple[Measure, ...], ...] | str
) -> tuple[MeasureSummary, ...]:
    if isinstance(measures, str):
        raise TactileError(measures)
    return summarise_measures(table.labels, measures)


def summarise_measures(
    labels: NDArray[Any], measures: Sequence[Sequence[Measure]]
) -> tuple[MeasureSummary, ...]:
    """Return one summary a measure and label, from labels and measures of each trial."""
    found: dict[tuple[str, str, str], list[Measure]] = {}
    for label, of_trial in zip(labels, measures, strict=True):
        for measure in of_trial:
            found.setdefault((measure.name, str(label), measure.unit), []).append(measure)
    order = list(dict.fromkeys(name for name, _, _ in found))
    keys = sorted(found, key=lambda key: (order.index(key[0]), key[1]))
    return tuple(_summarise(*key, found[key]) for key in keys)


def _summarise(name: str, label: str, unit: str, measures: Sequence[Measure]) -> MeasureSummary:
    good = [measure for measure in measures if not measure.reason]
    median = spread = uncertainty = None
    if good:
        low, median, high = np.quantile([m.value for m in good], [0.16, 0.5, 0.84]).tolist()
        spread = 0.5 * (high - low) if len(good) >= SPREAD_NEEDS else None
        uncertainty = float(np.median([m.standard_uncertainty for m in good]))
    reasons = Counter(measure.reason for measure in measures if measure.reason)
    return MeasureSummary(
        name=name,
        unit=unit,
        label=label,
        trials=len(measures),
        measured=len(good),
        median=median,
        spread=spread,
        standard_uncertainty=uncertainty,
        reason=reasons.most_common(1)[0][0] if reasons else '',
    )
