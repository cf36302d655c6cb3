# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Physical quantities of a window, each with its uncertainty or the reason why there is none.

The pitch of grooves under a glide, the stiffness that a press meets, its relaxation. See
docs/measures.md for what each means, and how far it may be trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_features.errors import UndefinedFeatureError
from tactile_features.records import Measure
from tactile_features.windows import Samples

MOST_TERMS = 10_000
_TINY = 1e-300

FloatArray = NDArray[np.float64]

# The press, and its relaxation.
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

# The ripple.
MIN_PERIODS = 3
"""Fewer periods than this in a window are a trend, not a ripple."""

MAX_HARMONICS = 12
FALSE_ALARM = 1e-3
"""Probability that a window without a period is said to have one."""

_TREND_DEGREE = 3
_TOP_SHARE = 0.9  # of half the sample rate, up to which a harmonic is looked for
_OVERSAMPLING = 16
_CANDIDATES = 6
_PITCH_ITERATIONS = 8
_CLOSE = 1e-4  # step of the frequency that no longer counts, against 1 / window
_MAIN_SHARE = 0.8  # of the explained squares, which the harmonics of a multiple must keep

GROOVE_PITCH = 'groove_pitch'
FREE_STIFFNESS = 'free_stiffness'
CONTACT_STIFFNESS = 'contact_stiffness'
RELAXATION_TIME = 'relaxation_time'
_LARGEST_N = 1e9  # no sensor's; squares of it are still numbers


def incomplete_beta(a: float, b: float, x: float) -> float:
    """Return the regularised incomplete beta function I_x(a, b), for x from 0 to 1.

    Own code, because SciPy's would bring 37 MB into the process of each finger. By the continued
    fraction 8.17.22 of the NIST Digital Library of Mathematical Functions; the relative error is
    below 1e-12 for ``a + b`` up to 1000.
    """
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    log_factor = (
        math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b) + a * math.log(x) + b * math.log1p(-x)
    )
    if x < (a + 1) / (a + b + 2):
        return math.exp(log_factor) * _continued_fraction(a, b, x) / a
    return 1.0 - math.exp(log_factor) * _continued_fraction(b, a, 1.0 - x) / b


def _continued_fraction(a: float, b: float, x: float) -> float:
    """Evaluate from the front, by the method of Lentz, until a term changes nothing."""
    upper, lower = 1.0, 1.0 / _away_from_zero(1.0 - (a + b) * x / (a + 1))
    value = lower
    for m in range(1, MOST_TERMS):
        even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        before = value
        for term in (even, odd):
            lower = 1.0 / _away_from_zero(1.0 + term * lower)
            upper = _away_from_zero(1.0 + term / upper)
            value *= lower * upper
        if value == before:
            break
    return value


def _away_from_zero(value: float) -> float:
    return value if abs(value) > _TINY else _TINY


class Value(NamedTuple):
    """An estimate and its standard uncertainty, in the same unit."""

    value: float
    standard_uncertainty: float


class Press(NamedTuple):
    """Slopes of the tension by the tendon's displacement [N/m].

    ``free`` is the finger's own, before the fingertip touches; ``contact`` is added by touching.
    """

    free: Value
    contact: Value


