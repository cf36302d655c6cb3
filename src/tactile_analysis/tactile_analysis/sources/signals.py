# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials from sources other than bags of this package, and their signals at a constant rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import product
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.files import ImportNotes
from tactile_bags.trial import mean_period_s, Signal, Trial
from tactile_features.config import round_rate

GAP_PERIODS = 3.5
"""Longest time between two samples that is interpolated, in sample periods.

Up to two samples in between may be lost.
"""

RATE_TOLERANCE = 0.01
"""Largest relative difference between a stated rate and the rate computed from the stamps."""

NEWTONS = {
    'N': 1.0, 'mN': 1e-3, 'uN': 1e-6, 'µN': 1e-6, 'kN': 1e3, 'g': 9.80665e-3, 'kg': 9.80665,
}  # fmt: skip
"""Factors from units of force to newtons. Values in g and kg are weights at standard gravity."""

LARGEST_N = 1e6
"""Values above this limit are implausible as tension of a tendon [N]."""

MAX_MAGNITUDE = 1e100
"""Largest accepted absolute value of a signal, because squares of larger values could overflow."""

_MAX_FACTOR = 10_000  # at this factor, the resampling filter has 100,000 taps on each side

Floats = NDArray[np.float64]


def make_trial(
    name: str,
    values: NDArray[Any],
    time_s: Floats | None,
    columns: Mapping[str, Any],
    options: SourceOptions,
    notes: ImportNotes,
    *,
    source: str = '',
    channels: tuple[str, ...] = (),
    units: tuple[str, ...] = (),
    rate_hz: float | None = None,
) -> Trial:
    """Return a trial with forces in newtons; if it is unusable, ``why_not`` has the reason.

    Parameters
    ----------
    name : str
    values : ndarray of shape (channels, samples)
        Numbers of any type; they are converted to float64 when the signal is read.
    time_s : ndarray of shape (samples,), or None
        Times from an arbitrary zero [s]; None if the source has no times.
    columns : mapping
        Known properties of the trial: ``label``, ``source`` and others.
    options : SourceOptions
        States the unit and the rate, if the source does not.
    notes : ImportNotes
        Record of the import, to which conversions of units are added.
    source : str
        File or bag; default: the column ``source``.
    channels, units : tuple of str
        Name and unit of each channel. Both are empty if they are unknown. A single unknown unit
        is an empty string.
    rate_hz : float, optional
        Sample rate that the source states [Hz].

    Raises
    ------
    SourceError
        When the source states another unit than ``options``.
    """
    units = _join_units(name, units, options.unit, len(values))
    channels = channels or tuple(f'channel_{i}' for i in range(len(values)))
    factors = np.array([NEWTONS.get(unit, 1.0) for unit in units])[:, np.newaxis]
    if (factors != 1.0).any():
        converted = dict.fromkeys(unit for unit in units if unit in NEWTONS and unit != 'N')
        notes.add(f'force: converted from {", ".join(converted)} to N')
    units = tuple('N' if unit in NEWTONS else unit for unit in units)
    stated_hz = options.rate_hz or rate_hz
    period_s = mean_period_s(time_s)
    rate = stated_hz or (None if period_s is None else round_rate(1.0 / period_s))
    if stated_hz is None and rate is not None:
        notes.rate_from_stamps = True
    why_not = (
        _find_fault(values, factors, channels, units)
        or _find_rate_fault(options.rate_hz, rate_hz, period_s)
        or find_time_fault(time_s, rate)
    )

    def load() -> Signal:
        times = time_s
        if times is None and rate is not None:
            times = np.arange(values.shape[1]) / rate
        unit = units[0] if len(set(units)) == 1 else ''
        found = np.asarray(values, dtype=np.float64)
        found = found if (factors == 1.0).all() else found * factors
        return Signal(times, found, channels, unit, rate)

    def known(*names: str) -> str:
        return str(next((columns[n] for n in names if n in columns), ''))

    return Trial(
        name=name,
        source=source or known('source'),
        label=known('label'),
        session_id=known('session_id', 'session'),
        mounting_id=known('mounting_id', 'mounting'),
        contact=known('contact'),
        task=known('task'),
        why_not=f'trial {name}: {why_not}' if why_not else None,
        is_faulty=bool(why_not),
        columns=columns,
        load_signal=load,
    )


