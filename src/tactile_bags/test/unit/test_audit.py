# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Audits of streams and trials: lost samples, duplicates, order, and steps of the clock."""

import random
import re
import tracemalloc

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from tactile_bags.audit import FingerAuditor
from tactile_features.extraction.phase_window import format_clock_step
from tactile_features.types import TrialEvent
from tactile_ros.strain import StrainBlock, StrainStatus

PERIOD_NS = 10_000_000
START_NS = 1_600_000_000_000_000_000


def blocks_of(counts, *, start=0):
    """Return a stream without gaps, whose blocks have these numbers of samples."""
    blocks, sequence = [], start
    for count in counts:
        stamp_ns = START_NS + sequence * PERIOD_NS
        blocks.append(StrainBlock(stamp_ns, sequence, PERIOD_NS, np.zeros(count)))
        sequence += count
    return blocks


def whole(blocks, rate_hz=100.0):
    auditor = FingerAuditor('', rate_hz)
    for block in blocks:
        assert auditor.add_block(block) == []
    (audit,) = auditor.finish()
    return audit


def event_at(stamp_ns, phase, trial='t'):
    return TrialEvent(stamp_ns, trial, '', 'stiffness', 'flexion', 'wood', phase)


def event(phase, second, trial='t'):
    return event_at(START_NS + round(second * 1e9), phase, trial)


def trial_audits(blocks, events, *, events_first=True):
    auditor = FingerAuditor('thumb', 100.0)
    audits = []
    steps = [(auditor.add_event, events), (auditor.add_block, blocks)]
    for step, items in steps if events_first else steps[::-1]:
        for item in items:
            audits += step(item)
    return [*audits, *auditor.finish()][:-1]


@given(
    counts=st.lists(st.integers(1, 9), min_size=3, max_size=40),
    dropped=st.sets(st.integers(1, 38)),
)
def test_every_loss_between_two_blocks_is_counted(counts, dropped):
    blocks = blocks_of(counts)
    dropped = {i for i in dropped if i < len(blocks) - 1}
    kept = [b for i, b in enumerate(blocks) if i not in dropped]
    audit = whole(kept)
    assert audit.lost_count == sum(counts[i] for i in dropped)
    assert audit.gap_count == sum(i - 1 not in dropped for i in dropped)
    assert audit.passed == (not dropped)
    assert audit.sample_count == sum(len(b.tension_n) for b in kept)
    assert audit.rate_hz == pytest.approx(100.0)
    assert dropped or audit.largest_step_s == pytest.approx(0.01)


def test_the_line_of_an_audit_holds_nothing_that_a_terminal_obeys():
    events = [event('approach', 0.1, 'a\x1b[2J'), event('done', 0.3, 'a\x1b[2J')]
    for kept in (blocks_of([1] * 40), blocks_of([1] * 20) + blocks_of([1] * 20, start=21)):
        (audit,) = trial_audits(kept, events)
        assert audit.format().startswith('thumb: trial a?[2J: ')


@given(
    counts=st.lists(st.integers(1, 9), min_size=2, max_size=30),
    seed=st.integers(0, 2**32 - 1),
)
def test_order_and_repetition_are_counted(counts, seed):
    """A shuffled stream has no losses; repeated samples are duplicates."""
    blocks = blocks_of(counts)
    rng = random.Random(seed)
    first, rest = blocks[0], blocks[1:]
    rng.shuffle(rest)
    again = [rng.choice(blocks) for _ in range(3)]
    audit = whole([first, *rest, *again])
    assert audit.lost_count == audit.gap_count == 0
    assert audit.sample_count == sum(counts)
    assert audit.duplicate_count == sum(len(b.tension_n) for b in again)
    assert (audit.disordered_count > 0) == (rest != blocks[1:])


def second_block(*, at_ns=START_NS + 5 * PERIOD_NS, sequence=5, **fields):
    return StrainBlock(at_ns, sequence, PERIOD_NS, np.zeros(5), **fields)


@pytest.mark.parametrize(
    ('second', 'finding'),
    [
        (second_block(lost_before=2), '2'),  # only the driver knows about this loss
        # restarted sequence numbers are not duplicates
        (second_block(at_ns=START_NS + 10**9, sequence=0), 'restarts'),
        (second_block(status=StrainStatus.RECONNECTED), 'reconnections'),
    ],
)
def test_what_a_block_states_is_a_finding(second, finding):
    audit = whole([*blocks_of([5]), second])
    assert finding in audit.findings[0]
    assert audit.duplicate_count == 0
    assert audit.rate_hz == pytest.approx(100.0)


def test_a_wrong_rate_names_the_remedy_and_nothing_at_all_is_a_finding():
    audit = whole(blocks_of([100]), rate_hz=60.0)
    assert re.search('100 Hz.*60 Hz', audit.findings[0])
    assert whole(blocks_of([100]), rate_hz=0.0).passed
    assert not whole([]).passed


