# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classification of the trials of any recording, with or without labels."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.bag_features import event_before
from tactile_analysis.datasets.feature_options import FeatureOptions
from tactile_analysis.datasets.feature_tables import prepare, refuse_new_signals, speeds_of
from tactile_analysis.trial_set import TrialSet
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import replay_phases
from tactile_bags.trial import Signal
from tactile_classifier.datasets.dataset import name_channel
from tactile_classifier.errors import DatasetError
from tactile_classifier.model_file.model import Prediction, TactileModel
from tactile_classifier.model_set import ModelSet
from tactile_classifier.types import NO_ANSWER
from tactile_features.spec import ALL, MEAN
from tactile_features.types import TrialEvent
from tactile_ros.errors import TactileError


@dataclass(frozen=True)
class ClassifiedTrial:
    """Prediction of a model for a trial.

    ``trial`` is the name of the trial; in bags with trial events, its id. ``label`` is the
    recorded label, or empty.
    """

    trial: str
    source: str
    label: str
    model: TactileModel
    answer: Prediction

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        answer = self.answer
        return {
            'trial': self.trial,
            'source': self.source,
            'label': self.label or None,
            'model_id': self.model.model_id,
            'task': self.model.task,
            'contact': self.model.contact or None,
            'answer': answer.label,
            'reason': answer.reason,
            'probabilities': dict(answer.probabilities),
            'scores': dict(answer.scores),
            'novelty': answer.novelty,
            'novelty_threshold': answer.novelty_threshold,
            'p_value': answer.p_value,
        }


@dataclass(frozen=True)
class ClassifiedTrials:
    """All predictions, with sentences on processing steps and trials that were left out."""

    trials: tuple[ClassifiedTrial, ...]
    notes: tuple[str, ...] = ()


def classify_recording(
    recording: TrialSet, models: Path, options: FeatureOptions | None = None
) -> ClassifiedTrials:
    """Classify the trials of a recording.

    Parameters
    ----------
    recording : TrialSet
        For bags with trial events, features are computed again with the extractor of the live
        node. For other recordings, each trial is one window; a trial that is longer than the
        trials used in training is cut to their length.
    models : Path
        A model file, or a folder with model files.
    options : FeatureOptions, optional
        Selection and cropping of the trials of imported recordings.

    Raises
    ------
    TactileError, ModelFileError, DatasetError
        If no model can be used, or options, recording and models do not fit.
    """
    options = options or FeatureOptions()
    loaded = ModelSet.load(models)
    if recording.is_own:
        refuse_new_signals(recording)
        options.check_for_bags()
        found = tuple(_classify_bags(recording, loaded))
        return ClassifiedTrials(found, loaded.refused)
    questions = {(model.task, model.contact) for model in loaded.models}
    if len(questions) > 1:
        named = '; '.join(sorted(' '.join(filter(None, each)) for each in questions))
        raise TactileError(
            f'the models in {models} are for {named}, and the task of {recording.name} is '
            'unknown: give one model file with --model'
        )
    trials = prepare(recording, replace(options, skip_bad=True), needs_label=False)
    skipped = tuple(f'left out: {sentence}' for sentence in trials.skipped)
    found = tuple(
        each for model in loaded.models for each in _classify_trials(trials, model, options)
    )
    return ClassifiedTrials(found, (*loaded.refused, *trials.notes, *skipped))


def _classify_bags(recording: TrialSet, models: ModelSet) -> Iterator[ClassifiedTrial]:
    specs = tuple({model.spec.digest: model.spec for model in models.models}.values())
    for bag in recording.bags:
        for namespace in bag.namespaces:
            config = recorded_features(bag, namespace).config
            replayed = replay_phases(bag, RecordedFeatures(config, specs), namespace, finish=True)
            models.set_specifications(replayed.specifications)
            events: defaultdict[str, list[TrialEvent]] = defaultdict(list)
            for event in replayed.events:
                events[event.trial_id].append(event)
            for window in replayed.windows:
                label = event_before(window, events[window.trial_id]).object_label
                if recording.is_changed:
                    place = str(bag.path), namespace, window.trial_id
                    known = recording.find_window(*place, window.window_start_ns)
                    if known is None:
                        continue
                    label = known.label
                for model in models.find(window):
                    answer = model.answer(window)
                    yield ClassifiedTrial(window.trial_id, str(bag.path), label, model, answer)


def _classify_trials(
    trials: TrialSet, model: TactileModel, options: FeatureOptions
) -> Iterator[ClassifiedTrial]:
    _check_unit(trials, model)
    included = trials.included
    speeds_m_s: NDArray[np.float64] = np.zeros(len(included))
    if options.speed_column is not None:
        speeds_m_s = speeds_of(trials, options.speed_column)
    for trial, speed_m_s in zip(included, speeds_m_s.tolist(), strict=True):
        signal = trial.signal
        assert signal.rate_hz is not None, 'the set is even'
        samples = _take_channel(signal, model, options)
        try:
            answer = model.classify(samples, signal.rate_hz, speed_m_s=speed_m_s, cut=True)
        except DatasetError as error:
            answer = Prediction(NO_ANSWER, str(error))
        yield ClassifiedTrial(trial.name, trial.source, trial.label, model, answer)


def _check_unit(trials: TrialSet, model: TactileModel) -> None:
    unit = trials.unit or 'N'
    if not any(re.search(rf'(?<!\w){re.escape(unit)}(?!\w)', each) for each in model.spec.units):
        raise TactileError(
            f'model {model.model_id} was trained on signals in {model.spec.units[0]}, but the '
            f'recording is in {unit}: correct it with --unit, or train on recordings in {unit}'
        )


def _take_channel(
    signal: Signal, model: TactileModel, options: FeatureOptions
) -> NDArray[np.float64]:
    """Return the samples of the model's channel, of shape (samples,).

    If the model uses all channels, the shape is (channels, samples).
    """
    channel, names = model.spec.channel, signal.channels
    if options.channel:
        asked = name_channel(options.channel, names)
        if channel and len(names) > 1 and asked != channel:
            raise TactileError(
                f'model {model.model_id} was trained on channel {channel}, but --channel is '
                f'{options.channel}: omit the option'
            )
        channel = asked
    if len(names) == 1 and channel != ALL:
        channel = names[0]
    name = name_channel(channel or 0, names)
    if name == MEAN:
        return np.asarray(signal.values.mean(axis=0))
    return signal.values if name == ALL else np.asarray(signal.values[names.index(name)])


def count_right(found: Sequence[ClassifiedTrial]) -> tuple[int, int]:
    """Return the number of correct predictions, and the number of trials that were counted.

    Only trials whose label the model knows are counted.
    """
    known = [each for each in found if each.label in each.model.labels]
    return sum(each.answer.label == each.label for each in known), len(known)
