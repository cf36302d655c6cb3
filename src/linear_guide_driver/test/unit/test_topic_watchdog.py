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
from linear_guide_driver.safety.topic_watchdog import find_silence, TopicWatchdog

MS = 1_000_000


def test_a_topic_is_silent_before_the_first_message_and_after_the_time_out():
    watchdog = TopicWatchdog('trial_runner/heartbeat', 0.2)
    assert 'Nothing has been heard on trial_runner/heartbeat yet' in watchdog.describe_silence(0)
    assert not watchdog.was_heard
    watchdog.beat(1000 * MS)
    assert watchdog.was_heard
    assert watchdog.describe_silence(1200 * MS) == ''
    assert 'trial_runner/heartbeat for 0.2 s; look' in watchdog.describe_silence(1201 * MS)
    watchdog.beat(1300 * MS)
    assert watchdog.describe_silence(1300 * MS) == ''


def test_the_first_silent_topic_is_named():
    heard, silent = TopicWatchdog('a', 0.2), TopicWatchdog('b', 0.2)
    heard.beat(0)
    assert find_silence((), 0) == ''
    assert find_silence((heard,), 0) == ''
    assert ' b ' in find_silence((heard, silent), 0)
