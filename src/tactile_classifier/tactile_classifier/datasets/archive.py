# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Labelled-trials archives: raw signals of many trials in one NumPy ``.npz`` file.

An archive contains ``x`` (trials, channels, samples), ``label`` (trials,), ``rate_hz`` () and any
number of further columns (trials,), which can be used to select, group or hold out trials. If the
trials have different lengths, they are either padded and ``length`` is added, or concatenated and
``offsets`` is added: see `LAYOUT`. Pickled objects are refused.
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
"""Larger archives are not loaded [byte]."""

MAX_MAGNITUDE = 1e100
"""Largest accepted absolute value in an archive, in its unit."""

NEWTONS = {
    'N': 1.0, 'mN': 1e-3, 'uN': 1e-6, 'µN': 1e-6, 'kN': 1e3, 'g': 9.80665e-3, 'kg': 9.80665,
}  # fmt: skip
"""Units of force, converted to newtons [N]; g and kg are weights at standard gravity."""

LARGEST_N = 1e6
"""Values above this limit are implausible as tension of a tendon [N]."""

FEW_SAMPLES = 16
"""Trials with fewer samples cause a warning: their spectrum has at most eight components."""

LAYOUT = """an archive contains the following arrays, with one entry per trial unless stated:
  x        numbers of shape (trials, channels, samples), or (trials, samples); or X
  label    strings or integers; or y
  rate_hz  one number; or fs, or --rate-hz
  unit     optional, one string: unit of x, such as N; forces are converted to N
  channel_names  optional, one string per channel
  and any further columns
For trials of unequal length, either pad x with any values and add
  length   number of valid samples of each trial
or concatenate the trials in x of shape (channels, all samples) and add
  offsets  (trials + 1,): trial i is x[:, offsets[i]:offsets[i + 1]]"""

_OTHER_NAMES = {
    'x': ('X', 'data', 'signal', 'signals', 'X_train'),
    'label': ('y', 'Y', 'labels', 'target', 'y_train'),
    'rate_hz': ('fs', 'rate', 'sample_rate', 'sampling_rate', 'frequency'),
}

Channel = int | str
"""Index of a channel from 0, its name, ``'mean'`` or ``'all'``."""

Array = npt.NDArray[Any]
Indices = npt.NDArray[np.intp]

_MAX_FACTOR = 10_000  # at this factor, the resampling filter has 100,000 taps on each side


def _no_numbers() -> Indices:
    return np.empty(0, dtype=np.intp)


@dataclasses.dataclass(frozen=True)
class Skipped:
    """A trial that was left out: its row in the archive, from 0, and the reason."""

    row: int
    reason: str


