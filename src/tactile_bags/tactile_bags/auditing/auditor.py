# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Auditors of a recording's samples: rate, gaps, duplicates, order.

The recorder, which audits each trial when it has ended, and the audit of a bag on the disk
share one implementation. It compares sequence numbers and stamps. So it finds losses anywhere
between the sensor and the file, however samples are grouped into messages.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path

from tactile_bags.auditing.audit import Audit, make_audit
from tactile_bags.auditing.host_clock import EVENT_DELAY_S, HostClock, SpanCounts, Unstepped
from tactile_bags.auditing.stream_counts import SampleRun
from tactile_bags.auditing.trial_counts import TrialCounts
from tactile_bags.bag_reader import TactileBag
from tactile_bags.message_records import read_records
from tactile_bags.recorded_setup import nominal_rate_hz
from tactile_bags.recorded_topics import EVENT, EVENT_TOPIC, STRAIN
from tactile_features.records import PHASE_ABORTED, PHASE_DONE, TrialEvent
from tactile_ros.strain import StrainBlock

MAX_BLOCKS = 100_000
"""Most blocks that are kept for events that come late: fewer seconds of very small blocks."""

MAX_TRIALS = 1000
"""Most trials that wait for their samples; the oldest is then audited without them."""


class FingerAuditor:
    """Blocks and trial events of one finger in, an audit of each trial out.

    The events of a trial may come before its samples, or up to `EVENT_DELAY_S` after them. So
    long are samples kept, without their values, and no longer: memory does not grow with the
    length of a recording, nor with the number of its trials.

    A step of the host's clock is a finding of the trial that it falls into, and of the whole
    recording. Other trials are not affected.

    Parameters
    ----------
    finger : str
        Namespace.
    nominal_rate_hz : float
        0: not known. It may be told later.
    """

    def __init__(self, finger: str, nominal_rate_hz: float = 0.0) -> None:
        self.finger = finger
        self.nominal_rate_hz = nominal_rate_hz
        self._whole = SpanCounts()
        self._clock = HostClock()
        self._recent: deque[Unstepped] = deque()
        self._latest_ns: int | None = None  # in stream time, as all that follow
        self._gone_ns: int | None = None
        self._trials: deque[TrialCounts] = deque()  # only the last one can be under way

    def add_block(self, block: StrainBlock) -> list[Audit]:
        """Take in samples; return the audits of the trials that are now over."""
        if not len(block.tension_n):
            return []
        stamped = SampleRun(
            block.stamp_ns,
            block.period_ns,
            block.sequence,
            len(block.tension_n),
            block.lost_before,
            block.status,
        )
        unstepped = self._clock.take(stamped)
        run = unstepped.run
        if unstepped.step_ns > 0:
            # An event that came between the step and this block was taken for one far ahead.
            for trial in self._trials:
                trial.start_ns = min(trial.start_ns, run.stamp_ns)
                trial.end_ns = min(trial.end_ns, run.stamp_ns)
        self._whole.add(unstepped)
        self._recent.append(unstepped)
        last_ns = run.stamp_of(run.size - 1)
        self._latest_ns = last_ns if self._latest_ns is None else max(self._latest_ns, last_ns)
        self._let_go(self._latest_ns - round(EVENT_DELAY_S * 1e9))
        return self._take_complete()

    def _let_go(self, before_ns: int) -> None:
        """Give up runs for which no event can come any more; a trial under way counts them."""
        while self._recent:
            unstepped = self._recent[0]
            last_ns = unstepped.run.stamp_of(unstepped.run.size - 1)
            if last_ns >= before_ns and len(self._recent) <= MAX_BLOCKS:
                return
            self._recent.popleft()
            self._gone_ns = last_ns if self._gone_ns is None else max(self._gone_ns, last_ns)
            for trial in self._trials:
                trial.add(unstepped)

    def add_event(self, event: TrialEvent) -> list[Audit]:
        """Take in the start of a phase; return the audits of the trials that are now over."""
        stamp_ns = self._clock.time_of_event(event.stamp_ns, self._latest_ns)
        trial = self._trials[-1] if self._trials else None
        is_new = trial is None or trial.is_over or trial.trial_id != event.trial_id
        if trial is None or is_new:
            if trial is not None:
                trial.is_over = True
            trial = TrialCounts(event.trial_id, stamp_ns)
            self._trials.append(trial)
        trial.start_ns = min(trial.start_ns, stamp_ns)
        trial.end_ns = max(trial.end_ns, stamp_ns)
        trial.is_over = event.phase in (PHASE_DONE, PHASE_ABORTED)
        if self._gone_ns is not None and stamp_ns <= self._gone_ns:
            trial.is_too_late |= is_new or trial.is_over
        return self._take_complete()

    def finish(self) -> list[Audit]:
        """Return the audits of trials that still wait for samples, then of the whole."""
        audits = []
        while self._trials:
            self._trials[0].is_over = True
            audits.append(self._audit(self._trials.popleft()))
        return [*audits, make_audit(self._whole, self.finger, self.nominal_rate_hz)]

    def _take_complete(self) -> list[Audit]:
        audits = []
        # Only with a sample beyond its end is it known that a trial's last ones have come.
        while self._trials and self._trials[0].is_over:
            is_complete = self._latest_ns is not None and self._latest_ns > self._trials[0].end_ns
            if not is_complete and len(self._trials) <= MAX_TRIALS:
                break
            audits.append(self._audit(self._trials.popleft()))
        return audits

    def _audit(self, trial: TrialCounts) -> Audit:
        for unstepped in self._recent:
            trial.add(unstepped)
        return make_audit(trial.finish(), self.finger, self.nominal_rate_hz, trial)


def audit_bag(path: Path) -> list[Audit]:
    """Audit a bag: each trial, then the whole, finger by finger.

    Raises
    ------
    BagError
        When the bag cannot be read.
    """
    with TactileBag(path) as bag:
        return audit_open_bag(bag)


def audit_open_bag(bag: TactileBag) -> list[Audit]:
    """Audit a bag that is open; see `audit_bag`."""
    audits: list[Audit] = []
    for finger in bag.namespaces:
        auditor = FingerAuditor(finger, nominal_rate_hz(bag, finger))
        for message, record in read_records(bag.messages(STRAIN, EVENT, namespace=finger)):
            if message.type_name == STRAIN:
                audits += auditor.add_block(record)
            elif message.topic.endswith(EVENT_TOPIC.name):  # and not what was found in the signal
                audits += auditor.add_event(record)
        audits += auditor.finish()
    return audits
