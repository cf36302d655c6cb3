# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording run again through the plain core, and compared with what was recorded.

Nothing here needs a ROS graph: `replay_through_core` reads the bag and calls the
very objects that the nodes call. `tactile_bringup.nodes.replay_nodes` does the same
through real nodes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from tactile_bags.bag_reader import BagMessage, TactileBag
from tactile_bags.errors import BagError
from tactile_bags.message_records import read_records
from tactile_bags.recorded_topics import CLASSIFICATION, EVENT, FEATURES, STRAIN
from tactile_classifier.errors import ModelFileError
from tactile_classifier.model_file.inference import TactileModel
from tactile_classifier.model_file.live_recalibration import LiveRecalibration
from tactile_classifier.names import parse_classifier_name
from tactile_classifier.records import ClassificationResult, ClassifierConfig
from tactile_features.config import FeatureConfig
from tactile_features.conversions import event_from_msg
from tactile_features.errors import FeatureError
from tactile_features.extraction.extractor import TrialFeatureExtractor
from tactile_features.records import (
    FeatureWindow,
    PHASE_ABORTED,
    PHASE_DONE,
    PHASES_STATED,
    TrialEvent,
)
from tactile_features.spec import spec_for
from tactile_ros.errors import MessageError


@dataclass
class TactileResults:
    """What one pass over a recording yields, in the order of the windows' ends.

    Attributes
    ----------
    windows : list of FeatureWindow
    classifications : list of ClassificationResult
    made_at_ns : dict of int to int
        By the `id` of each: when it arrived in the recording, or when the message did that
        completed it. Empty where this is not known.
    """

    windows: list[FeatureWindow] = field(default_factory=list)
    classifications: list[ClassificationResult] = field(default_factory=list)
    made_at_ns: dict[int, int] = field(default_factory=dict)

    def all(self) -> list[FeatureWindow | ClassificationResult]:
        """Return windows and classifications."""
        return [*self.windows, *self.classifications]

    def sort(self) -> TactileResults:
        """Bring the results into the order of time, whatever order they arrived in."""
        self.windows.sort(
            key=lambda w: (w.window_end_ns, w.trial_id, w.feature_set, not w.partial)
        )
        self.classifications.sort(
            key=lambda c: (c.window_end_ns, c.trial_id, c.model_id, not c.partial)
        )
        return self


def recorded_config(bag: TactileBag) -> FeatureConfig:
    """Return the feature parameters that the recording was made with."""
    values = bag.metadata.get('feature_config')
    try:
        return FeatureConfig(**_renamed(values or {}))
    except (TypeError, FeatureError) as error:
        raise BagError(f'{bag.path}: its feature parameters are unusable: {error}') from error


