# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials from NumPy files.

These are archives (``.npz``), a ``.npy`` file of all trials with a file of labels, or one ``.npy``
file per trial. An archive contains the raw signals of many trials, their labels, the sample rate,
and any number of further columns, which can be used to select, group or hold out trials: see
`ARCHIVE`. Pickled objects are refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
from typing import Any, IO
import zipfile

import numpy as np
from numpy.typing import NDArray

from tactile_analysis.options import SourceError, SourceOptions
from tactile_analysis.sources.files import (
    decode_text,
    ImportNotes,
    LAYOUT,
    name_labels,
    SourceFile,
)
from tactile_analysis.sources.signals import make_trial
from tactile_bags.trial import Trial
from tactile_features.spec import ALL, format_rates, is_same_rate, MEAN

MAX_ARCHIVE_BYTES = 2**30
"""Largest archive that is loaded [byte]."""

ARCHIVE = """an archive contains the following arrays, with one entry per trial unless stated:
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

Array = NDArray[Any]

_LABEL_SUFFIXES = ('.npy', '.txt', '.csv')


def _load_array(path: Path) -> NDArray[Any]:
    """Return the array of a ``.npy`` file."""
    try:
        # A memory map reads only the header; the data are read after the size has been checked.
        array = np.load(path, mmap_mode='r', allow_pickle=False)
    except Exception as error:  # exceptions of NumPy or of the file system
        raise SourceError(f'{path} is not a readable .npy file: {error}') from error
    if not isinstance(array, np.ndarray):
        raise SourceError(f'{path} is not a .npy file; check its suffix')
    if math.prod(array.shape) * array.dtype.itemsize > MAX_ARCHIVE_BYTES:
        raise SourceError(f'{path} is larger than {MAX_ARCHIVE_BYTES >> 20} MiB')
    return np.array(array)


def _read_labelled_array(
    leaf: SourceFile, options: SourceOptions, notes: ImportNotes
) -> dict[str, Array] | None:
    """Return the arrays ``x`` and ``label`` of a file with one row per trial; see `ARCHIVE`.

    The labels are in another file: the file stated by the user, or ``NAME_labels``, ``NAME_y``,
    ``labels``, ``label`` or ``y`` in the same folder, with the suffix ``.npy``, ``.txt`` or
    ``.csv``. If there is no such file, None is returned.
    """
    path = options.labels or _find_labels(leaf.path)
    if path is None:
        return None
    x = _load_array(leaf.path)
    labels = _load_array(path) if path.suffix == '.npy' else _read_lines(path)
    notes.add(f'label: the entries of {path.name}')
    if path.suffix == '.csv' and len(labels) == len(x) + 1:
        notes.add(f'{path.name}: "{labels[0]}" in its first line is the name of the column')
        labels = labels[1:]
    if labels.shape != x.shape[:1]:
        raise SourceError(
            f'{leaf.path} has shape {x.shape}, but {path} has {len(labels)} labels; '
            'the first dimension must be the number of trials'
        )
    return {'x': x, 'label': labels}


def _find_labels(path: Path) -> Path | None:
    names = (f'{path.stem}_labels', f'{path.stem}_y', 'labels', 'label', 'y')
    places = (path.with_name(name + suffix) for name in names for suffix in _LABEL_SUFFIXES)
    return next((place for place in places if place != path and place.is_file()), None)


def _read_lines(path: Path) -> NDArray[np.str_]:
    try:
        text = decode_text(path.read_bytes())
    except OSError as error:
        raise SourceError(f'cannot read the labels {path}: {error.strerror}') from error
    return np.array([line.strip().strip('"') for line in text.splitlines() if line.strip()])


def read_array_trials(
    leaves: Sequence[SourceFile], options: SourceOptions, notes: ImportNotes
) -> list[Trial]:
    """Read ``.npy`` files: a single file with a row per trial, or one file per trial.

    A single file needs a file of labels in the same folder.
    A file with one trial has the shape (samples,) or (channels, samples).
    """
    arrays = _read_labelled_array(leaves[0], options, notes) if len(leaves) == 1 else None
    if arrays is not None:
        return _make_trials(leaves[0], arrays, options, notes)
    trials = []
    named = name_labels(leaves, options, notes)
    if len(leaves) == 1 and notes.no_label is not None:
        notes.no_label = SourceError(
            f'{leaves[0].path} has no labels: write them to {leaves[0].path.stem}_labels.npy, or '
            f'name their file with --labels\n{LAYOUT}'
        )
    if options.labels is not None and len(leaves) > 1:
        raise SourceError(
            f'a file of labels ({options.labels}) is only for one array with a row per trial, but '
            f'there are {len(leaves)} arrays: state --label or --label-from'
        )
    recordings = {leaf.path for leaf in leaves}
    found = {_find_labels(leaf.path) for leaf in leaves}
    unused = {str(path) for path in found if path is not None and path not in recordings}
    if unused:
        notes.add(f'not used, because each array is one trial: {", ".join(sorted(unused))}')
    for leaf, columns in zip(leaves, named, strict=True):
        values = _load_array(leaf.path)
        if values.ndim not in (1, 2) or values.dtype.kind not in 'fiub' or not values.size:
            raise SourceError(
                f'{leaf.path} is {values.dtype} of shape {values.shape}; a trial must be numbers '
                'of shape (samples,) or (channels, samples)'
            )
        values = np.atleast_2d(values).astype(np.float64)
        if len(values) > values.shape[1]:
            notes.add('the longer side of an array was used as its samples')
            values = values.T
        known = {**columns, 'source': leaf.name}
        trials.append(make_trial(leaf.name, values, None, known, options, notes))
    return trials


def read_archive_trials(
    leaf: SourceFile, options: SourceOptions, notes: ImportNotes
) -> list[Trial]:
    """Read the trials of a NumPy archive; see `ARCHIVE`."""
    return _make_trials(leaf, read_arrays(leaf.path), options, notes)


def _make_trials(
    leaf: SourceFile, arrays: dict[str, Array], options: SourceOptions, notes: ImportNotes
) -> list[Trial]:
    """Return the trials in arrays that are named as in an archive; see `ARCHIVE`.

    Trials are named by the column ``trial``, or else by their row, from 0.
    """
    path = leaf.path
    x, label, rate_hz = _take_arrays(path, arrays, options.rate_hz, notes)
    signals = _cut_signals(path, x, arrays)
    count = len(signals)
    if label is not None:
        label = _decode_text(path, 'label', label)
        if label.shape != (count,) or label.dtype.kind not in 'Uiu':
            raise SourceError(
                f'label in {path} is {label.dtype} of shape {label.shape}; '
                f'it must be strings or integers of shape ({count},), one per trial'
            )
        arrays['label'] = label.astype(str)
    channels = _take_channels(path, arrays, len(signals[0]))
    unit = _take_unit(path, arrays)
    columns: dict[str, list[Any]] = {}
    for name, column in arrays.items():
        if column.shape != (count,):
            raise SourceError(
                f'column {name} in {path} has shape {column.shape}; it must be ({count},)'
            )
        column = _decode_text(path, name, column)
        columns[name] = (column if column.dtype.kind in 'biufU' else column.astype(str)).tolist()
    return [
        make_trial(
            str(known.get('trial', row)),
            signal,
            None,
            known,
            options,
            notes,
            source=leaf.name,
            channels=channels,
            units=(unit,) * len(signal) if unit else (),
            rate_hz=rate_hz,
        )
        for row, signal in enumerate(signals)
        for known in [{name: column[row] for name, column in columns.items()}]
    ]


def write_archive(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write arrays as an archive; replace an existing file."""
    # `numpy.savez` is not used: it cannot store an array with the name of one of its parameters.
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f'{name}.npy', 'w', force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)  # type: ignore[no-untyped-call]


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an archive by name, without checking their contents.

    Raises SourceError if the file is not an archive, is too large, or contains pickled objects.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            _check_headers(path, archive)
        with np.load(path, allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except FileNotFoundError:
        raise SourceError(f'{path} does not exist') from None
    except SourceError:
        raise
    except Exception as error:  # zipfile, zlib and NumPy raise different exceptions
        raise SourceError(f'{path} is not a readable .npz archive: {error}') from error


def _check_headers(path: Path, archive: zipfile.ZipFile) -> None:
    """Check sizes and types in the headers, before any data is loaded.

    Raises SourceError if an array contains pickled objects, or the arrays are too large.
    """
    total = 0
    for member in archive.infolist():
        if not member.filename.endswith('.npy'):
            raise SourceError(f'{path} contains {member.filename}, which is not an array')
        name = member.filename.removesuffix('.npy')
        with archive.open(member) as stream:
            shape, dtype = _read_header(stream)
        if dtype.hasobject:
            raise SourceError(
                f'array {name} in {path} contains pickled objects, which are never loaded: '
                'save it with a numeric, boolean or string type'
                + (f'; {ARCHIVE}' if name == 'x' else f', for example as {name}.astype(str)')
            )
        total += math.prod(shape) * dtype.itemsize
    if total > MAX_ARCHIVE_BYTES:
        raise SourceError(
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


def _take_arrays(
    path: Path, arrays: dict[str, Array], rate_hz: float | None, notes: ImportNotes
) -> tuple[Array, Array | None, float]:
    """Remove signals, labels and sample rate [Hz] from ``arrays`` and return them.

    Arrays with other common names, such as ``X`` or ``fs``, are also accepted; a note is added.

    If there is no array with the rate, ``rate_hz`` is used. If there are no labels, None is
    returned for them, and the error is stored in ``notes.no_label``. Raises `SourceError` if
    another array is missing, or if the rate differs from ``rate_hz``.
    """
    named = {key: _find_name(key, arrays) for key in ('x', 'label', 'rate_hz')}
    if rate_hz is not None and not named['rate_hz']:
        arrays['rate_hz'], named['rate_hz'] = np.array(rate_hz), 'rate_hz'
    missing = [key for key, name in named.items() if not name]
    text = f'{path} has no {" and no ".join(missing)}'
    if missing == ['rate_hz']:
        text += '; give the sample rate with --rate-hz'
    error = SourceError(f'{text}\n{ARCHIVE}')
    if missing == ['label']:
        notes.no_label = error
    elif missing:
        raise error
    for key, name in named.items():
        if name not in ('', key):
            notes.add(f'{path.name}: {name} used as {key}')
    x, rate = arrays.pop(named['x']), arrays.pop(named['rate_hz'])
    label = arrays.pop(named['label']) if named['label'] else None
    if rate.size != 1 or rate.dtype.kind not in 'fiu' or not 0 < float(rate.item()) < math.inf:
        raise SourceError(f'rate_hz in {path} must be one positive number')
    if rate_hz is not None and not (rate.size == 1 and is_same_rate(float(rate.item()), rate_hz)):
        own, stated = (
            format_rates(float(rate.item()), rate_hz) if rate.size == 1 else (rate, rate_hz)
        )
        raise SourceError(
            f'{path} has {named["rate_hz"]} = {own}, but --rate-hz is {stated}: '
            'use --resample-hz to change the rate'
        )
    if x.ndim == 2 and 'offsets' not in arrays:
        notes.add(f'{path.name}: shape {x.shape} read as trials x samples, one channel')
        x = x[:, np.newaxis, :]
    return x, label, float(rate.item())


def _take_unit(path: Path, arrays: dict[str, Array]) -> str:
    """Remove the unit of the signals from ``arrays`` and return it.

    If ``unit`` has one entry per trial, it is an ordinary column and is not removed.
    """
    if 'unit' not in arrays or arrays['unit'].ndim:
        return ''
    unit = _decode_text(path, 'unit', arrays.pop('unit'))
    if unit.dtype.kind != 'U':
        raise SourceError(f'unit in {path} must be one string, such as N')
    return str(unit.item())


def _take_channels(path: Path, arrays: dict[str, Array], count: int) -> tuple[str, ...]:
    """Remove the channel names from the arrays and return them; empty if there are none."""
    if 'channel_names' not in arrays:
        return ()
    names = _decode_text(path, 'channel_names', arrays.pop('channel_names'))
    different = set(names.ravel().tolist()) - {'', MEAN, ALL}
    if names.shape != (count,) or names.dtype.kind != 'U' or len(different) < count:
        raise SourceError(
            f'channel_names in {path} must be {count} different strings, one per channel, '
            f'other than "{MEAN}" and "{ALL}"'
        )
    return tuple(names.tolist())


def _find_name(key: str, arrays: dict[str, Array]) -> str:
    return next((name for name in (key, *_OTHER_NAMES[key]) if name in arrays), '')


def _cut_signals(path: Path, x: Array, arrays: dict[str, Array]) -> list[Array]:
    """Return the signal of each trial, of shape (channels, samples).

    Removes ``length`` and ``offsets`` from ``arrays``. If ``length`` does not contain integers, it
    is an ordinary column and is not removed.
    """
    if 'offsets' in arrays:
        return _cut_joined(path, x, arrays.pop('offsets'))
    if x.ndim != 3 or x.dtype.kind not in 'fiub' or 0 in x.shape:
        raise SourceError(
            f'x in {path} is {x.dtype} of shape {x.shape}; '
            'it must be numbers of shape (trials, channels, samples) or (trials, samples)'
        )
    trials, _, samples = x.shape
    length = arrays.get('length')
    if length is None or length.dtype.kind not in 'iu':
        return list(x)
    del arrays['length']
    if length.shape != (trials,) or length.min() < 1 or length.max() > samples:
        raise SourceError(
            f'length in {path} must be {trials} numbers of samples from 1 to {samples}, one per '
            'trial; rename the column if it has another meaning'
        )
    return [trial[:, :count] for trial, count in zip(x, length.tolist(), strict=True)]


def _cut_joined(path: Path, x: Array, offsets: Array) -> list[Array]:
    joined = x[np.newaxis] if x.ndim == 1 else x
    if joined.ndim != 2 or joined.dtype.kind not in 'fiub' or 0 in joined.shape:
        raise SourceError(
            f'x in {path} is {x.dtype} of shape {x.shape}; with offsets it must be numbers of '
            'shape (channels, all samples)'
        )
    fits = offsets.ndim == 1 and len(offsets) > 1 and offsets.dtype.kind in 'iu'
    bounds = [int(value) for value in offsets] if fits else []
    if not fits or bounds[0] != 0 or bounds[-1] != joined.shape[1] or np.diff(bounds).min() < 1:
        raise SourceError(
            f'offsets in {path} must be increasing integers from 0 to {joined.shape[1]}, which is '
            'the number of samples in x; there must be one more than trials'
        )
    return np.split(joined, bounds[1:-1], axis=1)


def _decode_text(path: Path, name: str, column: Array) -> Array:
    """Decode a column of byte strings; return other columns unchanged."""
    if column.dtype.kind != 'S':
        return column
    try:
        return np.char.decode(column, 'utf-8')
    except UnicodeDecodeError as error:
        raise SourceError(
            f'{name} in {path} contains bytes that are not UTF-8: {error.object!r}; '
            'save it as strings'
        ) from error