def _join_units(name: str, units: tuple[str, ...], stated: str, count: int) -> tuple[str, ...]:
    """Return the unit of each channel; raise SourceError if the source contradicts ``stated``."""
    for other in set(filter(None, units)) - {stated}:
        if stated:
            raise SourceError(
                f'trial {name} is in {other}, but --unit is {stated}: omit the option, or correct '
                'the heading'
            )
    return (stated,) * count if stated else units or ('',) * count


def _find_fault(
    values: NDArray[Any], factors: Floats, channels: Sequence[str], units: Sequence[str]
) -> str:
    """Return why the values are unusable; empty if they are usable."""
    if values.shape[1] < 2:
        return f'it has {values.shape[1]} samples'
    for channel, factor, name, unit in zip(values, factors[:, 0], channels, units, strict=True):
        # Converted to Python floats, because float32 cannot represent the limit of 1e100.
        low, high = float(channel.min()) * factor, float(channel.max()) * factor
        if not (math.isfinite(low) and math.isfinite(high)):
            bad = np.flatnonzero(~np.isfinite(channel))
            return (
                f'channel {name} is not finite at {len(bad)} of {len(channel)} samples, first at '
                f'sample {bad[0]}'
            )
        if unit == 'N' and max(-low, high) > LARGEST_N:
            return (
                f'channel {name}, sample {np.abs(channel).argmax()} is {max(-low, high):.6g} N, '
                f'but tendons carry at most {LARGEST_N:g} N; check the unit (--unit) and the '
                'decimal mark (--decimal)'
            )
        if max(-low, high) > MAX_MAGNITUDE:
            return (
                f'channel {name} exceeds {MAX_MAGNITUDE:g}, its squares would overflow: scale it'
            )
    return ''


def find_time_fault(time_s: Floats | None, rate_hz: float | None) -> str:
    """Return why samples at these times cannot be used at a constant rate; empty if they can."""
    if time_s is None or rate_hz is None:
        return ''
    if not np.isfinite(time_s).all():
        return 'a time is missing'
    steps = np.diff(time_s)
    if (steps <= 0.0).any():
        return f'the time does not increase at its sample {int(np.argmax(steps <= 0.0)) + 1}'
    if steps.max() * rate_hz > GAP_PERIODS:
        at = int(np.argmax(steps))
        return f'no samples for {steps[at]:.4g} s, from {time_s[at] - time_s[0]:.4g} s on'
    return ''


def _find_rate_fault(
    option_hz: float | None, file_hz: float | None, period_s: float | None
) -> str:
    """Return a sentence about two rates that contradict each other; empty if all rates agree.

    The rates are ``option_hz`` from the options, ``file_hz`` from the file, and the rate of stamps
    with the mean period ``period_s``.
    """
    stamps_hz = 1.0 / period_s if period_s else None
    stated = [('--rate-hz says', option_hz), ('the file says', file_hz)]
    own = [('the file says', file_hz), ('its stamps say', stamps_hz)]
    for (source, stated_hz), (other, own_hz) in product(stated, own):
        if stated_hz and own_hz and abs(own_hz - stated_hz) > RATE_TOLERANCE * stated_hz:
            return (
                f'{source} {stated_hz:g} Hz, but {other} {own_hz:.6g} Hz; state the unit of the '
                'times (--time-unit ms), or omit --rate-hz. `tactile evaluate`, `train` and '
                '`features` change the rate with --resample-hz'
            )
    return ''


def choose_rate(trials: Sequence[Trial]) -> float:
    """Return the common sample rate of trials [Hz].

    Raises SourceError if a rate is unknown, or if the rates differ.
    """
    rates = [trial.signal.rate_hz for trial in trials]
    silent = [trial.name for trial, rate_hz in zip(trials, rates, strict=True) if not rate_hz]
    if silent:
        who = f'trial {silent[0]} has' if any(rates) else 'the recordings have'
        raise SourceError(f'{who} no times, so the sample rate is unknown: --rate-hz')
    groups = _group_by_rate(np.array(rates, dtype=np.float64))
    if len(groups) > 1:
        named = _format_rates([(rate, [trials[i] for i in rows]) for rate, rows in groups])
        raise SourceError(
            f'the trials have different rates: {named}; use recordings of one rate at a time'
        )
    return groups[0][0]


