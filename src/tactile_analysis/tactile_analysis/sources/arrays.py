# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Trials of ``.npy`` files: one file with labels beside it, or one file per trial."""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

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
from tactile_analysis.sources.raw_trials import RawTrial
from tactile_classifier.datasets.archive import MAX_ARCHIVE_BYTES

_LABEL_SUFFIXES = ('.npy', '.txt', '.csv')


def _load_array(path: Path) -> NDArray[Any]:
    """Return the array of a ``.npy`` file."""
    try:
        # Memory-mapped, so that only the header is read before the size is checked.
        array = np.load(path, mmap_mode='r', allow_pickle=False)
    except Exception as error:  # NumPy raises several types, and so does the file system
        raise SourceError(f'{path} is not a readable .npy file: {error}') from error
    if not isinstance(array, np.ndarray):
        raise SourceError(f'{path} is not a .npy file; check its suffix')
    if math.prod(array.shape) * array.dtype.itemsize > MAX_ARCHIVE_BYTES:
        raise SourceError(f'{path} is larger than {MAX_ARCHIVE_BYTES >> 20} MiB')
    return np.array(array)


def read_labelled_array(
    leaf: SourceFile, options: SourceOptions
) -> dict[str, NDArray[Any]] | None:
    """Return ``x`` and ``label`` of a file with one row per trial, as in an archive.

    Returns None if there is no file of labels: the stated one, or ``NAME_labels``, ``NAME_y``,
    ``labels`` or ``y`` beside the file, with the suffix ``.npy``, ``.txt`` or ``.csv``.
    """
    path = options.labels or _find_labels(leaf.path)
    if path is None:
        return None
    x = _load_array(leaf.path)
    labels = _load_array(path) if path.suffix == '.npy' else _read_lines(path)
    if path.suffix == '.csv' and len(labels) == len(x) + 1:
        labels = labels[1:]  # the first line is the name of the column
    if labels.shape != x.shape[:1]:
        raise SourceError(
            f'{leaf.path} has shape {x.shape}, but {path} has {len(labels)} labels; '
            'the first dimension must be the number of trials'
        )
    return {'x': x, 'label': labels}


def _find_labels(path: Path) -> Path | None:
    names = (f'{path.stem}_labels', f'{path.stem}_y', 'labels', 'label', 'y')
    places = (path.with_name(name + suffix) for name in names for suffix in _LABEL_SUFFIXES)
    return next((place for place in places if place.is_file()), None)


def _read_lines(path: Path) -> NDArray[np.str_]:
    try:
        text = decode_text(path.read_bytes())
    except OSError as error:
        raise SourceError(f'cannot read the labels {path}: {error.strerror}') from error
    return np.array([line.strip().strip('"') for line in text.splitlines() if line.strip()])


def read_array_trials(
    leaves: Sequence[SourceFile], options: SourceOptions, notes: ImportNotes
) -> list[RawTrial]:
    """Read files with one trial each, of shape (samples,) or (channels, samples)."""
    trials = []
    named = name_labels(leaves, options, notes)
    if len(leaves) == 1 and notes.no_label is not None:
        notes.no_label = SourceError(
            f'{leaves[0].path} has no labels: write them to {leaves[0].path.stem}_labels.npy, or '
            f'name their file with --labels\n{LAYOUT}'
        )
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
        trials.append(RawTrial(leaf.name, values, None, {**columns, 'source': leaf.name}))
    return trials
