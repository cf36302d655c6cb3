# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Analysis of recordings, without ROS: from bags and other files to models, accuracies and pages.

For example::

    from pathlib import Path
    from tactile_analysis import classify_recording, compute_tables, FeatureOptions, TrialSet

    trials = TrialSet.load('bags')  # or CSV, Parquet, .npy, .npz; see `SourceOptions`
    trials.to_frame()  # label, session, source and so on, one row per trial
    trials = trials.select('contact=flexion').exclude('label=cork', 'the plate was loose')
    trials.trials[0].signal.values  # the samples of one trial, read when needed
    trials.to_table()  # all samples, as a pyarrow.Table
    x, y, groups = trials.windows('session_id')  # signals, labels and groups for scikit-learn
    trials.save('trials.npz')

    tables, left_out = compute_tables(trials)  # a `FeatureTable` for each task and contact

    classify_recording(trials, Path('models'))  # the label of each trial, by model files

The commands ``tactile import``, ``features``, ``train``, ``evaluate``, ``classify`` and ``export``
call these functions and print the results.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    'ClassifiedTrial': 'tactile_analysis.datasets.classified',
    'ClassifiedTrials': 'tactile_analysis.datasets.classified',
    'ModelEvaluation': 'tactile_analysis.datasets.model_accuracy',
    'FeatureOptions': 'tactile_analysis.datasets.feature_options',
    'TrialSet': 'tactile_analysis.trial_set',
    'RecordingSet': 'tactile_analysis.report.recordings',
    'SetResult': 'tactile_analysis.report.analysis',
    'SourceError': 'tactile_analysis.options',
    'SourceOptions': 'tactile_analysis.options',
    'analyse': 'tactile_analysis.report.analysis',
    'build_page': 'tactile_analysis.report.build',
    'choose_automatically': 'tactile_analysis.datasets.automatic_features',
    'classify_recording': 'tactile_analysis.datasets.classified',
    'evaluate_models': 'tactile_analysis.datasets.model_accuracy',
    'compute_tables': 'tactile_analysis.datasets.feature_tables',
    'make_sets': 'tactile_analysis.report.recordings',
    'open_trials': 'tactile_analysis.datasets.feature_tables',
    'prepare': 'tactile_analysis.datasets.feature_tables',
    'read_tables': 'tactile_analysis.datasets.feature_tables',
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    # Imported on first use: matplotlib, pyarrow and scikit-learn are slow to import.
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f'module {__name__} has no attribute {name}')


def __dir__() -> list[str]:
    return __all__
