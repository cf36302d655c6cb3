# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""All models of a finger: each answers the windows of its specification."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.records import ClassificationResult, ModelInfo
from tactile_features.records import FeatureWindow
from tactile_features.spec import FeatureSpec


class ModelSet:
    """The models that answer the windows of one finger.

    Parameters
    ----------
    models : sequence of TactileModel
    contact : str
        Answer windows of this contact only; empty: of any.
    recalibration_trials : int
        Known trials of each session that recalibrate each model; 0: none.
    refused : sequence of str
        One sentence for each file that cannot be used.

    Attributes
    ----------
    models : tuple of TactileModel
    refused : tuple of str
    partial_samples : tuple of int
        Lengths of the partial windows that any of them answers, rising.
    infos : tuple of ModelInfo
    """

    models: tuple[TactileModel, ...]
    refused: tuple[str, ...]
    partial_samples: tuple[int, ...]
    infos: tuple[ModelInfo, ...]

    def __init__(
        self,
        models: Sequence[TactileModel],
        contact: str = '',
        recalibration_trials: int = 0,
        refused: Sequence[str] = (),
    ) -> None:
        raise NotImplementedError

    @classmethod
    def load(
        cls, models: str | Path, contact: str = '', recalibration_trials: int = 0
    ) -> ModelSet:
        """Return the models of a folder or of one file.

        Raises
        ------
        ModelFileError
            When none is usable.
        """
        raise NotImplementedError

    def set_specifications(self, specs: Iterable[FeatureSpec]) -> None:
        """Take in the specifications that the feature node announces."""
        raise NotImplementedError

    def classify(self, window: FeatureWindow) -> list[ClassificationResult]:
        """Return one answer of each model that the window is for."""
        raise NotImplementedError
