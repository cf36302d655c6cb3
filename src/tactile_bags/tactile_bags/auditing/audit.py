# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Audit of a trial or a recording: counts and findings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from tactile_bags.auditing.host_clock import EVENT_DELAY_S, SpanCounts
from tactile_bags.auditing.trial_counts import TrialCounts
from tactile_features.extraction.phase_window import format_clock_step
from tactile_features.feature_sets.feature_set import RATE_TOLERANCE

LONGEST_STEP_S = 0.1
"""Longest time between two samples that is not worth a word [s]; at least three periods."""

MOST_NOTED = 100
"""Failed trials that the metadata of a bag list."""


@dataclass(frozen=True)
class Audit:
    """Result of the audit of one trial or of a whole recording.

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
        Samples received; sequence numbers missing; runs of missing numbers; samples received
        twice; samples received after a newer one.
    rate_hz : float
        From sequence numbers, so losses do not change it [Hz]; 0: fewer than two samples.
    nominal_rate_hz : float
        Expected rate [Hz]; 0: not known, and not compared.
    largest_step_s : float
        Longest time between neighbouring samples, without steps of the host's clock [s].
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


def make_audit(
    span: SpanCounts,
    finger: str,
    nominal_rate_hz: float,
    trial: TrialCounts | None = None,
) -> Audit:
    """Return the audit of a span: of a trial, or of the whole recording."""
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


def _findings(span: SpanCounts, nominal_hz: float, trial: TrialCounts | None) -> Iterable[str]:
    counts = span.counts
    if span.steps:
        first = format_clock_step(span.first_step_ns, 'trial' if trial else 'recording')
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


class AuditSummary:
    """Summary of a bag's audits: number of trials, failed trials and whole-recording audits.

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