@pytest.mark.parametrize('events_first', [True, False])
@pytest.mark.parametrize('size', [1, 7, 400])
def test_a_trial_is_audited_by_its_own_samples(events_first, size):
    blocks = blocks_of([size] * (800 // size))
    del blocks[len(blocks) // 2 : len(blocks) // 2 + (size < 400)]
    events = [event('approach', 1.0), event('done', 2.0)]
    events += [event('approach', 5.0, 'u'), event('done', 6.0, 'u')]
    audits = trial_audits(blocks, events, events_first=events_first)
    assert [(a.finger, a.trial_id) for a in audits] == [('thumb', 't'), ('thumb', 'u')]
    assert all(a.passed for a in audits), [a.findings for a in audits]
    assert audits[0].sample_count == 101


@pytest.mark.parametrize('lost', [100, 150, 200])
def test_a_sample_lost_at_the_edge_of_a_trial_is_found(lost):
    """The first, a middle or the last sample of a trial from 1 s to 2 s is lost."""
    blocks = [b for i, b in enumerate(blocks_of([1] * 400)) if i != lost]
    (audit,) = trial_audits(blocks, [event('approach', 1.0), event('done', 2.0)])
    assert audit.lost_count == 1


def test_a_trial_that_the_samples_do_not_cover_is_found():
    events = [event('approach', 1.0), event('done', 9.0)]
    (audit,) = trial_audits(blocks_of([400]), events)
    assert any('5.010 s' in finding for finding in audit.findings)
    (audit,) = trial_audits(blocks_of([900], start=500), events)
    assert any('4.000 s' in finding for finding in audit.findings)


@pytest.mark.parametrize('lost', [150, 800, 1_450])
def test_a_trial_longer_than_events_may_be_late_is_audited_whole(lost):
    """The trial lasts from 1 s to 15 s. One sample near its start, middle or end is lost."""
    blocks = [b for i, b in enumerate(blocks_of([1] * 1_600)) if i != lost]
    auditor = FingerAuditor('', 100.0)
    audits = auditor.add_event(event('contact', 1.0))
    for i, block in enumerate(blocks):
        audits += auditor.add_block(block)
        if i == 1_480:  # 0.2 s before the last sample of the trial
            audits += auditor.add_event(event('done', 15.0))
    (audit,) = audits
    assert audit.sample_count == 1_400
    assert (audit.lost_count, audit.gap_count) == (1, 1)


def test_events_that_come_too_late_for_their_samples_are_a_finding():
    blocks = blocks_of([10] * 1000)
    (audit,) = trial_audits(
        blocks, [event('contact', 10.0), event('done', 12.0)], events_first=False
    )
    assert not audit.passed
    assert '10 s' in audit.findings[0]
    (audit,) = trial_audits(
        blocks, [event('contact', 95.0), event('done', 97.0)], events_first=False
    )
    assert audit.passed


def test_trials_without_any_samples_do_not_pile_up(monkeypatch):
    monkeypatch.setattr('tactile_bags.audit.MAX_TRIALS', 10)
    auditor = FingerAuditor('', 100.0)
    audits = []
    for i in range(15):
        for phase in ('contact', 'done'):
            audits += auditor.add_event(event(phase, i, f't{i}'))
    assert [audit.trial_id for audit in audits] == [f't{i}' for i in range(5)]
    assert not any(audit.passed for audit in audits)


@pytest.mark.parametrize('with_trials', [False, True])
def test_memory_does_not_grow_with_the_length_of_a_recording(with_trials):
    """The memory of the auditor is limited, both with trials and without any trial."""
    auditor = FingerAuditor('', 100.0)
    tension_n = np.zeros(1)

    def record(first, last):
        for i in range(first, last):
            second = i // 100
            auditor.add_block(StrainBlock(START_NS + i * PERIOD_NS, i, PERIOD_NS, tension_n))
            if with_trials and i % 500 == 0:
                auditor.add_event(event('contact', second, f't{second}'))
                auditor.add_event(event('done', second + 3, f't{second}'))

    tracemalloc.start()
    try:
        record(0, 2_000)
        early = tracemalloc.get_traced_memory()[0]
        record(2_000, 4_000)
        assert tracemalloc.get_traced_memory()[0] < early + 50_000
        assert early < 1_000_000
    finally:
        tracemalloc.stop()
    assert auditor.finish()[-1].sample_count == 4_000


def test_samples_that_come_late_are_no_clock_step():
    blocks = blocks_of([1] * 1000)
    blocks.insert(800, blocks.pop(300))
    blocks.insert(900, blocks[100])
    audit = whole(blocks)
    assert (audit.duplicate_count, audit.disordered_count, len(audit.findings)) == (1, 1, 2)


PHASES = ('approach', 'contact', 'hold', 'release', 'done')
STEPS = [
    (-60, StrainStatus.CLOCK_STEP),
    (60, StrainStatus.CLOCK_STEP),
    (-0.5, StrainStatus.CLOCK_STEP),
    (-15, 0),
]


def stepped_recording(
    step_s, status, *, at=3_000, starts, lost=(), restart=False, late_s=0.0, count=5_600
):
    """Return the audits of a recording with trials of 4 s, during which the clock is set.

    The clock is set by ``step_s`` at the sample with the number ``at``. Trials begin at the
    samples with the numbers ``starts``. Each event arrives ``late_s`` after its stamp [s].
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
            audits += auditor.add_event(event_at(stamp_ns, phase, f't{start}'))
    assert len(auditor._recent) <= 1_002
    audits += auditor.finish()
    assert [a.trial_id for a in audits] == [*(f't{start}' for start in starts), '']
    return audits


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
@pytest.mark.parametrize(
    ('starts', 'late_s'),
    [
        pytest.param([3_010, 4_000, 5_000], 0.05, id='before'),
        pytest.param([1_000, 2_590, 3_010, 4_000], 0.0, id='between'),
        pytest.param([2_000, 2_598, 3_002], 0.05, id='at the edges'),
    ],
)
def test_a_clock_step_outside_of_trials_fails_none(step_s, status, starts, late_s):
    *trials, recording = stepped_recording(step_s, status, starts=starts, late_s=late_s)
    for audit in trials:
        assert audit.passed, audit.format()
        assert audit.sample_count == 400
        assert audit.rate_hz == pytest.approx(100.0)
    assert recording.findings == (format_clock_step(round(step_s * 1e9), 'recording'),)
    assert (recording.sample_count, recording.lost_count) == (5_600, 0)


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
@pytest.mark.parametrize('at', [2_902, 3_299])
def test_a_clock_step_in_a_trial_fails_only_this_one(step_s, status, at):
    starts = [1_000, 2_900, 3_400, 5_000]
    before, during, *after, _ = stepped_recording(step_s, status, at=at, starts=starts)
    assert during.findings == (format_clock_step(round(step_s * 1e9), 'trial'),)
    assert during.sample_count == 400
    span_ns = during.end_ns - during.start_ns
    assert span_ns == 399 * PERIOD_NS + round(step_s * 1e9)
    assert all(audit.passed for audit in (before, *after)), [a.format() for a in after]


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
def test_a_loss_beside_a_clock_step_is_counted(step_s, status):
    _, during, after, _ = stepped_recording(
        step_s, status, starts=[1_000, 2_900, 4_000], lost={2_950, 3_100, 4_100}
    )
    assert during.findings[0] == format_clock_step(round(step_s * 1e9), 'trial')
    assert (during.lost_count, after.lost_count) == (2, 1)
    assert (after.gap_count, len(after.findings)) == (1, 1)


@pytest.mark.parametrize(('step_s', 'status'), STEPS)
def test_trials_after_a_restart_with_a_clock_step_pass(step_s, status):
    status |= StrainStatus.RECONNECTED | StrainStatus.RESTARTED
    before, *after, recording = stepped_recording(
        step_s, status, starts=[1_000, 3_100, 5_000], restart=True
    )
    assert all(audit.passed for audit in (before, *after)), [a.format() for a in after]
    assert recording.duplicate_count == 0


def test_many_clock_steps_take_little_memory():
    auditor = FingerAuditor('', 100.0)
    auditor.add_event(event_at(START_NS, 'contact'))
    tracemalloc.start()
    try:
        for i in range(3_000):
            if i == 1_500:
                early = tracemalloc.get_traced_memory()[0]
            stamp_ns = START_NS + i * PERIOD_NS + i // 10 * -15 * 10**9
            status = StrainStatus.CLOCK_STEP * (i % 10 == 0)
            block = StrainBlock(stamp_ns, i, PERIOD_NS, np.zeros(1), status=status)
            assert auditor.add_block(block) == []
        assert tracemalloc.get_traced_memory()[0] < early + 50_000
    finally:
        tracemalloc.stop()
    trial, recording = auditor.finish()
    assert '299' in recording.findings[0]
    assert not trial.passed


@pytest.mark.parametrize('step_s', [-60, -15, 60, 10**9])
def test_an_event_between_a_clock_step_and_its_block_delays_no_other_trial(step_s):
    """The first event of a trial has a stamp after the step, but arrives before the next block."""
    auditor = FingerAuditor('', 100.0)
    audits = []
    events = {2_000: ('contact', 'a'), 2_200: ('done', 'a')}
    events |= {3_000: ('contact', 'b'), 3_200: ('done', 'b')}
    for i in range(4_000):
        stamp_ns = START_NS + i * PERIOD_NS + (i >= 2_000) * step_s * 10**9
        if i in events:
            phase, trial = events[i]
            audits += auditor.add_event(event_at(stamp_ns, phase, trial))
        status = StrainStatus.CLOCK_STEP * (i == 2_000)
        audits += auditor.add_block(
            StrainBlock(stamp_ns, i, PERIOD_NS, np.zeros(1), status=status)
        )
    assert [audit.trial_id for audit in audits] == ['a', 'b']
    assert audits[0].passed == (step_s > 0), audits[0].format()
    assert audits[1].passed, audits[1].format()