def measure_press(elapsed_s: FloatArray, tension_n: FloatArray, speed_m_s: float) -> Press:
    """Return the slopes before and after the touch in a pull of constant speed.

    Two straight lines: one from a quarter of the tension up to the touch, one from
    `CONTACT_SETTLE_S` after it to the end of the pull. The uncertainties are those of the lines,
    with the scatter about the free one. The samples are those from slack to the end of the pull,
    of shape (n,) [s, N]. Too few on either line, or no touch, is an `UndefinedFeatureError`.
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

    A constant and one exponential, by non-linear least squares over evenly spaced samples of shape
    (n,) [s, N]; its uncertainty is that of the fit, with its residuals' scatter. None, one that is
    too slow for the hold, several, or fewer than four samples are an `UndefinedFeatureError`.
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


class Ripple(NamedTuple):
    """A periodic part of a window: its fundamental, and the number of harmonics that it has."""

    frequency_hz: float
    standard_uncertainty_hz: float
    harmonics: int


class _Fit(NamedTuple):
    frequency_hz: float
    harmonics: int
    squares: float
    residual: FloatArray
    lever: FloatArray


def find_ripple(elapsed_s: FloatArray, tension_n: FloatArray) -> Ripple:
    """Return the fundamental of the periodic part of a window.

    Harmonics of one frequency beside a cubic trend, by non-linear least squares; the number
    of harmonics, and with it the choice between a frequency and its fractions, by
    Schwarz's criterion. The uncertainty is the sandwich estimate of that fit with one
    cluster a period (Liang and Zeger, Biometrika 73, 1986): what the periods do not
    have in common counts, be it noise or not. The samples are evenly spaced, of shape (n,) [s, N].

    Where no periodic part stands out, it is an `UndefinedFeatureError`. It must do so from the
    tension, whose noise is white where the sensor's is, and from its differences, whose noise is
    white where the tension drifts as a random walk does: each by an F test, corrected for the
    number of frequencies that were looked at.
    """
    elapsed_s, tension_n = average_samples(elapsed_s, tension_n)
    elapsed_s = elapsed_s - elapsed_s[0]
    n = len(tension_n)
    if n < 8 * MIN_PERIODS:
        raise UndefinedFeatureError(f'{n} samples are too few to look for periodic grooves')
    span_s = float(elapsed_s[-1])
    trend = _make_columns(elapsed_s, 0.0, 0)
    rest = _remove(trend, tension_n)
    fits = [
        fit
        for frequency_hz, harmonics in _find_candidates(rest, (n - 1) / span_s)
        if (fit := _refine(elapsed_s, rest, frequency_hz, harmonics)) is not None
        and fit.frequency_hz * span_s >= MIN_PERIODS
    ]
    best = min(fits, key=lambda fit: _schwarz(n, fit.squares, fit.harmonics), default=None)
    if best is not None:
        best = _leave_echoes(elapsed_s, rest, best)
    if best is None or not _is_significant(elapsed_s, tension_n, best):
        raise UndefinedFeatureError(
            'no periodic grooves found: no ripple stands out from trend and noise '
            f'(false alarms below {100 * FALSE_ALARM:g} %)'
        )
    return Ripple(best.frequency_hz, _spread_hz(elapsed_s, best), best.harmonics)


def _make_columns(elapsed_s: FloatArray, frequency_hz: float, harmonics: int) -> FloatArray:
    """Cubic trend, cosines and sines of the harmonics, shape (n, 4 + 2 harmonics)."""
    place = 2 * elapsed_s / elapsed_s[-1] - 1
    angle = 2 * np.pi * frequency_hz * elapsed_s[:, np.newaxis] * np.arange(1, harmonics + 1)
    trend = np.vander(place, _TREND_DEGREE + 1)
    return np.hstack([trend, np.cos(angle), np.sin(angle)])


def _solve(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Least squares by the normal equations: harmonics and scaled powers are well apart.

    Without BLAS, whose threads cost more than they bring on so little.
    """
    gram = np.einsum('ij,ik->jk', columns, columns)
    return np.asarray(np.linalg.solve(gram, np.einsum('ij,i->j', columns, values)))


