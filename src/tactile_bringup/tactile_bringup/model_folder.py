# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""A folder of model files, one for each task and kind of contact."""

from __future__ import annotations

from pathlib import Path

from tactile_bringup.errors import BringupError
from tactile_bringup.graph import all_classifier_names, parse_classifier_name


def model_path(folder: Path, task: str, contact: str) -> Path:
    """Return where the model for a task and a contact lies."""
    return folder / f'{task}_{contact}.onnx'


def find_models(folder: Path) -> dict[str, str]:
    """Return the model files of a folder by the name of the classifier node.

    Raises
    ------
    BringupError
        When the folder holds none.
    """
    models = {}
    for name in all_classifier_names():
        path = model_path(folder, *parse_classifier_name(name))
        if path.is_file():
            models[name] = str(path.resolve())
    if not models:
        example = model_path(folder, 'texture', 'flexion')
        raise BringupError(
            f'no model files in {folder}, such as {example.name}; `tactile train` writes them'
        )
    return models


def find_model(folder: Path, classifier: str) -> str:
    """Return the model file of a folder for one classifier node.

    Raises
    ------
    BringupError
        When the folder has none for it.
    """
    models = find_models(folder)
    if classifier not in models:
        raise BringupError(f'{folder} has no model for the {classifier}, only {", ".join(models)}')
    return models[classifier]
