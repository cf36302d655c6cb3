# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples and trial events in, windows of features out.

The one implementation behind the live node, the replay of bags and training.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.extraction.partial_window import PartialWindow
from tactile_features.extraction.phase_window import describe_clock_step, PhaseWindow
from tactile_features.feature_sets.feature_set import FeatureSet, WindowSamples
from tactile_features.phases.signal_phases import SignalPhases
from tactile_features.records import (
    FeatureWindow,
    Outcome,
    PHASE_APPROACH,
    PHASE_CONTACT,
    PHASE_GLIDE,
    PHASE_HOLD,
    PHASES_STATED,
    TrialEvent,
)
from tactile_features.spec import array_spec, FeatureSpec, set_for, WantedFeatures
from tactile_features.windows import SampleBuffer
from tactile_ros.strain import StrainBlock

GRACE_S = 0.5
"""Longest time that a sample takes to arrive; only after it does a sample count as missing."""


class TrialFeatureExtractor:
    """Cuts one window out of every finished glide and hold phase.

    With ``partial_samples`` the first parts of a texture window come as soon as their
    samples are there, marked as partial, and before the window itself.

    With ``phases`` other than ``stated`` the events are found in the tension, and those
    that are added are passed over.

    The windows depend on stamps and sequence numbers alone: in whatever way events
    and blocks interleave, and however samples are grouped into blocks, the same
    windows come out in the same order, bit for bit, as long as neither topic runs
    ahead of the other by more than ``buffer_s``, and the clock of the samples is not set
    back by a second or more: then nothing that is still to come can belong to what was.

    A window whose samples do not come is refused `GRACE_S` after ``samples_timeout_s`` by
    `time_out`, which a node calls by a monotonic clock, and by `pass_time`, which a replay
    calls at the end of its data. Samples that come later refuse it by their stamps, with
    the same bits. So a replay equals what was live, unless a sample with a stamp within
    ``samples_timeout_s`` took longer than `GRACE_S` to arrive.

    Parameters
    ----------
    config : FeatureConfig

    Attributes
    ----------
    block_count, sample_count, event_count : int
        What has come in.
    window_counts : dict of Outcome to int
        What has come out, without the partial windows.
    """

    def __init__(
        self, config: FeatureConfig, wanted: Sequence[WantedFeatures] = ()
    ) -> None:
        self.config = config
        self.block_count = 0
        self.sample_count = 0
        self.event_count = 0
        self.window_counts = dict.fromkeys(Outcome, 0)
        self._buffer_ns = round(config.buffer_s * 1e9)
        # Twice the nominal rate: a stream that is too fast is told so, not cut off.
        capacity = round(2 * config.buffer_s * config.rate_hz)
        self._buffer = SampleBuffer(self._buffer_ns, capacity, config.max_gap_samples)
        self._event: TrialEvent | None = None
        self._before: TrialEvent | None = None
        self._waiting: deque[PhaseWindow] = deque()
        self._filling: deque[PartialWindow] = deque()
        self._signal = None if config.phases == PHASES_STATED else SignalPhases(config)
        self._detected: list[TrialEvent] = []

    @property
    def late_sample_count(self) -> int:
        """Samples that came again or too late."""
        return self._buffer.late_sample_count

    @property
    def restart_count(self) -> int:
        """Restarts of the stream of samples."""
        return self._buffer.restart_count

    def add_block(self, block: StrainBlock) -> list[FeatureWindow]:
        """Take in samples; return the windows that are now complete, in order of phases."""
        self.block_count += 1
        self.sample_count += len(block.tension_n)
        is_set_back = self._buffer.add(block)
        step_ns = self._buffer.new_step_ns
        windows = []
        if self._signal and (is_set_back or step_ns):
            message = describe_clock_step(step_ns, 'trial') if step_ns else _SET_BACK
            for event in self._signal.abort(message):
                self._detected.append(event)
                windows += self._take_event(event)
        if is_set_back:
            windows += self._forget_past(step_ns)
        if self._signal:
            for event in self._signal.add(self._buffer.new_samples):
                self._detected.append(event)
                windows += self._take_event(event)
        windows += self._take_partial()
        windows += self._take_complete()
        self._buffer.evict()
        return windows

    def add_event(self, event: TrialEvent, *, is_past: bool = False) -> list[FeatureWindow]:
        """Take in the start of a phase; return the windows that are now complete.

        Events are passed over where ``phases`` says that they are found in the signal.

        Parameters
        ----------
        event : TrialEvent
        is_past : bool
            It was published before anybody listened to the samples. The phase that it ends is
            not refused when they do not come.
        """
        self.event_count += 1
        return [] if self._signal else self._take_event(event, is_past=is_past)

    def take_detected_events(self) -> list[TrialEvent]:
        """Return the phases found in the signal since the last call."""
        detected, self._detected = self._detected, []
        return detected

    def _take_event(self, event: TrialEvent, *, is_past: bool = False) -> list[FeatureWindow]:
        begun, self._event = self._event, event
        before, self._before = self._before, begun
        if begun is not None and begun != event:
            same_trial = begun.trial_id == event.trial_id and not _begins_again(begun, event)
            if same_trial and begun.phase in (PHASE_GLIDE, PHASE_HOLD):
                same = before is not None and before.trial_id == begun.trial_id
                before = before if same else None
                window = PhaseWindow(begun, event, self.config, before, is_past=is_past)
                self._waiting.append(window)
        if begun != event and event.phase == PHASE_GLIDE:
            self._filling.extend(
                PartialWindow(event, count, self.config) for count in self.config.partial_samples
            )
        return self._take_partial() + self._take_complete()

    @property
    def waits_since_ns(self) -> int | None:
        """End of the oldest phase that waits for samples, on their clock [ns]; None: none."""
        return self._waiting[0].end.stamp_ns if self._waiting else None

    def time_out(self) -> list[FeatureWindow]:
        """Refuse the oldest window that waits: its samples have not come in time."""
        return self._end_oldest(self._waiting[0].time_out()) if self._waiting else []

    def pass_time(self, now_ns: int) -> list[FeatureWindow]:
        """Refuse the windows whose samples have not come in time, when the last data came.

        Parameters
        ----------
        now_ns : int
            Time of arrival of the last data of any kind (ROS time) [ns].
        """
        most_ns = (self.config.samples_timeout_s + GRACE_S) * 1e9
        windows: list[FeatureWindow] = []
        while self._waiting and now_ns - self._waiting[0].end.stamp_ns > most_ns:
            windows += self.time_out()
        return windows

    def finish(self) -> list[FeatureWindow]:
        """Return windows for the finished phases that still wait: no more samples will come."""
        return self._give_up(Outcome.GAP, 'the stream ended before all samples had come')

    def _take_partial(self) -> list[FeatureWindow]:
        windows: list[FeatureWindow] = []
        while self._filling:
            window = self._filling[0].take(self._buffer)
            if window is not None:
                windows.append(self._mark(window))
            elif not self._is_overdue(self._filling[0]):
                break
            self._filling.popleft()
        return windows

    def _take_complete(self) -> list[FeatureWindow]:
        windows: list[FeatureWindow] = []
        while self._waiting:
            # Only the oldest phase may go, so that the order does not depend on arrival.
            window = self._waiting[0].take(self._buffer)
            if window is None and self._is_overdue(self._waiting[0]):
                window = self._waiting[0].time_out()
            if window is None:
                break
            windows += self._end_oldest(window)
        return windows

    def _end_oldest(self, window: FeatureWindow) -> list[FeatureWindow]:
        is_past = self._waiting.popleft().is_past
        return [] if is_past and window.outcome != Outcome.OK else self._count(window)

    def _count(self, window: FeatureWindow) -> list[FeatureWindow]:
        self.window_counts[window.outcome] += 1
        return [self._mark(window)]

    def _mark(self, window: FeatureWindow) -> FeatureWindow:
        """Return a window without samples as simulated where the newest sample is."""
        if window.simulated or window.sample_count or not self._buffer.is_simulated:
            return window
        return dataclasses.replace(window, simulated=True)

    def _is_overdue(self, waiting: PhaseWindow) -> bool:
        event = self._event
        return event is not None and event.stamp_ns - waiting.end.stamp_ns > self._buffer_ns

    def _forget_past(self, step_ns: int) -> list[FeatureWindow]:
        """Refuse what waits when the clock is set back, and the phase that it falls into."""
        if not step_ns:
            return self._give_up(Outcome.GAP, f'{_SET_BACK} before they came')
        windows = self._give_up(Outcome.BAD_TIME, describe_clock_step(step_ns, 'trial'))
        event = self._event
        if event is not None and event.phase in (PHASE_GLIDE, PHASE_HOLD):
            self._event = None  # its end would be on another clock
            reason = describe_clock_step(step_ns, event.phase)
            window = PhaseWindow(event, event, self.config).refuse(Outcome.BAD_TIME, reason)
            windows += self._count(window)
        return windows

    def _give_up(self, outcome: Outcome, reason: str) -> list[FeatureWindow]:
        self._filling.clear()
        windows: list[FeatureWindow] = []
        while self._waiting:
            windows += self._end_oldest(self._waiting[0].refuse(outcome, reason))
        return windows