def _remove(columns: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(values - np.einsum('ij,j->i', columns, _solve(columns, values)))


def _schwarz(n: int, squares: float, harmonics: int) -> float:
    return n * math.log(max(squares, 1e-300)) + (2 * harmonics + 1) * math.log(n)


def _find_candidates(rest: FloatArray, rate_hz: float) -> list[tuple[float, int]]:
    """Frequency and number of harmonics where the sum of the harmonics' power is best."""
    n = len(rest)
    size = _OVERSAMPLING * n
    power = 2 / n * np.abs(np.fft.rfft(rest, size)) ** 2
    last = int(_TOP_SHARE * size / 2)
    low = math.ceil(MIN_PERIODS * _OVERSAMPLING)
    fundamental = np.arange(low, last + 1)
    total = float(np.sum(rest * rest))
    left = np.full(len(fundamental), total)
    score = np.full(len(fundamental), np.inf)
    harmonics = np.ones(len(fundamental), dtype=np.intp)
    for h in range(1, MAX_HARMONICS + 1):
        there = h * fundamental <= last
        left[there] -= power[h * fundamental[there]]
        # What the neighbouring harmonics share is counted twice: never all of it.
        squares = np.maximum(left, 1e-3 * total)
        now = n * np.log(np.maximum(squares, 1e-300)) + (2 * h + 1) * math.log(n)
        better = there & (now < score)
        score[better], harmonics[better] = now[better], h
    inner = (score[1:-1] <= score[:-2]) & (score[1:-1] <= score[2:])
    peaks = np.flatnonzero(inner) + 1
    chosen = peaks[np.argsort(score[peaks], kind='stable')[:_CANDIDATES]]
    return [(float(fundamental[i] * rate_hz / size), int(harmonics[i])) for i in chosen]


def _refine(
    elapsed_s: FloatArray, rest: FloatArray, frequency_hz: float, harmonics: int
) -> _Fit | None:
    """Gauss-Newton on the frequency, all else solved for; None when it runs away."""
    start_hz, resolution_hz = frequency_hz, 1 / float(elapsed_s[-1])
    turn = 2 * np.pi * elapsed_s[:, np.newaxis] * np.arange(1, harmonics + 1)
    for _ in range(_PITCH_ITERATIONS):
        columns = _make_columns(elapsed_s, frequency_hz, harmonics)
        solved = _solve(columns, rest)
        residual = rest - np.einsum('ij,j->i', columns, solved)
        waves = columns[:, _TREND_DEGREE + 1 :]
        cosines, sines = waves[:, :harmonics], waves[:, harmonics:]
        cosine_part, sine_part = np.split(solved[_TREND_DEGREE + 1 :], 2)
        slope = np.einsum('ij,j->i', turn * cosines, sine_part)
        slope -= np.einsum('ij,j->i', turn * sines, cosine_part)
        lever = _remove(columns, slope)
        weight = float(np.sum(lever * lever))
        if weight == 0.0:
            return None
        step_hz = float(np.sum(lever * residual)) / weight
        if abs(step_hz) < _CLOSE * resolution_hz:
            return _Fit(frequency_hz, harmonics, float(np.sum(residual**2)), residual, lever)
        frequency_hz += max(-0.2, min(0.2, step_hz / resolution_hz)) * resolution_hz
        if abs(frequency_hz - start_hz) > resolution_hz:
            return None
    return None


def _leave_echoes(elapsed_s: FloatArray, rest: FloatArray, fit: _Fit) -> _Fit:
    """Return the fit of a multiple of the frequency where that explains nearly as much.

    Edges that pass every 7.5 samples come out a little different every other time, so that the
    samples repeat after two periods only.
    """
    total = float(np.sum(rest * rest))
    for multiple in range(fit.harmonics, 1, -1):
        harmonics = fit.harmonics // multiple
        higher = _refine(elapsed_s, rest, multiple * fit.frequency_hz, harmonics)
        if higher and total - higher.squares >= _MAIN_SHARE * (total - fit.squares):
            return higher
    return fit


def _spread_hz(elapsed_s: FloatArray, fit: _Fit) -> float:
    period = np.floor(elapsed_s * fit.frequency_hz).astype(np.intp)
    scores = np.bincount(period, weights=fit.lever * fit.residual)
    count = len(scores)
    variance = float(np.sum(scores * scores)) * count / (count - 1)
    of_periods = math.sqrt(variance) / float(np.sum(fit.lever * fit.lever))
    # When an edge passed is known to one sample; over the window that is a change of pitch.
    of_sampling = fit.frequency_hz / (len(elapsed_s) * math.sqrt(12))
    return math.hypot(of_periods, of_sampling)


def _is_significant(elapsed_s: FloatArray, tension_n: FloatArray, fit: _Fit) -> bool:
    looked_at = len(tension_n) * _TOP_SHARE / 2 * MAX_HARMONICS
    for times, values in ((elapsed_s, tension_n), (elapsed_s[1:], np.diff(tension_n))):
        columns = _make_columns(times, fit.frequency_hz, fit.harmonics)
        total = float(np.sum(_remove(columns[:, : _TREND_DEGREE + 1], values) ** 2))
        left = float(np.sum(_remove(columns, values) ** 2))
        free = len(values) - columns.shape[1] - 1
        if free < 1 or total <= 0.0:
            return False
        # Upper tail of F(2 h + 1, free), as an incomplete beta function of the share left.
        tail = incomplete_beta(free / 2, fit.harmonics + 0.5, min(1.0, left / total))
        if tail * looked_at > FALSE_ALARM:
            return False
    return True


def measure_glide(
    samples: Samples, speed_m_s: float, speed_uncertainty: float
) -> tuple[Measure, ...]:
    """Return the pitch of the grooves under a glide.

    The speed is 0 where it is not known [m/s]; its standard uncertainty is relative [1].
    """

    def find_pitch() -> tuple[Value]:
        if not speed_m_s > 0.0:
            raise UndefinedFeatureError('the trial does not say how fast the finger glided')
        ripple = find_ripple(*_split(samples))
        pitch_m = speed_m_s / ripple.frequency_hz
        relative = ripple.standard_uncertainty_hz / ripple.frequency_hz
        return (Value(pitch_m, pitch_m * math.hypot(relative, speed_uncertainty)),)

    return _try(find_pitch, (GROOVE_PITCH,), 'm')


def measure_hold(
    samples: Samples, pull: Samples, pull_speed_m_s: float, no_pull: str = ''
) -> tuple[Measure, ...]:
    """Return the stiffness that the pull into contact met, and how the hold relaxes.

    The speed is that of the tendon in the pull; 0: not known [m/s]. ``no_pull`` says why the
    samples of the pull are not to be used; empty otherwise.
    """

    def press() -> Press:
        if no_pull:
            raise UndefinedFeatureError(no_pull)
        if not pull_speed_m_s > 0.0:
            raise UndefinedFeatureError('the trial does not say how fast the tendon was pulled')
        return measure_press(*_split(pull), pull_speed_m_s)

    return (
        *_try(press, (FREE_STIFFNESS, CONTACT_STIFFNESS), 'N/m'),
        *_try(lambda: (measure_relaxation(*_split(samples)),), (RELAXATION_TIME,), 's'),
    )


def _split(samples: Samples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Seconds since the first sample, and tension, each in memory of its own."""
    tension_n = np.array(samples['tension_n'])
    if not (np.abs(tension_n) < _LARGEST_N).all():
        raise UndefinedFeatureError(f'the tension goes beyond {_LARGEST_N:g} N')
    return (samples['stamp_ns'] - samples['stamp_ns'][0]) * 1e-9, tension_n


def _try(
    estimate: Callable[[], Iterable[Value]], names: Sequence[str], unit: str
) -> tuple[Measure, ...]:
    try:
        values = tuple(estimate())
    except UndefinedFeatureError as error:
        return tuple(Measure(name, unit, reason=str(error)) for name in names)
    except (ZeroDivisionError, np.linalg.LinAlgError):
        reason = 'the samples have no spread in time or no ripple'
        return tuple(Measure(name, unit, reason=reason) for name in names)
    return tuple(
        Measure(name, unit, float(value.value), float(value.standard_uncertainty))
        for name, value in zip(names, values, strict=True)
    )
