# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Conversion of the messages of a bag to records. Messages with invalid values are skipped."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
import logging
from typing import Any

from tactile_bags.bag_reader import BagMessage
from tactile_classifier.conversions import classification_from_msg, model_infos_from_msg
from tactile_features.conversions import (
    event_from_msg,
    feature_window_from_msg,
    specifications_from_msg,
    strain_block_from_msg,
)
from tactile_ros.errors import MessageError
from tactile_ros.topics import CLASSIFICATION, EVENT, FEATURES, MODELS, SPECIFICATIONS, STRAIN

_CONVERSIONS: dict[str, Callable[[Any], Any]] = {
    STRAIN: strain_block_from_msg,
    EVENT: event_from_msg,
    FEATURES: feature_window_from_msg,
    CLASSIFICATION: classification_from_msg,
    SPECIFICATIONS: specifications_from_msg,
    MODELS: model_infos_from_msg,
}

RECORDED_TYPES = tuple(_CONVERSIONS)
"""Message types that can be converted to a record."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class KeptMessage(BagMessage):
    """A message that keeps its decoded record.

    If ``correct`` is given, it is applied to the record after decoding.
    """

    correct: Callable[[Any], Any] | None = None

    @cached_property
    def record(self) -> Any:
        record = _CONVERSIONS[self.type_name](self.decode())
        return record if self.correct is None else self.correct(record)


def read_records(messages: Iterable[BagMessage]) -> Iterator[tuple[BagMessage, Any]]:
    """Yield each message with its record; raise `BagError` if its bytes cannot be decoded."""
    refused = 0
    for message in messages:
        try:
            if isinstance(message, KeptMessage):
                record = message.record
            else:
                record = _CONVERSIONS[message.type_name](message.decode())
        except MessageError as error:
            refused += 1
            if refused == 1:
                _logger.warning('a message on %s is refused: %s', message.topic, error)
            continue
        yield message, record
    if refused > 1:
        _logger.warning('%d messages of the recording are refused', refused)