@dataclasses.dataclass(frozen=True)
class LabelledTrials:
    """Raw signals and metadata of many trials.

    Attributes
    ----------
    x : ndarray of shape (trials, channels, samples)
        Signals in ``unit``.
    label : ndarray of str, shape (trials,)
    rate_hz : float
        Sample rate [Hz].
    columns : mapping of str to ndarray of shape (trials,)
    lengths : ndarray of int, shape (trials,)
        Number of valid samples of each trial; the rest is padding. Default: all samples.
    rows : ndarray of int, shape (trials,)
        Row of each trial in the archive, from 0. Default: consecutive numbers.
    skip_bad : bool
        Leave out unusable trials; otherwise an unusable trial raises an error.
    skipped : tuple of Skipped
        Trials that were left out.
    steps : tuple of str
        Descriptions of the processing steps.
    unit : str
        Unit of the signals, such as ``N``; empty if unknown.
    channels : tuple of str
        Names of the channels. Default: ``channel_0`` and so on.
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
            f'there is no channel {name}; the {len(self.channels)} channels are '
            f'{", ".join(self.channels)}: give a name, a number from 0, "{MEAN}" or "{ALL}"'
        )

    def signal(self, channel: Channel = 0) -> npt.NDArray[np.float64]:
        """Return one channel, or the mean of all channels, shape (trials, samples).

        Raises DatasetError when there is no such channel.
        """
        name = self.name_channel(channel)
        if name == MEAN:
            return np.asarray(self.x.mean(axis=1, dtype=np.float64))
        if name == ALL:
            raise DatasetError('choose one channel, or the mean of all channels')
        return self.x[:, self.channels.index(name)].astype(np.float64)

    def where(self, column: str, value: object = True) -> LabelledTrials:
        """Return the trials that have this value in a column.

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
        """Return the trials except those with the given indices; add these to ``skipped``.

        ``bad`` maps each index to the reason. Raises DatasetError if a trial would be left out but
        ``skip_bad`` is not set, or if no trial remains.
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
        """Cut all trials to the time from ``start_s`` to ``stop_s``, excluding ``stop_s``.

        Trials that end before ``stop_s`` are left out if ``skip_bad`` is set. Raises DatasetError
        if ``skip_bad`` is not set and such a trial exists, if all trials are shorter, or if no
        sample remains.
        """
        longest = int(self.lengths.max())
        first, last = (round(t * self.rate_hz, 6) for t in (start_s, stop_s))
        if not 0 <= first < last <= longest:
            raise DatasetError(
                f'the trials last {longest / self.rate_hz:.6g} s; '
                f'{start_s:g} to {stop_s:g} s is outside'
            )
        short = {
            int(i): f'it lasts {self.lengths[i] / self.rate_hz:.6g} s; {stop_s:g} s are needed'
            for i in np.flatnonzero(self.lengths < last)
        }
        kept = self.drop(short)
        begin, end = math.ceil(first), math.ceil(last)
        x = kept.x[:, :, begin:end]
        return dataclasses.replace(kept, x=x, lengths=np.full(len(x), end - begin))

    def cut_to_shortest(self) -> LabelledTrials:
        """Cut all trials to the length of the shortest one, from their first sample."""
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
        """Resample the trials with `scipy.signal.resample_poly`.

        The anti-aliasing filter has linear phase and no delay. It uses a Kaiser window with beta
        5 and extends over ten periods of the slower rate on each side. Beyond both ends, the
        signal is extrapolated by the line through its first and last sample. Raises DatasetError
        if the ratio of the rates is not a ratio of two integers up to 10,000.
        """
        from scipy.signal import resample_poly  # takes half a second to import

        ratio = Fraction(rate_hz / self.rate_hz).limit_denominator(_MAX_FACTOR)
        up, down = ratio.numerator, ratio.denominator
        if not 0 < up <= _MAX_FACTOR or abs(self.rate_hz * up / down / rate_hz - 1) > 1e-9:
            raise DatasetError(
                f'cannot resample from {self.rate_hz:g} to {rate_hz:g} Hz: the ratio must be '
                f'a ratio of two integers up to {_MAX_FACTOR}'
            )
        if up == down:
            return self
        lengths = -(-self.lengths * up // down)
        if self.x[:, :, :1].nbytes // self.x.itemsize * 8 * int(lengths.max()) > MAX_ARCHIVE_BYTES:
            raise DatasetError(f'at {rate_hz:g} Hz the trials exceed the memory limit')
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
        Number of cross-validation folds. If it is not 0, an archive with only one label is
        refused, because it cannot be cross-validated.
    skip_bad : bool
        Leave out unusable trials; the reasons are stored in ``skipped``.
    rate_hz : float, optional
        Sample rate, for an archive that contains no rate [Hz].

    Raises
    ------
    DatasetError
        If the file is invalid; the message gives the reason.
    """
    path = Path(path)
    return trials_from_arrays(path, read_arrays(path), folds, skip_bad=skip_bad, rate_hz=rate_hz)


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an archive by name, without checking their contents.

    Raises DatasetError if the file is not an archive, is too large, or contains pickled objects.
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
    except Exception as error:  # zipfile, zlib and NumPy raise different exceptions
        raise DatasetError(f'{path} is not a readable .npz archive: {error}') from error


