# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The answers of a finger's models, with counts and news of them for people."""

from __future__ import annotations

from tactile_classifier.model_file.model_set import ModelSet
from tactile_classifier.records import ClassificationResult
from tactile_features.records import FeatureWindow
from tactile_features.spec import FeatureSpecifications


class Answering:
    """Answers windows by a `ModelSet`, counts them and notes what people want to know.

    Parameters
    ----------
    models : ModelSet

    Attributes
    ----------
    seen_count : int
        Full windows that came in.
    ignored_count : int
        Those that no model answers: of another feature set, contact or specification.
    published_count : int
        Answers on full windows.
    partial_count : int
        Answers on partial windows.
    refused_count : int
        Windows, partial ones too, whose features are of another specification than the model
        that answers them with the reason.
    is_told : bool
        The specifications of the feature node have been announced.
    mismatch : str
        That reason of the last window; empty where it fitted.
    """

    def __init__(self, models: ModelSet) -> None:
        self.models = models
        self.seen_count = 0
        self.ignored_count = 0
        self.published_count = 0
        self.partial_count = 0
        self.refused_count = 0
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
            self.partial_count += len(results)
        else:
            self.seen_count += 1
            self.ignored_count += not results
            self.published_count += len(results)
        if results:
            reasons = [self._by_id[each.model_id].format_mismatch(window) for each in results]
            self.mismatch = next(filter(None, reasons), '')
            self.refused_count += bool(self.mismatch)
        for result in results:
            self._note(result, window)
        return results

    def take_news(self) -> list[str]:
        """Return sentences about answers since the last call: decided early, recalibrated."""
        news, self._news = self._news, []
        return news

    def values(self) -> dict[str, object]:
        """Return the counts by name, for diagnostics."""
        return {
            'windows': self.seen_count,
            'answers': self.published_count,
            'windows for others': self.ignored_count,
            'windows of another specification': self.refused_count,
            'early predictions': self.partial_count,
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
