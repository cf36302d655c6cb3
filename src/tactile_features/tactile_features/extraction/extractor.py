# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Extraction of feature windows from samples and trial events.

The live node, the replay of bags and training all use this implementation.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import dataclasses
import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError, UndefinedFeatureError
from tactile_features.extraction.phase_window import EarlyWindow, format_clock_step, PhaseWindow
from tactile_features.feature_sets.feature_set import FeatureSet, WindowSamples
from tactile_features.feature_sets.registry import find_feature_set
from tactile_features.phases import SignalPhases
from tactile_features.spec import (
    array_spec,
    FeatureSpec,
    set_for,
    shared_rate_hz,
    spec_of,
)
from tactile_features.types import (
    FeatureWindow,
    PHASE_ABORTED,
    PHASE_APPROACH,
    PHASE_DONE,
    PHASE_GLIDE,
    PHASE_HOLD,
    PHASE_TOUCH,
    PHASES_STATED,
    TrialEvent,
    WindowOutcome,
)
from tactile_features.windows import SampleBuffer
from tactile_ros.strain import StrainBlock

GRACE_S = 0.5
"""Longest time that a sample may need to arrive [s]; after that, it counts as missing."""

_SET_BACK = 'the clock of the samples was set back'
LONGEST_STEP_S = 0.5


class _Lane:
    """The buffer and the incomplete early windows of one specification."""

    def __init__(self, config: FeatureConfig, phase: str, buffer: SampleBuffer) -> None:
        self.config = config
        self.phase = phase
        self.spec = spec_of(config.feature_set(phase))
        self.buffer = buffer
        self.early: deque[EarlyWindow] = deque()

    def begin(self, event: TrialEvent, *, is_past: bool) -> None:
        """Process the start of a phase."""
        if event.phase == self.phase and self.spec.is_early:
            self.early.append(EarlyWindow(event, self.config, self.buffer, is_past=is_past))

    def end(self, begun: TrialEvent, end: TrialEvent | None) -> None:
        """Process the end of a phase; ``end`` is None if another trial began instead."""
        if self.early and self.early[-1].start == begun:
            self.early[-1].end_phase(end)

    def take_early(self) -> list[FeatureWindow]:
        """Return new early windows, and refusals if a phase ended inside its returned window."""
        windows: list[FeatureWindow] = []
        while self.early:
            windows += self.early[0].take_new()
            if not self.early[0].is_over:
                break
            self.early.popleft()
        return windows

    def give_up_early(self, outcome: WindowOutcome, reason: str) -> list[FeatureWindow]:
        """Refuse incomplete early windows; drop those whose phase has not ended yet."""
        windows: list[FeatureWindow] = []
        for window in self.early:
            if not window.is_given and (window.is_ended or outcome == WindowOutcome.BAD_TIME):
                windows += window.give(window.refuse(outcome, reason))
        self.early.clear()
        return windows


class _FinishedPhase:
    """The windows of one finished phase, one for each specification.

    Each window is computed as soon as its samples have arrived, independently of the others. The
    windows are returned in the order of the specifications. If ``is_past`` is True, the phase
    ended before this process subscribed to the samples, and refused windows are not returned.
    """

    def __init__(
        self,
        begun: TrialEvent,
        end: TrialEvent,
        lanes: Sequence[_Lane],
        *,
        is_past: bool,
    ) -> None:
        self.end = end
        self._is_past = is_past
        self._waiting = deque(
            PhaseWindow(begun, end, lane.config, lane.buffer)
            for lane in lanes
            if lane.phase == begun.phase and not lane.spec.is_early
        )
        self._taken: dict[PhaseWindow, FeatureWindow] = {}

    @property
    def is_over(self) -> bool:
        """True when all windows of the phase have been returned."""
        return not self._waiting

    def take(self) -> list[FeatureWindow]:
        """Return the next complete windows, except refused ones if ``is_past``."""
        for window in self._waiting:
            if window not in self._taken and (found := window.take()) is not None:
                self._taken[window] = found
        given = []
        while self._waiting and self._waiting[0] in self._taken:
            given.append(self._taken.pop(self._waiting.popleft()))
        return self._select(given)

    def end_with(self, refuse: Callable[[PhaseWindow], FeatureWindow]) -> list[FeatureWindow]:
        """Return the remaining windows like `take`; incomplete ones are refused by ``refuse``."""
        given = [self._taken.get(window) or refuse(window) for window in self._waiting]
        self._waiting.clear()
        return self._select(given)

    def _select(self, windows: list[FeatureWindow]) -> list[FeatureWindow]:
        return [w for w in windows if w.outcome == WindowOutcome.OK or not self._is_past]


