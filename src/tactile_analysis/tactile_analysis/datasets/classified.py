# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classification of the trials of any recording, with or without labels."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.datasets.bag_features import event_before
from tactile_analysis.datasets.feature_tables import prepare_trials, speeds_of
from tactile_analysis.datasets.reading import Reading
from tactile_analysis.trial_set import TrialSet
from tactile_bags.recorded_setup import recorded_features, RecordedFeatures
from tactile_bags.replay import replay_phases
from tactile_classifier.datasets.archive import LabelledTrials
from tactile_classifier.errors import DatasetError
from tactile_classifier.model_file.model import Prediction, TactileModel
from tactile_classifier.model_set import ModelSet
from tactile_classifier.types import NO_ANSWER
from tactile_features.spec import ALL
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
    recording: TrialSet, models: Path, reading: Reading | None = None
) -> ClassifiedTrials:
    """Classify the trials of a recording.

    Parameters
    ----------
    recording : TrialSet
        For bags with trial events, features are computed again with the extractor of the live
        node. For other recordings each trial is one window; longer trials are cut as in training.
    models : Path
        A model file, or a folder with model files.
    reading : Reading, optional
        Selection and cropping of the trials of imported recordings.

    Raises
    ------
    TactileError, ModelFileError, DatasetError
        If no model can be used, or options, recording and models do not fit.
    """
    reading = reading or Reading()
    loaded = ModelSet.load(models)
    if recording.is_own:
        reading.check_for_bags()
        found = tuple(_classify_bags(recording, loaded))
        return ClassifiedTrials(found, loaded.refused)
    questions = {(model.task, model.contact) for model in loaded.models}
    if len(questions) > 1:
        named = '; '.join(sorted(' '.join(filter(None, each)) for each in questions))
        raise TactileError(
            f'the models in {models} are for {named}, and the task of {recording.name} is '
            'unknown: give one model file with --model'
        )
    trials = recording.to_arrays(needs_label=False, skip_bad=True)
    trials = prepare_trials(trials, reading)
    skipped = tuple(f'left out: row {each.row}: {each.reason}' for each in trials.skipped)
    found = tuple(
        each
        for model in loaded.models
        for each in _classify_trials(recording, trials, model, reading)
    )
    return ClassifiedTrials(found, (*loaded.refused, *trials.steps, *skipped))


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
                    label = known[0].label
                for model in models.find(window):
                    answer = model.answer(window)
                    yield ClassifiedTrial(window.trial_id, str(bag.path), label, model, answer)


def _classify_trials(
    recording: TrialSet, trials: LabelledTrials, model: TactileModel, reading: Reading
) -> Iterator[ClassifiedTrial]:
    _check_unit(trials, model)
    signals = _channel_of(trials, model, reading)
    speeds_m_s: NDArray[np.float64] = np.zeros(len(trials))
    if reading.speed_column is not None:
        speeds_m_s = speeds_of(trials, reading.speed_column)
    names = trials.columns.get('trial', trials.rows).astype(str)
    sources = trials.columns.get('source', np.full(len(trials), str(recording.paths[0])))
    for i, signal in enumerate(signals):
        try:
            answer = model.classify(
                signal[..., : trials.lengths[i]],
                trials.rate_hz,
                speed_m_s=float(speeds_m_s[i]),
                cut=True,
            )
        except DatasetError as error:
            answer = Prediction(NO_ANSWER, str(error))
        yield ClassifiedTrial(str(names[i]), str(sources[i]), str(trials.label[i]), model, answer)


def _check_unit(trials: LabelledTrials, model: TactileModel) -> None:
    unit = trials.unit or 'N'
    if not any(re.search(rf'(?<!\w){re.escape(unit)}(?!\w)', each) for each in model.spec.units):
        raise TactileError(
            f'model {model.model_id} was trained on signals in {model.spec.units[0]}, but the '
            f'recording is in {unit}: correct it with --unit, or train on recordings in {unit}'
        )


def _channel_of(
    trials: LabelledTrials, model: TactileModel, reading: Reading
) -> NDArray[np.float64]:
    """Return the signals of the model's channel, shape (trials, n); (trials, channels, n): all."""
    channel = model.spec.channel
    if reading.channel:
        asked = trials.name_channel(reading.channel)
        if channel and len(trials.channels) > 1 and asked != channel:
            raise TactileError(
                f'model {model.model_id} was trained on channel {channel}, but --channel is '
                f'{reading.channel}: omit the option'
            )
        channel = asked
    if len(trials.channels) == 1 and channel != ALL:
        return trials.signal(0)
    name = trials.name_channel(channel or '0')
    if name == ALL:
        return np.asarray(trials.x, dtype=np.float64)
    return trials.signal(name)


def count_right(found: Sequence[ClassifiedTrial]) -> tuple[int, int]:
    """Return the number of correct predictions, and of trials whose label the model knows."""
    known = [each for each in found if each.label in each.model.labels]
    return sum(each.answer.label == each.label for each in known), len(known)
