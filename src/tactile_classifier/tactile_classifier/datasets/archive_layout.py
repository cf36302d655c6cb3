# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Layout of the arrays of a labelled-trials archive: padded, one after another, or neither."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import DatasetError

Array = npt.NDArray[Any]

LAYOUT = """an archive holds, with one entry a trial where not said otherwise:
  x        numbers of shape (trials, channels, samples), or (trials, samples); or X
  label    strings or integers; or y
  rate_hz  one number; or fs, or --rate-hz
  unit     optional, one string: of x, as in N
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


def find_arrays(
    path: Path, arrays: dict[str, Array], rate_hz: float | None = None
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Take signals, labels and rate out of the arrays, under our names or other usual ones.

    Returns them with sentences on what was taken for what, where the names or shapes are not ours.
    ``rate_hz`` stands in where the arrays state none. Raises DatasetError when one is missing, or
    the stated rate differs from that of the arrays.
    """
    named = {key: _find_name(key, arrays) for key in ('x', 'label', 'rate_hz')}
    if rate_hz is not None and not named['rate_hz']:
        arrays['rate_hz'], named['rate_hz'] = np.array(rate_hz), 'rate_hz'
    missing = [key for key, name in named.items() if not name]
    if missing:
        text = f'{path} has no {" and no ".join(missing)}'
        if missing == ['rate_hz']:
            text += '; state the sample rate with --rate-hz'
        raise DatasetError(f'{text}\n{LAYOUT}')
    x, label, rate = (arrays.pop(name) for name in named.values())
    steps = [f'took {name} of {path.name} as {key}' for key, name in named.items() if name != key]
    if rate_hz is not None and (rate.size != 1 or float(rate.item()) != rate_hz):
        raise DatasetError(
            f'{path} says {named["rate_hz"]} = {rate}, and --rate-hz says {rate_hz:g}; '
            'to change the rate, use --resample-hz'
        )
    if x.ndim == 2 and 'offsets' not in arrays:
        steps.append(f'took the {x.shape} numbers of {path.name} as trials x samples, one channel')
        x = x[:, np.newaxis, :]
    return x, label, rate, tuple(steps)


def take_unit(path: Path, arrays: dict[str, Array]) -> str:
    """Return the unit of the signals, and take it out of the arrays; a column of units stays.

    Raises DatasetError when it is no string.
    """
    if 'unit' not in arrays or arrays['unit'].ndim:
        return ''
    unit = decode_text(path, 'unit', arrays.pop('unit'))
    if unit.dtype.kind != 'U':
        raise DatasetError(f'unit in {path} must be one string, as in N')
    return str(unit.item())


def _find_name(key: str, arrays: dict[str, Array]) -> str:
    return next((name for name in (key, *_OTHER_NAMES[key]) if name in arrays), '')


def unpack_signals(
    path: Path, x: Array, arrays: dict[str, Array], largest_bytes: int
) -> tuple[Array, npt.NDArray[np.intp]]:
    """Return signals of shape (trials, channels, samples) and the samples of each that count.

    Takes ``length`` and ``offsets`` out of the arrays. A ``length`` that is not of integers is
    an ordinary column and stays. Raises DatasetError when shapes or numbers do not fit, or the
    padded signals take more than ``largest_bytes``.
    """
    if 'offsets' in arrays:
        return _unpack_joined(path, x, arrays.pop('offsets'), largest_bytes)
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


def _unpack_joined(
    path: Path, x: Array, offsets: Array, largest_bytes: int
) -> tuple[Array, npt.NDArray[np.intp]]:
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
    if total > largest_bytes:
        raise DatasetError(
            f'the trials of {path}, padded to the longest, take {total / 2**20:.0f} MiB; '
            f'the limit is {largest_bytes / 2**20:.0f} MiB'
        )
    padded = np.zeros(shape, dtype=joined.dtype)
    for row, (first, count) in enumerate(zip(bounds[:-1], lengths.tolist(), strict=True)):
        padded[row, :, :count] = joined[:, first : first + count]
    return padded, lengths.astype(np.intp)


def decode_text(path: Path, name: str, column: Array) -> Array:
    """Return a column of byte strings as text; others as they are.

    Raises DatasetError when one is not UTF-8.
    """
    if column.dtype.kind != 'S':
        return column
    try:
        return np.char.decode(column, 'utf-8')
    except UnicodeDecodeError as error:
        raise DatasetError(
            f'{name} in {path} holds bytes that are not UTF-8: {error.object!r}; '
            'save it as strings'
        ) from error
