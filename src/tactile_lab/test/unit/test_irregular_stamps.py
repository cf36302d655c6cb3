# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Features and audit of samples that a publisher stamps irregularly, when it sends them."""

import pytest

from tactile_bags.audit import FingerAuditor
from tactile_features import FeatureConfig, TrialFeatureExtractor, WindowOutcome
from tactile_features.types import TrialEvent
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.topic_stream import TopicReading, TopicStream

START_NS = 1_795_378_589_000_000_000
PERIOD_NS = 1_000_000_000 / 60


def run_trial(stamps_ns):
    """Return the feature window and the audit of a trial whose samples have these stamps.

    No message is lost.
    """
    stream = TopicStream(TendonSensorConfig(sensor='topic', topic='/force', rate_hz=60.0))
    extractor, auditor = TrialFeatureExtractor(FeatureConfig()), FingerAuditor('', 60.0)
    windows, audits = [], []
    for phase, second in (('hold', 1), ('release', 6), ('done', 7)):
        stamp_ns = START_NS + second * 1_000_000_000
        event = TrialEvent(stamp_ns, 't1', '', 'stiffness', 'flexion', 'pla', phase)
        windows += extractor.add_event(event)
        audits += auditor.add_event(event)
    for number, stamp_ns in enumerate(stamps_ns):
        reading = TopicReading(stamp_ns, 3.0 - 0.001 * number)
        for block in stream.add(reading, stamp_ns + 1_000_000, number):
            windows += extractor.add_block(block)
            audits += auditor.add_block(block)
    (window,), (audit,) = windows, audits
    return window, audit, stream.clock.irregular_stamps


@pytest.mark.parametrize('every', [20, 60])
def test_late_stamps_do_not_refuse_a_trial(every):
    # Delays of the stamps of the first two samples in each cycle, in sample periods.
    late = {0: 1.6, 1: 0.7}
    stamps_ns = [
        START_NS + round((i + late.get(i % every, 0.0) * (i > 60)) * PERIOD_NS) for i in range(600)
    ]
    window, audit, irregular = run_trial(stamps_ns)
    assert irregular >= 500 // every
    assert (window.outcome, window.interpolated_count) == (WindowOutcome.OK, 0), window.reason
    assert audit.passed, audit.findings
    assert audit.lost_count == 0


def test_pause_of_the_publisher_refuses_the_trial():
    stamps_ns = [START_NS + round((i + 5 * (i > 200)) * PERIOD_NS) for i in range(600)]
    window, audit, irregular = run_trial(stamps_ns)
    assert irregular == 0
    assert window.outcome == WindowOutcome.GAP
    assert 'samples are missing' in window.reason
    assert not audit.passed
