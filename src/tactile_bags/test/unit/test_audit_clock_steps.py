# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import tracemalloc

import numpy as np
import pytest

from tactile_bags.audit import FingerAuditor
from tactile_features.records import TrialEvent
from tactile_ros.strain import StrainBlock, StrainStatus

PERIOD_NS = 10_000_000
START_NS = 1_600_000_000_000_000_000
PHASES = ('approach', 'contact', 'hold', 'release', 'done')
STEPS = [
    (-60, StrainStatus.CLOCK_STEP),
    (60, StrainStatus.CLOCK_STEP),
    (-0.5, StrainStatus.CLOCK_STEP),
    (-15, 0),
]


def event(stamp_ns, phase, trial='t'):
    return TrialEvent(stamp_ns, trial, '', 'stiffness', 'flexion', '', phase)


def stepped_recording(
    step_s, status, *, at=1_000, starts, lost=(), restart=False, late_s=0.0, count=2_600
):
    """Return the audits of trials of 4 s, while the clock is set with sample ``at``.

    ``starts`` are numbers of samples. Each event comes ``late_s`` after its stamp [s].
    """
    auditor = FingerAuditor('', 100.0)
    audits = []
    events = {
        start + 100 * k: (start, phase) for start in starts for k, phase in enumerate(PHASES)
    }

    def stamp_of(i):
        return START_NS + i * PERIOD_NS + (round(step_s * 1e9) if i >= at else 0)

    late = round(late_s * 1e9) // PERIOD_NS
    for i in range(count):
        if i not in lost:
            sequence = i - at if restart and i >= at else i
            block_status = status if i == at else 0
            block = StrainBlock(stamp_of(i), sequence, PERIOD_NS, np.zeros(1), status=block_status)
            audits += auditor.add_block(block)
        if i - late in events:
            start, phase = events[i - late]
            stamp_ns = stamp_of(i - late) + 1
            audits += auditor.add_event(event(stamp_ns, phase, f't{start}'))
    assert len(auditor._recent) <= 1_002
    audits += auditor.finish()
    assert [a.trial_id for a in audits] == [*(f't{start}' for start in starts), '']
    return audits


def step_finding(step_s):
    way = 'forward' if step_s > 0 else 'back'
    return f"the host's clock was set {way} by {abs(step_s):.3f} s during the "


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
@pytest.mark.parametrize(
    ('starts', 'late_s'),
    [
        pytest.param([1_010, 2_000], 0.05, id='before'),
        pytest.param([100, 590, 1_010, 2_000], 0.0, id='between'),
        pytest.param([100, 598, 1_002], 0.05, id='at the edges'),
    ],
)
def test_a_clock_step_outside_of_trials_fails_none(step_s, status, starts, late_s):
    *trials, recording = stepped_recording(step_s, status, starts=starts, late_s=late_s)
    for audit in trials:
        assert audit.passed, audit.format()
        assert audit.sample_count == 400
        assert audit.rate_hz == pytest.approx(100.0)
    assert recording.findings == (step_finding(step_s) + 'recording',)
    assert (recording.sample_count, recording.lost_count) == (2_600, 0)


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
@pytest.mark.parametrize('at', [902, 1_299])
def test_a_clock_step_in_a_trial_fails_only_this_one(step_s, status, at):
    starts = [100, 900, 1_400, 2_100]
    before, during, *after, _ = stepped_recording(step_s, status, at=at, starts=starts)
    assert during.findings == (step_finding(step_s) + 'trial',)
    assert during.sample_count == 400
    span_ns = during.end_ns - during.start_ns
    assert span_ns == 399 * PERIOD_NS + round(step_s * 1e9)
    assert all(audit.passed for audit in (before, *after)), [a.format() for a in after]


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
def test_a_loss_beside_a_clock_step_is_counted(step_s, status):
    _, during, after, _ = stepped_recording(
        step_s, status, starts=[100, 900, 2_000], lost={950, 1_100, 2_100}
    )
    assert during.findings[0] == step_finding(step_s) + 'trial'
    assert (during.lost_count, after.lost_count) == (2, 1)
    assert [finding.split(' (')[0] for finding in after.findings] == ['1 samples lost in 1 gaps']


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
def test_trials_after_a_restart_with_a_clock_step_pass(step_s, status):
    status |= StrainStatus.RECONNECTED | StrainStatus.RESTARTED
    before, *after, recording = stepped_recording(
        step_s, status, starts=[100, 1_100, 2_100], restart=True
    )
    assert all(audit.passed for audit in (before, *after)), [a.format() for a in after]
    assert recording.duplicate_count == 0


def test_many_clock_steps_take_little_memory():
    auditor = FingerAuditor('', 100.0)
    auditor.add_event(event(START_NS, 'contact'))
    tracemalloc.start()
    try:
        for i in range(2_000):
            if i == 1_000:
                early = tracemalloc.get_traced_memory()[0]
            stamp_ns = START_NS + i * PERIOD_NS + i // 10 * -15 * 10**9
            status = StrainStatus.CLOCK_STEP * (i % 10 == 0)
            block = StrainBlock(stamp_ns, i, PERIOD_NS, np.zeros(1), status=status)
            assert auditor.add_block(block) == []
        assert tracemalloc.get_traced_memory()[0] < early + 50_000
    finally:
        tracemalloc.stop()
    trial, recording = auditor.finish()
    assert 'during the trial, the first of' in trial.findings[0]
    assert 'during the recording, the first of 199 steps' in recording.findings[0]


@pytest.mark.parametrize('step_s', [-60, -15, 60, 10**9])
def test_an_event_between_a_clock_step_and_its_block_delays_no_other_trial(step_s):
    """The first event of a trial is stamped by the new clock, which no block has shown yet."""
    auditor = FingerAuditor('', 100.0)
    audits = []
    events = {500: ('contact', 'a'), 700: ('done', 'a')}
    events |= {1_500: ('contact', 'b'), 1_700: ('done', 'b')}
    for i in range(2_500):
        stamp_ns = START_NS + i * PERIOD_NS + (i >= 500) * step_s * 10**9
        if i in events:
            phase, trial = events[i]
            audits += auditor.add_event(event(stamp_ns, phase, trial))
        status = StrainStatus.CLOCK_STEP * (i == 500)
        audits += auditor.add_block(
            StrainBlock(stamp_ns, i, PERIOD_NS, np.zeros(1), status=status)
        )
    assert [audit.trial_id for audit in audits] == ['a', 'b']
    assert audits[0].passed == (step_s > 0), audits[0].format()
    assert audits[1].passed, audits[1].format()
