# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Labelled-trials archives: raw signals of many trials in one NumPy ``.npz`` file.

``x`` (trials, channels, samples), ``label`` (trials,), ``rate_hz`` () and any number
of further columns (trials,) to select, group or hold out by. Trials of unequal length are
padded, with ``length``, or joined, with ``offsets``: see `LAYOUT`. No pickled objects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from fractions import Fraction
import math
from pathlib import Path
from typing import Any, IO
import zipfile

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import DatasetError
from tactile_features.spec import ALL, format_rates, is_same_rate, MEAN

MAX_ARCHIVE_BYTES = 2**30
"""Archives whose arrays take more than this are not loaded [byte]."""

MAX_MAGNITUDE = 1e100
"""Largest absolute value in an archive [its unit]."""

NEWTONS = {
    'N': 1.0, 'mN': 1e-3, 'uN': 1e-6, 'µN': 1e-6, 'kN': 1e3, 'g': 9.80665e-3, 'kg': 9.80665,
}  # fmt: skip
"""Units of force [N]; g and kg are weights at standard gravity."""

LARGEST_N = 1e6
"""A larger value is no tension of a tendon [N]."""

FEW_SAMPLES = 16
"""Trials of fewer samples are pointed out: a spectrum of them has eight lines at most."""

LAYOUT = """an archive holds, with one entry a trial where not said otherwise:
  x        numbers of shape (trials, channels, samples), or (trials, samples); or X
  label    strings or integers; or y
  rate_hz  one number; or fs, or --rate-hz
  unit     optional, one string: of x, as in N; forces are converted to N
  channel_names  optional, one string for each channel
  and any further columns
For trials of unequal length, either pad x with anything and add
  length   samples of each trial that count
or join the trials, one after another, in x of shape (channels, all samples) and add
  offsets  (trials + 1,): trial i is x[:, offsets[i]:offsets[i + 1]]"""

_OTHER_NAMES = {
    'x': ('X', 'data', 'signal', 'signals', 'X_train'),
    'label': ('y', 'Y', 'labels', 'target', 'y_train'),
    'rate_hz': ('fs', 'rate', 'sample_rate', 'sampling_rate', 'frequency'),
}

Channel = int | str
"""Number of a channel from 0, its name, ``'mean'`` or ``'all'``."""

Array = npt.NDArray[Any]
Indices = npt.NDArray[np.intp]

_MAX_FACTOR = 10_000  # of a resampling: the filter has ten times as many taps on each side


def _no_numbers() -> Indices:
    return np.empty(0, dtype=np.intp)


@dataclasses.dataclass(frozen=True)
class Skipped:
    """A trial that was left out: its row in the archive, from 0, and why."""

    row: int
    reason: str


