# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether a recording holds every sample: rate, gaps, duplicates, order.

One implementation for the recorder, which audits each trial when it has ended, and for a
bag on the disk. It goes by sequence numbers and stamps, so that it finds what was lost
anywhere between the sensor and the file, however samples are grouped into messages.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from tactile_bringup.bags import EVENT, EVENT_TOPIC, STRAIN, TactileBag
from tactile_features.conversions import event_from_msg, strain_block_from_msg
from tactile_features.phase_window import RATE_TOLERANCE
from tactile_features.records import (
    PHASE_ABORTED,
    PHASE_DONE,
    STATUS_RECONNECTED,
    StrainBlock,
    TrialEvent,
)

LONGEST_STEP_S = 0.1
"""Longest time between two samples that is not worth a word [s]; at least three periods."""

MAX_GAPS = 10_000
"""Gaps that are remembered, for samples that come late after all."""

MAX_BLOCKS = 2_000_000
"""Blocks that are remembered for the audit of a trial."""


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
        Times of the first and the last audited sample [ns].
    sample_count, lost_count, gap_count, duplicate_count, disordered_count : int
        Samples that came; missing in the numbering, in so many runs; came again; came
        later than a newer one.
    rate_hz : float
        By the numbering, so a loss does not change it; 0: fewer than two samples.
    nominal_rate_hz : float
        0: not known, and not compared.
    largest_step_s : float
        Longest time between two neighbouring samples.
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


