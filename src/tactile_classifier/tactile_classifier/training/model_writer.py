# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writing what was trained as one ONNX file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import os
from pathlib import Path
import tempfile
from typing import Any, TYPE_CHECKING

import numpy as np

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.graphs import (
    add_answer,
    add_neighbours,
    add_novelty,
    add_probabilities,
    add_random_convolutions,
    add_scaling,
    add_svm,
    Graph,
    Shape,
)
from tactile_classifier.model_file.manifest import format_card
from tactile_classifier.model_file.model import (
    ANSWER,
    INPUT,
    NOVELTY,
    SAMPLES,
    SCORES,
    TactileModel,
)
from tactile_classifier.records import NO_ANSWER, ROCKET, UNKNOWN
from tactile_classifier.training.trainer import FittedStage, Trained
from tactile_features.model_contract import MAX_MODEL_BYTES
from tactile_features.onnx_container import pack_container

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline


TARGET_OPSET = {'': 18, 'ai.onnx.ml': 3}
IR_VERSION = 8
"""Versions of operators and file format that onnxruntime reads since 1.14."""


def write_model(path: str | Path, trained: Trained) -> TactileModel:
    """Convert, check and write a model; return it as loaded from the written bytes.

    Everything is computed in doubles, but for trees, whose thresholds scikit-learn
    too compares in single precision. The converted model must give the
    estimator's label for every training trial and length of window, or it is not written.

    Parameters
    ----------
    path : str or Path
        Replaced at once when the model is complete; never half written.
    trained : Trained
        From `train`.

    Raises
    ------
    ModelFileError
        When the conversion fails or changes a label, or the file cannot be written.
    """
    try:
        try:
            card = format_card(trained.manifest)
            data = pack_container(_convert(trained), trained.manifest.to_dict(), card)
        except ImportError as error:
            raise ModelFileError(
                f'writing a model needs skl2onnx ({error}): pip install skl2onnx'
            ) from error
        if len(data) > MAX_MODEL_BYTES:
            raise ModelFileError(
                f'it would have {len(data) / 2**20:.0f} MiB, the limit is '
                f'{MAX_MODEL_BYTES >> 20} MiB: train it on fewer trials'
            )
        model = TactileModel(data, str(Path(path).absolute()))
    except ModelFileError as error:
        raise ModelFileError(f'model {path} is not written: {error}') from error
    for stage in trained.stages:
        _check_answers(path, model, stage)
    replace_file(Path(path), data)
    return model


def _check_answers(path: str | Path, model: TactileModel, stage: FittedStage) -> None:
    if list(stage.estimator.classes_) != list(model.labels):
        raise ModelFileError(
            f"model {path} is not written: the labels of the manifest are not the estimator's"
        )
    taken = sorted({UNKNOWN, NO_ANSWER} & set(model.labels))
    if taken:
        raise ModelFileError(
            f'model {path} is not written: the label "{taken[0]}" is the name of an answer '
            'without a label; rename it'
        )
    answer = model.compute(stage.values, stage.sample_count).answer
    found = np.array(model.labels)[answer]
    changed = np.flatnonzero(found != stage.estimator.predict(stage.values))
    if len(changed):
        raise ModelFileError(
            f'model {path} is not written: conversion to ONNX changes the label of '
            f'{len(changed)} of {len(stage.values)} training trials, first of trial '
            f'{changed[0]}; such trials lie on the border between classes: look for '
            'duplicates with different labels, or choose another classifier'
        )


def _convert(trained: Trained) -> bytes:
    from onnx import helper

    manifest = trained.manifest
    k, labels = len(manifest.spec.names), len(manifest.labels)
    shapes: dict[str, Shape] = {ANSWER: (int, [None, 1]), SCORES: (float, [None, labels])}
    if trained.stages[0].novelty is not None:
        shapes[NOVELTY] = (float, [None, 1])
    inputs: dict[str, Shape] = {INPUT: (float, [None, k])}
    if len(trained.stages) > 1:
        inputs[SAMPLES] = (int, [])
    graph = Graph()
    _add_stages(graph, trained.stages, manifest.classifier, shapes)
    model = helper.make_model(
        graph.to_proto(inputs, shapes),
        opset_imports=[helper.make_opsetid(*item) for item in TARGET_OPSET.items()],
        ir_version=IR_VERSION,
        producer_name='tactile_classifier',
    )
    data: bytes = model.SerializeToString()
    return data


def _add_stages(
    graph: Graph, stages: Sequence[FittedStage], classifier: str, shapes: Mapping[str, Shape]
) -> None:
    """Add what answers windows of several lengths, of which the input says which it is.

    Halves, and halves of these, are branches: only one stage is computed.
    """
    names = [graph.name(name) for name in shapes]
    if len(stages) == 1:
        for found, name in zip(_add_stage(graph, stages[0], classifier), names, strict=True):
            graph.add('Identity', found, output=name)
        return
    middle = len(stages) // 2
    branches = {}
    for side, half in (('then', stages[:middle]), ('else', stages[middle:])):
        inner = Graph(graph.name(f'{side}_'))
        _add_stages(inner, half, classifier, shapes)
        outputs = {inner.name(name): shape for name, shape in shapes.items()}
        branches[f'{side}_branch'] = inner.to_proto({}, outputs)
    border = graph.constant(np.array(stages[middle].sample_count))
    graph.add_many('If', [graph.add('Less', SAMPLES, border)], names, **branches)


def _add_stage(graph: Graph, stage: FittedStage, classifier: str) -> list[str]:
    """Add one stage; return the names of answer, scores and novelty."""
    if classifier == 'tree':
        scores = graph.embed(_convert_tree(stage.estimator), INPUT)
    else:
        scaled = add_scaling(graph, stage.estimator, INPUT)
        add: Callable[[Graph, Any, str], str] = {
            'knn': add_neighbours,
            ROCKET: add_random_convolutions,
        }.get(classifier, add_svm)
        scores = add(graph, stage.estimator.named_steps['classify'], scaled)
    answer = add_answer(graph, scores)
    if stage.calibration is not None:
        labels = len(stage.estimator.classes_)
        scores = add_probabilities(graph, scores, answer, labels, stage.calibration)
    novelty = [] if stage.novelty is None else [add_novelty(graph, INPUT, stage.novelty)]
    return [answer, scores, *novelty]


def _convert_tree(estimator: Pipeline) -> Any:
    from skl2onnx import to_onnx
    from skl2onnx.common.data_types import DoubleTensorType
    from skl2onnx.helpers.onnx_helper import select_model_inputs_outputs
    from skl2onnx.sklapi import CastTransformer

    steps: list[tuple[str, Any]] = list(estimator.steps)
    # scikit-learn's trees compare in single precision, whatever they are given.
    steps.insert(-1, ('cast', CastTransformer(dtype=np.float32).fit(np.zeros((1, 1)))))
    pipeline = type(estimator)(steps)
    try:
        model = to_onnx(
            pipeline,
            initial_types=[(INPUT, DoubleTensorType([None, estimator.n_features_in_]))],
            options={id(pipeline): {'zipmap': False}},
            target_opset=TARGET_OPSET,
        )
        # Only the scores: the label is the largest, by one rule for all classifiers.
        return select_model_inputs_outputs(model, 'probabilities')
    except Exception as error:  # skl2onnx, onnx and protobuf each have their own
        cause = error.__cause__ or error
        raise ModelFileError(
            f'skl2onnx cannot convert it ({cause}): pip install "skl2onnx>=1.20"'
        ) from error


def replace_file(path: Path, data: bytes) -> None:
    """Write a file at once, so that it is never half written."""
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
