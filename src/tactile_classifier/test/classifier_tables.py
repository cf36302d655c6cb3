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
