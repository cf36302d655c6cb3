# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the models of a finger ask of its feature node, so that nobody has to say it twice."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tactile_classifier.model_file.inference import read_manifest
from tactile_ros.errors import TactileError

RUNNING = 'running_samples'


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
    wanted: dict[str, Any] = {}
    askers: dict[str, str] = {}
    running: set[int] = set()
    for path in models.values():
        values = read_manifest(path).feature_values()
        of_running = values.pop(RUNNING, ())
        if any(stated.get(name, value) != value for name, value in values.items()):
            continue
        running.update(of_running)
        for name, value in values.items():
            if name in wanted and wanted[name] != value:
                raise TactileError(
                    f'the models {askers[name]} and {path} cannot share a feature node: {name} '
                    f'would have to be {wanted[name]} for the one and {value} for the other. '
                    'Train them alike, or name one of them alone'
                )
            wanted[name] = value
            askers.setdefault(name, path)
    if running:
        wanted[RUNNING] = tuple(sorted(running))
    return {name: value for name, value in wanted.items() if name not in stated}
