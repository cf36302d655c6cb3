# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Choice of the set of features and of the classifier inside the folds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
import dataclasses
import time
from typing import Any, NamedTuple

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.datasets.splits import Split
from tactile_classifier.errors import DatasetError
from tactile_classifier.estimators.classifiers import RANDOM_STATE
from tactile_classifier.estimators.threads import on_one_thread
from tactile_classifier.evaluation.cross_validation import (
    chance_level,
    check_folds,
    find_tested_cells,
    list_pairs,
    split_interval,
)
from tactile_classifier.evaluation.intervals import Interval
from tactile_classifier.records import ROCKET


class Candidate(NamedTuple):
    """A set of features, and a classifier with its scaling."""

    feature_set: str
    classifier: str
    scaling: str


@dataclasses.dataclass(frozen=True)
class CandidateScore:
    """Accuracy of a candidate on the folds.

    Attributes
    ----------
    accuracy : float
        Mean over the folds [1]; of the best candidate it is too good on average.
    fold_s : float
        Time to train and test a fold, without the features, mean of the folds [s].
    """

    candidate: Candidate
    accuracy: float
    fold_s: float


@dataclasses.dataclass(frozen=True)
class FeatureChoice:
    """The choice, and the candidates that it was made from.

    Attributes
    ----------
    split : str
        How the trials were divided, in words.
    ranking : tuple of CandidateScore
        All candidates, the best first; of equals the one that was named first.
    nested_accuracy : float
        When each fold's training trials choose, and its tests only judge [1].
    interval : Interval
        Of ``nested_accuracy``.
    chance : float
        Accuracy of always naming the commonest label [1].
    picks : tuple of (Candidate, int)
        What the folds chose, and how many of them.
    """

    split: str
    ranking: tuple[CandidateScore, ...]
    nested_accuracy: float
    interval: Interval
    chance: float
    picks: tuple[tuple[Candidate, int], ...]

    @property
    def best(self) -> CandidateScore:
        """The chosen candidate."""
        return self.ranking[0]

    def to_dict(self) -> dict[str, Any]:
        """Return the choice as what JSON can hold."""
        return {
            'split': self.split,
            'ranking': [
                {**s.candidate._asdict(), 'accuracy': s.accuracy, 'fold_s': s.fold_s}
                for s in self.ranking
            ],
            'nested_accuracy': self.nested_accuracy,
            'interval': self.interval.to_dict(),
            'chance': self.chance,
            'picks': [{**c._asdict(), 'folds': count} for c, count in self.picks],
        }


@on_one_thread
def choose_candidate(
    tables: Mapping[str, FeatureTable], split: Split, random_state: int = RANDOM_STATE
) -> FeatureChoice:
    """Choose among tables of the same trials and the classifiers that go with each.

    Folds inside each fold's training trials choose for that fold (nested cross-validation), which
    says how good the choice is. The choice itself is made by the folds.

    Parameters
    ----------
    tables : mapping of str to FeatureTable
        By feature set; of equally good ones the first is chosen, so cheap ones come first.
    split : Split
        Of which the first repetition is used.
    random_state : int
        Of the folds inside the folds.

    Raises
    ------
    DatasetError
        When the tables are not of the same trials.
    EvaluationError
        When a fold's training trials cannot be divided once more.
    """
    first = next(iter(tables.values()))
    for name, table in tables.items():
        if not np.array_equal(table.labels, first.labels):
            raise DatasetError(f'the table of {name} is not of the same trials')
    folds = split.repeats[0]
    inner = [split.divide_again(train, first.labels, random_state) for train, _ in folds]
    candidates = [
        Candidate(name, *pair) for name, table in tables.items() for pair in _list_pairs(table)
    ]
    right, scores, counts = [], [], []
    for candidate in candidates:
        table = tables[candidate.feature_set]
        asked = (candidate.classifier, candidate.scaling, table.values, table.labels)
        start_s = time.perf_counter()
        right.append(check_folds(*asked, folds, table.channels))
        fold_s = (time.perf_counter() - start_s) / len(folds)
        accuracy = float(np.mean([each.mean() for each in right[-1]]))
        scores.append(CandidateScore(candidate, accuracy, fold_s))
        counts.append(
            [sum(int(e.sum()) for e in check_folds(*asked, f, table.channels)) for f in inner]
        )
    picked = np.argmax(counts, axis=0)
    named = np.zeros(len(first))
    for i, pick in enumerate(picked):
        named[folds[i][1]] = right[pick][i]
    nested = np.array([named[test].mean() for _, test in folds])
    return FeatureChoice(
        split.once().name,
        tuple(sorted(scores, key=lambda score: -score.accuracy)),
        float(nested.mean()),
        split_interval(split, find_tested_cells(first, split), named, nested),
        chance_level(first, split),
        tuple(Counter(candidates[pick] for pick in picked).most_common()),
    )


def _list_pairs(table: FeatureTable) -> list[tuple[str, str]]:
    # The four classifiers on a waveform itself take its samples for features of any order.
    return list_pairs(table, [ROCKET] if table.is_waveform else None)
