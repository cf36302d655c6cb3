# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The window of one phase: selection and checks of its samples, and its features."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.feature_sets.feature_set import RATE_TOLERANCE, WindowSamples
from tactile_features.spec import spec_of
from tactile_features.types import FeatureWindow, PHASE_ABORTED, TrialEvent, WindowOutcome
from tactile_features.windows import PAUSE_NS, SAMPLE, SampleBuffer, Samples
from tactile_ros.strain import StrainStatus

_BAD_STATUS = {
    StrainStatus.SATURATED: 'saturated',
    StrainStatus.STUCK: 'stuck',
    StrainStatus.DEVICE_ERROR: 'reported as faulty by the device',
}

CROP_MARGIN = 10.0
"""The limit of the stamp error is a fraction of the window length. If the crop at the start of the
phase times this number is shorter, it replaces the window length; see `PhaseWindow`."""

_NO_SAMPLES: Samples = np.empty(0, SAMPLE)


class _Cut(NamedTuple):
    """The samples of a window.

    Attributes
    ----------
    samples : Samples
    after : SAMPLE or None
        The sample after the window. None if the window has a fixed number of samples and is
        complete.
    lead : Samples
        The samples between the start of the phase and the window.
    """

    samples: Samples
    after: Any
    lead: Samples


class PhaseWindow:
    """The window of one finished glide or hold phase.

    The feature set of the phase determines which samples form the window. There are two kinds of
    windows: a fixed number of samples that begins after the crop at the start and must end before
    the crop at the end, or all samples between the two crops.

    A stamp error e shifts the window by e along its phase. In a texture window of length T, a
    fraction e / T of the samples then belongs to another part of the surface. The frequencies do
    not change, because the window has a fixed number of samples. The relative error of the slope
    of a hold is at most 3 e / T: for a regression over evenly spaced times, the worst case is an
    error of +e in one half of the window and of -e in the other half. The measured duration of
    the window, which is compared with the nominal rate, is wrong by up to 2 e. Therefore e must
    not exceed ``max_stamp_error_share`` of T. If this fraction is 1 %, the duration is known
    within `RATE_TOLERANCE`. The crop at the start excludes the transient only if e is small
    compared with the crop. Therefore, if `CROP_MARGIN` times the crop is shorter than T, it
    replaces T in this limit. A crop of 0 sets no limit.

    Parameters
    ----------
    start, end : TrialEvent
        The event of this phase, and the next event of the trial.
    config : FeatureConfig
    buffer : SampleBuffer
        The samples, with the gap policy of ``config``.
    """

    def __init__(
        self,
        start: TrialEvent,
        end: TrialEvent,
        config: FeatureConfig,
        buffer: SampleBuffer,
    ) -> None:
        self.start = start
        self.end = end
        self._config = config
        self._buffer = buffer
        self._set = config.feature_set(start.phase)
        self._spec = spec_of(self._set)
        self._speed_m_s = start.glide_speed_m_s if self._set.needs_speed else 0.0
        self._period_ns = round(1e9 / config.rate_hz)
        self._no_window: str | None = None
        try:
            window = self._set.window(config.rate_hz, self._speed_m_s)
        except FeatureError as error:
            self._no_window = str(error)
            self._speed_m_s = 0.0
            return
        self._is_counted = window.sample_count > 0
        self._wanted = window.sample_count or 2
        if self._is_counted:
            length_s = (self._wanted - 1) / config.rate_hz
        else:
            phase_s = (end.stamp_ns - start.stamp_ns) / 1e9
            length_s = phase_s - window.crop_start_s - window.crop_end_s
        self._from_ns = start.stamp_ns + round(window.crop_start_s * 1e9)
        self._to_ns = end.stamp_ns - round(window.crop_end_s * 1e9)
        self._shortest_ns = round(window.shortest_s * 1e9)
        crops_s = CROP_MARGIN * window.crop_start_s or length_s
        self._most_error_s = config.max_stamp_error_share * min(length_s, crops_s)

    def take(self) -> FeatureWindow | None:
        """Return the window, or None while samples that have not arrived yet could change it."""
        if refused := self.refuse_by_events():
            return refused
        cut = self._cut()
        if cut is None:
            return None
        if refused := self._refuse_evicted():
            return refused
        return self.time_out() if self._is_too_late(cut.after) else self._assess(cut)

    def refuse_by_events(self) -> FeatureWindow | None:
        """Return a refused window if the events show that there are no features, or None."""
        if self.end.phase == PHASE_ABORTED:
            reason = f'the trial was aborted: {self.end.message or "no reason given"}'
            return self.refuse(WindowOutcome.ABORTED, reason)
        if self._no_window is not None:
            return self.refuse(WindowOutcome.UNDEFINED, self._no_window)
        if self.end.stamp_ns < self.start.stamp_ns:
            return self.refuse(WindowOutcome.BAD_TIME, _format_set_back(self.start, self.end))
        if self._to_ns - self._from_ns < self._shortest_ns:
            reason = (
                f'the {self.start.phase} leaves {(self._to_ns - self._from_ns) / 1e9:.3f} s '
                f'between its crops; the window needs {self._shortest_ns / 1e9:.3f} s'
            )
            return self.refuse(WindowOutcome.TOO_SHORT, reason)
        return None

    def refuse(
        self, outcome: WindowOutcome, reason: str, samples: Samples = _NO_SAMPLES
    ) -> FeatureWindow:
        """Return the window without features, with the outcome and the reason."""
        return self._window(outcome, reason, samples, np.empty(0))

    def time_out(self) -> FeatureWindow:
        """Return the window without features, because its samples have not arrived in time."""
        reason = (
            f'no samples arrived within {self._config.samples_timeout_s:g} s after the end of the '
            f'{self.start.phase}: the sensor is silent, see its diagnostics'
        )
        return self.refuse(WindowOutcome.GAP, reason)

    def _is_too_late(self, after: Any) -> bool:
        """Return True if the sample after the window arrived after ``samples_timeout_s``."""
        if after is None or after['step_ns']:
            return False
        late_ns = int(after['latest_ns']) - self.end.stamp_ns
        return late_ns > self._config.samples_timeout_s * 1e9

    def _refuse_evicted(self) -> FeatureWindow | None:
        evicted_ns = self._buffer.evicted_ns
        if evicted_ns is None or evicted_ns < self._from_ns:
            return None
        reason = (
            f'the buffer of {self._config.buffer_s:g} s no longer holds the full window; '
            'raise buffer_s'
        )
        return self.refuse(WindowOutcome.GAP, reason)

    def _first_samples(self) -> _Cut | None:
        """Return the first samples after the crop, or None while some of them are missing."""
        begin = self._buffer.first_at(self._from_ns)
        end = begin + self._wanted
        return self._slice(begin, end, None) if end <= len(self._buffer.samples) else None

    def _slice(self, begin: int, end: int, after: Any) -> _Cut:
        samples = self._buffer.samples
        lead = samples[self._buffer.first_at(self.start.stamp_ns) : begin]
        return _Cut(samples[begin:end], after, lead)

    def _cut(self) -> _Cut | None:
        if self._is_counted:
            cut = self._first_samples()
            if cut is not None and cut.samples['latest_ns'][-1] <= self._to_ns:
                return cut
        buffer = self._buffer
        if buffer.watermark_ns is None or buffer.watermark_ns <= self._to_ns:
            return None
        end = buffer.first_beyond(self._to_ns)
        return self._slice(buffer.first_at(self._from_ns), end, buffer.samples[end])

    def _assess(self, cut: _Cut) -> FeatureWindow:
        samples = cut.samples
        if reason := self._find_step(cut):
            return self.refuse(WindowOutcome.BAD_TIME, reason, samples)
        if reason := self._find_gap(cut):
            return self.refuse(WindowOutcome.GAP, reason, samples)
        if len(samples) < self._wanted:
            reason = f'the {self.start.phase} has {len(samples)} of {self._wanted} samples'
            return self.refuse(WindowOutcome.TOO_SHORT, reason, samples)
        if reason := self._find_stamp_error(samples):
            return self.refuse(WindowOutcome.BAD_TIME, reason, samples)
        if reason := self._find_fault(samples):
            return self.refuse(WindowOutcome.BAD_SIGNAL, reason, samples)
        tension_n = np.ascontiguousarray(samples['tension_n'])
        config = self._config
        of_set = WindowSamples(samples['stamp_ns'], tension_n, config.rate_hz, self._speed_m_s)
        try:
            values = self._set.compute(of_set)
        except FeatureError as error:
            return self.refuse(WindowOutcome.UNDEFINED, str(error), samples)
        return self._window(WindowOutcome.OK, '', samples, values)

    def _find_step(self, cut: _Cut) -> str | None:
        after_ns = [] if cut.after is None else [cut.after['step_ns']]
        steps_ns = np.concatenate([cut.lead['step_ns'], cut.samples['step_ns'], after_ns])
        steps_ns = steps_ns[steps_ns != 0]
        return format_clock_step(int(steps_ns[0]), self.start.phase) if len(steps_ns) else None

    def _find_stamp_error(self, samples: Samples) -> str | None:
        known_error_s = float(samples['stamp_error_s'].max())  # an unknown error is -1
        if known_error_s > self._most_error_s:
            return (
                f'the stamps may be wrong by {known_error_s:.4f} s; this window allows '
                f'{self._most_error_s:.4f} s (max_stamp_error_share). Find out what delays the '
                'samples on their way to the host'
            )
        if _worst_error_s(samples) < 0.0 and not self._config.accept_unknown_stamp_error:
            return (
                'the error of the stamps is unknown, and the parameter '
                'accept_unknown_stamp_error is false'
            )
        return None

    def _find_gap(self, cut: _Cut) -> str | None:
        samples, after, _ = cut
        holes = np.flatnonzero(samples['hole'][1:])
        if len(holes):
            before, behind = samples['sequence'][holes[0] : holes[0] + 2].tolist()
            if behind > before + 1:
                return (
                    f'{behind - before - 1} samples are missing after sequence number {before}; '
                    f'max_gap_samples allows {self._config.max_gap_samples}'
                )
            first_ns, second_ns = samples['stamp_ns'][holes[0] : holes[0] + 2].tolist()
            if second_ns - first_ns > PAUSE_NS:
                return (
                    f'the samples paused for {(second_ns - first_ns) / 1e9:.3f} s before sequence '
                    f"number {behind}; see the sensor's diagnostics"
                )
            return f'the stream was interrupted and restarted at sequence number {behind}'
        # Samples were lost before the first or after the last sample. If a sample one nominal
        # period away would have been inside the window, the lost samples belonged to it.
        first = samples[0] if len(samples) else after
        if first['hole'] and first['stamp_ns'] - self._period_ns >= self._from_ns:
            return 'samples are missing at the start of the window'
        is_cut_short = len(samples) and after is not None and after['hole']
        if is_cut_short and samples['stamp_ns'][-1] + self._period_ns <= self._to_ns:
            return 'samples are missing at the end of the window'
        return None

    def _find_fault(self, samples: Samples) -> str | None:
        status = int(np.bitwise_or.reduce(samples['status']))
        if faults := [text for bit, text in _BAD_STATUS.items() if status & bit]:
            return f'samples in the window are {" and ".join(faults)}'
        if not np.isfinite(samples['tension_n']).all():
            return 'samples in the window are not finite'
        span_ns = int(samples['stamp_ns'][-1]) - int(samples['stamp_ns'][0])
        nominal_ns = (len(samples) - 1) * self._period_ns
        # If the stamps are arrival times, each end may be wrong by one period.
        if abs(span_ns - nominal_ns) > RATE_TOLERANCE * nominal_ns + 2 * self._period_ns:
            rate_hz = (len(samples) - 1) / span_ns * 1e9 if span_ns > 0 else 0.0
            return (
                f'the window of {len(samples)} samples lasts {span_ns / 1e9:.3f} s instead of '
                f'{nominal_ns / 1e9:.3f} s: the samples come at {rate_hz:.4g} Hz, and these '
                f'features need {1e9 / self._period_ns:.4g} Hz'
            )
        return None

    def _window(
        self, outcome: WindowOutcome, reason: str, samples: Samples, values: NDArray[np.float64]
    ) -> FeatureWindow:
        found = len(samples) > 0
        status = int(np.bitwise_or.reduce(samples['status']))
        of_simulation = status & StrainStatus.SIMULATED if found else self._buffer.is_simulated
        return FeatureWindow(
            feature_set=self._spec.feature_set,
            feature_set_version=self._spec.version,
            trial_id=self.start.trial_id,
            contact=self.start.contact,
            simulated=self.start.simulated or bool(of_simulation),
            outcome=outcome,
            reason=reason,
            values=values,
            window_start_ns=int(samples['stamp_ns'][0]) if found else self.start.stamp_ns,
            window_end_ns=int(samples['stamp_ns'][-1]) if found else self.end.stamp_ns,
            first_sequence=int(samples['sequence'][0]) if found else 0,
            rate_hz=self._spec.rate_hz,
            sample_count=len(samples),
            interpolated_count=int(np.count_nonzero(samples['interpolated'])),
            status=status,
            frame_id=self._config.frame_id,
            speed_m_s=self._speed_m_s,
            specification_digest=self._spec.digest,
            stamp_error_s=_worst_error_s(samples),
        )


