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

"""Cross-validated neighbours from distances, against scikit-learn in every fold."""

from __future__ import annotations

from functools import partial
from typing import Any

from inference import _stiffness_table, _texture_tables
from measuring import measure_ratio, Report, Row
import numpy as np
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from tactile_classifier.datasets.splits import stratified_split
from tactile_classifier.estimators.classifiers import SCALINGS
from tactile_classifier.estimators.neighbours import NEIGHBOURS, predict_neighbours


def run_neighbours(quick: bool) -> Report:
    """Answer all folds of repeated cross-validation."""
    rows = []
    for task, table in (('texture', _texture_tables()[0]), ('stiffness', _stiffness_table())):
        split = stratified_split(table, 6, 2 if quick else 10)
        folds = [fold for repeat in split.repeats for fold in repeat]
        # Errors that split the votes; without any there would be nothing to get wrong.
        noise = np.random.default_rng(3).normal(0.0, 2.0, table.values.shape)
        values = table.values + noise * table.values.std(axis=0)
        for scaling in SCALINGS:
            ours = partial(predict_neighbours, values, table.labels, folds, scaling)
            theirs = partial(_predict_by_search, values, table.labels, folds, scaling)
            changed = sum(
                int(np.sum(one != other)) for one, other in zip(ours(), theirs(), strict=True)
            )
            ratio = measure_ratio(ours, theirs, rounds=3 if quick else 9)
            rows.append(
                Row(
                    f'{task} {len(table)} x {values.shape[1]}, {scaling}, {len(folds)} folds',
                    ratio,
                    float(changed),
                    0.0,
                )
            )
    return Report(
        'neighbours: three nearest, cross-validated',
        "scikit-learn's KNeighborsClassifier fitted in every fold",
        'answers that differ',
        rows,
    )


def _predict_by_search(values: Any, labels: Any, folds: Any, scaling: str) -> list[Any]:
    answers = []
    for train, test in folds:
        estimator = KNeighborsClassifier(NEIGHBOURS, algorithm='kd_tree')
        if scaling == 'standard':
            estimator = make_pipeline(StandardScaler(), estimator)
        estimator.fit(values[train], labels[train])
        answers.append(estimator.predict(values[test]))
    return answers
