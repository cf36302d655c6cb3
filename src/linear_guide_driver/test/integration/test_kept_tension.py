# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import threading
import time

import pytest

from linear_guide_driver.dynamixel import tension_keeper
from linear_guide_driver.dynamixel.bus import DynamixelBus
from tactile_testing.waiting import wait_until

TARGET_N = 3.0


class Finger:
    """Feeds the tension of a linear finger to the actuator's safety, a hundred times a second."""

    def __init__(self, client):
        self.stiffness_n_m = 10000.0
        self.tension_n = 0.0
        self._client, self._ended = client, threading.Event()
        self._thread = threading.Thread(target=self._feed)
        self._thread.start()

    def _feed(self):
        while not self._ended.wait(0.01):
            self.tension_n = self.stiffness_n_m * max(0.0, self._client.state.displacement_m)
            self._client.safety.add_samples([self.tension_n], False, time.monotonic_ns())

    def is_at_target(self):
        return abs(self.tension_n - TARGET_N) < 0.3

    def end(self):
        self._ended.set()
        self._thread.join()


@pytest.fixture
def finger(tendon):
    finger = Finger(tendon)
    wait_until(lambda: tendon.safety.tension_n is not None)
    yield finger
    finger.end()


def test_a_tension_is_kept_after_this_computer_was_asleep(tendon, finger, monkeypatch):
    read_block, slept = DynamixelBus.read_block, threading.Event()

    def read_late(bus, block):
        if not slept.is_set():
            time.sleep(0.3)
            slept.set()
        return read_block(bus, block)

    tendon.pull_to_tension(TARGET_N, 0.02)
    monkeypatch.setattr(tension_keeper, 'POLL_WAIT_S', 0.2)
    monkeypatch.setattr(DynamixelBus, 'read_block', read_late)
    assert slept.wait(5.0)
    finger.stiffness_n_m = 7000.0
    wait_until(lambda: not finger.is_at_target())
    wait_until(finger.is_at_target)
