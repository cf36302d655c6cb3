# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
from linear_guide_driver.safety import find_loss, TopicWatchdog

MS = 1_000_000


def test_a_topic_is_silent_before_the_first_message_and_after_the_time_out():
    watchdog = TopicWatchdog('trial_runner/heartbeat', 0.2)
    assert 'Nothing has been heard on trial_runner/heartbeat yet' in watchdog.format_loss(0)
    assert not watchdog.was_heard
    watchdog.beat(1000 * MS)
    assert watchdog.was_heard
    assert watchdog.format_loss(1200 * MS) == ''
    assert 'trial_runner/heartbeat for 0.2 s; look' in watchdog.format_loss(1201 * MS)
    watchdog.beat(1300 * MS)
    assert watchdog.format_loss(1300 * MS) == ''


def test_the_first_silent_topic_is_named():
    heard, silent = TopicWatchdog('a', 0.2), TopicWatchdog('b', 0.2)
    heard.beat(0)
    assert find_loss((), 0) == ''
    assert find_loss((heard,), 0) == ''
    assert ' b ' in find_loss((heard, silent), 0)