class _Run(NamedTuple):
    """A block of samples without their values, or a part of one."""

    stamp_ns: int
    period_ns: int
    sequence: int
    size: int
    lost_before: int
    status: int

    def stamp_of(self, i: int) -> int:
        return self.stamp_ns + i * self.period_ns

    def part(self, begin: int, end: int) -> _Run:
        """Return the samples from ``begin`` up to but not with ``end``."""
        return self._replace(
            stamp_ns=self.stamp_of(begin),
            sequence=self.sequence + begin,
            size=end - begin,
            lost_before=0 if begin else self.lost_before,
        )

    def up_to(self, stamp_ns: int) -> int:
        """Return how many samples are not later than this."""
        if self.period_ns <= 0:
            return self.size if self.stamp_ns <= stamp_ns else 0
        return min(self.size, max(0, (stamp_ns - self.stamp_ns) // self.period_ns + 1))


class _Counts:
    """Goes along a stream of runs and counts what is missing, doubled, late."""

    def __init__(self) -> None:
        self.samples = self.lost = self.gaps = self.duplicates = self.disordered = 0
        self.restarts = self.reconnections = 0
        self.start_ns = self.end_ns = 0
        self.largest_step_ns = 0
        self._next: int | None = None
        self._status = 0
        self._missing: deque[tuple[int, int]] = deque(maxlen=MAX_GAPS)
        self._span_ns = self._steps = 0
        self._segment: tuple[int, int] | None = None

    def follow(self, before: _Run) -> None:
        """Begin behind this run, which does not count itself."""
        self._next = before.sequence + before.size
        self._status = before.status
        self.end_ns = before.stamp_of(before.size - 1)

    def stop_before(self, after: _Run) -> None:
        """End before this run, which does not count itself."""
        if self._next is not None and after.sequence > self._next:
            self._lose(after.sequence - self._next, after.sequence)

    def _lose(self, count: int, sequence: int) -> None:
        assert self._next is not None
        if count:
            self.gaps += 1
            self.lost += count
        if sequence > self._next:
            self._missing.append((self._next, sequence))

    def add(self, run: _Run) -> None:
        if self._next is not None and run.sequence < self._next:
            if run.stamp_ns <= self.end_ns:
                self._take_late(run)
                return
            self.restarts += 1
            self._close_segment()
            self._next = None
        self._take_new(run)

    def _take_late(self, run: _Run) -> None:
        """Take a run whose numbers have been passed: late, again, or partly new."""
        assert self._next is not None
        old = min(run.size, self._next - run.sequence)
        late = self._fill(run.sequence, run.sequence + old)
        self.samples += late
        self.disordered += late
        self.duplicates += old - late
        if old < run.size:
            self._take_new(run.part(old, run.size))

    def _fill(self, begin: int, end: int) -> int:
        """Take these numbers out of those that are missing; return how many were."""
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

    def _take_new(self, run: _Run) -> None:
        if self._next is not None:
            # What the driver knows of may be more than the numbering shows.
            self._lose(max(run.sequence - self._next, run.lost_before), run.sequence)
            self.largest_step_ns = max(self.largest_step_ns, run.stamp_ns - self.end_ns)
        if run.status & ~self._status & STATUS_RECONNECTED:
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
        self.end_ns = run.stamp_of(run.size - 1)

    def _close_segment(self) -> None:
        """Take the time and the numbers since the numbering last began anew."""
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

    def audit(
        self, finger: str, nominal_rate_hz: float, trial: tuple[str, int, int] | None = None
    ) -> Audit:
        """Return the result; ``trial``: its name, its first and its last time."""
        return Audit(
            finger=finger,
            trial_id=trial[0] if trial else '',
            findings=tuple(self._findings(nominal_rate_hz, trial)),
            start_ns=self.start_ns,
            end_ns=self.end_ns,
            sample_count=self.samples,
            lost_count=self.lost,
            gap_count=self.gaps,
            duplicate_count=self.duplicates,
            disordered_count=self.disordered,
            rate_hz=self.rate_hz,
            nominal_rate_hz=nominal_rate_hz,
            largest_step_s=self.largest_step_ns * 1e-9,
        )

    def _findings(self, nominal_hz: float, trial: tuple[str, int, int] | None) -> Iterable[str]:
        if not self.samples:
            yield 'no samples of the tension came'
            return
        period_s = 1.0 / (nominal_hz or self.rate_hz or 1.0)
        longest_s = max(LONGEST_STEP_S, 3.0 * period_s)
        if self.lost:
            share = self.lost / (self.samples + self.lost)
            yield f'{self.lost} samples lost in {self.gaps} gaps ({share:.2%})'
        if self.duplicates:
            yield f'{self.duplicates} samples came again'
        if self.disordered:
            yield f'{self.disordered} samples came later than a newer one'
        if self.restarts:
            yield f'the numbering began anew {self.restarts} times; what was lost is not known'
        if self.reconnections:
            yield (
                f'the sensor was reached anew {self.reconnections} times; '
                'what was lost is not known'
            )
        rate_hz = self.rate_hz
        if nominal_hz and rate_hz and abs(rate_hz / nominal_hz - 1.0) > RATE_TOLERANCE:
            yield (
                f'the rate is {rate_hz:.4g} Hz, not {nominal_hz:.4g} Hz; '
                'set rate_hz of the feature node to that of the sensor'
            )
        if self.largest_step_ns * 1e-9 > longest_s and not self.lost:
            yield f'{self.largest_step_ns * 1e-9:.3f} s lie between two samples'
        if trial is not None:
            late_s = (self.start_ns - trial[1]) * 1e-9
            early_s = (trial[2] - self.end_ns) * 1e-9
            if late_s > longest_s:
                yield f'the samples begin {late_s:.3f} s after the trial'
            if early_s > longest_s:
                yield f'the samples end {early_s:.3f} s before the trial'


@dataclass
class _Trial:
    trial_id: str
    start_ns: int
    end_ns: int


class FingerAuditor:
    """Blocks and trial events of one finger in, an audit of each trial out.

    The events of a trial may come before or after its samples.

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
        self._whole = _Counts()
        self._runs: list[_Run] = []
        self._latest_ns: int | None = None
        self._open: _Trial | None = None
        self._ended: list[_Trial] = []

    def add_block(self, block: StrainBlock) -> list[Audit]:
        """Take in samples; return the audits of the trials that are now over."""
        if not len(block.tension_n):
            return []
        run = _Run(
            block.stamp_ns,
            block.period_ns,
            block.sequence,
            len(block.tension_n),
            block.lost_before,
            block.status,
        )
        self._whole.add(run)
        self._runs.append(run)
        last_ns = run.stamp_of(run.size - 1)
        self._latest_ns = last_ns if self._latest_ns is None else max(self._latest_ns, last_ns)
        if len(self._runs) > MAX_BLOCKS:
            del self._runs[: MAX_BLOCKS // 2]
        return self._take_complete()

    def add_event(self, event: TrialEvent) -> list[Audit]:
        """Take in the start of a phase; return the audits of the trials that are now over."""
        if self._open is None or self._open.trial_id != event.trial_id:
            self._close_trial()
            self._open = _Trial(event.trial_id, event.stamp_ns, event.stamp_ns)
        self._open.start_ns = min(self._open.start_ns, event.stamp_ns)
        self._open.end_ns = max(self._open.end_ns, event.stamp_ns)
        if event.phase in (PHASE_DONE, PHASE_ABORTED):
            self._close_trial()
        return self._take_complete()

    def finish(self) -> list[Audit]:
        """Return the audits of trials that still wait for samples, then of the whole."""
        self._close_trial()
        ended, self._ended = self._ended, []
        return [
            *(self._audit(trial) for trial in ended),
            self._whole.audit(self.finger, self.nominal_rate_hz),
        ]

    def _close_trial(self) -> None:
        if self._open is not None:
            self._ended.append(self._open)
            self._open = None

    def _take_complete(self) -> list[Audit]:
        audits = []
        # Only with a sample beyond its end is it known that a trial's last ones have come.
        while (
            self._ended and self._latest_ns is not None and self._latest_ns > self._ended[0].end_ns
        ):
            audits.append(self._audit(self._ended.pop(0)))
        return audits

    def _audit(self, trial: _Trial) -> Audit:
        counts = _Counts()
        before: _Run | None = None
        after: _Run | None = None
        has_begun = False
        for run in self._runs:
            begin, end = run.up_to(trial.start_ns - 1), run.up_to(trial.end_ns)
            if begin and not has_begun:
                before = run.part(begin - 1, begin)
            if end < run.size and after is None:
                after = run.part(end, end + 1)
            if begin < end:
                if not has_begun and before is not None:
                    counts.follow(before)
                has_begun = True
                counts.add(run.part(begin, end))
        if after is not None:
            counts.stop_before(after)
        if not self._ended and (self._open is None or self._open.start_ns > trial.end_ns):
            # The next trial's events may come late, but not by more than this one lasted.
            keep_from_ns = trial.end_ns
            self._runs = [r for r in self._runs if r.stamp_of(r.size - 1) >= keep_from_ns]
        return counts.audit(
            self.finger, self.nominal_rate_hz, (trial.trial_id, trial.start_ns, trial.end_ns)
        )


def nominal_rate_hz(facts: dict[str, Any]) -> float:
    """Return the sample rate that a recording was made for [Hz]; 0 when it does not say."""
    config = facts.get('feature_config')
    value = config.get('rate_hz', 0.0) if isinstance(config, dict) else 0.0
    return float(value) if isinstance(value, int | float) and 0.0 < value < 1e9 else 0.0


def summarise_audits(audits: Sequence[Audit]) -> dict[str, Any]:
    """Return what a bag notes of its audits: how many there were, and those that failed."""
    trials = [audit for audit in audits if audit.trial_id]
    failed = [audit for audit in trials if not audit.passed]
    return {
        'trials': len(trials),
        'failed_trials': len(failed),
        'failed': [audit.to_dict() for audit in failed[:MOST_NOTED]],
        'whole': [audit.to_dict() for audit in audits if not audit.trial_id],
    }


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
        for message in bag.messages(STRAIN, EVENT, namespace=finger):
            decoded = message.decode()
            if message.type_name == STRAIN:
                audits += auditor.add_block(strain_block_from_msg(decoded))
            elif message.topic.endswith(EVENT_TOPIC.name):  # and not what was found in the signal
                audits += auditor.add_event(event_from_msg(decoded))
        audits += auditor.finish()
    return audits