_SET_BACK = 'the clock of the samples was set back'


def _begins_again(begun: TrialEvent, event: TrialEvent) -> bool:
    """Return whether the trial is played again, and the phase did not end with this event.

    An event that is stamped earlier but ends the phase comes from a clock that was set back.
    """
    is_earlier = event.stamp_ns < begun.stamp_ns
    return is_earlier and event.phase in (PHASE_APPROACH, PHASE_CONTACT, begun.phase)


def features_from_trials(
    task: str,
    x: ArrayLike,
    rate_hz: float,
    *,
    first_samples: int | None = None,
    config: FeatureConfig | None = None,
    speeds_m_s: ArrayLike | None = None,
) -> tuple[NDArray[np.float64], FeatureSpec]:
    """Return the features of ready-cut windows, one row a trial.

    Parameters
    ----------
    task : str
        ``texture`` or ``stiffness``.
    x : array_like of shape (trials, samples)
        Tension [N]; all samples of a row are the window. A set whose window depends on the
        speed takes the middle of each row.
    rate_hz : float
        Sample rate [Hz].
    first_samples : int, optional
        Of a window, take only so many samples: the features of a partial window.
    config : FeatureConfig, optional
        Names the feature set and its options; the defaults where not given. How windows are
        cut does not count.
    speeds_m_s : array_like of shape (trials,), optional
        Sliding speed of each trial [m/s]; for sets that need it.

    Returns
    -------
    values : ndarray of shape (trials, k)
    spec : FeatureSpec
        Names and units of the columns.

    Raises
    ------
    FeatureError
        When the shape, the rate, the speeds or ``first_samples`` do not fit, a value is not
        finite or a feature is undefined; the message names the trial.
    """
    tension = np.asarray(x, dtype=np.float64)
    if tension.ndim != 2 or tension.shape[1] < 2:
        raise FeatureError(
            f'the trials have shape {tension.shape}; it must be (trials, samples), samples >= 2'
        )
    count = tension.shape[1]
    config = config or FeatureConfig()
    feature_set = set_for(task, config)
    spec = array_spec(task, count, rate_hz, config)
    bad = np.flatnonzero(~np.isfinite(tension).all(axis=1))
    if len(bad):
        raise FeatureError(f'the tension of trial {bad[0]} holds values that are not finite')
    if first_samples is not None:
        if not feature_set.has_parts:
            raise FeatureError(f'{feature_set.name} ({task}) has no partial windows')
        if not 2 <= first_samples <= count:
            raise FeatureError(
                f'first_samples is {first_samples}; the windows have {count} samples'
            )
        tension = tension[:, :first_samples]
    if feature_set.needs_speed:
        return _compute_each(feature_set, tension, rate_hz, speeds_m_s, len(spec.names)), spec
    samples = WindowSamples(_times_ns(tension.shape[1], rate_hz), tension, rate_hz)
    try:
        if first_samples is not None:
            return feature_set.compute_part(samples, count), spec
        return feature_set.compute(samples), spec
    except UndefinedFeatureError as error:
        where = f'trial {error.windows[0]}: ' if error.windows else ''
        raise UndefinedFeatureError(f'{where}{error}', error.windows) from error


