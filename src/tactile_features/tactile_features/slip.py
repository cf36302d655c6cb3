# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""A held object begins to slide: found in the stream of tension, without a trial."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from tactile_features.errors import FeatureError
from tactile_features.windows import SampleBuffer, Samples
from tactile_ros.configs import check_parameters, parameter
from tactile_ros.strain import NO_MEASUREMENT, StrainBlock, StrainStatus

FloatArray = NDArray[np.float64]

LARGEST_RATE_HZ = 250.0
"""Faster samples are averaged down to at most this rate: a slip takes milliseconds."""

SMALLEST_RATE_HZ = 20.0
"""In slower samples no slip is looked for."""

RATE_TOLERANCE = 0.01
"""A rate that changes by a larger share is another one."""

_MOVE_S = 0.1  # over which the finger's own motion shows
_MEMORY_S = 20.0  # of the estimate of the noise
_PRIOR = 60.0  # values that the white noise counts for in the estimate from the past
_TRIMMED = 9.0  # in variances: what one value may add to the estimate of white noise
_PAST_TRIMMED = 2.0  # the same for that from the past, which holds slips that were missed
_PAST_SCALE = 1.3474  # mean square of normal values, over that of values trimmed so


@dataclass(frozen=True)
class SlipConfig:
    """Conditions under which a fall of the tension is a slip.

    Raises
    ------
    FeatureError
        When a value is out of its range.
    """

    threshold: float = parameter(
        5.0,
        'how unlikely a fall must be, in standard deviations of the noise; '
        'docs/measures.md has misses and false alarms by threshold',
        unit='1',
        range=(3.0, 50.0),
    )
    history_s: float = parameter(
        0.2,
        'how long the tension must have run straight before a fall can be told',
        unit='s',
        range=(0.1, 10.0),
    )
    fall_s: float = parameter(
        0.05, 'how long a fall is gathered at most', unit='s', range=(0.001, 1.0)
    )
    min_tension_n: float = parameter(
        0.5, 'nothing is held below this tension', unit='N', range=(0.0, 1000.0)
    )
    move_per_s: float = parameter(
        0.3,
        'change of the tension, relative and per second, beyond which the finger itself moves',
        unit='1/s',
        range=(0.01, 100.0),
    )
    frame_id: str = parameter('tendon_sensor_link', 'frame of the sensor')

    def __post_init__(self) -> None:
        check_parameters(self, FeatureError)


@dataclass(frozen=True)
class Slip:
    """A held object began to slide.

    ``stamp_ns`` is that of the sample that gave the decision, ``onset_ns`` the estimated time of
    the change itself [ns], ``statistic`` that of the fall, in units of the threshold [1].
    """

    stamp_ns: int
    onset_ns: int
    statistic: float
    tension_n: float
    simulated: bool = False