@dataclasses.dataclass(frozen=True)
class LabelledTrials:
    """Raw signals of many trials, with what is known about each.

    Attributes
    ----------
    x : ndarray of shape (trials, channels, samples)
        Signals, in ``unit``.
    label : ndarray of str, shape (trials,)
    rate_hz : float
        Sample rate [Hz].
    columns : mapping of str to ndarray of shape (trials,)
    lengths : ndarray of int, shape (trials,)
        Samples of each trial that count; what follows is padding. Left out: all.
    rows : ndarray of int, shape (trials,)
        The row of each trial in the archive, from 0. Left out: these trials are all.
    skip_bad : bool
        Leave out trials that cannot be used; otherwise the first one is an error.
    skipped : tuple of Skipped
        The trials that were left out.
    steps : tuple of str
        What was done to the signals, in words.
    unit : str
        Of the signals, such as ``N``; empty: not known.
    channels : tuple of str
        Names of the channels. Left out: ``channel_0`` and so on.
    """

    x: Array
    label: Array
    rate_hz: float
    columns: Mapping[str, Array]
    lengths: Indices = dataclasses.field(default_factory=_no_numbers)
    rows: Indices = dataclasses.field(default_factory=_no_numbers)
    skip_bad: bool = False
    skipped: tuple[Skipped, ...] = ()
    steps: tuple[str, ...] = ()
    unit: str = ''
    channels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.lengths):
            object.__setattr__(self, 'lengths', np.full(len(self.x), self.x.shape[2]))
        if not len(self.rows):
            object.__setattr__(self, 'rows', np.arange(len(self.x)))
        if not self.channels:
            names = tuple(f'channel_{i}' for i in range(self.x.shape[1]))
            object.__setattr__(self, 'channels', names)

    def __len__(self) -> int:
        return len(self.label)

    def name_channel(self, channel: Channel) -> str:
        """Return the name of a channel, `MEAN` or `ALL`.

        Raises DatasetError when there is no such channel.
        """
        name = str(channel)
        if name in (MEAN, ALL, *self.channels):
            return name
        if name.isdecimal() and int(name) < len(self.channels):
            return self.channels[int(name)]
        raise DatasetError(
            f'there is no channel {name}; there are {len(self.channels)}: '
            f'{", ".join(self.channels)}. Take one by its name, or by its number from 0; or '
            f'"{MEAN}" or "{ALL}"'
        )

    def signal(self, channel: Channel = 0) -> npt.NDArray[np.float64]:
        """Return one channel, or the mean of all, shape (trials, samples).

        Raises DatasetError when there is no such channel.
        """
        name = self.name_channel(channel)
        if name == MEAN:
            return np.asarray(self.x.mean(axis=1, dtype=np.float64))
        if name == ALL:
            raise DatasetError('a signal is that of one channel, or the mean of all')
        return self.x[:, self.channels.index(name)].astype(np.float64)

    def where(self, column: str, value: object = True) -> LabelledTrials:
        """Return the trials whose column has this value.

        Raises DatasetError when there is no such column, or no such trial.
        """
        if column not in self.columns:
            raise DatasetError(
                f'there is no column "{column}"; there are: {", ".join(self.columns) or "none"}'
            )
        keep = np.asarray(self.columns[column] == value)
        if keep.shape != self.label.shape or not keep.any():
            raise DatasetError(f'no trial has {column} = {value}')
        return self.take(keep)

    def take(self, keep: Array) -> LabelledTrials:
        return dataclasses.replace(
            self,
            x=self.x[keep],
            label=self.label[keep],
            columns={name: values[keep] for name, values in self.columns.items()},
            lengths=self.lengths[keep],
            rows=self.rows[keep],
        )

    def drop(self, bad: Mapping[int, str]) -> LabelledTrials:
        """Return the trials without those that are bad, by place among these, and remember why.

        Raises DatasetError when ``skip_bad`` is not set, or no trial is left.
        """
        if not bad:
            return self
        skipped = tuple(Skipped(int(self.rows[i]), bad[i]) for i in sorted(bad))
        first = f'row {skipped[0].row}: {skipped[0].reason}'
        if not self.skip_bad:
            raise DatasetError(
                f'{len(bad)} of {len(self)} trials cannot be used, first {first}; '
                '--skip-bad leaves such trials out'
            )
        if len(bad) == len(self):
            raise DatasetError(f'no trial of {len(self)} can be used, first {first}')
        keep = np.ones(len(self), dtype=bool)
        keep[list(bad)] = False
        return dataclasses.replace(self.take(keep), skipped=(*self.skipped, *skipped))

    def between(self, start_s: float, stop_s: float) -> LabelledTrials:
        """Return the samples from ``start_s`` up to, not including, ``stop_s``.

        Raises DatasetError when no trial lasts so long, no sample is left, or single trials are
        shorter and ``skip_bad`` is not set.
        """
        longest = int(self.lengths.max())
        first, last = (round(t * self.rate_hz, 6) for t in (start_s, stop_s))
        if not 0 <= first < last <= longest:
            raise DatasetError(
                f'the trials last {longest / self.rate_hz:.6g} s; '
                f'{start_s:g} to {stop_s:g} s is not a part of them'
            )
        short = {
            int(i): f'it lasts {self.lengths[i] / self.rate_hz:.6g} s, not {stop_s:g} s'
            for i in np.flatnonzero(self.lengths < last)
        }
        kept = self.drop(short)
        begin, end = math.ceil(first), math.ceil(last)
        x = kept.x[:, :, begin:end]
        return dataclasses.replace(kept, x=x, lengths=np.full(len(x), end - begin))

    def cut_to_shortest(self) -> LabelledTrials:
        """Return all trials cut to the samples of the shortest one, from their begin."""
        shortest = int(self.lengths.min())
        if shortest == self.x.shape[2]:
            return self
        step = (
            f'cut to the first {shortest / self.rate_hz:.6g} s, the length of the shortest trial '
            f'(row {self.rows[np.argmin(self.lengths)]})'
        )
        return dataclasses.replace(
            self,
            x=self.x[:, :, :shortest],
            lengths=np.full(len(self), shortest),
            steps=(*self.steps, step),
        )

    def resample(self, rate_hz: float) -> LabelledTrials:
        """Return the trials at another rate, by `scipy.signal.resample_poly`.

        Its low-pass against aliasing has linear phase and no delay: a Kaiser window with beta 5,
        ten periods of the slower rate on each side. Beyond both ends, the line through the first
        and last sample goes on. Raises DatasetError when the rates have no ratio of whole numbers
        up to 10,000.
        """
        from scipy.signal import resample_poly  # half a second

        ratio = Fraction(rate_hz / self.rate_hz).limit_denominator(_MAX_FACTOR)
        up, down = ratio.numerator, ratio.denominator
        if not 0 < up <= _MAX_FACTOR or abs(self.rate_hz * up / down / rate_hz - 1) > 1e-9:
            raise DatasetError(
                f'cannot resample from {self.rate_hz:g} to {rate_hz:g} Hz: their ratio must be '
                f'that of two whole numbers up to {_MAX_FACTOR}'
            )
        if up == down:
            return self
        lengths = -(-self.lengths * up // down)
        if self.x[:, :, :1].nbytes // self.x.itemsize * 8 * int(lengths.max()) > MAX_ARCHIVE_BYTES:
            raise DatasetError(f'at {rate_hz:g} Hz the trials take more than the limit of memory')
        x = np.zeros((*self.x.shape[:2], int(lengths.max())))
        for count in np.unique(self.lengths):
            same = self.lengths == count
            part = self.x[same, :, :count].astype(np.float64)
            new = resample_poly(part, up, down, axis=2, padtype='line')
            x[same, :, : new.shape[2]] = new
        step = (
            f'resampled from {self.rate_hz:g} to {rate_hz:g} Hz: polyphase filter {up}/{down} '
            'against aliasing, scipy.signal.resample_poly, Kaiser 5.0'
        )
        return dataclasses.replace(
            self, x=x, rate_hz=rate_hz, lengths=lengths, steps=(*self.steps, step)
        )


def load_archive(
    path: str | Path,
    folds: int = 6,
    *,
    skip_bad: bool = False,
    rate_hz: float | None = None,
) -> LabelledTrials:
    """Read a labelled-trials archive.

    Parameters
    ----------
    path : str or Path
    folds : int
        Trials of one label only are refused, because they cannot be cross-validated. 0: trials
        that are not for that.
    skip_bad : bool
        Leave out trials that cannot be used, with the reason in ``skipped``.
    rate_hz : float, optional
        Sample rate, where the archive states none [Hz].

    Raises
    ------
    DatasetError
        With a sentence that says what is wrong with the file.
    """
    path = Path(path)
    return trials_from_arrays(path, read_arrays(path), folds, skip_bad=skip_bad, rate_hz=rate_hz)


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an archive by name, unchecked.

    Raises DatasetError when it is no archive, too large, or holds pickled objects.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            _check_headers(path, archive)
        with np.load(path, allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except FileNotFoundError:
        raise DatasetError(f'{path} does not exist') from None
    except DatasetError:
        raise
    except Exception as error:  # zipfile, zlib and NumPy each have their own
        raise DatasetError(f'{path} is not a readable .npz archive: {error}') from error


def save_archive(path: Path, trials: LabelledTrials) -> None:
    """Write trials as an archive that `load_archive` reads, replacing the file."""
    arrays = {
        **trials.columns,
        'x': trials.x,
        'label': trials.label,
        'rate_hz': np.array(trials.rate_hz),
    }
    if trials.unit:
        arrays['unit'] = np.array(trials.unit)
    if len(trials.channels) > 1:
        arrays['channel_names'] = np.array(trials.channels)
    if (trials.lengths != trials.x.shape[2]).any():
        arrays['length'] = trials.lengths
    # Not by numpy.savez: it cannot hold a column that is named as one of its arguments.
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f'{name}.npy', 'w', force_zip64=True) as member:
                array = np.asarray(array)
                np.lib.format.write_array(member, array, allow_pickle=False)  # type: ignore[no-untyped-call]


def _check_headers(path: Path, archive: zipfile.ZipFile) -> None:
    """Refuse what must not be loaded, by what the headers announce."""
    total = 0
    for member in archive.infolist():
        if not member.filename.endswith('.npy'):
            raise DatasetError(f'{path} holds {member.filename}, which is not an array')
        name = member.filename.removesuffix('.npy')
        with archive.open(member) as stream:
            shape, dtype = _read_header(stream)
        if dtype.hasobject:
            raise DatasetError(
                f'array {name} in {path} holds pickled objects, which are never loaded: '
                'save it with a numeric, boolean or string type'
                + (f'; {LAYOUT}' if name == 'x' else f', as in {name}.astype(str)')
            )
        total += math.prod(shape) * dtype.itemsize
    if total > MAX_ARCHIVE_BYTES:
        raise DatasetError(
            f'{path} unpacks to {total / 2**20:.0f} MiB; '
            f'the limit is {MAX_ARCHIVE_BYTES / 2**20:.0f} MiB'
        )


def _read_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
    read = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)  # type: ignore[no-untyped-call]
    return shape, dtype