def save_archive(path: Path, trials: LabelledTrials) -> None:
    """Write trials as an archive that `load_archive` reads; replace an existing file."""
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
    # numpy.savez does not accept columns that have the name of one of its arguments.
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f'{name}.npy', 'w', force_zip64=True) as member:
                array = np.asarray(array)
                np.lib.format.write_array(member, array, allow_pickle=False)  # type: ignore[no-untyped-call]


def _check_headers(path: Path, archive: zipfile.ZipFile) -> None:
    """Check sizes and types in the headers, before any data is loaded.

    Raises DatasetError if an array contains pickled objects, or the arrays are too large.
    """
    total = 0
    for member in archive.infolist():
        if not member.filename.endswith('.npy'):
            raise DatasetError(f'{path} contains {member.filename}, which is not an array')
        name = member.filename.removesuffix('.npy')
        with archive.open(member) as stream:
            shape, dtype = _read_header(stream)
        if dtype.hasobject:
            raise DatasetError(
                f'array {name} in {path} contains pickled objects, which are never loaded: '
                'save it with a numeric, boolean or string type'
                + (f'; {LAYOUT}' if name == 'x' else f', for example as {name}.astype(str)')
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
    """Return the trials in arrays, with the same checks as `load_archive`.

    ``path`` is named in messages as the source. ``unit`` is the unit of the signals, if known.
    Forces are converted to N. If ``needs_label`` is False, labels may be missing (they are then
    empty), and constant trials are allowed.
    """
    x, label, rate, steps = _find_arrays(path, arrays, rate_hz, needs_label=needs_label)
    x, lengths = _unpack_signals(path, x, arrays)
    trials = len(x)
    label = _decode_text(path, 'label', label)
    if label.shape != (trials,) or label.dtype.kind not in 'Uiu':
        raise DatasetError(
            f'label in {path} is {label.dtype} of shape {label.shape}; '
            f'it must be strings or integers of shape ({trials},), one per trial'
        )
    channels = _take_channels(path, arrays, x.shape[1])
    own_unit = _take_unit(path, arrays)
    if unit and own_unit not in ('', unit):
        raise DatasetError(f'{path} is in {own_unit}, but --unit is {unit}: omit the option')
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
        raise DatasetError(f'{path} has only one class, "{loaded.label[0]}": record at least two')
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
    """Remove signals, labels and sample rate from ``arrays`` and return them.

    Other common names of the arrays are accepted; for each of them, a sentence is returned. If the
    arrays contain no rate, ``rate_hz`` is used. Raises DatasetError if an array is missing, or if
    the rate in the arrays differs from ``rate_hz``.
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
            text += '; give the sample rate with --rate-hz'
        raise DatasetError(f'{text}\n{LAYOUT}')
    x, label, rate = (arrays.pop(name) for name in named.values())
    steps = [f'{path.name}: {name} used as {key}' for key, name in named.items() if name != key]
    if rate_hz is not None and not (rate.size == 1 and is_same_rate(float(rate.item()), rate_hz)):
        own, stated = (
            format_rates(float(rate.item()), rate_hz) if rate.size == 1 else (rate, rate_hz)
        )
        raise DatasetError(
            f'{path} has {named["rate_hz"]} = {own}, but --rate-hz is {stated}: '
            'use --resample-hz to change the rate'
        )
    if x.ndim == 2 and 'offsets' not in arrays:
        steps.append(f'{path.name}: shape {x.shape} read as trials x samples, one channel')
        x = x[:, np.newaxis, :]
    return x, label, rate, tuple(steps)


def _take_unit(path: Path, arrays: dict[str, Array]) -> str:
    """Remove the unit of the signals from ``arrays`` and return it.

    If ``unit`` has one entry per trial, it is an ordinary column and is not removed.
    """
    if 'unit' not in arrays or arrays['unit'].ndim:
        return ''
    unit = _decode_text(path, 'unit', arrays.pop('unit'))
    if unit.dtype.kind != 'U':
        raise DatasetError(f'unit in {path} must be one string, such as N')
    return str(unit.item())


def _take_channels(path: Path, arrays: dict[str, Array], count: int) -> tuple[str, ...]:
    """Remove the channel names from the arrays and return them; empty if there are none."""
    if 'channel_names' not in arrays:
        return ()
    names = _decode_text(path, 'channel_names', arrays.pop('channel_names'))
    different = set(names.ravel().tolist()) - {'', MEAN, ALL}
    if names.shape != (count,) or names.dtype.kind != 'U' or len(different) < count:
        raise DatasetError(
            f'channel_names in {path} must be {count} different strings, one per channel, '
            f'other than "{MEAN}" and "{ALL}"'
        )
    return tuple(names.tolist())


def _find_name(key: str, arrays: dict[str, Array]) -> str:
    return next((name for name in (key, *_OTHER_NAMES[key]) if name in arrays), '')


def _unpack_signals(path: Path, x: Array, arrays: dict[str, Array]) -> tuple[Array, Indices]:
    """Return signals of shape (trials, channels, samples), and the number of valid samples.

    Removes ``length`` and ``offsets`` from ``arrays``. If ``length`` does not contain integers, it
    is an ordinary column and is not removed.
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
            f'length in {path} must be {trials} numbers of samples from 1 to {samples}, one per '
            'trial; rename the column if it has another meaning'
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
            f'offsets in {path} must be increasing integers from 0 to {joined.shape[1]}, which is '
            'the number of samples in x; there must be one more than trials'
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
    """Decode a column of byte strings; return other columns unchanged."""
    if column.dtype.kind != 'S':
        return column
    try:
        return np.char.decode(column, 'utf-8')
    except UnicodeDecodeError as error:
        raise DatasetError(
            f'{name} in {path} contains bytes that are not UTF-8: {error.object!r}; '
            'save it as strings'
        ) from error


def _find_unusable(path: Path, x: Array, lengths: Indices, unit: str) -> dict[int, str]:
    """Return the reason for each unusable trial, by row; padding is ignored."""
    if x.dtype.kind != 'f' and unit != 'N':
        return {}
    unusable = {}
    for row, (trial, count) in enumerate(zip(x, lengths.tolist(), strict=True)):
        # Converted to Python floats, because float32 cannot represent the limit of 1e100.
        low, high = float(trial[:, :count].min()), float(trial[:, :count].max())
        if not (math.isfinite(low) and math.isfinite(high)):
            bad = ~np.isfinite(trial[:, :count])
            channel, sample = (int(i) for i in np.argwhere(bad)[0])
            unusable[row] = (
                f'x in {path.name} is not finite at {bad.sum()} of {bad.size} samples, first in '
                f'channel {channel}, sample {sample}'
            )
        elif unit == 'N' and max(-low, high) > LARGEST_N:
            unusable[row] = (
                f'x in {path.name} reaches {max(-low, high):.6g} N, more than the {LARGEST_N:g} N '
                'that are plausible for a tendon: check its unit'
            )
        elif max(-low, high) > MAX_MAGNITUDE:
            unusable[row] = (
                f'x in {path.name} exceeds {MAX_MAGNITUDE:g}, so its squares would overflow: '
                'scale it'
            )
    return unusable


def _format_doubts(path: Path, x: Array, lengths: Indices, rows: Indices) -> tuple[str, ...]:
    """Return warnings about usable trials; raise DatasetError if no trial contains a signal."""
    # A channel is constant if it keeps its first value until the end of the trial.
    padding = np.arange(x.shape[2]) >= lengths[:, None, None]
    constant = ((x == x[:, :, :1]) | padding).all(axis=2)
    if constant.all():
        raise DatasetError(f'{path}: all trials are constant and contain no signal')
    same = lengths[0] == lengths.min() == lengths.max()
    if same and len(x) > 1 and all(np.array_equal(x[0], trial) for trial in x[1:]):
        raise DatasetError(
            f'{path}: all {len(x)} trials contain the same samples: check the selected columns, '
            'and the separator of a text table'
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