class SlipDetector:
    """Finds the sudden falls of tension with which an object under the fingertip breaks loose.

    How far the last few samples lie below the straight line through those before them is
    compared with the noise, for falls of 1, 2, 4 ... samples: the generalised likelihood ratio of
    a step in a line, with its noise estimated from the stream. The noise is the larger of
    two estimates: from second differences, which no trend enters, and from the past of
    the statistic itself, which knows noise that is not white. Few values make a poor
    estimate; Wallace's approximation (Ann. Math. Stat. 30, 1959) turns Student's statistic into
    a normal one.

    The rate is that of the blocks, by their ``period_ns``. When it changes, everything begins
    anew. In blocks of less than `SMALLEST_RATE_HZ` nothing is found, nor before a rate is known:
    a block of one sample may state none.

    A faster change than ``move_per_s``, a gap, a sample that is no measurement or too
    little tension begin the history anew. The answer depends on stamps and sequence numbers
    alone, however samples are grouped into blocks. ``rate_hz`` is 0 while it is not known.
    """

    def __init__(self, config: SlipConfig) -> None:
        self.config = config
        self.rate_hz = 0.0
        self._filled = 0

    def _begin(self, sample_rate_hz: float) -> None:
        """Begin anew, with samples of another rate."""
        config, self.rate_hz = self.config, sample_rate_hz
        self._factor = math.ceil(sample_rate_hz / LARGEST_RATE_HZ)
        rate_hz = sample_rate_hz / self._factor
        history = max(6, round(config.history_s * rate_hz))
        self._quarter = history // 4 + 1
        longest = max(1, round(config.fall_s * rate_hz))
        self._lengths = [2**i for i in range(longest.bit_length()) if 2**i < longest] + [longest]
        self._filters = _make_filters(history, self._lengths)
        self._gains = np.sqrt(np.sum(self._filters**2, axis=1))
        self._move = max(1, round(_MOVE_S * rate_hz))
        self._move_share = config.move_per_s * self._move / rate_hz
        self._memory = _MEMORY_S * rate_hz
        self._buffer = SampleBuffer(10**9, round(2 * sample_rate_hz) + 1, 0)
        self._size = self._filters.shape[1]
        self._tension_n = np.empty(self._size)
        self._stamps_ns = np.empty(self._size, np.int64)
        self._bin: list[float] = []
        self._filled = 0
        self._is_simulated = False  # one of the samples since the history began
        self._white = self._white_count = self._past_count = 0.0
        self._past: FloatArray = np.zeros(len(self._lengths))

    def add(self, block: StrainBlock) -> list[Slip]:
        """Take in samples; return the slips found, in order of time."""
        if block.period_ns > 0:
            rate_hz = _rate_of(block.period_ns)
            if abs(rate_hz - self.rate_hz) > RATE_TOLERANCE * self.rate_hz:
                self._begin(rate_hz)
        if self.rate_hz < SMALLEST_RATE_HZ:
            return []
        if self._buffer.add(block):
            self._forget_noise()
            self._forget()
        slips = self._take(self._buffer.new_samples)
        self._buffer.evict()
        return slips

    def _take(self, samples: Samples) -> list[Slip]:
        slips = []
        tension_n = samples['tension_n']
        good = np.isfinite(tension_n) & ((samples['status'] & NO_MEASUREMENT) == 0)
        simulated = (samples['status'] & StrainStatus.SIMULATED) != 0
        columns = (samples['stamp_ns'], samples['sequence'], tension_n, samples['hole'], good)
        for stamp_ns, sequence, value_n, is_after_hole, is_good, is_simulated in zip(
            *(column.tolist() for column in (*columns, simulated)), strict=True
        ):
            if is_after_hole or not is_good:
                self._forget()
            self._is_simulated |= is_simulated
            # Only whole bins count, and they begin at multiples of their length.
            if not is_good or sequence % self._factor != len(self._bin):
                self._bin.clear()
                continue
            self._bin.append(value_n)
            if len(self._bin) == self._factor:
                slip = self._step(stamp_ns, math.fsum(self._bin) / self._factor)
                self._bin.clear()
                if slip is not None:
                    slips.append(slip)
        return slips

    def _step(self, stamp_ns: int, tension_n: float) -> Slip | None:
        """Take in one value of the lower rate."""
        self._tension_n[:-1] = self._tension_n[1:]
        self._stamps_ns[:-1] = self._stamps_ns[1:]
        self._tension_n[-1], self._stamps_ns[-1] = tension_n, stamp_ns
        self._filled += 1
        slip = self._test() if self._filled >= self._size else None
        # Noise is noise in an empty hand, too.
        is_moving = self._is_moving()
        if self._filled > max(2, self._move) and not is_moving:
            self._learn_white()
        if slip is not None or is_moving:
            self._forget()
        return slip

    def _is_moving(self) -> bool:
        if self._filled <= self._move:
            return False
        now_n = float(self._tension_n[-1])
        change_n = abs(now_n - float(self._tension_n[-1 - self._move]))
        return change_n > self._move_share * max(abs(now_n), self.config.min_tension_n)

    def _learn_white(self) -> None:
        last, middle, first = self._tension_n[-3:].tolist()
        bend = first - 2 * middle + last
        self._white_count = min(self._white_count + 1.0, self._memory)
        news = _trim(bend * bend / 6, self._white, self._white_count)
        self._white += (news - self._white) / self._white_count

    def _test(self) -> Slip | None:
        if self._tension_n.min() < self.config.min_tension_n:
            return None
        values = self._tension_n - self._tension_n[-1]
        falls = np.einsum('ij,j->i', self._filters, values) / self._gains
        variance = np.maximum(self._white, self._past)
        # Neighbouring second differences share samples: about half of them are news.
        freedom = self._white_count / 2
        slip = None
        if freedom >= 1.0 and variance.min() > 0.0:
            t_squared = np.where(falls > 0.0, falls * falls, 0.0) / variance
            best = int(np.argmax(t_squared))
            deviate = _normalise(float(t_squared[best]), freedom)
            fall_n = float(falls[best] * self._gains[best])
            if deviate > self.config.threshold and self._is_below(self._lengths[best], fall_n):
                slip = Slip(
                    stamp_ns=int(self._stamps_ns[-1]),
                    onset_ns=int(self._stamps_ns[-1 - self._lengths[best]]),
                    statistic=deviate / self.config.threshold,
                    tension_n=float(self._tension_n[-1]),
                    simulated=self._is_simulated,
                )
        self._learn_past(falls)
        return slip

    def _is_below(self, length: int, fall_n: float) -> bool:
        """Return whether the tension fell, and did not merely leave a line that led upwards."""
        before = self._tension_n[-length - self._quarter : -length].mean()
        return bool(before - self._tension_n[-length:].mean() >= fall_n / 2)

    def _learn_past(self, falls: FloatArray) -> None:
        """Mean square of the statistic where it fell: rises are creep that bends, or a pull."""
        if self._past_count == 0.0:
            self._past_count = _PRIOR
            self._past[:] = self._white
        self._past_count = min(self._past_count + 1.0, self._memory)
        for i, fall in enumerate(falls.tolist()):
            known = float(self._past[i])
            if fall > 0.0:
                most = _PAST_TRIMMED * known if known > 0.0 else math.inf
                news = _PAST_SCALE * min(fall * fall, most)
                self._past[i] += (news - known) / self._past_count

    def _forget(self) -> None:
        self._filled = 0
        self._is_simulated = False
        self._bin.clear()

    def _forget_noise(self) -> None:
        self._white = self._white_count = self._past_count = 0.0
        self._past[:] = 0.0


