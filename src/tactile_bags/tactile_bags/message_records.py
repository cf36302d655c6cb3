# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Records from the messages of a bag. What a node refuses is passed over here, too."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
import logging
from typing import Any

from tactile_bags.bag_reader import BagMessage
from tactile_bags.recorded_topics import CLASSIFICATION, EVENT, FEATURES, STRAIN
from tactile_classifier.conversions import classification_from_msg
from tactile_features.conversions import (
    event_from_msg,
    feature_window_from_msg,
    strain_block_from_msg,
)
from tactile_ros.errors import MessageError

_CONVERSIONS: dict[str, Callable[[Any], Any]] = {
    STRAIN: strain_block_from_msg,
    EVENT: event_from_msg,
    FEATURES: feature_window_from_msg,
    CLASSIFICATION: classification_from_msg,
}

_logger = logging.getLogger(__name__)


def read_records(messages: Iterable[BagMessage]) -> Iterator[tuple[BagMessage, Any]]:
    """Yield each message with its record: block, event, feature window or classification.

    Raises
    ------
    BagError
        When the bytes are no such message.
    """
    refused = 0
    for message in messages:
        try:
            record = _CONVERSIONS[message.type_name](message.decode())
        except MessageError as error:
            refused += 1
            if refused == 1:
                _logger.warning('a message on %s is refused: %s', message.topic, error)
            continue
        yield message, record
    if refused > 1:
        _logger.warning('%d messages of the recording are refused', refused)
