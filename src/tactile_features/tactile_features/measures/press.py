# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stiffness of a press on an object, and its relaxation, as the tendon sees both."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_features.errors import UndefinedFeatureError

FloatArray = NDArray[np.float64]

CONTACT_SETTLE_S = 0.02
"""Left out after the touch: the jump of the damped fingertip, and the sensor's low pass."""

MAX_SAMPLES = 720
_TAUT_SHARE = 0.25  # of the touch's or the end's tension, from where the free pull is straight
_KINK_SHARE = 0.03  # of the largest tension, that a touch lifts it above the free line
_KINK_SIGMAS = 8.0
_FREE_SAMPLES = 6
_CONTACT_SAMPLES = 3
_ITERATIONS = 30
_LONGEST_SHARE = 5.0  # of the hold: a slower relaxation cannot be told from a straight line
_LEAST_SIGMAS = 10.0
_WHITE_SIGMAS = 6.0
_RELAXATION_UNKNOWNS = 3  # a constant, a size and a rate


class Value(NamedTuple):
    """An estimate and its standard uncertainty, in the same unit."""

    value: float
    standard_uncertainty: float


class Press(NamedTuple):
    """Slopes of the tension by the tendon's displacement [N/m].

    Attributes
    ----------
    free : Value
        Before the fingertip touches: the finger's own.
    contact : Value
        What touching adds to it.
    """

    free: Value
    contact: Value


def measure_press(elapsed_s: FloatArray, tension_n: FloatArray, speed_m_s: float) -> Press:
    """Return the slopes before and after the touch in a pull of constant speed.

    Two straight lines: one from a quarter of the tension up to the touch, one from
    `CONTACT_SETTLE_S` after it to the end of the pull. The uncertainties are those of the lines,
    with the scatter about the free one.

    Parameters
    ----------
    elapsed_s, tension_n : ndarray of shape (n,)
        Samples of the pull, from slack to its end [s, N].
    speed_m_s : float
        Of the tendon [m/s].

    Raises
    ------
    UndefinedFeatureError
        When there are too few samples on either line or nothing was touched.
    """
    elapsed_s, tension_n = average_samples(elapsed_s, tension_n)
    end = int(np.argmax(tension_n))  # the tendon brakes around it
    most_n = float(tension_n[end])
    # Twice: the touch, which ends the free pull, is found from the free pull.
    touch = end
    for _ in range(2):
        first = int(np.argmax(tension_n >= _TAUT_SHARE * float(tension_n[touch])))
        touch = _find_touch(elapsed_s[first:end], tension_n[first:end], most_n) + first
    if touch == end:
        raise UndefinedFeatureError(
            'the slope of the tension does not rise in the pull: nothing was touched'
        )
    free = _fit_line(elapsed_s[first:touch], tension_n[first:touch])
    # It touched after the sample before.
    begin = int(np.searchsorted(elapsed_s, elapsed_s[touch - 1] + CONTACT_SETTLE_S))
    begin = max(begin, touch + 1)
    count = end - begin
    if count < _CONTACT_SAMPLES:
        raise UndefinedFeatureError(
            f'{max(count, 0)} samples between the touch and the end of the pull; '
            f'its slope needs {_CONTACT_SAMPLES}: pull more slowly or sample faster'
        )
    pressed = _fit_line(elapsed_s[begin:end], tension_n[begin:end])
    free_u = free.scatter * free.lever / speed_m_s
    # Few samples in contact: their own scatter is a poor estimate, unless it is the larger.
    pressed_u = max(free.scatter, pressed.scatter) * pressed.lever / speed_m_s
    return Press(
        Value(free.slope / speed_m_s, free_u),
        Value((pressed.slope - free.slope) / speed_m_s, math.hypot(free_u, pressed_u)),
    )


