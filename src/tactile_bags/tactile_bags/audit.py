# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Audits of a recording: lost, duplicate and late samples, gaps, rate, and clock steps.

The recorder audits each trial after its end. The audit of a bag on disk uses the same
implementation. An audit compares sequence numbers and stamps. It therefore finds losses anywhere
between the sensor and the file, and does not depend on how samples are grouped into messages.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from tactile_bags.bag_reader import TactileBag
from tactile_bags.message_records import read_records
from tactile_bags.recorded_setup import nominal_rate_hz
from tactile_features.extraction.phase_window import format_clock_step
from tactile_features.feature_sets.feature_set import RATE_TOLERANCE
from tactile_features.types import PHASE_ABORTED, PHASE_DONE, TrialEvent
from tactile_ros.errors import plain_text
from tactile_ros.strain import StrainBlock, StrainStatus
from tactile_ros.topics import EVENT, EVENT_TOPIC, STRAIN

_RECONNECTED, _CLOCK_STEP = int(StrainStatus.RECONNECTED), int(StrainStatus.CLOCK_STEP)
"""Status bits as integers, because operations on an `IntFlag` are slow."""

MAX_GAPS = 10_000
"""Largest number of gaps that are remembered. If the missing samples of such a gap arrive later,
they are counted as late instead of lost."""


