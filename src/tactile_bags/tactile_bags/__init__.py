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

"""Bags of tactile recordings: MCAP, as rosbag2 writes them, without rosbag2."""

from tactile_bags.bag_reader import BagMessage, TactileBag
from tactile_bags.bag_writer import BagWriter, FACTS_KEY
from tactile_bags.recorded_topics import (
    AUDIT,
    CLASSIFICATION,
    classification_topic,
    DIAGNOSTICS,
    EVENT,
    EVENT_TOPIC,
    FEATURES,
    FEATURES_TOPIC,
    join_topic,
    JOINT_STATE,
    message_store,
    recorded_topics,
    RecordedTopic,
    RUNNING_FEATURES_TOPIC,
    running_topic,
    SLIP,
    STRAIN,
    STRAIN_TOPIC,
    TARE,
    WRENCH,
)

__all__ = [
    'AUDIT',
    'CLASSIFICATION',
    'DIAGNOSTICS',
    'EVENT',
    'EVENT_TOPIC',
    'FACTS_KEY',
    'FEATURES',
    'FEATURES_TOPIC',
    'JOINT_STATE',
    'RUNNING_FEATURES_TOPIC',
    'SLIP',
    'STRAIN',
    'STRAIN_TOPIC',
    'TARE',
    'WRENCH',
    'BagMessage',
    'BagWriter',
    'RecordedTopic',
    'TactileBag',
    'classification_topic',
    'join_topic',
    'message_store',
    'recorded_topics',
    'running_topic',
]
