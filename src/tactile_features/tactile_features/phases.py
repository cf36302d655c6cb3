# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The phases of a trial found in the tension itself, where nobody states them.

    rest ── rise ──▶ held ──────────────▶ fall ── flat ──▶ rest
     contact │  hold │    glide │  release │    done │

A finger is pulled, holds or glides, and is released; each of these bends the tension. How
often and how exactly they are found: docs/phases.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_features.config import FeatureConfig
from tactile_features.errors import FeatureError
from tactile_features.records import (
    PHASE_ABORTED,
    PHASE_CONTACT,
    PHASE_DONE,
    PHASE_GLIDE,
    PHASE_HOLD,
    PHASE_RELEASE,
    PHASES_STATED,
    PROTOCOL_STIFFNESS,
    PROTOCOL_TEXTURE,
    TrialEvent,
)
from tactile_features.windows import SAMPLE, Samples
from tactile_ros.strain import StrainStatus

FloatArray = NDArray[np.float64]

_MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

_JUMPED_SHARE = 0.3
"""A sample that has gone this share of a jump is no longer before it."""

REDUCED_HZ = 60.0
"""Faster streams are averaged down to about this rate."""

MEMORY = 900
"""Fewest of the last samples that are kept."""

SLOPE_STEPS = 5
"""Number of steps over which a slope is computed."""

_BEND_BEFORE = 6  # samples before a place in which the bend near it is looked for
_BEND_AFTER = 6  # and samples behind it

# Chosen on training sessions of the simulator, see docs/phases.md.
_REST_LEARN = 9  # samples of rest before anything can begin
_REST_MEMORY = 60  # samples that say what rest is
_REST_RENEW = 15  # they are asked anew where the number of a sample can be divided by this
_CONFIRM = 3  # samples in a row that begin a rise, or a fall
_RISE_SIGMAS = 6.0  # how far a rise stands out from the noise
_ONSET_SIGMAS = 3.0  # and where it began
_ONSET_SHARE = 0.05  # but not below this share of what counts as a rise
_FLAT_SHARE = 0.1  # a rise or fall is over where its slope is this share of its steepest
_FLAT_SAMPLES = 6  # for so many samples
_BEND_SHARE = 0.5  # near the bend, the slope is this share of the steepest
_AGAIN_SHARE = 0.25  # of the level: so much more tension is a new pull
_FALLEN_SHARE = 0.25  # of the level: with so little left, the tendon has been released
_RELEASE_NS = 1_000_000_000  # before half the tension is gone, in which a release began
_GUARD_S = 0.15  # the transient of the contact
_GLIDE_BEFORE = 18  # most samples before the start of a glide from which it is told,
_GLIDE_LEAST = 8  # fewest of them
_GLIDE_AFTER = (6, 12, 24, 48)  # and samples after it, in turn
_GLIDE_SIGMAS = 5.0  # how far the tension jumps there
_GLIDE_SHARE = 0.015  # of the level: and at least this
_GLIDE_CONFIRM_S = 0.3  # after which a jump is known not to be a release


def estimate_noise_n(tension_n: FloatArray) -> float:
    """Return the standard deviation of the noise, from differences of neighbours [N].

    Their median absolute value knows neither the level nor a drift, and does not see the few
    samples where something happens. A converter's step, if coarser than the noise, can make it 0.
    """
    if len(tension_n) < 2:
        return 0.0
    return float(_MAD_TO_SIGMA / math.sqrt(2) * np.median(np.abs(np.diff(tension_n))))


def locate_bend(time_s: FloatArray, tension_n: FloatArray, least: int = 3) -> int:
    """Return the index of the sample where two straight lines meet best.

    Each line is fitted by itself, to ``least`` samples or more of the ``n >= 2 * least - 1`` that
    lie around one bend; the sample that is returned belongs to both.
    """
    errors = [
        _line_error(time_s[: i + 1], tension_n[: i + 1]) + _line_error(time_s[i:], tension_n[i:])
        for i in range(least - 1, len(time_s) - least + 1)
    ]
    return least - 1 + int(np.argmin(errors))


def _line_error(time_s: FloatArray, tension_n: FloatArray) -> float:
    """Return the squares that a straight line leaves."""
    t, x = time_s - time_s.mean(), tension_n - tension_n.mean()
    s_tx = float(t @ x)
    return float(x @ x) - s_tx * s_tx / float(t @ t)


class Step(NamedTuple):
    """Jump of a line between one sample and the next.

    ``spread`` is the standard deviation of the jump over that of one sample [1]; ``before_n`` is
    that of the samples before it about a line of their own [N];
    ``slope_n_s``: slope of the line on both sides [N/s].
    """

    height_n: float
    spread: float
    before_n: float
    slope_n_s: float


