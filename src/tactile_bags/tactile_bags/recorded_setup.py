# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feature specifications and models of a recording, from its messages.

In a simulated recording, the parameters of the features are in the metadata.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
import hashlib
import json
import logging
import os
from pathlib import Path
from typing import Any

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.message_records import read_records
from tactile_classifier.types import ModelInfo
from tactile_features.config import FeatureConfig, round_rate
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import RATE_TOLERANCE
from tactile_features.feature_sets.registry import PHASE_OF_TASK
from tactile_features.spec import FeatureSpec, shared_rate_hz, spec_for
from tactile_ros.errors import TactileError
from tactile_ros.topics import MODELS, SPECIFICATIONS, STRAIN

_logger = logging.getLogger(__name__)

WRITTEN_IN = 'written_in'
"""Key of the metadata entry with the path of the bag during the recording."""


@dataclass(frozen=True)
class RecordedFeatures:
    """The features of one finger in a recording: parameters of the node, and specifications.

    If ``wanted`` is empty, the specifications follow from the parameters in ``config``.
    """

    config: FeatureConfig
    wanted: tuple[FeatureSpec, ...] = ()

    @property
    def specifications(self) -> tuple[FeatureSpec, ...]:
        """The feature specifications of the recorded windows."""
        return self.wanted or tuple(spec_for(task, self.config) for task in PHASE_OF_TASK)

    def bound(self) -> FeatureConfig:
        """Return parameters that yield the first recorded specification of each task.

        Raises `BagError` when a specification cannot be computed.
        """
        config, tasks = self.config, set[str]()
        try:
            for each in self.wanted:
                if each.task not in tasks:
                    tasks.add(each.task)
                    config = each.bind(config)
        except FeatureError as error:
            raise BagError(f'its features cannot be computed: {error}') from error
        return config


def recorded_features(bag: TactileBag, namespace: str = '') -> RecordedFeatures:
    """Return the features of a finger; raise `BagError` when they are unusable."""
    config = bag.metadata.get('feature_config') or {}
    wanted: dict[str, FeatureSpec] = {}
    messages = list(bag.messages(SPECIFICATIONS, namespace=namespace))
    records = list(read_records(messages))
    if messages and not records and messages[-1].is_of_another_release:
        _logger.warning(
            '%s: its feature specifications are from another release; features are computed by '
            'the installed release with the recorded parameters',
            bag.path,
        )
        config = _read_json(messages[-1].decode().config)
    elif messages and not records:
        raise BagError(
            f'{bag.path}: its feature parameters are unusable: each message on '
            f'{messages[0].topic} is refused; the log contains the reason'
        )
    for _, announced in records:
        config = announced.config
        wanted |= {spec.digest: spec for spec in announced.specs}
    try:
        return RecordedFeatures(_read_config(config), tuple(wanted.values()))
    except (TypeError, FeatureError) as error:
        raise BagError(f'{bag.path}: its feature parameters are unusable: {error}') from error


def computable_features(bag: TactileBag, namespace: str = '') -> RecordedFeatures:
    """Return the features of a finger, for the rate of its recorded samples.

    If `recorded_features` were configured for this rate, they are returned. Otherwise, the node
    could not compute features (for example, with ``rate_hz`` 60 and samples at 100 Hz). In this
    case, the features are configured for the rate of the samples, with windows of the same
    duration.
    """
    recorded = recorded_features(bag, namespace)
    first = next(iter(read_records(bag.messages(STRAIN, namespace=namespace))), None)
    needed_hz = shared_rate_hz(recorded.specifications)
    if first is None or first[1].period_ns <= 0 or not needed_hz:
        return recorded
    rate_hz = round_rate(1e9 / first[1].period_ns)
    if abs(rate_hz / needed_hz - 1.0) <= RATE_TOLERANCE:
        return recorded
    try:
        config = recorded.bound().at_rate(rate_hz)
    except FeatureError as error:
        raise BagError(f'{bag.path}: no features at {rate_hz:g} Hz: {error}') from error
    _logger.warning(
        '%s: its features were configured for %g Hz, but its samples have %g Hz; features are '
        'computed for %g Hz',
        bag.path,
        needed_hz,
        rate_hz,
        rate_hz,
    )
    return RecordedFeatures(config)


def _read_json(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text  # `_read_config` refuses text


def _read_config(values: Mapping[str, Any]) -> FeatureConfig:
    """Return the parameters of a recording; ignore unknown parameters of other releases."""
    if not isinstance(values, Mapping):
        raise TypeError(f'they are {type(values).__name__}, not names and values')
    known = {field.name for field in fields(FeatureConfig)}
    if unknown := sorted(map(str, values.keys() - known)):
        _logger.info('parameters of another release are ignored: %s', ', '.join(unknown))
    return FeatureConfig(**{name: value for name, value in values.items() if name in known})


def nominal_rate_hz(bag: TactileBag, namespace: str = '') -> float:
    """Return the nominal sample rate of a recording [Hz], or 0 if it is unknown."""
    try:
        features = recorded_features(bag, namespace)
    except BagError:
        return 0.0
    if features.wanted:
        return shared_rate_hz(features.wanted)
    return features.config.rate_hz if bag.metadata.get('feature_config') else 0.0


def recorded_models(bag: TactileBag, namespace: str = '') -> tuple[ModelInfo, ...]:
    """Return the models that classified during the recording."""
    found: dict[str, ModelInfo] = {}
    for _, infos in read_records(bag.messages(MODELS, namespace=namespace)):
        found |= {info.model_id: info for info in infos.models}
    return tuple(found.values())


def find_models(bag: TactileBag, namespace: str = '') -> list[Path]:
    """Find the model files that were used during a recording; empty if there were no models.

    A file is searched at its recorded path, and then at the same path relative to the bag, because
    the bag and its models may have been moved together. If a file is missing or has changed,
    raises `TactileError`.
    """
    folder = (bag.path if bag.path.is_dir() else bag.path.parent).resolve()
    written_in = str(bag.metadata.get(WRITTEN_IN, ''))
    return [_find(info, folder, written_in) for info in recorded_models(bag, namespace)]


def _find(info: ModelInfo, folder: Path, written_in: str) -> Path:
    places = [Path(info.path)]
    if written_in:
        places.append(Path(folder, os.path.relpath(info.path, written_in)).resolve())
    there = [place for place in places if place.is_file()]
    for place in there:
        if hashlib.sha256(place.read_bytes()).hexdigest() == info.sha256:
            return place
    problem = f'has changed since: {there[0]}' if there else f'is not at {info.path}'
    raise TactileError(f'the model {info.model_id} of this recording {problem}; state --models')


def gather_models(files: Sequence[Path], scratch: Path) -> Path | None:
    """Return a path for the parameter ``models`` of a node, or None if there are no files.

    If there are several files, the path is a new folder in ``scratch`` with links to the files.
    """
    if len(files) < 2:
        return files[0] if files else None
    folder = Path(scratch, f'models_{len(list(scratch.iterdir()))}')
    folder.mkdir()
    for number, file in enumerate(files):
        (folder / f'{number:03d}_{file.name}').symlink_to(file)
    return folder
