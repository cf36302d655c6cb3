# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# %%
# # Add a feature set
#
# A feature set is one class. Here: the root mean square and the range of the tension of a glide.
# [Feature sets](../feature_sets.md) says what else a set may state.
import importlib
import sys
import tempfile
from pathlib import Path

import numpy as np

MODULE = """
import numpy as np

from tactile_features import Feature, FeatureSet


class Roughness(FeatureSet):
    name = 'roughness'
    version = 1
    phase = 'glide'
    cut = ('texture_crop_start_s', 'max_gap_samples')
    count_field = 'texture_samples'

    def describe(self, sample_count, rate_hz):
        return Feature('tension__rms', 'N'), Feature('tension__range', 'N')

    def compute(self, samples):
        change = samples.tension_n - samples.tension_n.mean(axis=-1, keepdims=True)
        rms = np.sqrt((change**2).mean(axis=-1))
        return np.stack([rms, np.ptp(change, axis=-1)], axis=-1)
"""

# %%
# ## Installation
#
# The class belongs into a package of yours, whose `pyproject.toml` names it in the entry point group
# `tactile.feature_sets`. `pip install` then writes what this script writes by hand:
scratch = tempfile.TemporaryDirectory()
site = Path(scratch.name)
metadata = site / 'roughness-1.0.dist-info'
metadata.mkdir()
(site / 'roughness.py').write_text(MODULE)
(metadata / 'METADATA').write_text('Metadata-Version: 2.1\nName: roughness\nVersion: 1.0\n')
(metadata / 'entry_points.txt').write_text('[tactile.feature_sets]\nroughness = roughness:Roughness\n')
sys.path.insert(0, str(site))
importlib.invalidate_caches()

# %%
# ## Use
#
# The set is chosen by its name, here as by the parameter `texture_features` of the features node. The trials are noise of
# 1 N and of 3 N.
from tactile_classifier import LabelledTrials, evaluate, table_from_trials
from tactile_features import FeatureConfig, list_feature_sets

print(', '.join(list_feature_sets('glide')))
rng = np.random.default_rng(0)
x = rng.normal(size=(40, 1, 120)) * np.repeat([1.0, 3.0], 20)[:, None, None]
trials = LabelledTrials(x, np.repeat(['smooth', 'rough'], 20), 60.0, {})
table = table_from_trials('texture', trials, config=FeatureConfig(texture_features='roughness'))
for name, unit, value in zip(table.spec.names, table.spec.units, table.values[0], strict=True):
    print(f'{name}: {value:.2f} {unit}')
score = evaluate(table, ['knn'], ['none']).scores[0]
print(f'{100 * score.mean:.0f} % by {score.split}')