def format_clock_step(step_ns: int, phase: str) -> str:
    """Return the reason to refuse a window that contains a step of the host's clock."""
    way = 'forward' if step_ns > 0 else 'back'
    return f"the host's clock was set {way} by {abs(step_ns) / 1e9:.3f} s during the {phase}"


def _format_set_back(start: TrialEvent, end: TrialEvent) -> str:
    return (
        f'the end of the {start.phase} is stamped {(start.stamp_ns - end.stamp_ns) / 1e9:.3f} s '
        "before its start: the host's clock was set back"
    )


def _worst_error_s(samples: Samples) -> float:
    """Return the largest bound on the stamp errors [s], or -1 if one of them is unknown."""
    errors_s = samples['stamp_error_s']
    return float(errors_s.max()) if len(errors_s) and errors_s.min() >= 0.0 else -1.0


class EarlyWindow(PhaseWindow):
    """The first samples of a phase, returned as soon as they have arrived.

    The window does not depend on the end of the phase, which may not be known yet. The order in
    which the samples and the event that ends the phase arrive does not matter. If the phase ended
    or was aborted inside the window, a refusal with the same specification follows as soon as the
    window and the end of the phase are known.

    Parameters
    ----------
    start : TrialEvent
        Start of the phase.
    config : FeatureConfig
        Its feature set for the phase must be early (`FeatureSet.is_early`).
    buffer : SampleBuffer
    is_past : bool
        True if the start was published before this process subscribed to the samples. In this
        case, refused windows are not returned.

    Attributes
    ----------
    due_ns : int
        Nominal time of the last sample [ns].
    is_given : bool
        True if the window has been returned.
    is_ended : bool
        True if the end of the phase is known.
    """

    def __init__(
        self, start: TrialEvent, config: FeatureConfig, buffer: SampleBuffer, *, is_past: bool
    ) -> None:
        super().__init__(start, start, config, buffer)
        self._is_past = is_past
        self._given: FeatureWindow | None = None
        self._last_ns = 0
        self._phase_end: TrialEvent | None = None
        self._is_followed = False
        self.due_ns = start.stamp_ns
        if self._no_window is None:
            self.due_ns = self._from_ns + (self._wanted - 1) * self._period_ns

    @property
    def is_given(self) -> bool:
        return self._given is not None

    @property
    def is_ended(self) -> bool:
        return self._phase_end is not None

    @property
    def is_over(self) -> bool:
        """True when the window and a possible refusal have been returned."""
        if self._given is None:
            return False
        return self._given.outcome != WindowOutcome.OK or self._is_followed

    def end_phase(self, end: TrialEvent | None) -> None:
        """Store the event that ended the phase; None if another trial began instead."""
        self._is_followed = True
        self._phase_end = end

    def take_new(self) -> list[FeatureWindow]:
        """Return the window, and the refusal that follows it, as soon as each is known."""
        if self._given is None:
            window = self.take()
            return [] if window is None else self.give(window)
        return self._refuse_afterwards()

    def give(self, window: FeatureWindow) -> list[FeatureWindow]:
        """Mark the window as returned; return it, unless it is refused and ``is_past``.

        If the phase has already ended inside the window, the refusal follows in the same list.
        """
        self._given = window
        if window.outcome != WindowOutcome.OK and self._is_past:
            return []
        return [window, *self._refuse_afterwards()]

    def take(self) -> FeatureWindow | None:
        """Return the window, or None while samples are missing."""
        if self._no_window is not None:
            return self.refuse(WindowOutcome.UNDEFINED, self._no_window)
        cut = self._first_samples()
        if cut is None:
            return None
        if window := self._refuse_evicted():
            return window
        self._last_ns = int(cut.samples['latest_ns'][-1])
        late_ns = self._last_ns - self.due_ns
        is_late = late_ns > self._config.samples_timeout_s * 1e9
        return self.time_out() if is_late and not self._find_step(cut) else self._assess(cut)

    def time_out(self) -> FeatureWindow:
        """Return the window without features, because its samples have not arrived in time."""
        reason = (
            f'the samples did not arrive within {self._config.samples_timeout_s:g} s after the '
            'nominal end of the window: the sensor is silent, see its diagnostics'
        )
        return self.refuse(WindowOutcome.GAP, reason)

    def _refuse_afterwards(self) -> list[FeatureWindow]:
        """Return the refusal if the phase ended inside a window that was already returned."""
        given, end = self._given, self._phase_end
        if given is None or given.outcome != WindowOutcome.OK or end is None:
            return []
        start = self.start
        crop_ns = start.stamp_ns - self._to_ns
        needs_ns = self._last_ns + crop_ns - start.stamp_ns
        lasted_ns = end.stamp_ns - start.stamp_ns
        if end.phase == PHASE_ABORTED and end.stamp_ns > self._last_ns:
            return []
        if end.phase == PHASE_ABORTED:
            outcome = WindowOutcome.ABORTED
            reason = f'the trial was aborted inside the window: {end.message or "no reason given"}'
        elif lasted_ns < 0:
            outcome, reason = WindowOutcome.BAD_TIME, _format_set_back(start, end)
        elif lasted_ns < needs_ns:
            outcome = WindowOutcome.TOO_SHORT
            reason = (
                f'the {start.phase} ended after {lasted_ns / 1e9:.3f} s, inside the window, which '
                f'needs {needs_ns / 1e9:.3f} s'
            )
        else:
            return []
        return [dataclasses.replace(given, outcome=outcome, reason=reason, values=np.empty(0))]