class TrialFeatureExtractor:
    """Cut windows out of every finished glide and hold phase, and compute their features.

    If ``wanted`` contains specifications for a phase, the phase has one window for each of them.
    Otherwise it has one window, computed with the parameters in ``config``. The windows of one
    specification do not depend on the other specifications. The windows of one phase are returned
    in the order of the specifications.

    An early window is returned as soon as its samples have arrived. If the phase then ends inside
    the window, a refusal with the same specification follows.

    If the parameter ``phases`` is not ``stated``, events are detected in the tension, and added
    events are ignored.

    The windows depend only on the samples and events with their stamps and sequence numbers. It
    does not matter in which order events and blocks are added, nor how samples are grouped into
    blocks: the same windows are returned in the same order, with the same bits. This requires that
    neither topic is ahead of the other by more than ``buffer_s``, and that the clock of the
    samples is not set back by 1 s or more.

    If the samples of a window are still missing ``samples_timeout_s`` plus `GRACE_S` after the end
    of its phase, the window is refused. A node measures this time with a monotonic clock and calls
    `time_out`. A replay calls `pass_time` at the end of its data. If later samples arrive before
    that, the window is refused because of the stamps of these samples, with the same result. The
    windows of a replay therefore equal the live windows. The only exception is a sample that is
    stamped within ``samples_timeout_s``, but took longer than `GRACE_S` to arrive.

    Parameters
    ----------
    config : FeatureConfig
        Parameters that do not depend on the specification, and the parameters of phases for which
        ``wanted`` has no specification.
    wanted : sequence of FeatureSpec
        The specifications to compute; if empty, ``config`` chooses them.

    Attributes
    ----------
    config : FeatureConfig
        If all wanted specifications have the same rate, ``rate_hz`` is this rate.
    specifications : tuple of FeatureSpec
        All specifications that are computed, distinct and complete.
    block_count, event_count : int
        Numbers of blocks and events that were added.
    window_counts : dict of WindowOutcome to int
        Number of windows returned, by outcome.

    Raises
    ------
    FeatureError
        When a wanted specification cannot be computed.
    """

    def __init__(self, config: FeatureConfig, wanted: Sequence[FeatureSpec] = ()) -> None:
        if rate_hz := shared_rate_hz(wanted):
            config = dataclasses.replace(config, rate_hz=rate_hz)
        self.config = config
        self.block_count = 0
        self.event_count = 0
        self.window_counts = dict.fromkeys(WindowOutcome, 0)
        self._buffer_ns = round(config.buffer_s * 1e9)
        self._buffers: dict[tuple[int, int], SampleBuffer] = {}
        self._lanes = self._make_lanes(wanted)
        # The detection of phases does not depend on the wanted specifications.
        is_stated = config.phases == PHASES_STATED
        self._buffer = self._lanes[0].buffer if is_stated else self._buffer_for(config)
        self._event: TrialEvent | None = None
        self._waiting: deque[_FinishedPhase] = deque()
        self._signal = None if is_stated else SignalPhases(config)
        self._detected: list[TrialEvent] = []

    def _make_lanes(self, wanted: Sequence[FeatureSpec]) -> tuple[_Lane, ...]:
        """Return a `_Lane` for each distinct specification, and for each phase without one."""
        bound: dict[str, tuple[str, FeatureConfig]] = {}

        def add(phase: str, config: FeatureConfig) -> None:
            bound.setdefault(spec_of(config.feature_set(phase)).digest, (phase, config))

        for spec in wanted:
            found = find_feature_set(spec.feature_set)
            if found is not None:
                add(found.phase, spec.bind(self.config))
        for phase in (PHASE_GLIDE, PHASE_HOLD):
            if phase not in {of_phase for of_phase, _ in bound.values()}:
                add(phase, self.config)
        return tuple(
            _Lane(config, phase, self._buffer_for(config)) for phase, config in bound.values()
        )

    def _buffer_for(self, config: FeatureConfig) -> SampleBuffer:
        """Return the buffer shared by all specifications with the same gap policy."""
        # The buffer has room for twice the nominal rate. If a stream is too fast, its windows are
        # therefore complete, and the rate is the reason to refuse them.
        capacity = round(2 * config.buffer_s * config.rate_hz)
        key = capacity, config.max_gap_samples
        if key not in self._buffers:
            self._buffers[key] = SampleBuffer(self._buffer_ns, *key)
        return self._buffers[key]

    @property
    def specifications(self) -> tuple[FeatureSpec, ...]:
        """Specifications that are computed."""
        return tuple(lane.spec for lane in self._lanes)

    @property
    def late_sample_count(self) -> int:
        """Number of samples that were duplicates or arrived too late."""
        return self._buffer.late_sample_count

    @property
    def restart_count(self) -> int:
        """Number of restarts of the sample stream."""
        return self._buffer.restart_count

    def add_block(self, block: StrainBlock) -> list[FeatureWindow]:
        """Add samples; return the windows that are complete now, in the order of their phases."""
        self.block_count += 1
        for buffer in self._buffers.values():
            is_set_back = buffer.add(block)  # the same for all buffers
        windows = self._find_phases(is_set_back) if self._signal or is_set_back else []
        windows += self._take_early()
        if self._waiting:
            windows += self._take_complete()
        for buffer in self._buffers.values():
            buffer.evict()
        return windows

    def _find_phases(self, is_set_back: bool) -> list[FeatureWindow]:
        step_ns = self._buffer.new_step_ns
        windows = []
        if self._signal and (is_set_back or step_ns):
            message = format_clock_step(step_ns, 'trial') if step_ns else _SET_BACK
            for event in self._signal.abort(message):
                self._detected.append(event)
                windows += self._take_event(event)
        if is_set_back:
            windows += self._forget_past(step_ns)
        if self._signal:
            for event in self._signal.add(self._buffer.new_samples):
                self._detected.append(event)
                windows += self._take_event(event)
        return windows

    def add_event(self, event: TrialEvent, *, is_past: bool = False) -> list[FeatureWindow]:
        """Add the event that starts a phase; return the windows that are complete now.

        If the parameter ``phases`` is not ``stated``, the event is only counted.

        Parameters
        ----------
        event : TrialEvent
        is_past : bool
            True for an event that was published before this process subscribed to the samples. If
            samples of the phase that this event ends are missing, no refusal is returned.
        """
        self.event_count += 1
        return [] if self._signal else self._take_event(event, is_past=is_past)

    def take_detected_events(self) -> list[TrialEvent]:
        """Return the phases detected in the tension since the last call."""
        detected, self._detected = self._detected, []
        return detected

    def _take_event(self, event: TrialEvent, *, is_past: bool = False) -> list[FeatureWindow]:
        begun, self._event = self._event, event
        if begun is not None and begun != event:
            same_trial = begun.trial_id == event.trial_id and not _begins_again(begun, event)
            if same_trial and begun.phase in (PHASE_GLIDE, PHASE_HOLD):
                self._waiting.append(_FinishedPhase(begun, event, self._lanes, is_past=is_past))
            for lane in self._lanes:
                lane.end(begun, event if same_trial else None)
        if begun != event:
            for lane in self._lanes:
                lane.begin(event, is_past=is_past)
        return self._take_early() + self._take_complete()

    @property
    def is_idle(self) -> bool:
        """True between trials, while no window waits for samples.

        If phases are detected in the tension, always False, because a trial may begin at any
        sample.
        """
        event = self._event
        is_between = event is None or event.phase in (PHASE_DONE, PHASE_ABORTED)
        return is_between and self._signal is None and self._find_oldest() is None

    @property
    def waits_since_ns(self) -> int | None:
        """Nominal time of the last sample of the oldest waiting window [ns], or None.

        This is the end of the phase or of the early window, on the clock of the samples. The end
        of an early window may lie in the future.
        """
        oldest = self._find_oldest()
        return oldest[0] if oldest else None

    @property
    def remaining_s(self) -> float:
        """Time from the last sample until the oldest waiting window is complete [s]."""
        oldest, last_ns = self._find_oldest(), self._buffer.watermark_ns
        if oldest is None:
            return 0.0
        due_ns, begun_ns = oldest
        return max(0, due_ns - max(begun_ns, last_ns or begun_ns)) / 1e9

    def _find_oldest(self) -> tuple[int, int] | None:
        """Return the due time and the start of the oldest waiting window [ns], or None."""
        waiting = [(w.due_ns, w.start.stamp_ns) for w in self._filling_windows()]
        if self._waiting:
            waiting.append((self._waiting[0].end.stamp_ns,) * 2)
        return min(waiting, default=None)

    def _filling_windows(self) -> list[EarlyWindow]:
        """Return the oldest incomplete early window of each specification."""
        return [lane.early[0] for lane in self._lanes if lane.early and not lane.early[0].is_given]

    def time_out(self) -> list[FeatureWindow]:
        """Refuse the oldest waiting window, because its samples have not arrived in time."""
        due_ns = self.waits_since_ns
        for window in self._filling_windows():
            if window.due_ns == due_ns:
                return self._count(window.give(window.time_out())) + self._take_early()
        if not self._waiting:
            return []
        return self._end_oldest(lambda window: window.refuse_by_events() or window.time_out())

    def pass_time(self, now_ns: int) -> list[FeatureWindow]:
        """Refuse the windows whose samples have not arrived in time.

        Parameters
        ----------
        now_ns : int
            Arrival time of the latest data of any kind, ROS time [ns].
        """
        most_ns = (self.config.samples_timeout_s + GRACE_S) * 1e9
        windows: list[FeatureWindow] = []
        while (due_ns := self.waits_since_ns) is not None and now_ns - due_ns > most_ns:
            windows += self.time_out()
        return windows

    def finish(self) -> list[FeatureWindow]:
        """Return windows for the finished phases that still wait, because the stream has ended."""
        return self._give_up(WindowOutcome.GAP, 'the stream ended before all samples had arrived')

    def _take_early(self) -> list[FeatureWindow]:
        windows: list[FeatureWindow] = []
        for lane in self._lanes:
            windows += lane.take_early()
            while lane.early and self._is_overdue(lane.early[0].due_ns):
                window = lane.early[0]
                windows += [*window.give(window.time_out()), *lane.take_early()]
        # Sorted by the time of their last sample, so that the order does not depend on how samples
        # are grouped into blocks.
        windows.sort(key=lambda window: window.window_end_ns)
        return self._count(windows)

    def _take_complete(self) -> list[FeatureWindow]:
        windows: list[FeatureWindow] = []
        while self._waiting:
            # Only windows of the oldest phase are returned, so that the order of windows does not
            # depend on the order in which samples and events arrive.
            phase = self._waiting[0]
            windows += self._count(phase.take())
            if phase.is_over:
                self._waiting.popleft()
            elif self._is_overdue(phase.end.stamp_ns):
                windows += self.time_out()
            else:
                break
        return windows

    def _end_oldest(self, refuse: Callable[[PhaseWindow], FeatureWindow]) -> list[FeatureWindow]:
        return self._count(self._waiting.popleft().end_with(refuse))

    def _count(self, windows: list[FeatureWindow]) -> list[FeatureWindow]:
        for window in windows:
            self.window_counts[window.outcome] += 1
        return windows

    def _is_overdue(self, due_ns: int) -> bool:
        event = self._event
        return event is not None and event.stamp_ns - due_ns > self._buffer_ns

    def _forget_past(self, step_ns: int) -> list[FeatureWindow]:
        """Refuse the waiting windows and those of the current phase when the clock is set back."""
        if not step_ns:
            return self._give_up(WindowOutcome.GAP, f'{_SET_BACK} before its samples arrived')
        windows = self._give_up(WindowOutcome.BAD_TIME, format_clock_step(step_ns, 'trial'))
        event = self._event
        if event is not None and event.phase in (PHASE_GLIDE, PHASE_HOLD):
            self._event = None  # the end of this phase will be stamped after the clock step
            reason = format_clock_step(step_ns, event.phase)
            phase = _FinishedPhase(event, event, self._lanes, is_past=False)
            self._waiting.append(phase)
            windows += self._end_oldest(
                lambda window: window.refuse(WindowOutcome.BAD_TIME, reason)
            )
        return windows

    def _give_up(self, outcome: WindowOutcome, reason: str) -> list[FeatureWindow]:
        windows: list[FeatureWindow] = []
        for lane in self._lanes:
            windows += self._count(lane.give_up_early(outcome, reason))
        while self._waiting:
            windows += self._end_oldest(
                lambda window: window.refuse_by_events() or window.refuse(outcome, reason)
            )
        return windows