def _compute_each(
    feature_set: FeatureSet,
    tension_n: NDArray[np.float64],
    rate_hz: float,
    speeds_m_s: ArrayLike | None,
    feature_count: int,
) -> NDArray[np.float64]:
    """Return the features of the middle of each trial, whose length its speed decides."""
    speeds = np.asarray([] if speeds_m_s is None else speeds_m_s, dtype=np.float64)
    if speeds.shape != tension_n.shape[:1]:
        raise FeatureError(
            f'{feature_set.name} needs the sliding speed of each of {len(tension_n)} trials; '
            f'the speeds have shape {speeds.shape}'
        )
    rows = np.empty((len(tension_n), feature_count))
    done = 0
    try:
        for row, speed_m_s in zip(tension_n, speeds.tolist(), strict=True):
            count = feature_set.window(rate_hz, speed_m_s).sample_count or len(row)
            if count > len(row):
                raise UndefinedFeatureError(f'it has {len(row)} samples, and its window {count}')
            first = (len(row) - count) // 2
            middle = row[first : first + count]
            samples = WindowSamples(_times_ns(count, rate_hz), middle, rate_hz, speed_m_s)
            rows[done] = feature_set.compute(samples)
            done += 1
    except UndefinedFeatureError as error:
        raise UndefinedFeatureError(f'trial {done}: {error}', (done,)) from error
    except FeatureError as error:
        raise FeatureError(f'trial {done}: {error}') from error
    return rows


def _times_ns(count: int, rate_hz: float) -> NDArray[np.int64]:
    times_ns: NDArray[np.int64] = np.rint(np.arange(count) * (1e9 / rate_hz)).astype(np.int64)
    return times_ns
