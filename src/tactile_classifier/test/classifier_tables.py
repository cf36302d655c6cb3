# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables of features for several test files."""

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_features.spec import array_spec


def make_table(labels, values=None, **columns):
    """Return a table of windows that are already cut; by default, three features are noise."""
    if values is None:
        values = np.random.default_rng(0).normal(size=(len(labels), 3))
    features = values.shape[1]
    task, samples = ('stiffness', 50) if features == 3 else ('texture', 2 * features - 1)
    columns = {name: np.asarray(column) for name, column in columns.items()}
    return FeatureTable(values, np.asarray(labels), array_spec(task, samples, 60.0), columns)


def make_repeats(conditions, seed):
    """Return a table with near copies: three trials for each condition and label."""
    rng = np.random.default_rng(seed)
    labels = np.tile(np.repeat(['a', 'b'], 3), conditions)
    values = np.repeat(rng.normal(size=(2 * conditions, 3)), 3, axis=0)
    values[labels == 'b', 0] += 1.5
    values += 1e-3 * rng.normal(size=values.shape)
    return make_table(labels, values, speed=np.repeat(np.arange(conditions), 6))