def measure_step(time_s: FloatArray, tension_n: FloatArray, first_after: int) -> Step:
    """Return the jump of a straight line that is as steep before as behind.

    Ordinary least squares. The index of the first sample behind the jump is 3 to ``n - 1``.
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

    Where a straight line with a jump fits best; from there back over the samples of a jump
    that took more than one. ``least``: fewest samples before it, at least 3.
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
    """Samples in, means of groups of them kept; the answer does not depend on the blocks.

    ``stamp_ns``, rising, and ``tension_n`` are those of the means. ``group`` is the number of the
    present group, counted from sequence number 0; negative: none yet.
    """

    def __init__(self, rate_hz: float) -> None:
        self._group_size = max(1, round(rate_hz / REDUCED_HZ))
        self.clear()

    def clear(self) -> None:
        """Forget everything: the next samples have nothing to do with the last ones."""
        self._pending: list[tuple[int, float]] = []
        self.group = -1
        self.forget()

    def forget(self) -> None:
        """Forget the means, but not the group that fills."""
        self.stamp_ns: list[int] = []
        self.tension_n: list[float] = []

    def add(self, samples: Samples) -> Iterator[None]:
        """Take in samples in the order of time; yield after each new mean."""
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
        """Keep the mean of a group as one sample; return whether there is a new one."""
        count = len(self._pending)
        if not count:
            return False
        stamp_ns = sum(stamp for stamp, _ in self._pending) // count
        tension_n = sum(tension for _, tension in self._pending) / count
        self._pending.clear()
        if self.stamp_ns and stamp_ns <= self.stamp_ns[-1]:
            return False  # times of arrival can stand still or step back
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
        """Return where each slope in memory begins [ns], and the slope [N/s]."""
        stamp_ns = np.array(self.stamp_ns)
        tension_n = np.array(self.tension_n)
        first, last = slice(None, -SLOPE_STEPS), slice(SLOPE_STEPS, None)
        slopes = (tension_n[last] - tension_n[first]) / ((stamp_ns[last] - stamp_ns[first]) / 1e9)
        return stamp_ns[first], slopes

    def recent(self, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the last samples: time before the last one, negative [s], and tension [N]."""
        stamp_ns = np.array(self.stamp_ns[-count:])
        return (stamp_ns - stamp_ns[-1]) / 1e9, np.array(self.tension_n[-count:])

    def locate_bend(self, near: int) -> int:
        """Return the place of the bend near a place."""
        first, last = max(0, near - _BEND_BEFORE), near + _BEND_AFTER + 1
        stamp_ns = np.array(self.stamp_ns[first:last])
        elapsed_s = (stamp_ns - stamp_ns[0]) / 1e9
        return first + locate_bend(elapsed_s, np.array(self.tension_n[first:last]))


class SignalPhases:
    """Samples in, the phases that begin in them out.

    The answer depends on the samples alone, not on how they are grouped. An event comes
    when it is certain, some tenths of a second after its stamp; a release when three
    quarters of the tension are gone. A trial whose glide leaves no trace in the tension
    ends as aborted.

    Nor does the answer depend on when one joins a stream. Who joins late finds no trial
    before the state is that of those who were there: after `_REST_MEMORY` samples of rest, or
    when a trial has ended. A stream with sequence number 0 is there from its beginning.
    """

    def __init__(self, config: FeatureConfig) -> None:
        if config.phases == PHASES_STATED:
            raise FeatureError(
                f'phases is "{config.phases}"; to find them in the signal it must be '
                f'{PROTOCOL_TEXTURE} or {PROTOCOL_STIFFNESS}'
            )
        self._config = config
        self._is_simulated = False
        self._signal = ReducedSignal(config.rate_hz)
        self._state: Callable[[], list[TrialEvent]]  # takes in one more mean
        self.reset()
        self._is_settled = False

    def abort(self, message: str) -> list[TrialEvent]:
        """Forget everything; return the end of the trial that was under way, if any."""
        is_silent = self._is_at_rest or not self._is_settled
        events = (
            [] if is_silent else [self._event(PHASE_ABORTED, self._signal.stamp_ns[-1], message)]
        )
        self.reset()
        return events

    def reset(self) -> None:
        """Forget everything: the next samples have nothing to do with the last ones."""
        self._signal.clear()
        self._is_settled = True  # whoever is there sees the stream begin anew
        self._start_learning()

    def add(self, samples: Samples) -> list[TrialEvent]:
        """Take in samples in the order of time; return the phases now known to begin."""
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
        return [self._event(PHASE_CONTACT, self._signal.stamp_ns[at])]

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
            # The start of a release looks the same, but not for long.
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
        """Return when the release began at the earliest: some time before half was gone.

        A soft object can give way faster at the start of a hold than a slow hand releases it.
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
    """Return the phases that `SignalPhases` finds in an array, in the order of time.

    Parameters
    ----------
    time_ns : array_like of int, shape (n,)
        Times of the samples, rising [ns].
    tension_n : array_like of shape (n,)
        Tension [N]; values that are not finite are passed over.
    config : FeatureConfig
        ``phases`` names the protocol.

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
