# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The models of one finger: each window is classified by every model that fits it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model, TactileModel
from tactile_classifier.types import ModelInfo, WindowPrediction
from tactile_features.model_contract import load_usable
from tactile_features.spec import FeatureSpec
from tactile_features.types import contacts_agree, FeatureWindow


class ModelSet:
    """The models that classify the windows of one finger.

    Parameters
    ----------
    models : sequence of TactileModel
    contact : str
        Classify only windows of this contact; an empty string allows all contacts.
    refused : sequence of str
        One sentence for each file that cannot be used.

    Attributes
    ----------
    infos : tuple of ModelInfo
        Metadata of each model, for the ``ModelInfos`` message.
    counts : dict of str to int
        Numbers of windows and results, as in the diagnostics. "windows for others" counts windows
        for which no model returned a result.
    mismatch : str or None
        How the specification of the last classified window differs from that of its model, or
        None if it does not.
    """

    def __init__(
        self,
        models: Sequence[TactileModel],
        contact: str = '',
        refused: Sequence[str] = (),
    ) -> None:
        self.models = tuple(models)
        self.refused = tuple(refused)
        self.infos = tuple(_info_of(model, contact) for model in models)
        self._contact = contact
        self._digests: frozenset[str] = frozenset()
        self.counts = {
            'windows': 0,
            'answers': 0,
            'windows for others': 0,
            'windows of another specification': 0,
        }
        self.mismatch: str | None = None

    @classmethod
    def load(cls, models: str | Path, contact: str = '') -> ModelSet:
        """Load the models of a folder with ``*.npz`` files, or one model file.

        For each file that cannot be loaded, ``refused`` contains a sentence; the other files are
        used. Models of another contact are ignored. Raises ModelFileError if no model is usable.
        """
        known: dict[str, str] = {}

        def load(path: Path) -> TactileModel:
            model = load_model(path)
            if model.sha256 in known:
                raise ModelFileError(
                    f'model {path} is the same as {known[model.sha256]}: remove one of them'
                )
            known[model.sha256] = model.path
            return model

        usable, refused = load_usable(models, contact, load)
        return cls(usable, contact, refused)

    @property
    def is_announced(self) -> bool:
        """True after the feature node has announced its specifications."""
        return bool(self._digests)

    @property
    def unfed(self) -> tuple[str, ...]:
        """One sentence for each model whose features the feature node has not announced.

        Empty until the feature node has announced its specifications.
        """
        return tuple(
            f'the feature node does not compute the features of model {model.model_id}: '
            f'set its parameter models to {model.path or "the file of this model"}'
            for model in self.models
            if self.is_announced and not self._is_fed(model)
        )

    def set_specifications(self, specs: Iterable[FeatureSpec]) -> None:
        """Store the specifications that the feature node announced for future windows."""
        announced = tuple(specs)
        self._digests = frozenset(spec.digest for spec in announced)
        for model in self.models:
            model.set_specifications(announced)

    def classify(self, window: FeatureWindow) -> list[WindowPrediction]:
        """Return the results for one window, in the order of the models.

        A model classifies a window if their specifications are equal. If no model has the
        specification of the window, each model of its feature set and contact whose specification
        the feature node has not announced returns a result with the reason instead of a label.
        Other models return nothing, because they receive windows with their own specification.
        """
        models = self.find(window)
        self.counts['windows'] += 1
        self.counts['windows for others'] += not models
        self.counts['answers'] += len(models)
        if models:
            reasons = (model.find_mismatch(window) for model in models)
            self.mismatch = next(filter(None, reasons), None)
            self.counts['windows of another specification'] += self.mismatch is not None
        return [model.classify_window(window) for model in models]

    def find(self, window: FeatureWindow) -> list[TactileModel]:
        """Return the models that return a result for a window; see `classify`."""
        if not contacts_agree(self._contact, window.contact):
            return []
        takers = [model for model in self.models if model.accepts(window)]
        fitting = [model for model in takers if model.fits(window.specification_digest)]
        if not fitting:
            fitting = [model for model in takers if not self._is_fed(model)]
        return fitting

    def _is_fed(self, model: TactileModel) -> bool:
        return any(model.fits(digest) for digest in self._digests)


def _info_of(model: TactileModel, contact: str) -> ModelInfo:
    return ModelInfo(
        model_id=model.model_id,
        path=model.path,
        sha256=model.sha256,
        task=model.task,
        contact=model.contact,
        labels=model.labels,
        specification_digest=model.spec.digest,
        simulated=model.manifest.simulated,
        contact_filter=contact,
    )
