# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classification of each window by every model that fits it.

`LiveRecalibration` is one model, corrected by the first known trials of each session; `ModelSet`
are all models of a finger; `Answering` counts their answers and tells news of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import dataclasses
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactile_classifier.confidence.recalibration import Correction, TRIALS
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.model import load_model, read_statistics, TactileModel
from tactile_classifier.records import ClassificationResult, ModelInfo
from tactile_features.model_contract import load_usable
from tactile_features.records import contacts_agree, FeatureWindow
from tactile_features.records import Outcome as FeatureOutcome
from tactile_features.spec import FeatureSpec, FeatureSpecifications

Matrix = npt.NDArray[np.float64]


@dataclasses.dataclass
class _Session:
    """Known trials of one session so far, and their correction."""

    session_id: str
    values: list[Matrix] = dataclasses.field(default_factory=list)
    labels: list[int] = dataclasses.field(default_factory=list)
    correction: Correction | None = None


class LiveRecalibration:
    """Answers with a model, recalibrated by the first known trials of each session.

    A trial is known when its window states an ``object_label`` that the model knows. It is
    answered first, and counts for the windows after it. Once there are enough, the correction
    stays until a window states another ``session_id``. The answers are those of the file that
    `recalibrate` would write for the same trials, to the last bit.

    Full windows and each length of partial windows count by themselves: they have topics of their
    own, and a replay repeats the order of each topic alone.

    With 0 ``trials`` the model answers as it is. Raises ModelFileError when it cannot be
    recalibrated, or there are fewer than `TRIALS`.
    """

    def __init__(self, model: TactileModel, trials: int) -> None:
        check_trials(trials)
        self.model = model
        self._trials = trials
        self._statistics = read_statistics(model) if trials else {}
        self._sessions: dict[int, _Session] = {}

    def classify(self, window: FeatureWindow) -> ClassificationResult:
        """Return the answer on a window that the model accepts, and learn from it."""
        if not self._trials:
            return self.model.classify_window(window)
        stage = window.sample_count if window.partial else 0
        session = self._sessions.get(stage)
        if session is None or session.session_id != window.session_id:
            session = self._sessions[stage] = _Session(window.session_id)
        answer = self.model.classify_window(window, session.correction)
        if session.correction is None and self._is_known(window):
            session.values.append(window.values)
            session.labels.append(self.model.labels.index(window.object_label))
            if len(session.values) == self._trials:
                session.correction = self._statistics[stage].recalibrate(
                    np.array(session.values),
                    np.array(session.labels),
                    lambda moved: self.model.compute(moved, stage).novelty,
                )
        return answer

    def _is_known(self, window: FeatureWindow) -> bool:
        return (
            window.object_label in self.model.labels
            and window.outcome == FeatureOutcome.OK
            and not self.model.format_mismatch(window)
            and bool(np.isfinite(window.values).all())
        )


def check_trials(trials: int) -> None:
    """Raise ModelFileError when so few known trials cannot recalibrate a model."""
    if 0 < trials < TRIALS:
        raise ModelFileError(
            f'recalibration_trials is {trials}; it must be 0 or at least {TRIALS}'
        )


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
        another contact are left out. Raises ModelFileError when none is usable.
        """
        check_trials(recalibration_trials)

        known: dict[str, str] = {}

        def load(path: Path) -> TactileModel:
            model = load_model(path)
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


class Answering:
    """Answers windows by a `ModelSet`, counts them and notes what people want to know.

    ``counts`` are by name, as in the diagnostics; windows for others are full windows that no
    model answers. ``mismatch`` says why the features of the last window are of another
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
            'answers on partial windows': 0,
        }
        self.is_told = False
        self.mismatch = ''
        self._by_id = {model.model_id: model for model in models.models}
        self._decided: dict[str, tuple[str, int]] = {}
        self._recalibrated = dict.fromkeys(self._by_id, 0)
        self._news: list[str] = []

    def announce(self, announced: FeatureSpecifications) -> tuple[str, ...]:
        """Take in the specifications of the feature node; return what is missing in them."""
        self.is_told = True
        self.models.set_specifications(announced.specs)
        return self.models.unfed

    def answer(self, window: FeatureWindow) -> list[ClassificationResult]:
        """Return the answers on a window."""
        results = self.models.classify(window)
        if window.partial:
            self.counts['answers on partial windows'] += len(results)
        else:
            self.counts['windows'] += 1
            self.counts['windows for others'] += not results
            self.counts['answers'] += len(results)
        if results:
            reasons = [self._by_id[each.model_id].format_mismatch(window) for each in results]
            self.mismatch = next(filter(None, reasons), '')
            self.counts['windows of another specification'] += bool(self.mismatch)
        for result in results:
            self._note(result, window)
        return results

    def take_news(self) -> list[str]:
        """Return sentences since the last call: decisions on partial windows, recalibrations."""
        news, self._news = self._news, []
        return news

    def values(self) -> dict[str, object]:
        """Return the counts by name, for diagnostics."""
        return {
            **self.counts,
            'recalibrated with trials': max(self._recalibrated.values(), default=0),
            'models': len(self.models.models),
            'refused model files': len(self.models.refused),
        }

    def _note(self, result: ClassificationResult, window: FeatureWindow) -> None:
        if not result.partial:
            self._note_recalibration(result, window)
            return
        trial = (result.trial_id, result.window_start_ns)
        if result.decided and trial != self._decided.get(result.model_id):
            self._decided[result.model_id] = trial
            seconds = (result.window_end_ns - result.window_start_ns) / 1e9
            self._news.append(
                f'{result.model_id}: {result.label} after {seconds:.2f} s of the window, '
                f'probability {max(result.scores):.3f} (trial {result.trial_id})'
            )

    def _note_recalibration(self, result: ClassificationResult, window: FeatureWindow) -> None:
        if result.recalibration_trials != self._recalibrated[result.model_id]:
            self._recalibrated[result.model_id] = result.recalibration_trials
            state = (
                f'recalibrated with {result.recalibration_trials} known trials'
                if result.recalibration_trials
                else 'as trained, until there are known trials'
            )
            self._news.append(f'session "{window.session_id}": {result.model_id} {state}')