class _SampleRun(NamedTuple):
    """A block of samples, or a part of a block, without the values.

    ``shift_ns`` is the difference between original stamps and stream time (see `_HostClock`) [ns].
    ``step_ns`` is the step of the host's clock between the previous sample and the first sample of
    this run [ns]; 0 if there was no step.
    """

    stamp_ns: int
    period_ns: int
    sequence: int
    size: int
    lost_before: int
    status: int
    shift_ns: int = 0
    step_ns: int = 0

    @property
    def end_ns(self) -> int:
        return self.stamp_of(self.size - 1)

    def stamp_of(self, i: int) -> int:
        return self.stamp_ns + i * self.period_ns

    def part(self, begin: int, end: int) -> _SampleRun:
        """Return the samples from index ``begin`` up to, but not including, ``end``."""
        return self._replace(
            stamp_ns=self.stamp_of(begin),
            sequence=self.sequence + begin,
            size=end - begin,
            lost_before=0 if begin else self.lost_before,
        )

    def up_to(self, stamp_ns: int) -> int:
        """Return the number of samples that are not later than ``stamp_ns``."""
        if self.period_ns <= 0:
            return self.size if self.stamp_ns <= stamp_ns else 0
        return min(self.size, max(0, (stamp_ns - self.stamp_ns) // self.period_ns + 1))


class _StreamCounts:
    """Counts missing, duplicate and late samples and clock steps in a span of a stream."""

    def __init__(self) -> None:
        self.samples = self.lost = self.gaps = self.duplicates = self.disordered = 0
        self.restarts = self.reconnections = 0
        self.steps = self.first_step_ns = 0
        self.start_ns = self.end_ns = self.start_shift_ns = self.end_shift_ns = 0
        self.largest_step_ns = 0
        self._next: int | None = None
        self._status = 0
        self._missing: deque[tuple[int, int]] = deque(maxlen=MAX_GAPS)
        self._span_ns = self._steps = 0
        self._segment: tuple[int, int] | None = None

    def follow(self, before: _SampleRun) -> None:
        """Begin counting after the run ``before``, without counting its samples."""
        self._next = before.sequence + before.size
        self._status = before.status
        self.end_ns = before.end_ns

    def stop_before(self, after: _SampleRun) -> None:
        """End counting before the run ``after``; count the samples that are missing before it."""
        if self._next is not None and after.sequence > self._next:
            self._lose(after.sequence - self._next, after.sequence)

    def _lose(self, count: int, sequence: int) -> None:
        assert self._next is not None
        if count:
            self.gaps += 1
            self.lost += count
        if sequence > self._next:
            self._missing.append((self._next, sequence))

    def add(self, run: _SampleRun) -> None:
        if not self.samples:
            self.start_shift_ns = run.shift_ns
        elif run.step_ns:
            self.steps += 1
            self.first_step_ns = self.first_step_ns or run.step_ns
        self.end_shift_ns = run.shift_ns
        if self._next is not None and run.sequence < self._next:
            if run.stamp_ns <= self.end_ns:
                self._take_late(run)
                return
            self.restarts += 1
            self._close_segment()
            self._next = None
        self._take_new(run)

    def _take_late(self, run: _SampleRun) -> None:
        """Add a run that begins before the next expected sequence number.

        Its samples may be late, duplicate or new.
        """
        assert self._next is not None
        old = min(run.size, self._next - run.sequence)
        late = self._fill(run.sequence, run.sequence + old)
        self.samples += late
        self.disordered += late
        self.duplicates += old - late
        if old < run.size:
            self._take_new(run.part(old, run.size))

    def _fill(self, begin: int, end: int) -> int:
        """Mark the sequence numbers from ``begin`` to ``end`` as received.

        Returns how many of them were missing.
        """
        filled, left = 0, []
        for low, high in self._missing:
            inside = min(high, end) - max(low, begin)
            if inside <= 0:
                left.append((low, high))
                continue
            filled += inside
            left += [part for part in ((low, begin), (end, high)) if part[0] < part[1]]
        if filled:
            self.lost -= filled
            self.gaps += len(left) - len(self._missing)
            self._missing = deque(left, maxlen=MAX_GAPS)
        return filled

    def _take_new(self, run: _SampleRun) -> None:
        if self._next is not None:
            # The driver may report more lost samples than are missing in the sequence numbers.
            self._lose(max(run.sequence - self._next, run.lost_before), run.sequence)
            self.largest_step_ns = max(self.largest_step_ns, run.stamp_ns - self.end_ns)
        if run.status & ~self._status & _RECONNECTED:
            self.reconnections += 1
        if not self.samples:
            self.start_ns = run.stamp_ns
        if self._segment is None:
            self._segment = (run.sequence, run.stamp_ns)
        if run.size > 1:
            self.largest_step_ns = max(self.largest_step_ns, run.period_ns)
        self.samples += run.size
        self._next = run.sequence + run.size
        self._status = run.status
        self.end_ns = run.end_ns

    def _close_segment(self) -> None:
        """End a segment between two restarts of the sequence numbers; add it to the totals."""
        steps, span_ns = self._of_segment()
        self._steps += steps
        self._span_ns += span_ns
        self._segment = None

    def _of_segment(self) -> tuple[int, int]:
        if self._segment is None or self._next is None:
            return 0, 0
        sequence, stamp_ns = self._segment
        return self._next - 1 - sequence, self.end_ns - stamp_ns

    @property
    def rate_hz(self) -> float:
        steps, span_ns = self._of_segment()
        steps, span_ns = self._steps + steps, self._span_ns + span_ns
        return steps / span_ns * 1e9 if steps > 0 and span_ns > 0 else 0.0


EVENT_DELAY_S = 10.0
"""If an event arrives later than this after its samples, its trial cannot be audited [s]."""

CLOCK_STEP_S = 1.0
"""If a stamp is earlier than the previous one by more than this time [s], the clock was set, even
if no status bit reports it."""

MAX_STEPS = 100
"""Number of clock steps that are stored for events that arrive late."""


class _HostClock:
    """Conversion of stamps to stream time.

    The host's clock can be set during a recording, which is called a clock step. Stream time is
    the time of the host's clock with all steps removed, so that stamps before and after a step are
    comparable.
    """

    def __init__(self) -> None:
        self._shift_ns = 0
        # Last run that was not late, with its original stamps.
        self._last: _SampleRun | None = None
        # For each clock step: end of the samples before it, and the shift of these samples [ns].
        self._past: deque[tuple[int, int]] = deque(maxlen=MAX_STEPS)

    def take(self, run: _SampleRun) -> _SampleRun:
        """Return the next run of samples with its stamps converted to the time of the stream.

        A step of the host's clock does not change the time of the stream.
        """
        last = self._last
        step_ns = 0
        if last is None or not _is_late(run, last):
            step_ns = _clock_step(run, last) if last is not None else 0
            self._last = run
        if step_ns:
            self._past.append((run.stamp_ns - self._shift_ns - step_ns, self._shift_ns))
            self._shift_ns += step_ns
        shift_ns = self._shift_ns
        return run._replace(stamp_ns=run.stamp_ns - shift_ns, shift_ns=shift_ns, step_ns=step_ns)

    def time_of_event(self, stamp_ns: int, latest_ns: int | None) -> int:
        """Convert the stamp of an event to stream time [ns].

        Shortly after a clock step, the stamp of an event may be from before or after the step. The
        result is the possible time that is closest to the latest sample, at ``latest_ns``.
        """
        if latest_ns is None:
            return stamp_ns - self._shift_ns
        while self._past and self._past[0][0] < latest_ns - round(EVENT_DELAY_S * 1e9):
            self._past.popleft()
        shifts_ns = [self._shift_ns, *(shift_ns for _, shift_ns in self._past)]
        return min((stamp_ns - s for s in shifts_ns), key=lambda t: abs(t - latest_ns))


def _is_late(run: _SampleRun, last: _SampleRun) -> bool:
    """Return True if a run comes after runs with higher sequence numbers.

    If its stamps do not fit its sequence numbers, the sequence numbers were restarted, and the run
    is not late.
    """
    if run.sequence >= last.sequence + last.size:
        return False
    elapsed_ns = last.stamp_of(run.sequence - last.sequence) - last.stamp_ns
    error_ns = abs(run.stamp_ns - last.stamp_ns - elapsed_ns)
    return error_ns < CLOCK_STEP_S * 1e9 + RATE_TOLERANCE * abs(elapsed_ns)


def _clock_step(run: _SampleRun, last: _SampleRun) -> int:
    """Return the step of the host's clock between two runs [ns], or 0 if there is none."""
    is_marked = run.status & ~last.status & _CLOCK_STEP
    is_behind = run.stamp_ns < last.end_ns - round(CLOCK_STEP_S * 1e9)
    if not is_marked and not is_behind:
        return 0
    # If the sequence numbers were restarted, the number of samples between the runs is unknown.
    steps = max(last.size, run.sequence - last.sequence)
    return run.stamp_ns - last.stamp_of(steps)


class _TrialCounts:
    """Sample counts of a trial that has not ended, or whose samples have not all arrived.

    All times are in stream time.
    """

    def __init__(self, trial_id: str, stamp_ns: int) -> None:
        self.trial_id = trial_id
        self.start_ns = self.end_ns = stamp_ns
        self.is_over = self.is_too_late = False
        self._counts = _StreamCounts()
        self._before: _SampleRun | None = None
        self._after: _SampleRun | None = None
        self._has_begun = False

    def add(self, run: _SampleRun) -> None:
        """Add the next run of the stream; samples outside the trial are ignored."""
        begin = run.up_to(self.start_ns - 1)
        end = run.up_to(self.end_ns) if self.is_over else run.size
        if begin and not self._has_begun:
            self._before = run.part(begin - 1, begin)
        if begin < end:
            if not self._has_begun and self._before is not None:
                self._counts.follow(self._before)
            self._has_begun = True
            self._counts.add(run.part(begin, end))
        if end < run.size and self._after is None:
            self._after = run.part(end, end + 1)

    def finish(self) -> _StreamCounts:
        """Return the counts; call this after the last run."""
        if self._after is not None:
            self._counts.stop_before(self._after)
        return self._counts


LONGEST_STEP_S = 0.1
"""If two samples are further apart than this time [s] and three periods, this is a finding."""

MOST_NOTED = 100
"""Largest number of failed trials that the metadata of a bag list."""


@dataclass(frozen=True)
class Audit:
    """Result of the audit of one trial or of a whole recording.

    Attributes
    ----------
    finger : str
        Namespace; empty for the root namespace.
    trial_id : str
        Empty for the whole recording.
    findings : tuple of str
        One sentence for each finding; empty if the audit passed.
    start_ns, end_ns : int
        Stamps of the first and the last audited sample [ns].
    sample_count, lost_count, gap_count, duplicate_count, disordered_count : int
        Numbers of samples received, of missing sequence numbers, of gaps (consecutive missing
        numbers), of samples received twice, and of samples received after a newer one.
    rate_hz : float
        Sample rate [Hz]. It is computed from sequence numbers, so losses do not affect it. It is 0
        if there are fewer than two samples.
    nominal_rate_hz : float
        Expected rate [Hz]. If it is 0, the expected rate is unknown, and the rate is not checked.
    largest_step_s : float
        Longest time between consecutive samples, without steps of the host's clock [s].
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
        """Return a dictionary for JSON."""
        return {**asdict(self), 'findings': list(self.findings), 'passed': self.passed}

    def format(self) -> str:
        """Return the result as one line of text."""
        what = f'trial {self.trial_id}' if self.trial_id else 'recording'
        finger = f'{self.finger}: ' if self.finger else ''
        found = f'{self.sample_count} samples, complete' if self.passed else ''
        return plain_text(f'{finger}{what}: {found or "; ".join(self.findings)}')


def _make_audit(
    counts: _StreamCounts,
    finger: str,
    nominal_rate_hz: float,
    trial: _TrialCounts | None = None,
) -> Audit:
    """Return the audit of a trial, or of the whole recording."""
    return Audit(
        finger=finger,
        trial_id=trial.trial_id if trial else '',
        findings=tuple(_findings(counts, nominal_rate_hz, trial)),
        start_ns=counts.start_ns + counts.start_shift_ns,
        end_ns=counts.end_ns + counts.end_shift_ns,
        sample_count=counts.samples,
        lost_count=counts.lost,
        gap_count=counts.gaps,
        duplicate_count=counts.duplicates,
        disordered_count=counts.disordered,
        rate_hz=counts.rate_hz,
        nominal_rate_hz=nominal_rate_hz,
        largest_step_s=counts.largest_step_ns * 1e-9,
    )


def _findings(
    counts: _StreamCounts, nominal_hz: float, trial: _TrialCounts | None
) -> Iterable[str]:
    if counts.steps:
        first = format_clock_step(counts.first_step_ns, 'trial' if trial else 'recording')
        yield f'{first}, the first of {counts.steps} steps' if counts.steps > 1 else first
    if trial is not None and trial.is_too_late:
        yield (
            f'its events arrived more than {EVENT_DELAY_S:g} s after its samples; '
            'the number of missing samples is unknown'
        )
        return
    if not counts.samples:
        yield 'no tension samples were recorded'
        return
    period_s = 1.0 / (nominal_hz or counts.rate_hz or 1.0)
    longest_s = max(LONGEST_STEP_S, 3.0 * period_s)
    if counts.lost:
        share = counts.lost / (counts.samples + counts.lost)
        yield f'samples lost: {counts.lost} ({share:.2%}), gaps: {counts.gaps}'
    if counts.duplicates:
        yield f'duplicate samples: {counts.duplicates}'
    if counts.disordered:
        yield f'samples received after a newer one: {counts.disordered}'
    if counts.restarts:
        yield f'restarts of the numbering, with unknown losses: {counts.restarts}'
    if counts.reconnections:
        yield (f'reconnections of the sensor, with unknown losses: {counts.reconnections}')
    rate_hz = counts.rate_hz
    if nominal_hz and rate_hz and abs(rate_hz / nominal_hz - 1.0) > RATE_TOLERANCE:
        yield (
            f'the rate is {rate_hz:.4g} Hz, not {nominal_hz:.4g} Hz; '
            'set rate_hz of the feature node to the rate of the sensor'
        )
    if counts.largest_step_ns * 1e-9 > longest_s and not counts.lost:
        yield f'{counts.largest_step_ns * 1e-9:.3f} s between two consecutive samples'
    if trial is not None:
        late_s = (counts.start_ns - trial.start_ns) * 1e-9
        early_s = (trial.end_ns - counts.end_ns) * 1e-9
        if late_s > longest_s:
            yield f'the samples begin {late_s:.3f} s after the trial'
        if early_s > longest_s:
            yield f'the samples end {early_s:.3f} s before the trial'


class AuditSummary:
    """Summary of the audits of a bag: number of trials, failed trials, and whole recordings."""

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
        """Return a dictionary for JSON."""
        return {
            'trials': self.trials,
            'failed_trials': self._failed_trials,
            'failed': [audit.to_dict() for audit in self._failed],
            'whole': [audit.to_dict() for audit in self._whole],
        }


def summarise_audits(audits: Iterable[Audit]) -> dict[str, Any]:
    """Return the contents of an `AuditSummary` of these audits."""
    summary = AuditSummary()
    for audit in audits:
        summary.add(audit)
    return summary.to_dict()


MAX_BLOCKS = 100_000
"""Largest number of sample blocks that are stored for late events. Very small blocks may cover
less than `EVENT_DELAY_S`."""

MAX_TRIALS = 1000
"""Largest number of trials whose last samples have not arrived. If there are more, the oldest
trial is audited without waiting."""


class FingerAuditor:
    """Auditor of the blocks and trial events of one finger.

    The events of a trial may arrive before its samples, or up to `EVENT_DELAY_S` after them.
    Samples are stored for that time, without their values. The memory therefore grows neither with
    the length of a recording nor with the number of its trials.

    A step of the host's clock is a finding of the trial in which it occurs and of the whole
    recording. Other trials are not affected. ``nominal_rate_hz`` may be set later; 0 means
    unknown.
    """

    def __init__(self, finger: str, nominal_rate_hz: float = 0.0) -> None:
        self.finger = finger
        self.nominal_rate_hz = nominal_rate_hz
        self._whole = _StreamCounts()
        self._clock = _HostClock()
        self._recent: deque[_SampleRun] = deque()
        self._latest_ns: int | None = None  # in stream time, like all times below
        self._gone_ns: int | None = None
        self._trials: deque[_TrialCounts] = deque()  # only the last may be running

    def add_block(self, block: StrainBlock) -> list[Audit]:
        """Add samples; return the audits of the trials that are complete now."""
        if not len(block.tension_n):
            return []
        stamped = _SampleRun(
            block.stamp_ns,
            block.period_ns,
            block.sequence,
            len(block.tension_n),
            block.lost_before,
            int(block.status),
        )
        run = self._clock.take(stamped)
        if run.step_ns > 0:
            # If an event was stamped after the clock step, but arrived before this block, its
            # stream time was too late.
            for trial in self._trials:
                trial.start_ns = min(trial.start_ns, run.stamp_ns)
                trial.end_ns = min(trial.end_ns, run.stamp_ns)
        self._whole.add(run)
        self._recent.append(run)
        self._latest_ns = _latest(self._latest_ns, run.end_ns)
        self._let_go(self._latest_ns - round(EVENT_DELAY_S * 1e9))
        return self._take_complete()

    def _let_go(self, before_ns: int) -> None:
        """Discard stored runs before ``before_ns``, because no later event can refer to them.

        First, they are counted for the trials that are still waiting for samples.
        """
        while self._recent:
            run = self._recent[0]
            if run.end_ns >= before_ns and len(self._recent) <= MAX_BLOCKS:
                return
            self._recent.popleft()
            self._gone_ns = _latest(self._gone_ns, run.end_ns)
            for trial in self._trials:
                trial.add(run)

    def add_event(self, event: TrialEvent) -> list[Audit]:
        """Add an event; return the audits of the trials that are complete now."""
        stamp_ns = self._clock.time_of_event(event.stamp_ns, self._latest_ns)
        trial = self._trials[-1] if self._trials else None
        is_new = trial is None or trial.is_over or trial.trial_id != event.trial_id
        if trial is None or is_new:
            if trial is not None:
                trial.is_over = True
            trial = _TrialCounts(event.trial_id, stamp_ns)
            self._trials.append(trial)
        trial.start_ns = min(trial.start_ns, stamp_ns)
        trial.end_ns = max(trial.end_ns, stamp_ns)
        trial.is_over = event.phase in (PHASE_DONE, PHASE_ABORTED)
        if self._gone_ns is not None and stamp_ns <= self._gone_ns:
            trial.is_too_late |= is_new or trial.is_over
        return self._take_complete()

    def finish(self) -> list[Audit]:
        """Return the audits of trials that were not audited yet, and of the whole recording."""
        audits = []
        while self._trials:
            self._trials[0].is_over = True
            audits.append(self._audit(self._trials.popleft()))
        return [*audits, _make_audit(self._whole, self.finger, self.nominal_rate_hz)]

    def _take_complete(self) -> list[Audit]:
        audits = []
        # A trial is complete if a sample after its end has arrived.
        while self._trials and self._trials[0].is_over:
            is_complete = self._latest_ns is not None and self._latest_ns > self._trials[0].end_ns
            if not is_complete and len(self._trials) <= MAX_TRIALS:
                break
            audits.append(self._audit(self._trials.popleft()))
        return audits

    def _audit(self, trial: _TrialCounts) -> Audit:
        for run in self._recent:
            trial.add(run)
        return _make_audit(trial.finish(), self.finger, self.nominal_rate_hz, trial)


def _latest(before_ns: int | None, now_ns: int) -> int:
    return now_ns if before_ns is None else max(before_ns, now_ns)


def audit_bag(path: Path) -> list[Audit]:
    """Audit each finger of a bag: each trial, and then the whole recording.

    Raises `BagError` if the bag cannot be read.
    """
    with TactileBag(path) as bag:
        return audit_open_bag(bag)


def audit_open_bag(bag: TactileBag) -> list[Audit]:
    """Audit an open bag; see `audit_bag`."""
    audits: list[Audit] = []
    for finger in bag.namespaces:
        auditor = FingerAuditor(finger, nominal_rate_hz(bag, finger))
        for message, record in read_records(bag.messages(STRAIN, EVENT, namespace=finger)):
            if message.type_name == STRAIN:
                audits += auditor.add_block(record)
            elif message.topic.endswith(EVENT_TOPIC.name):  # not the detected events
                audits += auditor.add_event(record)
        audits += auditor.finish()
    return audits
