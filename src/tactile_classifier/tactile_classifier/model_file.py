# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Writing a fitted estimator and its manifest as one ONNX file."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import ModelFileError
from tactile_classifier.inference import INPUT, OUTPUT, TactileModel
from tactile_classifier.manifest import Manifest
from tactile_classifier.onnx_container import seal
from tactile_classifier.svm_graph import build_svm_model

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline

__all__ = ['TactileModel', 'write_model']

TARGET_OPSET = {'': 18, 'ai.onnx.ml': 3}
IR_VERSION = 8
"""Versions of operators and file format that onnxruntime reads since 1.14."""


def write_model(
    path: str | Path,
    estimator: Pipeline,
    manifest: Manifest,
    training_values: npt.NDArray[np.float64],
) -> TactileModel:
    """Convert, check and write a model; return it as loaded from the written bytes.

    Everything is computed in doubles, but for trees, whose thresholds scikit-learn
    too compares in single precision. The converted model must give the
    estimator's label for every training trial, or it is not written.

    Parameters
    ----------
    path : str or Path
        Replaced at once when the model is complete; never half written.
    estimator : sklearn.pipeline.Pipeline
        Fitted, from `build_estimator`.
    manifest : Manifest
    training_values : ndarray of shape (trials, k)
        The features that it was fitted on.

    Raises
    ------
    ModelFileError
        When the conversion fails or changes a label, or the file cannot be written.
    """
    try:
        data = seal(_convert(estimator, manifest), manifest.to_json())
        model = TactileModel(data)
    except ModelFileError as error:
        raise ModelFileError(f'model {path} is not written: {error}') from error
    if list(estimator.classes_) != list(model.labels):
        raise ModelFileError(
            f"model {path} is not written: the labels of the manifest are not the estimator's"
        )
    changed = np.flatnonzero(
        np.array(model.predict(training_values)) != estimator.predict(training_values)
    )
    if len(changed):
        raise ModelFileError(
            f'model {path} is not written: conversion to ONNX changes the label of '
            f'{len(changed)} of {len(training_values)} training trials, first of trial '
            f'{changed[0]}; such trials lie on the border between classes: look for '
            'duplicates with different labels, or choose another classifier'
        )
    _replace(Path(path), data)
    return model


def _convert(estimator: Pipeline, manifest: Manifest) -> bytes:
    try:
        if manifest.classifier in ('svm_linear', 'svm_rbf'):
            opset = TARGET_OPSET['']
            model = build_svm_model(estimator, INPUT, OUTPUT, opset, IR_VERSION)
        else:
            model = _convert_by_skl2onnx(estimator, manifest)
    except ImportError as error:
        raise ModelFileError(
            f'writing a model needs skl2onnx ({error}): pip install skl2onnx'
        ) from error
    data: bytes = model.SerializeToString()
    return data


def _convert_by_skl2onnx(estimator: Pipeline, manifest: Manifest) -> Any:
    from skl2onnx import to_onnx
    from skl2onnx.common.data_types import DoubleTensorType
    from skl2onnx.helpers.onnx_helper import select_model_inputs_outputs
    from skl2onnx.sklapi import CastTransformer

    steps: list[tuple[str, Any]] = list(estimator.steps)
    if manifest.classifier == 'tree':
        # scikit-learn's trees compare in single precision, whatever they are given.
        steps.insert(-1, ('cast', CastTransformer(dtype=np.float32).fit(np.zeros((1, 1)))))
    pipeline = type(estimator)(steps)
    try:
        model = to_onnx(
            pipeline,
            initial_types=[(INPUT, DoubleTensorType([None, len(manifest.spec.names)]))],
            options={id(pipeline): {'zipmap': False}},
            target_opset=TARGET_OPSET,
        )
        # Only the scores: the label is the largest, by one rule for all classifiers.
        model = select_model_inputs_outputs(model, 'probabilities')
    except Exception as error:  # skl2onnx, onnx and protobuf each have their own
        cause = error.__cause__ or error
        raise ModelFileError(
            f'skl2onnx cannot convert it ({cause}): pip install "skl2onnx>=1.20"'
        ) from error
    model.ir_version = IR_VERSION
    for node in model.graph.node:
        node.output[:] = [OUTPUT if name == 'probabilities' else name for name in node.output]
    model.graph.output[0].name = OUTPUT
    return model


def _replace(path: Path, data: bytes) -> None:
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(
            dir=path.parent, prefix=f'.{path.name}.', delete=False
        ) as file:
            temporary = file.name
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)  # a temporary file is the owner's alone
        os.replace(temporary, path)
    except OSError as error:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
        raise ModelFileError(f'cannot write model {path}: {error.strerror}') from error
