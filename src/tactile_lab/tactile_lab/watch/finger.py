# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""State of one finger on the live page: points of the plot, phases, predictions. Without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import islice
import math
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.types import ModelInfo, PredictionOutcome, WindowPrediction
from tactile_features.feature_sets.texture_spectrum import compute_spectrum
from tactile_features.types import (
    FeatureWindow,
    PHASE_ABORTED,
    PHASE_DONE,
    PHASE_GLIDE,
    PHASE_HOLD,
    PROTOCOL_STIFFNESS,
    SET_TEXTURE_SPECTRUM,
    TrialEvent,
    WindowOutcome,
)
from tactile_ros.strain import StrainBlock, StrainStatus

BUCKET_NS = 10_000_000
"""Width of a time bucket of the plot [ns], which is one pixel. The samples of a bucket are drawn
with at most two points."""


class Point(NamedTuple):
    """One point of the plot.

    If the tension is None, the line has a gap here, because samples are missing or NaN.
    """

    stamp_ns: int
    tension_n: float | None


class Decimator:
    """Reduces the samples of strain blocks to the points of a plot.

    Samples are grouped in time buckets. If a bucket has more than two samples, only the smallest
    and the largest one become points. The result does not depend on how samples are divided into
    blocks.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Discard the samples of the incomplete bucket."""
        self._open: list[tuple[int, float]] = []
        self._next_sequence: int | None = None
        self.last_ns: int | None = None

    def add(self, block: StrainBlock) -> list[Point]:
        """Add the samples of a block; return the points that are now complete, in order of time.

        A block that is older than the previous samples is ignored.
        """
        count = len(block.tension_n)
        if not count or (self.last_ns is not None and block.stamp_ns <= self.last_ns):
            return []
        points: list[Point] = []
        if self._next_sequence is not None and block.sequence != self._next_sequence:
            points += self._close()
            points.append(Point(block.stamp_ns - 1, None))
        stamps_ns = block.stamp_ns + np.arange(count, dtype=np.int64) * block.period_ns
        buckets = stamps_ns // BUCKET_NS
        starts = np.flatnonzero(np.diff(buckets, prepend=buckets[0] - 1))
        for start, end in zip(starts, [*starts[1:], count], strict=True):
            if self._open and self._open[0][0] // BUCKET_NS != buckets[start]:
                points += self._close()
            self._take(stamps_ns[start:end], block.tension_n[start:end])
        if block.period_ns * 2 > BUCKET_NS:  # slow sensor: each sample is a point
            points += self._close()
        self._next_sequence = block.sequence + count
        self.last_ns = int(stamps_ns[-1])
        return points

    def _take(self, stamps_ns: NDArray[np.int64], tension_n: NDArray[np.float64]) -> None:
        """Add samples of one bucket; keep the smallest, the largest, and one NaN if any."""
        known = [*self._open, *zip(stamps_ns.tolist(), tension_n.tolist(), strict=True)]
        numbers = [sample for sample in known if math.isfinite(sample[1])]
        breaks = [sample for sample in known if not math.isfinite(sample[1])][:1]
        if len(numbers) > 2:
            smallest = min(numbers, key=lambda sample: sample[1])
            largest = max(numbers, key=lambda sample: sample[1])
            numbers = [*{smallest, largest}]
        self._open = sorted(numbers + breaks)

    def _close(self) -> list[Point]:
        points = [
            Point(stamp_ns, tension_n if math.isfinite(tension_n) else None)
            for stamp_ns, tension_n in self._open
        ]
        self._open = []
        return points


SHOWN_S = 12.0
"""Time for which points are kept [s]. A page shows a slightly shorter time."""

SPECTRUM_S = 3.0
"""Longest window of the displayed spectrum [s]; in the paper, all windows have this length."""

FEWEST_SAMPLES = 16
"""Smallest number of samples for a spectrum or a fitted line."""

HIGHEST_HZ = 60.0
"""Highest displayed frequency of the spectrum [Hz], or half the sample rate if this is lower."""

MOST_POINTS = round(SHOWN_S * 1e9 / BUCKET_NS) * 3
MOST_SAMPLES = 32_768
MOST_ANSWERS = 12

SIGNAL_FAULTS = (
    (StrainStatus.SATURATED, 'The sensor is saturated: the tension is beyond its range.'),
    (
        StrainStatus.STUCK,
        'The tension has not changed for too long: check the sensor.',
    ),
    (StrainStatus.DEVICE_ERROR, 'The sensor reports an internal error.'),
    (
        StrainStatus.CLOCK_STEP,
        'The clock of the computer was set: times before and after this cannot be compared.',
    ),
)

_Kept = TypeVar('_Kept')

MEASURED = (PHASE_GLIDE, PHASE_HOLD)
"""Phases in which the feature windows lie."""