def _group_by_rate(rates: Floats) -> list[tuple[float, NDArray[np.intp]]]:
    """Return each rate [Hz] with the indices of its trials; the most frequent rate comes first."""
    left, groups = np.arange(len(rates)), []
    while len(left):
        usual = np.sort(rates[left])[len(left) // 2]  # np.median could be the rate of no trial
        is_same = np.abs(rates[left] / usual - 1.0) <= RATE_TOLERANCE
        same = rates[left[is_same]]
        is_exact = bool((same == same[0]).all())  # for example, if an archive states the rate
        rate_hz = float(same[0]) if is_exact else round_rate(float(np.median(same)))
        groups.append((rate_hz, left[is_same]))
        left = left[~is_same]
    return sorted(groups, key=lambda group: -len(group[1]))


def _format_rates(groups: Sequence[tuple[float, Sequence[Trial]]]) -> str:
    """Return a text with the files of each rate, or its trials if a file has several rates."""
    sources = [{trial.source for trial in trials} for _, trials in groups]
    is_of_one_rate = len(set().union(*sources)) == sum(map(len, sources))
    parts = []
    for (rate_hz, trials), files in zip(groups, sources, strict=True):
        names = sorted(files) if is_of_one_rate else [f'trial {t.name}' for t in trials]
        more = f' and {len(names) - 3} more' if len(names) > 3 else ''
        parts.append(f'{rate_hz:g} Hz ({", ".join(names[:3])}{more})')
    return ', '.join(parts)


def make_even(signal: Signal, rate_hz: float) -> Signal:
    """Return the signal at a constant rate [Hz].

    If all times are within half a period of a constant rate, the samples are not changed.
    Otherwise, they are interpolated linearly. The times must increase.
    """
    time_s, count = signal.time_s, signal.values.shape[1]
    assert time_s is not None, 'the rate is known'
    places = (time_s - time_s[0]) * rate_hz
    line = np.linspace(0.0, places[-1], count)
    drift = abs(places[-1] - (count - 1))
    if np.abs(places - line).max() <= 0.5 and drift <= max(0.5, RATE_TOLERANCE * count):
        return replace(signal, rate_hz=rate_hz)
    grid = np.arange(math.floor(places[-1] + 1e-6) + 1, dtype=np.float64)
    values = np.stack([np.interp(grid, places, channel) for channel in signal.values])
    return replace(signal, time_s=grid / rate_hz, values=values, rate_hz=rate_hz)


def resample(signal: Signal, rate_hz: float) -> Signal:
    """Resample a signal of constant rate to another rate [Hz] with `scipy.signal.resample_poly`.

    The anti-aliasing filter has linear phase and no delay. It uses a Kaiser window with beta 5 and
    extends over ten periods of the slower rate on each side. Beyond both ends, the signal is
    extrapolated by the line through its first and last sample. Raises SourceError if the ratio of
    the rates is not a ratio of two integers up to 10,000.
    """
    from scipy.signal import resample_poly  # takes half a second to import

    assert signal.rate_hz is not None, 'the signal is even'
    up, down = find_ratio(signal.rate_hz, rate_hz)
    values = resample_poly(signal.values, up, down, axis=1, padtype='line')
    return replace(
        signal, time_s=np.arange(values.shape[1]) / rate_hz, values=values, rate_hz=rate_hz
    )


def find_ratio(old_hz: float, new_hz: float) -> tuple[int, int]:
    """Return the factors of upsampling and of downsampling from one rate to another."""
    ratio = Fraction(new_hz / old_hz).limit_denominator(_MAX_FACTOR)
    up, down = ratio.numerator, ratio.denominator
    if not 0 < up <= _MAX_FACTOR or abs(old_hz * up / down / new_hz - 1) > 1e-9:
        raise SourceError(
            f'cannot resample from {old_hz:g} to {new_hz:g} Hz: the ratio must be a ratio of two '
            f'integers up to {_MAX_FACTOR}'
        )
    return up, down


def join_columns(trials: Sequence[tuple[Trial, str]]) -> dict[str, NDArray[Any]]:
    """Return the columns that every trial has, including the label and the name of the trial.

    ``trials`` contains pairs of a trial and its name.
    """
    found = shared_columns([trial for trial, _ in trials])
    found['trial'] = np.array([name for _, name in trials])
    found['label'] = np.array([trial.label for trial, _ in trials])
    return found


def shared_columns(trials: Sequence[Trial]) -> dict[str, NDArray[Any]]:
    """Return the columns that every trial has, without the label."""
    names = [
        name
        for name in trials[0].columns
        if name != 'label' and all(name in trial.columns for trial in trials)
    ]
    found = {name: np.array([trial.columns[name] for trial in trials]) for name in names}
    if 'session' in found and 'session_id' not in found:
        found['session_id'] = found.pop('session')  # the name in feature tables
    return found
