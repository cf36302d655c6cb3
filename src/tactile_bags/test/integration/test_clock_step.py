# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The host's clock is set in a trial: from the bytes of the sensor to the windows of features."""

import os
import tty

import pytest

from tactile_features import FeatureConfig, Outcome, TrialEvent, TrialFeatureExtractor
from tactile_features.conversions import strain_block_from_msg
from tactile_testing.waiting import wait_until
from tendon_sensor_driver import encode_reading, TendonSensorClient, TendonSensorConfig
from tendon_sensor_driver.conversions import to_strain_msg

SECOND_NS = 1_000_000_000
CONFIG = FeatureConfig(texture_samples=30, texture_crop_start_s=0.1, texture_crop_end_s=0.0)


class Lab:
    """A board on a pty, its driver, and the host's clocks; 60 readings make a second pass.

    ``heard``: blocks and events in the order in which they came.
    """

    def __init__(self):
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.offset_ns = 10**9 * SECOND_NS
        self.heard = []
        self.blocks = self._readings = 0
        config = TendonSensorConfig(port=os.ttyname(self._slave), unit='N')
        self.client = TendonSensorClient(config, self._take, self.now_ns)

    def monotonic_ns(self):
        return self._readings * SECOND_NS // 60

    def now_ns(self):
        return self.monotonic_ns() + self.offset_ns

    def __enter__(self):
        self.client.open()
        os.write(self._master, b'\n')
        return self

    def __exit__(self, *_):
        self.client.close()
        os.close(self._master)
        os.close(self._slave)

    def _take(self, block):
        self.heard.append(strain_block_from_msg(to_strain_msg(block, 'link')))
        self.blocks += 1

    def send(self, count):
        for _ in range(count):
            wanted = self.blocks + 1
            self._readings += 1
            value = 3.0 + self._readings * 1e-4
            os.write(self._master, encode_reading(self._readings * 1000 // 60, value, 'N'))
            wait_until(lambda wanted=wanted: self.blocks >= wanted, 'no samples')

    def tell(self, phase, trial_id):
        event = TrialEvent(self.now_ns(), trial_id, 's1', 'texture', 'flexion', 'R1', phase)
        self.heard.append(event)

    def set_clock(self, step_s):
        self.offset_ns += round(step_s * SECOND_NS)


@pytest.mark.parametrize('step_s', [5.0, -0.5])
def test_a_trial_across_a_step_is_refused_and_the_next_one_is_not(monkeypatch, step_s):
    with Lab() as lab:
        monkeypatch.setattr('tendon_sensor_driver.clock.time', lab)
        lab.send(30)
        for trial_id in ('before', 'across', 'after'):
            lab.tell('glide', trial_id)
            lab.send(20)
            if trial_id == 'across':
                lab.set_clock(step_s)
            lab.send(60)
            lab.tell('done', trial_id)
            lab.send(30)
        assert lab.client.health().restarts == 0
    extractor = TrialFeatureExtractor(CONFIG)
    windows = []
    for item in lab.heard:
        is_event = isinstance(item, TrialEvent)
        windows += extractor.add_event(item) if is_event else extractor.add_block(item)
    assert [(w.trial_id, w.outcome) for w in windows] == [
        ('before', Outcome.OK),
        ('across', Outcome.BAD_TIME),
        ('after', Outcome.OK),
    ]
    way = 'forward' if step_s > 0 else 'back'
    reason = windows[1].reason
    assert f"the host's clock was set {way} by {abs(step_s)}" in reason.replace('4.9', '5.0')