def average_samples(elapsed_s: FloatArray, tension_n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of consecutive samples, `MAX_SAMPLES` at most: a fast sensor costs as a slow one."""
    factor = math.ceil(len(elapsed_s) / MAX_SAMPLES)
    whole = len(elapsed_s) // factor * factor
    time, values = (x[:whole].reshape(-1, factor).mean(axis=1) for x in (elapsed_s, tension_n))
    return time, values


class _Line(NamedTuple):
    slope: float
    scatter: float
    lever: float


def _fit_line(elapsed_s: FloatArray, tension_n: FloatArray) -> _Line:
    time = elapsed_s - elapsed_s.mean()
    squares = float(np.sum(time * time))
    slope = float(np.sum(time * tension_n)) / squares
    left = tension_n - tension_n.mean() - slope * time
    scatter = math.sqrt(float(np.sum(left * left)) / (len(time) - 2))
    return _Line(slope, scatter, 1 / math.sqrt(squares))


def _find_touch(elapsed_s: FloatArray, tension_n: FloatArray, most_n: float) -> int:
    """Index of the first sample from which all stay above the line through those before it."""
    n = len(tension_n)
    for here in range(_FREE_SAMPLES, n):
        time, values = elapsed_s[:here], tension_n[:here]
        line = _fit_line(time, values)
        ahead_s = elapsed_s[here:] - time.mean()
        above = tension_n[here:] - (values.mean() + line.slope * ahead_s)
        # The line itself is the less certain, the farther it leads.
        spread = line.scatter * np.sqrt(1 + 1 / here + (line.lever * ahead_s) ** 2)
        if above[-1] > _KINK_SHARE * most_n and (above > _KINK_SIGMAS * spread).all():
            return here
    return n


def measure_relaxation(elapsed_s: FloatArray, tension_n: FloatArray) -> Value:
    """Return the time constant of the tension while the tendon is held [s].

    A constant and one exponential, by non-linear least squares; its uncertainty is that of the
    fit, with its residuals' scatter.

    Parameters
    ----------
    elapsed_s, tension_n : ndarray of shape (n,)
        Evenly spaced samples of the hold [s, N].

    Raises
    ------
    UndefinedFeatureError
        When nothing relaxes, the relaxation is too slow for the hold, or it is more than one; or
        when there are fewer than four samples.
    """
    if len(elapsed_s) <= _RELAXATION_UNKNOWNS:
        raise UndefinedFeatureError(f'{len(elapsed_s)} samples are too few for a relaxation')
    time, values = average_samples(elapsed_s, tension_n)
    time = time - time[0]
    span_s = float(time[-1])
    values = values - values[-1]
    rate = 1 / span_s
    slow = 1 / (_LONGEST_SHARE * span_s)
    for _ in range(_ITERATIONS):
        decay = np.exp(-rate * time)
        size, left = _fit_decay(decay, values)
        # By the rate, with the constant and the exponential solved for beside it.
        slope = -size * time * decay
        lever = _fit_decay(decay, slope)[1]
        weight = float(np.sum(lever * lever))
        scatter = math.sqrt(float(np.sum(left * left)) / (len(time) - _RELAXATION_UNKNOWNS))
        if weight == 0.0 or abs(size) < _LEAST_SIGMAS * scatter / math.sqrt(len(time)):
            raise UndefinedFeatureError('the tension does not relax while the tendon is held')
        step = float(np.sum(lever * left)) / weight
        rate = min(max(rate + step, rate / 2), 2 * rate)
        if rate < slow / 10 or abs(step) < 1e-9 * rate:
            break
    spread = scatter / math.sqrt(weight)
    if rate - 2 * spread < slow:
        raise UndefinedFeatureError(
            f'the tension relaxes too slowly for a hold of {span_s:.1f} s, or in a straight line'
        )
    _refuse_pattern(left)
    return Value(1 / rate, spread / rate**2)


def _fit_decay(decay: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Factor of the decay beside a constant, and what both leave."""
    fall = decay - decay.mean()
    rise = values - values.mean()
    size = float(np.sum(fall * rise)) / float(np.sum(fall * fall))
    return size, rise - size * fall


def _refuse_pattern(left: FloatArray) -> None:
    """Refuse residuals that follow each other: von Neumann's ratio, as a normal deviate."""
    n = len(left)
    ratio = float(np.sum(np.diff(left) ** 2)) / float(np.sum(left * left))
    if (2.0 - ratio) * math.sqrt(n) / 2.0 > _WHITE_SIGMAS:
        raise UndefinedFeatureError(
            'the tension does not relax as one exponential: there is more than one relaxation'
        )
