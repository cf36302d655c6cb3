# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Model files by the classifier node that runs them, and which features they ask for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactile_classifier.names import all_classifier_names, classifier_name, parse_classifier_name
from tactile_ros.errors import TactileError

PARTIAL = 'partial_samples'


def model_path(folder: Path, task: str, contact: str) -> Path:
    """Return where the model for a task and a contact (which may be empty) lies."""
    return folder / (f'{task}_{contact}.onnx' if contact else f'{task}.onnx')


def find_models(path: Path) -> dict[str, str]:
    """Return model files by the name of the classifier node.

    Parameters
    ----------
    path : Path
        A model file, which says itself what it is for; or a folder with files named as
        `model_path` does.

    Raises
    ------
    TactileError
        When there is none.
    ModelFileError
        When the single file is no model.
    """
    if path.is_file():
        return {_classifier_of(path): str(path.resolve())}
    models = {}
    for name in all_classifier_names():
        file = model_path(path, *parse_classifier_name(name))
        if file.is_file():
            models[name] = str(file.resolve())
    if not models:
        example = model_path(path, 'texture', 'flexion')
        raise TactileError(
            f'no model files in {path}, such as {example.name}; `tactile train` writes them'
        )
    return models


def choose_models(path: Path, task: str, contact: str) -> dict[str, str]:
    """Return those models that take the windows of a task and a contact.

    Raises
    ------
    TactileError
        When there is none.
    ModelFileError
        When the single file is no model.
    """
    models = find_models(path)
    chosen = models_for(models, task, contact)
    if not chosen:
        name = classifier_name(task, contact)
        raise TactileError(f'{path} has no model for the {name}, only {", ".join(models)}')
    return chosen


def models_for(models: Mapping[str, str], task: str, contact: str) -> dict[str, str]:
    """Return those of some models that take the windows of a task and a contact.

    A model without a contact takes the windows of any.
    """
    wanted = (classifier_name(task, contact), classifier_name(task, ''))
    return {name: file for name, file in models.items() if name in wanted}


def _classifier_of(path: Path) -> str:
    from tactile_classifier.model_file.inference import read_manifest  # slow to import

    manifest = read_manifest(path)
    return classifier_name(manifest.task, manifest.contact)


def wanted_features(models: Mapping[str, str], stated: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of the feature node that models need and nobody has stated.

    Partial windows are those of any model: each answers its own and passes over the others.
    A model that does not fit what is stated asks for nothing; its classifier refuses it.

    Parameters
    ----------
    models : mapping of str to str
        Model file by the name of its classifier.
    stated : mapping
        Parameters of the feature node that the user has given.

    Raises
    ------
    TactileError
        When two models need different features: one node computes one kind for a task.
    ModelFileError
        When a file is no model.
    """
    from tactile_classifier.model_file.inference import read_manifest  # slow to import

    wanted: dict[str, Any] = {}
    askers: dict[str, str] = {}
    partial: set[int] = set()
    for path in models.values():
        values = read_manifest(path).feature_values()
        of_partial = values.pop(PARTIAL, ())
        if any(stated.get(name, value) != value for name, value in values.items()):
            continue
        partial.update(of_partial)
        for name, value in values.items():
            if name in wanted and wanted[name] != value:
                raise TactileError(
                    f'the models {askers[name]} and {path} cannot share a feature node: {name} '
                    f'would have to be {wanted[name]} for the one and {value} for the other. '
                    'Train them alike, or name one of them alone'
                )
            wanted[name] = value
            askers.setdefault(name, path)
    if partial:
        wanted[PARTIAL] = tuple(sorted(partial))
    return {name: value for name, value in wanted.items() if name not in stated}
