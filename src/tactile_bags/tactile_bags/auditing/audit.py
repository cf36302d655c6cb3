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

"""Whether a recording holds every sample: rate, gaps, duplicates, order.

One implementation for the recorder, which audits each trial when it has ended, and for a
bag on the disk. It goes by sequence numbers and stamps, so that it finds what was lost
anywhere between the sensor and the file, however samples are grouped into messages.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tactile_bags.auditing.host_clock import EVENT_DELAY_S, HostClock, SpanCounts, Unstepped
from tactile_bags.auditing.stream_counts import SampleRun
from tactile_bags.bag_reader import TactileBag
from tactile_bags.message_records import read_records
from tactile_bags.recorded_topics import EVENT, EVENT_TOPIC, STRAIN
from tactile_features.extraction.phase_window import describe_clock_step
from tactile_features.feature_sets.feature_set import RATE_TOLERANCE
from tactile_features.records import (
    PHASE_ABORTED,
    PHASE_DONE,
    StrainBlock,
    TrialEvent,
)

LONGEST_STEP_S = 0.1
"""Longest time between two samples that is not worth a word [s]; at least three periods."""

MAX_BLOCKS = 100_000
"""Most blocks that are kept for events that come late: fewer seconds of very small blocks."""

MAX_TRIALS = 1000
"""Most trials that wait for their samples; the oldest is then audited without them."""

MOST_NOTED = 100
"""Failed trials that the facts of a bag describe."""


@dataclass(frozen=True)
class Audit:
    """What the audit of one trial, or of a whole recording, found.

    Attributes
    ----------
    finger : str
        Namespace; empty: the root.
    trial_id : str
        Empty for the whole recording.
    findings : tuple of str
        One sentence each; empty when nothing is wrong.
    start_ns, end_ns : int
        Times of the first and the last audited sample [ns], as stamped.
    sample_count, lost_count, gap_count, duplicate_count, disordered_count : int
        Samples that came; missing in the numbering, in so many runs; came again; came
        later than a newer one.
    rate_hz : float
        By the numbering, so a loss does not change it; 0: fewer than two samples.
    nominal_rate_hz : float
        0: not known, and not compared.
    largest_step_s : float
        Longest time between two neighbouring samples; steps of the host's clock do not count.
    """

    finger: str
    trial_id: str
    findings: tuple[str, ...]
    start_ns: int
    end_ns: int
    sample_count: int
    lost_count: int
    gap_count: int
    duplicate_count: int
    disordered_count: int
    rate_hz: float
    nominal_rate_hz: float
    largest_step_s: float

    @property
    def passed(self) -> bool:
        return not self.findings

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return {**asdict(self), 'findings': list(self.findings), 'passed': self.passed}

    def describe(self) -> str:
        """Return one line for a person."""
        what = f'trial {self.trial_id}' if self.trial_id else 'recording'
        finger = f'{self.finger}: ' if self.finger else ''
        if self.passed:
            return f'{finger}{what}: {self.sample_count} samples, all there'
        return f'{finger}{what}: {"; ".join(self.findings)}'


def _make_audit(
    span: SpanCounts,
    finger: str,
    nominal_rate_hz: float,
    trial: _Trial | None = None,
) -> Audit:
    counts = span.counts
    return Audit(
        finger=finger,
        trial_id=trial.trial_id if trial else '',
        findings=tuple(_findings(span, nominal_rate_hz, trial)),
        start_ns=counts.start_ns + span.start_shift_ns,
        end_ns=counts.end_ns + span.end_shift_ns,
        sample_count=counts.samples,
        lost_count=counts.lost,
        gap_count=counts.gaps,
        duplicate_count=counts.duplicates,
        disordered_count=counts.disordered,
        rate_hz=counts.rate_hz,
        nominal_rate_hz=nominal_rate_hz,
        largest_step_s=counts.largest_step_ns * 1e-9,
    )


def _findings(span: SpanCounts, nominal_hz: float, trial: _Trial | None) -> Iterable[str]:
    counts = span.counts
    if span.steps:
        first = describe_clock_step(span.first_step_ns, 'trial' if trial else 'recording')
        yield f'{first}, the first of {span.steps} steps' if span.steps > 1 else first
    if trial is not None and trial.is_too_late:
        yield (
            f'its events came more than {EVENT_DELAY_S:g} s after its samples; '
            'what is missing is not known'
        )
        return
    if not counts.samples:
        yield 'no samples of the tension came'
        return
    period_s = 1.0 / (nominal_hz or counts.rate_hz or 1.0)
    longest_s = max(LONGEST_STEP_S, 3.0 * period_s)
    if counts.lost:
        share = counts.lost / (counts.samples + counts.lost)
        yield f'{counts.lost} samples lost in {counts.gaps} gaps ({share:.2%})'
    if counts.duplicates:
        yield f'{counts.duplicates} samples came again'
    if counts.disordered:
        yield f'{counts.disordered} samples came later than a newer one'
    if counts.restarts:
        yield f'the numbering began anew {counts.restarts} times; what was lost is not known'
    if counts.reconnections:
        yield (
            f'the sensor was reached anew {counts.reconnections} times; what was lost is not known'
        )
    rate_hz = counts.rate_hz
    if nominal_hz and rate_hz and abs(rate_hz / nominal_hz - 1.0) > RATE_TOLERANCE:
        yield (
            f'the rate is {rate_hz:.4g} Hz, not {nominal_hz:.4g} Hz; '
            'set rate_hz of the feature node to that of the sensor'
        )
    if counts.largest_step_ns * 1e-9 > longest_s and not counts.lost:
        yield f'{counts.largest_step_ns * 1e-9:.3f} s lie between two samples'
    if trial is not None:
        late_s = (counts.start_ns - trial.start_ns) * 1e-9
        early_s = (trial.end_ns - counts.end_ns) * 1e-9
        if late_s > longest_s:
            yield f'the samples begin {late_s:.3f} s after the trial'
        if early_s > longest_s:
            yield f'the samples end {early_s:.3f} s before the trial'


class _Trial:
    """A trial under way, or one that waits for its samples; counts those that it is given.

    All times are in stream time.
    """

    def __init__(self, trial_id: str, stamp_ns: int) -> None:
        self.trial_id = trial_id
        self.start_ns = self.end_ns = stamp_ns
        self.is_over = self.is_too_late = False
        self.span = SpanCounts()
        self._before: SampleRun | None = None
        self._has_begun = self._has_ended = False

    def add(self, unstepped: Unstepped) -> None:
        """Take in the next run of the stream, wherever it lies."""
        run = unstepped.run
        begin = run.up_to(self.start_ns - 1)
        end = run.up_to(self.end_ns) if self.is_over else run.size
        if begin and not self._has_begun:
            self._before = run.part(begin - 1, begin)
        if begin < end:
            if not self._has_begun and self._before is not None:
                self.span.counts.follow(self._before)
            self._has_begun = True
            self.span.add(unstepped._replace(run=run.part(begin, end)))
        if end < run.size and not self._has_ended:
            self._has_ended = True
            self._after = run.part(end, end + 1)

    def finish(self) -> SpanCounts:
        """Return what was counted; no more runs come."""
        if self._has_ended:
            self.span.counts.stop_before(self._after)
        return self.span


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
        0: not known.
    """

    def __init__(self, finger: str, nominal_rate_hz: float) -> None:
        self.finger = finger
        self.nominal_rate_hz = nominal_rate_hz
        self._whole = SpanCounts()
        self._clock = HostClock()
        self._recent: deque[Unstepped] = deque()
        self._latest_ns: int | None = None  # in stream time, as all that follow
        self._gone_ns: int | None = None
        self._trials: deque[_Trial] = deque()  # only the last one can be under way

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
            trial = _Trial(event.trial_id, stamp_ns)
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
        return [*audits, _make_audit(self._whole, self.finger, self.nominal_rate_hz)]

    def _take_complete(self) -> list[Audit]:
        audits = []
        # Only with a sample beyond its end is it known that a trial's last ones have come.
        while self._trials and self._trials[0].is_over:
            is_complete = self._latest_ns is not None and self._latest_ns > self._trials[0].end_ns
            if not is_complete and len(self._trials) <= MAX_TRIALS:
                break
            audits.append(self._audit(self._trials.popleft()))
        return audits

    def _audit(self, trial: _Trial) -> Audit:
        for unstepped in self._recent:
            trial.add(unstepped)
        return _make_audit(trial.finish(), self.finger, self.nominal_rate_hz, trial)


