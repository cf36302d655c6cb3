# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of the phases of a trial in the tension, for trials without stated events.

    rest ── rise ──▶ held ──────────────▶ fall ── flat ──▶ rest
     contact │  hold │    glide │  release │    done │

The tendon of a finger is pulled, the finger holds or glides, and the tendon is released. Each of
these changes bends the curve of the tension. docs/phases.md shows how often and how exactly they
are detected.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.types import (
    PHASE_ABORTED,
    PHASE_DONE,
    PHASE_GLIDE,
    PHASE_HOLD,
    PHASE_RELEASE,
    PHASE_TOUCH,
    PHASES_STATED,
    PROTOCOL_STIFFNESS,
    PROTOCOL_TEXTURE,
    TrialEvent,
)
from tactile_features.windows import SAMPLE, Samples
from tactile_ros.strain import StrainStatus

FloatArray = NDArray[np.float64]

_MAD_TO_SIGMA = 1.4826
"""Ratio of the standard deviation of a normal distribution to its median absolute deviation."""

_JUMPED_SHARE = 0.3
"""A sample that has passed this fraction of the height of a jump counts as after the jump."""

REDUCED_HZ = 60.0
"""If the rate of a stream is higher, its samples are averaged to about this rate [Hz]."""

MEMORY = 900
"""Smallest number of latest samples that are kept."""

SLOPE_STEPS = 5
"""Number of sample steps over which a slope is computed."""

# A bend is searched from _BEND_BEFORE samples before its estimated position to _BEND_AFTER after.
_BEND_BEFORE = 6
_BEND_AFTER = 6

# These values were chosen on training sessions of the simulator; see docs/phases.md.
_REST_LEARN = 9  # rest samples needed before a trial can begin
_REST_MEMORY = 60  # latest rest samples used to estimate the rest level and the noise
_REST_RENEW = 15  # re-estimate the rest level every 15 samples, counted by sample number
_CONFIRM = 3  # consecutive samples that confirm a rise or a fall
_RISE_SIGMAS = 6.0  # threshold of a rise, in standard deviations of the noise
_ONSET_SIGMAS = 3.0  # threshold of the onset of a rise, in standard deviations of the noise
_ONSET_SHARE = 0.05  # lowest threshold of the onset, as a fraction of the threshold of a rise
_FLAT_SHARE = 0.1  # below this fraction of its maximum slope, a rise or a fall is flat
_FLAT_SAMPLES = 6  # a rise ends after this number of consecutive flat samples
_BEND_SHARE = 0.5  # the slope at a bend is this fraction of the maximum slope
_AGAIN_SHARE = 0.25  # if the tension increases by this fraction of the level, a new pull begins
_FALLEN_SHARE = 0.25  # if the tension is below this fraction of the level, a release has begun
_RELEASE_NS = 1_000_000_000  # a release begins at most this long before half the tension is gone
_GUARD_S = 0.15  # duration of the transient after the contact
_GLIDE_BEFORE = 18  # largest number of samples before a glide that are used to detect it
_GLIDE_LEAST = 8  # smallest number of samples before a glide that are used to detect it
_GLIDE_AFTER = (6, 12, 24, 48)  # numbers of samples after its start, tried in this order
_GLIDE_SIGMAS = 5.0  # threshold of the jump at the start of a glide, in standard deviations
_GLIDE_SHARE = 0.015  # lowest threshold of that jump, as a fraction of the level
_GLIDE_CONFIRM_S = 0.3  # after this time, a jump cannot be the start of a release


def estimate_noise_n(tension_n: FloatArray) -> float:
    """Estimate the standard deviation of the noise from differences of consecutive samples [N].

    The median absolute difference depends neither on the level nor on drift, and a few samples of
    a contact do not affect it. If the step of the converter is larger than the noise, the result
    can be 0.
    """
    if len(tension_n) < 2:
        return 0.0
    return float(_MAD_TO_SIGMA / math.sqrt(2) * np.median(np.abs(np.diff(tension_n))))


