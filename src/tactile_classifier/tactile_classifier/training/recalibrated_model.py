# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A model file for the session of some known trials."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from tactile_classifier.datasets.dataset import FeatureTable
from tactile_classifier.errors import ModelFileError
from tactile_classifier.estimators.threads import on_one_thread
from tactile_classifier.model_file.card import render_card
from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.model_file.live_recalibration import (
    correct,
    read_statistics,
    RECALIBRATED,
)
from tactile_classifier.model_file.manifest import Manifest
from tactile_classifier.training.model_writer import replace_file
from tactile_features.onnx_container import replace_manifest


def write_recalibrated(
    path: str | Path, source: str | Path, tables: Mapping[int, FeatureTable]
) -> TactileModel:
    """Write a model with offsets and thresholds for a session; return it as loaded.

    The graph stays as it is. The manifest states the model that it came from, and what the known
    trials were.

    Parameters
    ----------
    path, source : str or Path
        The file to write, and the trained model.
    tables : mapping of int to FeatureTable
        Known trials of the session by samples: 0, the full windows, and each of the model's
        ``partial_samples``.

    Raises
    ------
    ModelFileError
        When the model cannot be recalibrated, or the trials do not fit it.
    TooFewTrialsError
        When there are too few trials.
    """
    model = TactileModel.load(source)
    manifest = recalibrate(model, tables)
    data = replace_manifest(Path(source).read_bytes(), manifest.to_dict(), render_card(manifest))
    recalibrated = TactileModel(data, str(Path(path).absolute()))
    replace_file(Path(path), data)
    return recalibrated


@on_one_thread
def recalibrate(model: TactileModel, tables: Mapping[int, FeatureTable]) -> Manifest:
    """Return the manifest of the recalibrated model. See `write_recalibrated`."""
    manifest = model.manifest
    statistics = read_statistics(model)
    table = tables[0]
    unknown = np.setdiff1d(table.labels, model.labels)
    if len(unknown):
        raise ModelFileError(f'model {model.model_id} does not know the label "{unknown[0]}"')
    offsets, stages = [], []
    for stage in manifest.stages:
        known = tables[stage.sample_count]
        model.check_fits(known.spec)
        offset, threshold = correct(
            model,
            statistics[stage.sample_count],
            stage.sample_count,
            known.values,
            np.searchsorted(model.labels, known.labels),
        )
        offsets.append(offset.tolist())
        stages.append(dataclasses.replace(stage, novelty_threshold=threshold))
    stated: dict[str, Any] = {
        'model_id': model.model_id,
        'trials': len(table),
        'sessions': sorted({str(name) for name in table.columns.get('session_id', [])}),
        'labels': sorted({str(name) for name in table.labels}),
        'sha256': table.compute_sha256(),
        'offsets': offsets,
    }
    calibration = {**manifest.calibration, RECALIBRATED: stated}
    return dataclasses.replace(manifest, stages=tuple(stages), calibration=calibration)