def trials_from_arrays(
    path: Path,
    arrays: dict[str, Array],
    folds: int,
    *,
    skip_bad: bool,
    rate_hz: float | None = None,
    unit: str = '',
    needs_label: bool = True,
) -> LabelledTrials:
    """Return the trials of arrays as `load_archive` does; ``path`` names their source.

    ``unit`` is that of the signals, where it is stated. Forces are converted to N. Without
    ``needs_label``, trials may have no label, which is empty then, and hold no signal.
    """
    x, label, rate, steps = _find_arrays(path, arrays, rate_hz, needs_label=needs_label)
    x, lengths = _unpack_signals(path, x, arrays)
    trials = len(x)
    label = _decode_text(path, 'label', label)
    if label.shape != (trials,) or label.dtype.kind not in 'Uiu':
        raise DatasetError(
            f'label in {path} is {label.dtype} of shape {label.shape}; '
            f'it must be strings or integers of shape ({trials},), one a trial'
        )
    channels = _take_channels(path, arrays, x.shape[1])
    own_unit = _take_unit(path, arrays)
    if unit and own_unit not in ('', unit):
        raise DatasetError(f'{path} is in {own_unit}, and --unit is {unit}; leave the option out')
    unit = unit or own_unit
    if unit in NEWTONS and unit != 'N':
        x, steps = x * NEWTONS[unit], (*steps, f'force: converted from {unit} to N')
        unit = 'N'
    if rate.size != 1 or rate.dtype.kind not in 'fiu' or not 0 < float(rate.item()) < math.inf:
        raise DatasetError(f'rate_hz in {path} must be one positive number')
    columns = {}
    for name, column in arrays.items():
        if column.shape != (trials,):
            raise DatasetError(
                f'column {name} in {path} has shape {column.shape}; it must be ({trials},)'
            )
        columns[name] = _decode_text(path, name, column)
    loaded = LabelledTrials(
        x,
        label.astype(str),
        float(rate.item()),
        columns,
        lengths,
        np.arange(trials, dtype=np.intp),
        skip_bad,
        steps=steps,
        unit=unit,
        channels=channels,
    )
    loaded = loaded.drop(_find_unusable(path, x, lengths, unit))
    if folds and len(np.unique(loaded.label)) < 2:
        raise DatasetError(f'{path} has one class only, "{loaded.label[0]}"; record at least two')
    if not needs_label:
        return loaded
    doubts = _format_doubts(path, loaded.x, loaded.lengths, loaded.rows)
    return dataclasses.replace(loaded, steps=(*loaded.steps, *doubts))


