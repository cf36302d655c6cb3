# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed and error of the prediction for one window with a model file.

The reference is the prediction of scikit-learn.
"""

from __future__ import annotations

from pathlib import Path
import tempfile

import numpy as np

from benchmarks.measuring import measure_ratio, Report, Row
from tactile_classifier import CLASSIFIERS, FeatureTable, train, write_model
from tactile_classifier.estimators.classifiers import compute_raw_scores
from tactile_classifier.types import ROCKET
from tactile_features import FeatureConfig, features_from_trials, spec_for


def run_inference(quick: bool) -> Report:
    """Compare the classification of single windows with scikit-learn."""
    rows = []
    spectra, waveforms = _texture_tables()
    for task, table, classifiers in (
        ('texture', spectra, CLASSIFIERS),
        ('texture waveform', waveforms, (ROCKET,)),
        ('stiffness', _stiffness_table(), CLASSIFIERS),
    ):
        rng = np.random.default_rng(8)
        first, second = rng.integers(0, len(table), (2, 100 if quick else 1000))
        # The classified points are on lines between two random trials, which cross the boundaries
        # between labels.
        queries = table.values[first] + rng.random((len(first), 1)) * (
            table.values[second] - table.values[first]
        )
        for classifier in classifiers:
            trained = train(table, classifier)
            with tempfile.TemporaryDirectory() as folder:
                model = write_model(Path(folder) / 'model.npz', trained)
            estimator = trained.estimator
            row = queries[:1]
            ratio = measure_ratio(
                lambda model=model, row=row: model.predict(row),
                lambda estimator=estimator, row=row: estimator.predict(row),
                rounds=5 if quick else 15,
            )
            found, part = model.compute(queries), trained
            changed = np.array(model.labels)[found.answer] != estimator.predict(queries)
            scores = part.calibration.compute(compute_raw_scores(estimator, queries))
            difference = np.abs(found.scores - scores).max()
            novelty = np.abs(found.novelty - part.novelty.compute(queries)).max()
            rows.append(
                Row(
                    f'{task}, {classifier}',
                    ratio,
                    float(difference),
                    1e-9,
                    more={
                        'novelty': f'{novelty:.1e}',
                        'changed labels': int(changed.sum()),
                        'of': len(queries),
                    },
                )
            )
    return Report(
        'inference: TactileModel for one window: label, probabilities and novelty',
        "scikit-learn's predict, label only, on the same row (480 x 91, 480 x 180, 300 x 3); for "
        'random convolutions the estimator of this package',
        'largest difference of a probability (and of the novelty), at points between trials',
        rows,
    )


def _texture_tables() -> tuple[FeatureTable, FeatureTable]:
    """Return feature tables with spectra and with waveforms of the same generated trials.

    There are 60 trials for each of 8 textures. A texture is a sum of four sines with noise.
    """
    rng = np.random.default_rng(6)
    time_s = np.arange(180) / 60.0
    rows = []
    for _ in range(8):
        frequency_hz, amplitude_n = rng.uniform(1.0, 25.0, 4), rng.uniform(0.01, 0.1, 4)
        phase = rng.uniform(0.0, 2 * np.pi, (60, 1, 4))
        angle = 2 * np.pi * time_s[:, np.newaxis] * frequency_hz + phase
        rows.append(np.sin(angle) @ amplitude_n + rng.normal(3.0, 0.1, (60, 180)))
    labels = np.repeat([f'plate {k}' for k in range(8)], 60)
    tables = []
    for name in ('texture_spectrum', 'glide_waveform'):
        config = FeatureConfig(texture_features=name)
        values, spec = features_from_trials('texture', np.concatenate(rows), 60.0, config=config)
        tables.append(FeatureTable(values, labels, spec))
    return tables[0], tables[1]


def _stiffness_table() -> FeatureTable:
    """Return 60 generated trials for each of 5 objects, whose features overlap slightly."""
    rng = np.random.default_rng(7)
    centres = [
        [-0.9, 12.6, -0.99],
        [-0.6, 11, -0.97],
        [-0.4, 10, -0.95],
        [-0.2, 9, -0.9],
        [-0.1, 8, -0.7],
    ]
    values = np.repeat(centres, 60, axis=0) * rng.normal(1.0, 0.03, (300, 3))
    labels = np.repeat([f'object {k}' for k in range(5)], 60)
    return FeatureTable(values, labels, spec_for('stiffness', FeatureConfig()))