def nominal_rate_hz(facts: dict[str, Any]) -> float:
    """Return the sample rate that a recording was made for [Hz]; 0 when it does not say."""
    config = facts.get('feature_config')
    value = config.get('rate_hz', 0.0) if isinstance(config, dict) else 0.0
    return float(value) if isinstance(value, int | float) and 0.0 < value < 1e9 else 0.0


class AuditSummary:
    """What a bag notes of its audits: how many there were, and those that failed.

    Attributes
    ----------
    trials : int
    last_failed : Audit or None
        The last trial that failed.
    """

    def __init__(self) -> None:
        self.trials = self._failed_trials = 0
        self.last_failed: Audit | None = None
        self._failed: list[Audit] = []
        self._whole: list[Audit] = []

    def add(self, audit: Audit) -> None:
        if not audit.trial_id:
            self._whole.append(audit)
            return
        self.trials += 1
        if not audit.passed:
            self._failed_trials += 1
            self.last_failed = audit
            if len(self._failed) < MOST_NOTED:
                self._failed.append(audit)

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return {
            'trials': self.trials,
            'failed_trials': self._failed_trials,
            'failed': [audit.to_dict() for audit in self._failed],
            'whole': [audit.to_dict() for audit in self._whole],
        }


def summarise_audits(audits: Iterable[Audit]) -> dict[str, Any]:
    """Return what `AuditSummary` notes of these."""
    summary = AuditSummary()
    for audit in audits:
        summary.add(audit)
    return summary.to_dict()


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
        auditor = FingerAuditor(finger, nominal_rate_hz(bag.facts))
        for message, record in read_records(bag.messages(STRAIN, EVENT, namespace=finger)):
            if message.type_name == STRAIN:
                audits += auditor.add_block(record)
            elif message.topic.endswith(EVENT_TOPIC.name):  # and not what was found in the signal
                audits += auditor.add_event(record)
        audits += auditor.finish()
    return audits