class Finger:
    """The latest samples, phases and predictions of one finger.

    Attributes
    ----------
    name : str
        Namespace of the finger; empty for the root namespace.
    version : int
        Number that increases with every change, except when samples are added.
    epoch : int
        Number that increases when the time jumps back; pages then discard their plots.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.version = 0
        self.epoch = 0
        self.rate_hz = 0.0
        self.status = 0
        self.simulated = False
        self._points: deque[Point] = deque(maxlen=MOST_POINTS)
        self.point_count = 0  # number of points since the start of the epoch
        self._base_ns = 0
        self._decimator = Decimator()
        self._samples: NDArray[np.float64] = np.empty(0)  # samples for the spectrum
        self._sample_ns = 0  # time of the last sample
        self._spans: deque[TrialEvent] = deque(maxlen=64)
        self._answers: dict[str, tuple[WindowPrediction, str]] = {}  # the keys are model ids
        self._models: tuple[ModelInfo, ...] = ()
        # Windows of the current trial; the keys are digests of specifications.
        self._windows: dict[str, FeatureWindow] = {}
        # The last hold that has ended: start, end and window, and the result of `hold`.
        self._held: tuple[tuple[Any, ...], dict[str, Any]] | None = None

    # -- input ---------------------------------------------------------------------

    def take_block(self, block: StrainBlock) -> None:
        """Add samples."""
        count = len(block.tension_n)
        if not count:
            return
        last_ns = self._decimator.last_ns
        if last_ns is None or block.stamp_ns <= last_ns:
            is_step = block.status & StrainStatus.CLOCK_STEP
            if last_ns is not None and not is_step and last_ns - block.stamp_ns < 1_000_000_000:
                return  # a late message with samples that are already known
            self._begin_anew(block.stamp_ns)
        points = self._decimator.add(block)
        self._points.extend(points)
        self.point_count += len(points)
        rate_hz = 1e9 / block.period_ns if block.period_ns > 0 else self.rate_hz
        if (rate_hz, block.status) != (self.rate_hz, self.status):
            self.rate_hz, self.status = rate_hz, block.status
            self.version += 1
        self._keep(block)
        self.simulated = self.simulated or bool(block.status & StrainStatus.SIMULATED)

    def _begin_anew(self, stamp_ns: int) -> None:
        self.epoch += 1
        self.version += 1
        self._points.clear()
        self.point_count = 0
        self._decimator.clear()
        self._base_ns = stamp_ns
        self._samples = np.empty(0)
        self._spans = deque(
            (e for e in self._spans if abs(e.stamp_ns - stamp_ns) < SHOWN_S * 1e9), maxlen=64
        )

    def _keep(self, block: StrainBlock) -> None:
        known, new = self._samples, block.tension_n
        if block.lost_before:
            known = np.empty(0)  # a spectrum must not contain a gap
        if len(breaks := np.flatnonzero(~np.isfinite(new))):
            known, new = np.empty(0), new[breaks[-1] + 1 :]
        count = min(MOST_SAMPLES, max(1, round(SPECTRUM_S * self.rate_hz)))
        self._samples = np.concatenate([known, new])[-count:]
        self._sample_ns = block.stamp_ns + (len(block.tension_n) - 1) * block.period_ns

    def take_event(self, event: TrialEvent) -> None:
        """Add the start of a phase."""
        if self._spans and self._spans[-1].trial_id != event.trial_id:
            self._windows = {}
        self._spans.append(event)
        self.simulated = self.simulated or event.simulated
        self.version += 1

    def take_models(self, models: Sequence[ModelInfo]) -> None:
        """Set the models that the classifier has loaded."""
        self._models = tuple(models)
        self.version += 1

    def names_model(self, answer: WindowPrediction) -> bool:
        """Return True if several models have the task and contact of a prediction.

        The name of the model is then printed with the prediction.
        """
        same = (
            model.task == answer.task and len({model.contact, answer.contact} - {''}) < 2
            for model in self._models
        )
        return sum(same) > 1

    def take_answer(self, answer: WindowPrediction) -> str:
        """Add the prediction of a model; return the label of the object in the trial, or ''."""
        stated = (e.object_label for e in reversed(self._spans) if e.trial_id == answer.trial_id)
        true_label = next(stated, '')
        _keep_newest(self._answers, answer.model_id, (answer, true_label))
        self.simulated = self.simulated or answer.simulated
        self.version += 1
        return true_label

    def take_window(self, window: FeatureWindow) -> None:
        """Add the features of a window."""
        _keep_newest(self._windows, window.specification_digest, window)
        self.simulated = self.simulated or window.simulated
        self.version += 1

    # -- output ----------------------------------------------------------------------

    def points_since(self, count: int) -> tuple[list[float], list[float | None]]:
        """Return times [s] and tensions [N] of all points after the first ``count`` ones.

        Times and number of points count from the start of the epoch.
        """
        known = max(0, min(len(self._points), len(self._points) - (self.point_count - count)))
        new = list(islice(self._points, known, None))
        return (
            [round((p.stamp_ns - self._base_ns) * 1e-9, 4) for p in new],
            [p.tension_n if p.tension_n is None else rounded(p.tension_n) for p in new],
        )

    @property
    def event(self) -> TrialEvent | None:
        """The latest trial event; None if there is none."""
        return self._spans[-1] if self._spans else None

    def describe(self) -> dict[str, Any]:
        """Return the state, except samples and spectrum, as a dictionary for JSON."""
        event = self.event
        return {
            'name': self.name,
            'rate_hz': rounded(self.rate_hz),
            'faults': [sentence for bit, sentence in SIGNAL_FAULTS if self.status & bit],
            'trial': event
            and {
                'id': event.trial_id,
                'protocol': event.protocol,
                'contact': event.contact,
                'object': event.object_label,
                'session': event.session_id,
                'phase': event.phase,
                'message': event.message,
                'detected': event.detected,
                'runs': event.phase not in (PHASE_DONE, PHASE_ABORTED),
            },
            'spans': self._describe_spans(),
            'answers': [describe_answer(*answer) for answer in self._answers.values()],
            'window': self._describe_window(),
            'has_models': bool(self._models or self._answers),
        }

    def _seconds(self, stamp_ns: int) -> float:
        return round((stamp_ns - self._base_ns) * 1e-9, 3)

    def _describe_spans(self) -> list[dict[str, Any]]:
        """Return the latest phases in order of time. The last one may not have ended."""
        events = list(self._spans)
        ends: list[int | None] = [*(event.stamp_ns for event in events[1:]), None]
        oldest_ns = self._sample_ns - round(2 * SHOWN_S * 1e9)
        return [
            {
                'phase': event.phase,
                'from': self._seconds(event.stamp_ns),
                'to': None if end_ns is None else self._seconds(end_ns),
            }
            for event, end_ns in zip(events, ends, strict=False)
            if event.phase not in (PHASE_DONE, PHASE_ABORTED)
            and (end_ns is None or end_ns > oldest_ns)
        ]

    def _describe_window(self) -> dict[str, Any] | None:
        if not self._windows:
            return None
        window = next(reversed(self._windows.values()))
        return {
            'from': self._seconds(window.window_start_ns),
            'to': self._seconds(window.window_end_ns),
        }

    def detail(self) -> dict[str, Any]:
        """Return the data of the second plot: `hold` for stiffness trials, else `spectrum`."""
        measured = [event for event in self._spans if event.phase in MEASURED]
        if measured:
            is_hold = measured[-1].phase == PHASE_HOLD
        elif self._spans:
            is_hold = self._spans[-1].protocol == PROTOCOL_STIFFNESS
        else:
            is_hold = {model.task for model in self._models} == {PROTOCOL_STIFFNESS}
        return {'hold': self.hold()} if is_hold else {'spectrum': self.spectrum()}

    def hold(self) -> dict[str, Any] | None:
        """Return the tension of the last hold with a least-squares line; None without a hold.

        If the trial has a feature window, the line is fitted to the window, otherwise to the whole
        hold so far. Times count from the start of the hold [s]. The result of a hold that has
        ended is stored, because its points are discarded after a while.
        """
        spans = list(self._spans)
        holds = [i for i, event in enumerate(spans) if event.phase == PHASE_HOLD]
        if not holds:
            return None
        begin = spans[holds[-1]]
        end_ns = spans[holds[-1] + 1].stamp_ns if holds[-1] + 1 < len(spans) else None
        ours = [w for w in self._windows.values() if w.trial_id == begin.trial_id]
        window = ours[-1] if ours and ours[-1].sample_count else None
        key = (begin.stamp_ns, end_ns, window and window.window_end_ns)
        known, found = self._held or ((), {})
        # Windows are discarded when the next trial begins.
        if known == key or (window is None and known[:2] == key[:2]):
            return found
        points = [
            ((p.stamp_ns - begin.stamp_ns) * 1e-9, p.tension_n)
            for p in self._points
            if p.stamp_ns >= begin.stamp_ns
            and (end_ns is None or p.stamp_ns <= end_ns)
            and p.tension_n is not None
        ]
        if len(points) < FEWEST_SAMPLES:
            return None
        time_s, tension_n = np.array(points).T
        part = 'hold so far' if end_ns is None else f'hold of {time_s[-1]:.1f} s'
        is_fitted = np.ones(len(points), dtype=np.bool_)
        if window is not None:
            part = f'window of {window.window_s:.1f} s'
            from_s = (window.window_start_ns - begin.stamp_ns) * 1e-9
            inside = (time_s >= from_s) & (time_s <= from_s + window.window_s)
            is_fitted = inside if inside.sum() >= FEWEST_SAMPLES else is_fitted
        slope, intercept = np.polyfit(time_s[is_fitted], tension_n[is_fitted], 1).tolist()
        ends_s = time_s[is_fitted][[0, -1]].tolist()
        found = {
            'x': [round(t, 3) for t in time_s.tolist()],
            'y': [rounded(value) for value in tension_n.tolist()],
            'line': [[round(t, 3), rounded(intercept + slope * t)] for t in ends_s],
            'slope_n_s': float(f'{slope:.3g}'),
            'part': part,
        }
        if end_ns is not None:
            self._held = key, found
        return found

    def spectrum(self) -> dict[str, Any] | None:
        """Return the amplitudes of a spectrum [N]; None if there are too few samples.

        If the current or the last trial has a feature window, it is the spectrum of the window, as
        used by the classifier. Otherwise, it is computed from the last seconds of the current
        phase. The entry ``part`` describes which samples were used.
        """
        spectra = (
            window
            for window in reversed(self._windows.values())
            if window.feature_set == SET_TEXTURE_SPECTRUM and window.outcome == WindowOutcome.OK
        )
        if window := next(spectra, None):
            part = f'window of {window.window_s:.1f} s'
            step_hz = window.rate_hz / (2 * (len(window.values) - 1))
            return _describe_spectrum(window.values, step_hz, part)
        if not self.rate_hz:
            return None
        count = min(round(SPECTRUM_S * self.rate_hz), len(self._samples))
        part = f'last {SPECTRUM_S:g} s'
        event = self.event
        if event is not None and event.phase in MEASURED:
            since_s = (self._sample_ns - event.stamp_ns) * 1e-9
            if 0 <= since_s < SPECTRUM_S:
                count = min(count, round(since_s * self.rate_hz))
                part = f'{event.phase} so far'
        if count < FEWEST_SAMPLES:
            return None
        values = compute_spectrum(self._samples[-count:], 'linear', 'none')
        return _describe_spectrum(values, self.rate_hz / count, part)


def _keep_newest(kept: dict[str, _Kept], key: str, value: _Kept) -> None:
    """Add a value to a dictionary; if it has more than `MOST_ANSWERS`, remove the oldest one."""
    kept.pop(key, None)
    kept[key] = value
    while len(kept) > MOST_ANSWERS:
        del kept[next(iter(kept))]


def _describe_spectrum(values: NDArray[np.float64], step_hz: float, part: str) -> dict[str, Any]:
    shown = values[: int(HIGHEST_HZ / step_hz) + 1]
    return {
        'step_hz': step_hz,
        'values': [rounded(v) for v in shown.tolist()],
        'part': part,
    }


def rounded(value: float) -> float:
    """Round to four significant digits, to keep the messages to pages small."""
    return float(f'{value:.4g}')


def describe_answer(answer: WindowPrediction, true_label: str) -> dict[str, Any]:
    """Return a prediction as a dictionary for JSON, with the most probable labels first."""
    scores = sorted(zip(answer.labels, answer.scores, strict=False), key=lambda x: -x[1])
    is_right = None
    if true_label and answer.outcome == PredictionOutcome.LABEL:
        is_right = answer.label == true_label
    return {
        'task': answer.task,
        'contact': answer.contact,
        'trial': answer.trial_id,
        'outcome': answer.outcome.name.lower(),
        'label': answer.label,
        'true': true_label,
        'right': is_right,
        'reason': answer.reason,
        'scores': [[label, rounded(score)] for label, score in scores],
        'kind': answer.score_kind,
        'seconds': round(answer.window_s, 1),
        'model': answer.model_id,
        'simulated': answer.simulated,
    }


def format_answer(
    finger: str, answer: WindowPrediction, true_label: str, *, names_model: bool = False
) -> str:
    """Return one line about a prediction: finger, task, and label with score, or *unknown*."""
    parts = [finger] if finger else []
    parts.append(f'{answer.task:9} {answer.contact or "any contact":9}')
    parts.append(f'{answer.window_s:.1f} s')
    if answer.outcome == PredictionOutcome.LABEL:
        score = f'({max(answer.scores):.2f} {answer.score_kind})' if answer.scores else ''
        parts.append(f'{answer.label:13} {score}')
        if true_label:
            parts.append('correct' if answer.label == true_label else f'wrong, it is {true_label}')
    elif answer.outcome == PredictionOutcome.UNKNOWN:
        parts.append(f'unknown: {answer.reason}')
    else:
        parts.append(f'no label: {answer.reason}')
    if names_model:
        parts.append(answer.model_id)
    if answer.simulated:
        parts.append('SIMULATED')
    return '  '.join(parts)
