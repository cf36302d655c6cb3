# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The part of a model file that features need: task, contact, specification, partial windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from tactile_features.spec import WantedFeatures


@dataclass(frozen=True)
class ModelContract:
    """The features that a model file asks for.

    Attributes
    ----------
    path : Path
    task, contact : str
        ``contact`` is empty for a model of any.
    wanted : WantedFeatures
    """

    path: Path
    task: str
    contact: str
    wanted: WantedFeatures


def read_contracts(
    models: str | Path, contact: str = ''
) -> tuple[list[ModelContract], list[str]]:
    """Return the contracts of model files, and one sentence for each file that is not usable.

    Parameters
    ----------
    models : str or Path
        A folder with ``*.onnx`` files, or one file.
    contact : str
        Leave out models of another contact; empty: of none.

    Raises
    ------
    ModelFileError
        When no file is usable.
    """
    raise NotImplementedError
