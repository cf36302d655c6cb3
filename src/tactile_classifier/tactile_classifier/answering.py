# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classification of each window by every model that fits it.

`ModelSet` are all models of a finger; `Answering` counts their answers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model, TactileModel
from tactile_classifier.records import ClassificationResult, ModelInfo
from tactile_features.model_contract import load_usable
from tactile_features.records import contacts_agree, FeatureWindow
from tactile_features.spec import FeatureSpec, FeatureSpecifications


class ModelSet:
    """The models that answer the windows of one finger.

    Parameters
    ----------
    models : sequence of TactileModel
    contact : str
        Answer windows of this contact only; empty: of any.
    refused : sequence of str
        One sentence for each file that cannot be used.

    Attributes
    ----------
    infos : tuple of ModelInfo
        Facts of each model.
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

    @classmethod
    def load(cls, models: str | Path, contact: str = '') -> ModelSet:
        """Return the models of a folder with ``*.npz`` files, or of one file.

        A file that cannot be loaded is refused; the others answer. Models of another contact are
        left out. Raises ModelFileError when none is usable.
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
    def unfed(self) -> tuple[str, ...]:
        """One sentence for each model of which no features are announced, once some are."""
        return tuple(
            f'the feature node announces no features that model {model.model_id} was trained on: '
            f'give its parameter models {model.path or "the file of this model"}'
            for model in self.models
            if self._digests and not self._is_fed(model)
        )

    def set_specifications(self, specs: Iterable[FeatureSpec]) -> None:
        """Take in the specifications that the feature node announces for the windows to come."""
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
        return [model.classify_window(window) for model in self.find(window)]

    def find(self, window: FeatureWindow) -> list[TactileModel]:
        """Return the models that answer a window; see `classify`."""
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


class Answering:
    """Answers windows by a `ModelSet`, and counts them.

    ``counts`` are by name, as in the diagnostics; windows for others are those that no model
    answers. ``mismatch`` says why the features of the last window are of another
    specification than its model's; empty where they are not. ``is_told``: the specifications of
    the feature node have been announced.
    """

    def __init__(self, models: ModelSet) -> None:
        self.models = models
        self.counts = {
            'windows': 0,
            'answers': 0,
            'windows for others': 0,
            'windows of another specification': 0,
        }
        self.is_told = False
        self.mismatch = ''
        self._by_id = {model.model_id: model for model in models.models}

    def announce(self, announced: FeatureSpecifications) -> tuple[str, ...]:
        """Take in the specifications of the feature node; return what is missing in them."""
        self.is_told = True
        self.models.set_specifications(announced.specs)
        return self.models.unfed

    def answer(self, window: FeatureWindow) -> list[ClassificationResult]:
        """Return the answers on a window."""
        results = self.models.classify(window)
        self.counts['windows'] += 1
        self.counts['windows for others'] += not results
        self.counts['answers'] += len(results)
        if results:
            reasons = [self._by_id[each.model_id].format_mismatch(window) for each in results]
            self.mismatch = next(filter(None, reasons), '')
            self.counts['windows of another specification'] += bool(self.mismatch)
        return results

    def values(self) -> dict[str, object]:
        """Return the counts by name, for diagnostics."""
        return {
            **self.counts,
            'models': len(self.models.models),
            'refused model files': len(self.models.refused),
        }
