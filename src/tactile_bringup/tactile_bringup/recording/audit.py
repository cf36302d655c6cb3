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

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tactile_bringup.recording.bag_records import read_records
from tactile_bringup.recording.bags import EVENT, EVENT_TOPIC, STRAIN, TactileBag
from tactile_bringup.recording.stream_counts import SampleRun, StreamCounts
from tactile_features.phase_window import RATE_TOLERANCE
from tactile_features.records import (
    PHASE_ABORTED,
    PHASE_DONE,
    StrainBlock,
    TrialEvent,
)

LONGEST_STEP_S = 0.1
"""Longest time between two samples that is not worth a word [s]; at least three periods."""

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


def _make_audit(
    counts: StreamCounts,
    finger: str,
    nominal_rate_hz: float,
    trial: tuple[str, int, int] | None = None,
) -> Audit:
    """Return the result; ``trial``: its name, its first and its last time."""
    return Audit(
        finger=finger,
        trial_id=trial[0] if trial else '',
        findings=tuple(_findings(counts, nominal_rate_hz, trial)),
        start_ns=counts.start_ns,
        end_ns=counts.end_ns,
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
    counts: StreamCounts, nominal_hz: float, trial: tuple[str, int, int] | None
) -> Iterable[str]:
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
        late_s = (counts.start_ns - trial[1]) * 1e-9
        early_s = (trial[2] - counts.end_ns) * 1e-9
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
        self._whole = StreamCounts()
        self._runs: list[SampleRun] = []
        self._latest_ns: int | None = None
        self._open: _Trial | None = None
        self._ended: list[_Trial] = []

    def add_block(self, block: StrainBlock) -> list[Audit]:
        """Take in samples; return the audits of the trials that are now over."""
        if not len(block.tension_n):
            return []
        run = SampleRun(
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
            _make_audit(self._whole, self.finger, self.nominal_rate_hz),
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
        counts = StreamCounts()
        before: SampleRun | None = None
        after: SampleRun | None = None
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
        span = (trial.trial_id, trial.start_ns, trial.end_ns)
        return _make_audit(counts, self.finger, self.nominal_rate_hz, span)


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
        for message, record in read_records(bag.messages(STRAIN, EVENT, namespace=finger)):
            if message.type_name == STRAIN:
                audits += auditor.add_block(record)
            elif message.topic.endswith(EVENT_TOPIC.name):  # and not what was found in the signal
                audits += auditor.add_event(record)
        audits += auditor.finish()
    return audits