def _begins_again(begun: TrialEvent, event: TrialEvent) -> bool:
    """Return True if the event starts a repetition of the trial instead of ending the phase.

    If an event that ends the phase has an earlier stamp than its start, the clock was set back.
    """
    is_earlier = event.stamp_ns < begun.stamp_ns
    return is_earlier and event.phase in (PHASE_APPROACH, PHASE_TOUCH, begun.phase)


def features_from_trials(
    task: str,
    x: ArrayLike,
    rate_hz: float,
    *,
    config: FeatureConfig | None = None,
    speeds_m_s: ArrayLike | None = None,
) -> tuple[NDArray[np.float64], FeatureSpec]:
    """Return the features of windows that are already cut, one row per trial.

    Parameters
    ----------
    task : str
        ``texture`` or ``stiffness``.
    x : array_like of shape (trials, samples)
        Tension [N]; each row is one window. If the window length of the feature set depends on
        the speed, the middle of each row is used.
    rate_hz : float
        Sample rate [Hz].
    config : FeatureConfig, optional
        Selects the feature set and its options; defaults if omitted. Parameters of the position
        of windows have no effect, because the windows are already cut.
    speeds_m_s : array_like of shape (trials,), optional
        Sliding speed of each trial [m/s]; required if the feature set needs the speed.

    Returns
    -------
    values : ndarray of shape (trials, k)
    spec : FeatureSpec
        Names and units of the columns.

    Raises
    ------
    FeatureError
        When the shape, the rate or the speeds are invalid, a value is not finite or a feature
        is undefined; the message names the trial.
    """
    # C order, as in the live stream: another memory layout can change the last bits of features.
    tension = np.asarray(x, dtype=np.float64, order='C')
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
        raise FeatureError(f'the tension of trial {bad[0]} has values that are not finite')
    if feature_set.needs_speed:
        return _compute_each(feature_set, tension, rate_hz, speeds_m_s, len(spec.names)), spec
    samples = WindowSamples(_times_ns(tension.shape[1], rate_hz), tension, rate_hz)
    try:
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
    """Return the features of each trial one by one, if the window length depends on the speed.

    The window is in the middle of the trial.
    """
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
                raise UndefinedFeatureError(f'it has {len(row)} samples; its window needs {count}')
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