def _find_arrays(
    path: Path,
    arrays: dict[str, Array],
    rate_hz: float | None = None,
    *,
    needs_label: bool = True,
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Take signals, labels and rate out of the arrays, under our names or other usual ones.

    With them come sentences on what was taken for what. ``rate_hz`` stands in where the arrays
    state none. Raises DatasetError when one is missing, or the rate is stated twice.
    """
    named = {key: _find_name(key, arrays) for key in ('x', 'label', 'rate_hz')}
    if rate_hz is not None and not named['rate_hz']:
        arrays['rate_hz'], named['rate_hz'] = np.array(rate_hz), 'rate_hz'
    if not named['label'] and named['x'] and not needs_label:
        joined = arrays.get('offsets')
        count = len(arrays[named['x']]) if joined is None else joined.size - 1
        arrays['label'], named['label'] = np.full(count, ''), 'label'
    missing = [key for key, name in named.items() if not name]
    if missing:
        text = f'{path} has no {" and no ".join(missing)}'
        if missing == ['rate_hz']:
            text += '; state the sample rate with --rate-hz'
        raise DatasetError(f'{text}\n{LAYOUT}')
    x, label, rate = (arrays.pop(name) for name in named.values())
    steps = [f'took {name} of {path.name} as {key}' for key, name in named.items() if name != key]
    if rate_hz is not None and not (rate.size == 1 and is_same_rate(float(rate.item()), rate_hz)):
        own, stated = (
            format_rates(float(rate.item()), rate_hz) if rate.size == 1 else (rate, rate_hz)
        )
        raise DatasetError(
            f'{path} says {named["rate_hz"]} = {own}, and --rate-hz says {stated}; '
            'to change the rate, use --resample-hz'
        )
    if x.ndim == 2 and 'offsets' not in arrays:
        steps.append(f'took the {x.shape} numbers of {path.name} as trials x samples, one channel')
        x = x[:, np.newaxis, :]
    return x, label, rate, tuple(steps)


def _take_unit(path: Path, arrays: dict[str, Array]) -> str:
    """Take the unit of the signals out of the arrays; a column of units stays."""
    if 'unit' not in arrays or arrays['unit'].ndim:
        return ''
    unit = _decode_text(path, 'unit', arrays.pop('unit'))
    if unit.dtype.kind != 'U':
        raise DatasetError(f'unit in {path} must be one string, as in N')
    return str(unit.item())


def _take_channels(path: Path, arrays: dict[str, Array], count: int) -> tuple[str, ...]:
    """Take the names of the channels out of the arrays; none: they are not named."""
    if 'channel_names' not in arrays:
        return ()
    names = _decode_text(path, 'channel_names', arrays.pop('channel_names'))
    different = set(names.ravel().tolist()) - {'', MEAN, ALL}
    if names.shape != (count,) or names.dtype.kind != 'U' or len(different) < count:
        raise DatasetError(
            f'channel_names in {path} must be {count} different strings, one for each channel, '
            f'and none of them "{MEAN}" or "{ALL}"'
        )
    return tuple(names.tolist())


def _find_name(key: str, arrays: dict[str, Array]) -> str:
    return next((name for name in (key, *_OTHER_NAMES[key]) if name in arrays), '')


def _unpack_signals(path: Path, x: Array, arrays: dict[str, Array]) -> tuple[Array, Indices]:
    """Return signals of shape (trials, channels, samples) and the samples of each that count.

    Takes ``length`` and ``offsets`` out of the arrays. A ``length`` that is not of integers is an
    ordinary column and stays.
    """
    if 'offsets' in arrays:
        return _unpack_joined(path, x, arrays.pop('offsets'))
    if x.ndim != 3 or x.dtype.kind not in 'fiub' or 0 in x.shape:
        raise DatasetError(
            f'x in {path} is {x.dtype} of shape {x.shape}; '
            'it must be numbers of shape (trials, channels, samples) or (trials, samples)'
        )
    trials, _, samples = x.shape
    length = arrays.get('length')
    if length is None or length.dtype.kind not in 'iu':
        return x, np.full(trials, samples, dtype=np.intp)
    del arrays['length']
    if length.shape != (trials,) or length.min() < 1 or length.max() > samples:
        raise DatasetError(
            f'length in {path} must be {trials} numbers of samples from 1 to {samples}, one a '
            'trial; a column of another meaning needs another name'
        )
    return x, length.astype(np.intp)


def _unpack_joined(path: Path, x: Array, offsets: Array) -> tuple[Array, Indices]:
    joined = x[np.newaxis] if x.ndim == 1 else x
    if joined.ndim != 2 or joined.dtype.kind not in 'fiub' or 0 in joined.shape:
        raise DatasetError(
            f'x in {path} is {x.dtype} of shape {x.shape}; with offsets it must be numbers of '
            'shape (channels, all samples)'
        )
    fits = offsets.ndim == 1 and len(offsets) > 1 and offsets.dtype.kind in 'iu'
    bounds = [int(value) for value in offsets] if fits else []
    lengths = np.diff(bounds)
    if not fits or bounds[0] != 0 or bounds[-1] != joined.shape[1] or lengths.min() < 1:
        raise DatasetError(
            f'offsets in {path} must be integers that rise from 0 to {joined.shape[1]}, the '
            'samples in x, one more than there are trials'
        )
    shape = (len(lengths), len(joined), int(lengths.max()))
    total = math.prod(shape) * joined.dtype.itemsize
    if total > MAX_ARCHIVE_BYTES:
        raise DatasetError(
            f'the trials of {path}, padded to the longest, take {total / 2**20:.0f} MiB; '
            f'the limit is {MAX_ARCHIVE_BYTES / 2**20:.0f} MiB'
        )
    padded = np.zeros(shape, dtype=joined.dtype)
    for row, (first, count) in enumerate(zip(bounds[:-1], lengths.tolist(), strict=True)):
        padded[row, :, :count] = joined[:, first : first + count]
    return padded, lengths.astype(np.intp)


def _decode_text(path: Path, name: str, column: Array) -> Array:
    """Return a column of byte strings as text; others as they are."""
    if column.dtype.kind != 'S':
        return column
    try:
        return np.char.decode(column, 'utf-8')
    except UnicodeDecodeError as error:
        raise DatasetError(
            f'{name} in {path} holds bytes that are not UTF-8: {error.object!r}; '
            'save it as strings'
        ) from error


def _find_unusable(path: Path, x: Array, lengths: Indices, unit: str) -> dict[int, str]:
    """Return why trials cannot be used, by row; padding does not count."""
    if x.dtype.kind != 'f' and unit != 'N':
        return {}
    unusable = {}
    for row, (trial, count) in enumerate(zip(x, lengths.tolist(), strict=True)):
        # As Python's floats: a limit of 1e100 is beyond float32 and would warn there.
        low, high = float(trial[:, :count].min()), float(trial[:, :count].max())
        if not (math.isfinite(low) and math.isfinite(high)):
            bad = ~np.isfinite(trial[:, :count])
            channel, sample = (int(i) for i in np.argwhere(bad)[0])
            unusable[row] = (
                f'x in {path.name} is not finite at {bad.sum()} of {bad.size} samples, first '
                f'channel {channel}, sample {sample}'
            )
        elif unit == 'N' and max(-low, high) > LARGEST_N:
            unusable[row] = (
                f'x in {path.name} goes to {max(-low, high):.6g} N, and no tendon carries more '
                f'than {LARGEST_N:g} N; is its unit right?'
            )
        elif max(-low, high) > MAX_MAGNITUDE:
            unusable[row] = (
                f'x in {path.name} goes beyond {MAX_MAGNITUDE:g}, whose squares would overflow; '
                'scale it'
            )
    return unusable


def _format_doubts(path: Path, x: Array, lengths: Indices, rows: Indices) -> tuple[str, ...]:
    """Return what is odd about trials that can be used; raise DatasetError if all hold nothing."""
    # A channel that keeps its first value up to the trial's end is constant.
    padding = np.arange(x.shape[2]) >= lengths[:, None, None]
    constant = ((x == x[:, :, :1]) | padding).all(axis=2)
    if constant.all():
        raise DatasetError(f'{path}: every trial is constant, so it holds no signal')
    same = lengths[0] == lengths.min() == lengths.max()
    if same and len(x) > 1 and all(np.array_equal(x[0], trial) for trial in x[1:]):
        raise DatasetError(
            f'{path}: all {len(x)} trials hold the same samples, so they were read or written '
            'wrongly; look at the columns that were taken, and at the separator of a text table'
        )
    doubts = [
        f'warning: channel {channel} is constant in {_name_rows(rows[flat])}'
        for channel, flat in enumerate(constant.T)
        if flat.any()
    ]
    short = lengths < FEW_SAMPLES
    if short.any():
        doubts.append(
            f'warning: fewer than {FEW_SAMPLES} samples in {_name_rows(rows[short])}, the fewest '
            f'{lengths.min()}'
        )
    return tuple(doubts)


def _name_rows(rows: Sequence[Any] | Array) -> str:
    named = ', '.join(str(row) for row in rows[:5])
    more = f' and {len(rows) - 5} more' if len(rows) > 5 else ''
    return f'{len(rows)} trial{"s" if len(rows) > 1 else ""} (row {named}{more})'