def locate_bend(time_s: FloatArray, tension_n: FloatArray, least: int = 3) -> int:
    """Return the index of the sample at which two straight lines fit best.

    The two lines are fitted independently, each to at least ``least`` samples. The returned sample
    belongs to both lines, so at least ``2 * least - 1`` samples are needed.
    """
    errors = [
        _line_error(time_s[: i + 1], tension_n[: i + 1]) + _line_error(time_s[i:], tension_n[i:])
        for i in range(least - 1, len(time_s) - least + 1)
    ]
    return least - 1 + int(np.argmin(errors))


def _line_error(time_s: FloatArray, tension_n: FloatArray) -> float:
    """Return the sum of squared residuals of a straight line."""
    t, x = time_s - time_s.mean(), tension_n - tension_n.mean()
    s_tx = float(t @ x)
    return float(x @ x) - s_tx * s_tx / float(t @ t)


class Step(NamedTuple):
    """A jump between two samples of a straight line.

    Attributes
    ----------
    height_n : float
        Height of the jump [N].
    spread : float
        Standard deviation of the height divided by the standard deviation of one sample [1].
    before_n : float
        Standard deviation of the samples before the jump from a line fitted to them [N].
    slope_n_s : float
        Common slope of the line on both sides [N/s].
    """

    height_n: float
    spread: float
    before_n: float
    slope_n_s: float


def measure_step(time_s: FloatArray, tension_n: FloatArray, first_after: int) -> Step:
    """Fit a straight line with a jump and the same slope on both sides; return the jump.

    The fit is an ordinary least-squares fit. ``first_after`` is the index of the first sample
    after the jump; it must be between 3 and ``n - 1``.
    """
    time, tension = np.split(time_s, [first_after]), np.split(tension_n, [first_after])
    centres = [(float(t.mean()), float(x.mean())) for t, x in zip(time, tension, strict=True)]
    s_tt, s_tx = 0.0, 0.0
    for t, x, (t0, x0) in zip(time, tension, centres, strict=True):
        s_tt += float((t - t0) @ (t - t0))
        s_tx += float((t - t0) @ (x - x0))
    slope = s_tx / s_tt
    apart_s = centres[1][0] - centres[0][0]
    height_n = centres[1][1] - centres[0][1] - slope * apart_s
    before_n = math.sqrt(max(0.0, _line_error(time[0], tension[0])) / (first_after - 2))
    share = 1 / len(time[0]) + 1 / len(time[1]) + apart_s * apart_s / s_tt
    return Step(height_n, math.sqrt(share), before_n, slope)


def locate_step(time_s: FloatArray, tension_n: FloatArray, least: int) -> int:
    """Return the index of the last sample before a jump.

    First, the jump with the largest ratio of height to standard deviation is located. Because a
    jump may last several samples, the index then moves back to the sample at which the jump began.
    ``least`` is the smallest number of samples before the jump, and at least 3.
    """
    steps = {i: measure_step(time_s, tension_n, i) for i in range(least, len(time_s) - 1)}
    first_after = max(steps, key=lambda i: abs(steps[i].height_n) / steps[i].spread)
    step = steps[first_after]
    level_n = tension_n - step.slope_n_s * time_s
    share = (level_n - level_n[:first_after].mean()) / step.height_n
    at = first_after - 1
    while at > 0 and share[at] > _JUMPED_SHARE:
        at -= 1
    return at