class SampleTimeout:
    """Decide when to refuse a window whose samples do not arrive while no other data arrive.

    If a window has waited longer than ``samples_timeout_s`` plus `GRACE_S`, and no block has
    arrived during that time, the window is refused. While blocks arrive, the extractor decides by
    their stamps. The time between two calls of `is_over` counts as `LONGEST_STEP_S` at most: a
    process that was suspended may have samples in its queues that it has not read yet.
    """

    def __init__(
        self, extractor: TrialFeatureExtractor, monotonic_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._extractor = extractor
        self._monotonic_s = monotonic_s
        self._most_s = extractor.config.samples_timeout_s + GRACE_S
        self._seen: tuple[int | None, int] = (None, 0)
        self._asked_s = monotonic_s()
        self._waited_s = 0.0

    def is_over(self) -> bool:
        """Return True if the oldest waiting window must be refused.

        The caller must call this several times per second.
        """
        now_s = self._monotonic_s()
        self._waited_s += min(now_s - self._asked_s, LONGEST_STEP_S)
        self._asked_s = now_s
        seen = (self._extractor.waits_since_ns, self._extractor.block_count)
        if seen != self._seen:
            self._seen = seen
            self._waited_s = 0.0
        longest_s = self._most_s + self._extractor.remaining_s
        return seen[0] is not None and self._waited_s > longest_s
