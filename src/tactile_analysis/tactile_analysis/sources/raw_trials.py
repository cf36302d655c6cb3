# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One trial as read from a source, and conversion of trials to the arrays of an archive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.options import SourceError
from tactile_analysis.sources.files import ImportNotes, LAYOUT
from tactile_bags.trial import mean_period_s
from tactile_classifier.datasets.archive import LARGEST_N, NEWTONS
from tactile_features.config import round_rate

GAP_PERIODS = 3.5
"""Longest pause that is interpolated, in sample periods: up to two samples are lost."""

RATE_TOLERANCE = 0.01
"""Largest relative difference between a stated rate and the rate of the stamps."""

RESERVED = ('x', 'rate_hz', 'length', 'offsets', 'unit', 'channel_names')
"""Names of arrays in an archive that are not columns."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RawTrial:
    """The samples of one trial.

    ``values`` has shape (channels, samples). ``time_s`` has shape (samples,) and an arbitrary zero
    [s]; it is None if the source has no times. ``columns`` are the known properties: ``label``,
    ``source`` and others. ``channels`` and ``units`` are empty if unknown; single units may be
    empty, too. ``stated_rate_hz`` is the sample rate in the source [Hz].
    """

    name: str
    values: Floats
    time_s: Floats | None = None
    columns: Mapping[str, Any] = field(default_factory=dict)
    channels: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    stated_rate_hz: float | None = None

    @property
    def unit(self) -> str:
        """The unit of all channels; empty if unknown or not the same for all."""
        return self.units[0] if len(set(self.units)) == 1 else ''

    def in_newtons(self, unit: str = '') -> RawTrial:
        """Return the trial with forces in newtons; channels with other units are unchanged.

        ``unit`` is the unit of all channels, if stated. Raises `SourceError` for forces beyond
        `LARGEST_N`.
        """
        for other in set(filter(None, self.units)) - {unit}:
            if unit:
                raise SourceError(
                    f'the heading of trial {self.name} states {other}, but --unit is {unit}; '
                    'omit the option, or correct the heading'
                )
        units = (unit,) * len(self.values) if unit else self.units
        if not any(each in NEWTONS for each in units):
            return replace(self, units=units)
        factors = np.array([NEWTONS.get(each, 1.0) for each in units])
        values = self.values if (factors == 1.0).all() else self.values * factors[:, np.newaxis]
        names = self.channels or [f'channel {i}' for i in range(len(units))]
        for name, own, channel in zip(names, units, values, strict=True):
            if own in NEWTONS:
                _check_forces(channel, f'trial {self.name}, {name}')
        return replace(self, values=values, units=tuple('N' if u in NEWTONS else u for u in units))

    @property
    def rate_hz(self) -> float | None:
        """The sample rate of the source or of the stamps [Hz]; None if both are missing."""
        if self.stated_rate_hz is not None:
            return self.stated_rate_hz
        period_s = mean_period_s(self.time_s)
        return None if period_s is None else round_rate(1.0 / period_s)


def _check_forces(values_n: Floats, where: str) -> None:
    """Raise `SourceError` for a force beyond `LARGEST_N`; ``where`` is used in the message."""
    with np.errstate(invalid='ignore'):
        beyond = np.flatnonzero(np.abs(values_n) > LARGEST_N)
    if len(beyond):
        raise SourceError(
            f'{where}: sample {beyond[0]} is {values_n[beyond[0]]:.6g} N, but tendons carry at '
            f'most {LARGEST_N:g} N; check the unit (--unit) and the decimal mark '
            '(--decimal)?'
        )


def arrays_from_trials(
    trials: Sequence[RawTrial], rate_hz: float | None, notes: ImportNotes, *, skip_bad: bool
) -> dict[str, NDArray[Any]]:
    """Return ``x``, ``label``, ``rate_hz``, ``length`` and columns, as in an archive.

    Samples of trials whose stamps are even within half a period are unchanged. Samples of other
    trials are interpolated to an even grid. By default, ``rate_hz`` [Hz] is the rate of the
    stamps. With ``skip_bad``, trials with pauses or fewer than two samples are skipped; otherwise
    they raise `SourceError`.
    """
    if not trials:
        raise SourceError(f'there are no trials\n{LAYOUT}')
    rate_hz = _choose_rate(trials, rate_hz, notes)
    kept: list[RawTrial] = []
    signals: list[Floats] = []
    filled = 0
    for trial in trials:
        try:
            values, changed = _make_even(trial, rate_hz)
        except SourceError as error:
            if not skip_bad:
                raise SourceError(f'{error}; --skip-bad skips such trials') from error
            notes.add(f'skipped: {error}')
            continue
        kept.append(trial)
        signals.append(values)
        filled += changed
    if filled:
        notes.add(
            f'{filled} of {len(trials)} trials have uneven stamps or lost samples: interpolated '
            f'linearly to an even {rate_hz:g} Hz'
        )
    if not kept:
        raise SourceError('no trial is usable')
    channels = {len(values) for values in signals}
    if len(channels) > 1:
        raise SourceError(
            f'the trials have {" and ".join(map(str, sorted(channels)))} channels; '
            'all must have the same number'
        )
    names = list(dict.fromkeys(trial.channels for trial in kept if trial.channels))
    if len(names) > 1 and channels != {1}:
        raise SourceError(
            f'the channels of the trials differ: {", ".join(names[0])}, and '
            f'{", ".join(names[1])}; state them with --force-column or --field'
        )
    lengths = np.array([values.shape[1] for values in signals])
    count = channels.pop()
    x = np.zeros((len(kept), count, int(lengths.max())))
    for row, values in enumerate(signals):
        x[row, :, : values.shape[1]] = values
    arrays = {
        'x': x,
        'rate_hz': np.array(rate_hz),
        **join_columns([(t.columns, t.name) for t in kept], notes),
    }
    if names and count > 1:
        arrays['channel_names'] = np.array(names[0])
    if (lengths != lengths[0]).any():
        arrays['length'] = lengths
    return arrays


def find_fault(trial: RawTrial, rate_hz: float | None) -> str:
    """Return why a trial is unusable at a rate [Hz]; empty if it is usable or no rate is known."""
    try:
        if rate_hz is not None:
            _make_even(trial, rate_hz)
    except SourceError as error:
        return str(error)
    return ''


def _choose_rate(trials: Sequence[RawTrial], rate_hz: float | None, notes: ImportNotes) -> float:
    found: list[_OwnRate] = []
    for trial in trials:
        stated, period_s = trial.stated_rate_hz, mean_period_s(trial.time_s)
        if stated is not None:
            found.append(_OwnRate(stated, trial, f'trial {trial.name} says'))
        if period_s is not None:
            found.append(_OwnRate(1.0 / period_s, trial, f'the stamps of trial {trial.name} say'))
            if stated is not None:
                _check_rate('the file says', stated, found[-1:], '')
    if rate_hz is not None:
        _check_rate('--rate-hz says', rate_hz, found, 'omit the option, or ')
        return rate_hz
    silent = [t.name for t in trials if t.stated_rate_hz is None and t.time_s is None]
    if silent or not found:
        who = f'trial {silent[0]} has' if silent and found else 'the recordings have'
        raise SourceError(f'{who} no times, so the sample rate is unknown: --rate-hz')
    groups = _group_by_rate(np.array([own.rate_hz for own in found]))
    if len(groups) > 1:
        told = _format_rates([(rate, [found[i].trial for i in rows]) for rate, rows in groups])
        raise SourceError(
            f'the trials have different rates: {told}; use recordings of one rate at a time'
        )
    if stated_hz := next((t.stated_rate_hz for t in trials if t.stated_rate_hz), None):
        return stated_hz
    rate_hz = groups[0][0]
    notes.add(f'rate: {rate_hz:g} Hz, from the stamps')
    return rate_hz


class _OwnRate(NamedTuple):
    """The sample rate of a trial [Hz]; ``words`` say whether it is stated or from stamps."""

    rate_hz: float
    trial: RawTrial
    words: str


def _check_rate(source: str, rate_hz: float, found: Sequence[_OwnRate], way_out: str) -> None:
    """Refuse a rate [Hz] that differs from the trials' rates; name the most different one."""
    own = max(found, key=lambda own: abs(own.rate_hz - rate_hz), default=None)
    if own is not None and abs(own.rate_hz - rate_hz) > RATE_TOLERANCE * rate_hz:
        raise SourceError(
            f'{source} {rate_hz:g} Hz, but {own.words} {own.rate_hz:.6g} Hz; {way_out}state '
            'the unit of the times (--time-unit ms). `tactile evaluate`, `train` and '
            '`features` change the rate with --resample-hz'
        )