class ReducedSignal:
    """Means of groups of samples. They do not depend on how the samples are grouped into blocks.

    Attributes
    ----------
    stamp_ns : list of int
        Stamps of the means, increasing [ns].
    tension_n : list of float
        Mean tensions [N].
    group : int
        Number of the current group, counted from sequence number 0; negative if there is none yet.
    """

    def __init__(self, rate_hz: float) -> None:
        self._group_size = max(1, round(rate_hz / REDUCED_HZ))
        self.clear()

    def clear(self) -> None:
        """Discard all samples: the next samples are unrelated to the last ones."""
        self._pending: list[tuple[int, float]] = []
        self.group = -1
        self.forget()

    def forget(self) -> None:
        """Discard the means, but keep the incomplete group."""
        self.stamp_ns: list[int] = []
        self.tension_n: list[float] = []

    def add(self, samples: Samples) -> Iterator[None]:
        """Add samples in the order of time; yield after each new mean."""
        groups = samples['sequence'] // np.uint64(self._group_size)
        usable = np.isfinite(samples['tension_n'])
        columns = (samples['stamp_ns'], samples['tension_n'], groups, usable)
        for stamp_ns, tension_n, group, is_usable in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            if group != self.group:
                if self._close_group():
                    yield
                self.group = group
            if is_usable:
                self._pending.append((stamp_ns, tension_n))
                if len(self._pending) == self._group_size and self._close_group():
                    yield

    def _close_group(self) -> bool:
        """Append the mean of the group; return False if its stamp does not increase."""
        count = len(self._pending)
        if not count:
            return False
        stamp_ns = sum(stamp for stamp, _ in self._pending) // count
        tension_n = sum(tension for _, tension in self._pending) / count
        self._pending.clear()
        if self.stamp_ns and stamp_ns <= self.stamp_ns[-1]:
            return False  # if stamps are arrival times, they can repeat or step back
        self.stamp_ns.append(stamp_ns)
        self.tension_n.append(tension_n)
        if len(self.stamp_ns) > 2 * MEMORY:
            del self.stamp_ns[:MEMORY], self.tension_n[:MEMORY]
        return True

    def slope(self) -> float:
        """Return the slope over the last samples [N/s]."""
        first = max(-len(self.stamp_ns), -1 - SLOPE_STEPS)
        elapsed_s = (self.stamp_ns[-1] - self.stamp_ns[first]) / 1e9
        return (self.tension_n[-1] - self.tension_n[first]) / elapsed_s

    def slopes(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the start [ns] and the value [N/s] of each slope over the stored means."""
        stamp_ns = np.array(self.stamp_ns)
        tension_n = np.array(self.tension_n)
        first, last = slice(None, -SLOPE_STEPS), slice(SLOPE_STEPS, None)
        slopes = (tension_n[last] - tension_n[first]) / ((stamp_ns[last] - stamp_ns[first]) / 1e9)
        return stamp_ns[first], slopes

    def recent(self, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the latest samples: times relative to the last one [s], and tensions [N]."""
        stamp_ns = np.array(self.stamp_ns[-count:])
        return (stamp_ns - stamp_ns[-1]) / 1e9, np.array(self.tension_n[-count:])

    def locate_bend(self, near: int) -> int:
        """Return the index of the bend close to the index ``near``."""
        first, last = max(0, near - _BEND_BEFORE), near + _BEND_AFTER + 1
        stamp_ns = np.array(self.stamp_ns[first:last])
        elapsed_s = (stamp_ns - stamp_ns[0]) / 1e9
        return first + locate_bend(elapsed_s, np.array(self.tension_n[first:last]))


class SignalPhases:
    """Detection of phases in a stream of samples.

    The result does not depend on how the samples are grouped into blocks. An event is returned
    when it is certain, which is some tenths of a second after its stamp. A release is returned
    when the tension above rest has fallen to a quarter of its value in the hold. If no glide is
    found in a trial of the texture protocol, the trial ends as aborted.

    If the detection starts in the middle of a stream, no trial is reported as long as the result
    could depend on earlier samples: until `_REST_MEMORY` samples of rest, or the end of a trial.
    Two detections that start at different times therefore report the same trials. If the first
    sequence number is 0, there are no earlier samples.
    """

    def __init__(self, config: FeatureConfig) -> None:
        if config.phases == PHASES_STATED:
            raise FeatureError(
                f'phases is "{config.phases}"; to detect them in the tension it must be '
                f'{PROTOCOL_TEXTURE} or {PROTOCOL_STIFFNESS}'
            )
        self._config = config
        self._is_simulated = False
        self._signal = ReducedSignal(config.rate_hz)
        self._state: Callable[[], list[TrialEvent]]  # function that takes the next mean
        self.reset()
        self._is_settled = False

    def abort(self, message: str) -> list[TrialEvent]:
        """Discard all samples; return an event that aborts the current trial, if there is one."""
        is_silent = self._is_at_rest or not self._is_settled
        events = (
            [] if is_silent else [self._event(PHASE_ABORTED, self._signal.stamp_ns[-1], message)]
        )
        self.reset()
        return events

    def reset(self) -> None:
        """Discard all samples: the next samples are unrelated to the last ones."""
        self._signal.clear()
        self._is_settled = True  # after a reset, the stream is observed from its beginning
        self._start_learning()

    def add(self, samples: Samples) -> list[TrialEvent]:
        """Add samples in the order of time; return the phases whose start is now certain."""
        if not len(samples):
            return []
        marks = samples['status'] & StrainStatus.SIMULATED
        events: list[TrialEvent] = []
        for part in np.split(samples, np.flatnonzero(np.diff(marks)) + 1):
            events += self._add(part, bool(part['status'][0] & StrainStatus.SIMULATED))
        return events

    def _add(self, samples: Samples, is_simulated: bool) -> list[TrialEvent]:
        self._is_simulated = is_simulated or (self._is_simulated and not self._is_at_rest)
        events: list[TrialEvent] = []
        if self._signal.group < 0:
            self._is_settled |= bool(samples['sequence'][0] == 0)
        for _ in self._signal.add(samples):
            was_settled = self._is_settled
            new = self._state()
            events += new if was_settled else []
        return events

    @property
    def _is_at_rest(self) -> bool:
        return self._state in (self._learn, self._rest)

    def _start_learning(self) -> None:
        self._state = self._learn
        self._signal.forget()

    def _learn(self) -> list[TrialEvent]:
        if len(self._signal.tension_n) < _REST_LEARN:
            return []
        self._measure_rest()
        some = np.array(self._signal.tension_n[-_REST_LEARN:])
        third = _REST_LEARN // 3
        moved_n = abs(float(np.median(some[-third:]) - np.median(some[:third])))
        if moved_n < self._threshold_n / 2:
            self._state = self._rest
            self._off_count = self._rest_count = 0
        return []

    def _measure_rest(self) -> None:
        some = np.array(self._signal.tension_n[-_REST_MEMORY:])
        self._rest_n = float(np.median(some))
        self._noise_n = estimate_noise_n(some)
        self._threshold_n = max(self._config.detected_rise_n, _RISE_SIGMAS * self._noise_n)

    def _rest(self) -> list[TrialEvent]:
        off_n = self._signal.tension_n[-1] - self._rest_n
        if abs(off_n) <= self._threshold_n:
            self._off_count = 0
        else:
            same_way = off_n * self._off_count >= 0
            self._off_count = (self._off_count if same_way else 0) + (1 if off_n > 0 else -1)
        if self._off_count == -_CONFIRM:
            self._is_settled = False
            self._start_learning()
        elif self._off_count == _CONFIRM:
            return self._begin_trial()
        else:
            self._rest_count += 1
            if self._signal.group % _REST_RENEW == 0:
                self._measure_rest()
                self._is_settled |= self._rest_count >= _REST_MEMORY
        return []

    def _begin_trial(self) -> list[TrialEvent]:
        small_n = max(_ONSET_SIGMAS * self._noise_n, _ONSET_SHARE * self._threshold_n)
        at = len(self._signal.tension_n) - 1
        while at > 0 and self._signal.tension_n[at] > self._rest_n + small_n:
            at -= 1
        self._trial_id = f'detected-{self._signal.stamp_ns[at]}'
        self._rise_from_ns = self._signal.stamp_ns[max(0, at - SLOPE_STEPS)]
        self._start_rise()
        return [self._event(PHASE_TOUCH, self._signal.stamp_ns[at])]

    def _start_rise(self) -> None:
        self._state = self._rise
        self._steepest_n_s = 0.0
        self._flat_count = self._off_count = 0

    def _rise(self) -> list[TrialEvent]:
        slope_n_s = self._signal.slope()
        self._steepest_n_s = max(self._steepest_n_s, slope_n_s)
        is_flat = slope_n_s < _FLAT_SHARE * self._steepest_n_s
        self._flat_count = self._flat_count + 1 if is_flat else 0
        if self._flat_count < _FLAT_SAMPLES:
            return []
        stamp_ns, slopes = self._signal.slopes()
        slopes[stamp_ns < self._rise_from_ns] = 0.0
        steepest = int(np.argmax(slopes))
        steep = np.flatnonzero(slopes[steepest:] > _BEND_SHARE * slopes[steepest])
        last_steep = steepest + (int(steep[-1]) if len(steep) else 0)
        at = self._signal.locate_bend(last_steep + 1 + SLOPE_STEPS // 2)
        self._state = self._hold
        self._held_ns = self._signal.stamp_ns[at]
        self._level_n = max(self._signal.tension_n[at] - self._rest_n, self._threshold_n)
        self._glide_ns: int | None = None
        self._has_glide = False
        if self._config.phases == PROTOCOL_STIFFNESS:
            return [self._event(PHASE_HOLD, self._held_ns)]
        return []

    def _hold(self) -> list[TrialEvent]:
        share = (self._signal.tension_n[-1] - self._rest_n) / self._level_n
        if _FALLEN_SHARE <= share <= 1.0 + _AGAIN_SHARE:
            self._off_count = 0
        else:
            self._off_count += 1
        if self._off_count == _CONFIRM:
            if share > 1.0:
                self._start_rise()
                return []
            return self._release()
        if self._config.phases == PROTOCOL_TEXTURE and not self._has_glide:
            return self._look_for_glide()
        return []

    def _look_for_glide(self) -> list[TrialEvent]:
        if self._glide_ns is None:
            self._glide_ns = self._find_glide()
        elif self._signal.stamp_ns[-1] - self._glide_ns > _GLIDE_CONFIRM_S * 1e9:
            # For a short time, the start of a release looks like the start of a glide.
            self._has_glide = True
            return [self._event(PHASE_GLIDE, self._glide_ns)]
        return []

    def _find_glide(self) -> int | None:
        elapsed_s, tension_n = self._signal.recent(_GLIDE_BEFORE + max(_GLIDE_AFTER))
        guarded_s = (self._held_ns - self._signal.stamp_ns[-1]) / 1e9 + _GUARD_S
        guarded = int(np.searchsorted(elapsed_s, guarded_s))
        for after in _GLIDE_AFTER:
            first_after = len(elapsed_s) - after
            first = max(guarded, first_after - _GLIDE_BEFORE)
            if first_after - first < _GLIDE_LEAST:
                return None
            time_s, some_n = elapsed_s[first:], tension_n[first:]
            step = measure_step(time_s, some_n, first_after - first)
            error_n = max(self._noise_n, step.before_n) * step.spread
            least_n = max(_GLIDE_SIGMAS * error_n, _GLIDE_SHARE * self._level_n)
            if abs(step.height_n) > least_n:
                at = locate_step(time_s, some_n, _GLIDE_LEAST) - len(time_s)
                return self._signal.stamp_ns[at]
        return None

    def _release(self) -> list[TrialEvent]:
        stamp_ns, slopes = self._signal.slopes()
        slopes[stamp_ns < max(self._held_ns, self._earliest_release_ns())] = 0.0
        steepest = int(np.argmin(slopes))
        self._steepest_n_s = float(slopes[steepest])
        gentle = np.flatnonzero(slopes[:steepest] > _BEND_SHARE * self._steepest_n_s)
        near = int(gentle[-1]) if len(gentle) else steepest
        at = self._signal.locate_bend(near + 1 + SLOPE_STEPS // 2)
        self._state = self._fall
        if self._config.phases == PROTOCOL_TEXTURE and not self._has_glide:
            message = 'no glide was found between contact and release'
            return [self._event(PHASE_ABORTED, self._signal.stamp_ns[at], message)]
        return [self._event(PHASE_RELEASE, self._signal.stamp_ns[at])]

    def _earliest_release_ns(self) -> int:
        """Return the earliest possible start of the release [ns].

        The limit is a fixed time before the tension fell to half, or longer for a slow release. It
        is needed because a soft object can relax at the start of a hold faster than a slow hand
        releases it.
        """
        shares = (np.array(self._signal.tension_n) - self._rest_n) / self._level_n
        half = np.flatnonzero(shares >= 0.5)
        half_ns = self._signal.stamp_ns[half[-1]] if len(half) else self._signal.stamp_ns[0]
        since_ns = self._signal.stamp_ns[-1] - half_ns
        return half_ns - max(_RELEASE_NS, 3 * since_ns)

    def _fall(self) -> list[TrialEvent]:
        if self._signal.slope() < _FLAT_SHARE * self._steepest_n_s:
            return []
        done_ns = self._signal.stamp_ns[-SLOPE_STEPS]
        is_aborted = self._config.phases == PROTOCOL_TEXTURE and not self._has_glide
        self._is_settled = True
        self._start_learning()
        return [] if is_aborted else [self._event(PHASE_DONE, done_ns)]

    def _event(self, phase: str, stamp_ns: int, message: str = '') -> TrialEvent:
        config = self._config
        is_texture = config.phases == PROTOCOL_TEXTURE
        return TrialEvent(
            stamp_ns=stamp_ns,
            trial_id=self._trial_id,
            session_id=config.detected_session_id,
            protocol=config.phases,
            contact=config.detected_contact,
            object_label=config.detected_object_label,
            phase=phase,
            message=message,
            glide_speed_m_s=config.detected_glide_speed_m_s if is_texture else 0.0,
            simulated=self._is_simulated,
            detected=True,
        )


def find_phases(
    time_ns: ArrayLike, tension_n: ArrayLike, config: FeatureConfig
) -> tuple[TrialEvent, ...]:
    """Detect the phases in an array with `SignalPhases`; return them in the order of time.

    Parameters
    ----------
    time_ns : array_like of int, shape (n,)
        Times of the samples, increasing [ns].
    tension_n : array_like of shape (n,)
        Tension [N]; values that are not finite are ignored.
    config : FeatureConfig
        Its parameter ``phases`` must be the protocol, ``texture`` or ``stiffness``.

    Raises
    ------
    FeatureError
        When the shapes differ, the times are not integers or ``phases`` is ``stated``.
    """
    time, tension = np.asarray(time_ns), np.asarray(tension_n, dtype=np.float64)
    if time.ndim != 1 or time.shape != tension.shape:
        raise FeatureError(
            f'times and tensions have shapes {time.shape} and {tension.shape}; '
            'both must be (samples,)'
        )
    if not np.issubdtype(time.dtype, np.integer):
        raise FeatureError(f'times must be integer nanoseconds; they are {time.dtype}')
    samples = np.zeros(len(time), SAMPLE)
    samples['stamp_ns'] = time
    samples['sequence'] = np.arange(len(time))
    samples['tension_n'] = tension
    return tuple(SignalPhases(config).add(samples))
