# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""All models of a finger: each answers the windows of its specification."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.model_file.live_recalibration import check_trials, LiveRecalibration
from tactile_classifier.records import ClassificationResult, ModelInfo
from tactile_features.model_contract import load_usable
from tactile_features.records import contacts_agree, FeatureWindow
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
        Facts of each model.

    Raises
    ------
    ModelFileError
        When a model cannot be recalibrated.
    """

    def __init__(
        self,
        models: Sequence[TactileModel],
        contact: str = '',
        recalibration_trials: int = 0,
        refused: Sequence[str] = (),
    ) -> None:
        self.models = tuple(models)
        self.refused = tuple(refused)
        self.partial_samples = tuple(sorted({n for m in models for n in m.partial_samples}))
        self.infos = tuple(_info_of(model, recalibration_trials, contact) for model in models)
        self._contact = contact
        self._live = [LiveRecalibration(model, recalibration_trials) for model in models]
        self._digests: frozenset[str] = frozenset()

    @classmethod
    def load(
        cls, models: str | Path, contact: str = '', recalibration_trials: int = 0
    ) -> ModelSet:
        """Return the models of a folder with ``*.onnx`` files, or of one file.

        A file that cannot be loaded or recalibrated is refused; the others answer. Models of
        another contact are left out.

        Raises
        ------
        ModelFileError
            When none is usable.
        """
        check_trials(recalibration_trials)

        known: dict[str, str] = {}

        def load(path: Path) -> TactileModel:
            model = TactileModel.load(path)
            if model.sha256 in known:
                raise ModelFileError(
                    f'model {path} is the same as {known[model.sha256]}: remove one of them'
                )
            LiveRecalibration(model, recalibration_trials)
            known[model.sha256] = model.path
            return model

        usable, refused = load_usable(models, contact, load)
        return cls(usable, contact, recalibration_trials, refused)

    @property
    def unfed(self) -> tuple[str, ...]:
        """One sentence for each model of which no features are announced, once some are."""
        return tuple(
            f'the feature node announces no features that model {model.model_id} was trained on: '
            f'give its parameter models {model.path or "the file of this model"}'
            for model in self.models
            if self._digests and not self._is_fed(model)
        )

    def set_specifications(self, specs: Iterable[FeatureSpec]) -> None:
        """Take in the specifications of the windows to come, as the feature node announces them.

        A model of ready-cut windows does not state how they were cut: it answers the windows of
        each announced specification that does not contradict its own.
        """
        announced = tuple(specs)
        self._digests = frozenset(spec.digest for spec in announced)
        for model in self.models:
            model.set_specifications(announced)

    def classify(self, window: FeatureWindow) -> list[ClassificationResult]:
        """Return the answers on one window, in the order of the models.

        Each model answers whose specification is the window's. A window that fits none is
        answered with the reason by each model of its feature set of which no features are
        announced: the others receive windows of their own.
        """
        if not contacts_agree(self._contact, window.contact):
            return []
        takers = [each for each in self._live if each.model.accepts(window)]
        fitting = [each for each in takers if each.model.fits(window.specification_digest)]
        if not fitting:
            fitting = [each for each in takers if not self._is_fed(each.model)]
        return [each.classify(window) for each in fitting]

    def _is_fed(self, model: TactileModel) -> bool:
        return any(model.fits(digest) for digest in self._digests)


def _info_of(model: TactileModel, recalibration_trials: int, contact: str) -> ModelInfo:
    return ModelInfo(
        model_id=model.model_id,
        path=model.path,
        sha256=model.sha256,
        task=model.task,
        contact=model.contact,
        labels=model.labels,
        specification_digest=model.spec.digest,
        recalibration_trials=recalibration_trials,
        simulated=model.manifest.simulated,
        contact_filter=contact,
    )