def _rate_of(period_ns: int) -> float:
    """Return the rate of a period that is rounded to nanoseconds: in whole hertz where it fits."""
    rate_hz = 1e9 / period_ns
    whole_hz = round(rate_hz)
    is_whole = whole_hz > 0 and round(1e9 / whole_hz) == period_ns
    return float(whole_hz) if is_whole else rate_hz


def _make_filters(history: int, lengths: list[int]) -> FloatArray:
    """Weights that give how far a fall's mean lies below the line through its history.

    Shape (lengths, history + the longest); a shorter fall leaves its oldest samples out.
    """
    longest = max(lengths)
    filters = np.zeros((len(lengths), history + longest))
    for row, length in zip(filters, lengths, strict=True):
        first = longest - length
        place = np.arange(history) - (history - 1) / 2
        ahead = (history - 1) / 2 + (length + 1) / 2
        row[first : first + history] = 1 / history + place * ahead / np.sum(place**2)
        row[first + history :] = -1 / length
    return filters


def _trim(news: float, known: float, count: float) -> float:
    """A slip must not pass for noise; the first values have nothing to be held against."""
    return min(news, _TRIMMED * known) if count > 2 * _TRIMMED and known > 0.0 else news


def _normalise(t_squared: float, freedom: float) -> float:
    """Return the normal deviate with the tail probability of Student's t; 0 for t = 0."""
    share = (8 * freedom + 1) / (8 * freedom + 3)
    return share * math.sqrt(freedom * math.log1p(t_squared / freedom))