def _renamed(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters of a recording by the names of today."""
    if not isinstance(values, Mapping):
        raise TypeError(f'they are {type(values).__name__}, not names and values')
    return {'partial_samples' if k == 'running_samples' else k: v for k, v in values.items()}


def recorded_results(bag: TactileBag, namespace: str = '') -> TactileResults:
    """Return the features and classifications that were published while recording."""
    results = TactileResults()
    for message, window in read_records(bag.messages(FEATURES, namespace=namespace)):
        results.windows.append(window)
        results.made_at_ns[id(window)] = message.received_at_ns
    for message, answer in read_records(bag.messages(CLASSIFICATION, namespace=namespace)):
        results.classifications.append(answer)
        results.made_at_ns[id(answer)] = message.received_at_ns
    return results.sort()


def first_sample_ns(bag: TactileBag, namespace: str = '') -> int | None:
    """Return the time of a finger's first sample in the recording [ns]; None: there is none."""
    first = next(read_records(bag.messages(STRAIN, namespace=namespace)), None)
    return None if first is None else int(first[1].stamp_ns)


def sensed_messages(bag: TactileBag, namespace: str = '') -> Iterator[BagMessage]:
    """Yield samples and events in the order of their arrival, as nodes are to take them.

    The topic of the events gives its last ones to those who come late. Those of trials that were
    over when the recorder came are left out: their samples are not in the recording.
    """
    over = _trials_before(bag, namespace)
    for message in bag.messages(STRAIN, EVENT, namespace=namespace):
        if message.type_name != EVENT or not over or not over.pop(0):
            yield message


def _trials_before(bag: TactileBag, namespace: str) -> list[bool]:
    """Return, of the first events, whether the trial of each was over before the recording.

    It ended before the first sample, and its events arrived faster than they happened.
    """
    begin_ns = first_sample_ns(bag, namespace)
    stamps_ns: dict[str, list[int]] = {}
    arrivals_ns: dict[str, list[int]] = {}
    trials, ended = [], set()
    for message in bag.messages(EVENT, namespace=namespace):
        try:
            event = event_from_msg(message.decode())
        except MessageError:
            break
        if begin_ns is None or event.stamp_ns >= begin_ns:
            break
        trials.append(event.trial_id)
        stamps_ns.setdefault(event.trial_id, []).append(event.stamp_ns)
        arrivals_ns.setdefault(event.trial_id, []).append(message.received_at_ns)
        if event.phase in (PHASE_DONE, PHASE_ABORTED):
            ended.add(event.trial_id)
    return [
        trial in ended and 2 * np.ptp(arrivals_ns[trial]) < np.ptp(stamps_ns[trial])
        for trial in trials
    ]


@dataclass
class ReplayedPhases:
    """What the plain core makes of a recording's samples and events.

    Attributes
    ----------
    windows : list of FeatureWindow
        In the order in which they became complete.
    completed_at_ns : list of int
        For each, when the message arrived that completed it [ns].
    events : list of TrialEvent
        The phases that the windows go by: those of the recording, or those found in the signal.
    """

    windows: list[FeatureWindow] = field(default_factory=list)
    completed_at_ns: list[int] = field(default_factory=list)
    events: list[TrialEvent] = field(default_factory=list)


def replay_phases(
    bag: TactileBag, config: FeatureConfig, namespace: str = '', *, finish: bool = False
) -> ReplayedPhases:
    """Return windows and phases of a recording, computed anew by the plain core.

    With ``finish``, phases that were still undecided when the recording ended yield
    a window without features too. Samples that had not come in time when it ended, a node
    had given up as well: see `TrialFeatureExtractor`.
    """
    extractor = TrialFeatureExtractor(config)
    replayed = ReplayedPhases()
    arrived_ns = 0

    def take(windows: list[FeatureWindow]) -> None:
        replayed.windows += windows
        replayed.completed_at_ns += [arrived_ns] * len(windows)

    for message, record in read_records(sensed_messages(bag, namespace)):
        arrived_ns = message.received_at_ns
        if message.type_name == STRAIN:
            take(extractor.add_block(record))
            replayed.events += extractor.take_detected_events()
        else:
            take(extractor.add_event(record))
            if config.phases == PHASES_STATED:
                replayed.events.append(record)
    arrived_ns = bag.end_ns
    take(extractor.pass_time(arrived_ns))
    if finish:
        take(extractor.finish())
    return replayed


def replay_windows(
    bag: TactileBag, config: FeatureConfig, namespace: str = '', *, finish: bool = False
) -> list[FeatureWindow]:
    """Return the windows of `replay_phases`."""
    return replay_phases(bag, config, namespace, finish=finish).windows


def replay_through_core(
    bag: TactileBag,
    models: Mapping[str, TactileModel],
    config: FeatureConfig,
    namespace: str = '',
    recalibration_trials: Mapping[str, int] = MappingProxyType({}),
) -> TactileResults:
    """Return features and classifications of a recording, without any node.

    Parameters
    ----------
    bag : TactileBag
    models : mapping of str to TactileModel
        By the name of the classifier node, which says the contact that it takes.
    config : FeatureConfig
    namespace : str
        Namespace of the finger.
    recalibration_trials : mapping of str to int
        Parameter of that name by classifier node, see `recorded_recalibration`; 0 where not given.
    """
    for model in models.values():
        model.expect(spec_for(model.task, config))
    recalibrations = {
        name: LiveRecalibration(model, recalibration_trials.get(name, 0))
        for name, model in models.items()
    }
    replayed = replay_phases(bag, config, namespace)
    results = TactileResults(replayed.windows)
    for window, at_ns in zip(replayed.windows, replayed.completed_at_ns, strict=True):
        results.made_at_ns[id(window)] = at_ns
        for name, model in models.items():
            task, contact = parse_classifier_name(name)
            takes_contact = ClassifierConfig(task=task, contact=contact).takes_contact
            if model.accepts(window) and takes_contact(window.contact):
                answer = recalibrations[name].classify(window)
                results.classifications.append(answer)
                results.made_at_ns[id(answer)] = at_ns
    return results.sort()


def recorded_recalibration(
    recorded: TactileResults, models: Mapping[str, TactileModel]
) -> dict[str, int]:
    """Return the known trials that each classifier node waited for, by its answers; 0: none."""
    found = dict.fromkeys(models, 0)
    for answer in recorded.classifications:
        for name, model in models.items():
            if answer.model_id == model.model_id:
                found[name] = max(found[name], answer.recalibration_trials)
    return found


def load_models(paths: Mapping[str, str]) -> dict[str, TactileModel]:
    """Load model files by the name of their classifier node.

    Raises
    ------
    ModelFileError
        When a file cannot be used, or is for another task or contact than its name says.
    """
    models = {}
    for name, path in paths.items():
        model = models[name] = TactileModel.load(Path(path))
        task, contact = parse_classifier_name(name)
        if model.task != task or model.contact not in ('', contact):
            raise ModelFileError(
                f'model {path} is for {model.task} {model.contact}, not for {task} {contact}; '
                'give the file the name of what it is for'
            )
    return models