def _group_by_rate(rates: Floats) -> list[tuple[float, NDArray[np.intp]]]:
    """Return each rate [Hz] with the indices of its trials; the most frequent rate comes first."""
    left, groups = np.arange(len(rates)), []
    while len(left):
        usual = np.sort(rates[left])[len(left) // 2]  # unlike np.median, the rate of a real trial
        is_same = np.abs(rates[left] / usual - 1.0) <= RATE_TOLERANCE
        groups.append((round_rate(float(np.median(rates[left[is_same]]))), left[is_same]))
        left = left[~is_same]
    return sorted(groups, key=lambda group: -len(group[1]))


def _format_rates(groups: Sequence[tuple[float, Sequence[RawTrial]]]) -> str:
    """Return each rate with its files, or with its trials if a file has several rates."""
    sources = [{str(t.columns.get('source', '')) for t in trials} for _, trials in groups]
    is_of_one_rate = len(set().union(*sources)) == sum(map(len, sources))
    parts = []
    for (rate_hz, trials), files in zip(groups, sources, strict=True):
        names = sorted(files) if is_of_one_rate else [f'trial {t.name}' for t in trials]
        more = f' and {len(names) - 3} more' if len(names) > 3 else ''
        parts.append(f'{rate_hz:g} Hz ({", ".join(names[:3])}{more})')
    return ', '.join(parts)


def _make_even(trial: RawTrial, rate_hz: float) -> tuple[Floats, bool]:
    """Return the samples at an even rate, and whether they were changed."""
    count = trial.values.shape[1]
    if count < 2:
        raise SourceError(f'trial {trial.name} has {count} samples')
    time_s = trial.time_s
    if time_s is None:
        return trial.values, False
    if not np.isfinite(time_s).all():
        raise SourceError(f'trial {trial.name}: a time is missing')
    steps = np.diff(time_s)
    if (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0)) + 1
        raise SourceError(f'trial {trial.name}: the time does not increase at its sample {row}')
    if steps.max() * rate_hz > GAP_PERIODS:
        at = int(np.argmax(steps))
        raise SourceError(
            f'trial {trial.name}: no samples for {steps[at]:.4g} s, from '
            f'{time_s[at] - time_s[0]:.4g} s on'
        )
    places = (time_s - time_s[0]) * rate_hz
    line = np.linspace(0.0, places[-1], count)
    drift = abs(places[-1] - (count - 1))
    if np.abs(places - line).max() <= 0.5 and drift <= max(0.5, RATE_TOLERANCE * count):
        return trial.values, False
    grid = np.arange(math.floor(places[-1] + 1e-6) + 1, dtype=np.float64)
    return np.stack([np.interp(grid, places, channel) for channel in trial.values]), True


def join_columns(
    trials: Sequence[tuple[Mapping[str, Any], str]], notes: ImportNotes | None = None
) -> dict[str, NDArray[Any]]:
    """Return the columns that every trial has, including the label and the name of the trial.

    ``trials`` has the properties and the name of each trial. Omitted columns are noted in
    ``notes``.
    """
    first = trials[0][0]
    shared = [name for name in first if all(name in columns for columns, _ in trials)]
    lost = sorted({name for columns, _ in trials for name in columns} - set(shared))
    if lost and notes is not None:
        notes.add(f'omitted, because some trials lack it: {", ".join(lost)}')
    # Names with a special meaning in an archive cannot be used for columns.
    named = {name: f'{name}_' if name in RESERVED else name for name in shared}
    found = {named[name]: np.array([columns[name] for columns, _ in trials]) for name in shared}
    if 'session' in found and 'session_id' not in found:
        found['session_id'] = found.pop('session')  # the name that splits require
    found['trial'] = np.array([name for _, name in trials])
    found['label'] = found['label'].astype(str)
    return found
