# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults in the signals of an archive."""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_classifier.errors import DatasetError

Array = npt.NDArray[Any]

MAX_MAGNITUDE = 1e100
"""Largest absolute value in an archive [its unit]."""

FEW_SAMPLES = 16
"""Trials of fewer samples are pointed out: a spectrum of them has eight lines at most."""


def find_unusable(path: Path, x: Array, lengths: npt.NDArray[np.intp]) -> dict[int, str]:
    """Return why trials cannot be used, by row; padding does not count."""
    if x.dtype.kind != 'f':
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
        elif max(-low, high) > MAX_MAGNITUDE:
            unusable[row] = (
                f'x in {path.name} goes beyond {MAX_MAGNITUDE:g}, whose squares would overflow; '
                'scale it'
            )
    return unusable


def describe_doubts(
    path: Path, x: Array, lengths: npt.NDArray[np.intp], rows: npt.NDArray[np.intp]
) -> tuple[str, ...]:
    """Return what is odd about trials that can be used: constant channels, very few samples.

    Raises
    ------
    DatasetError
        When every channel of every trial is constant, or all trials hold the same samples.
    """
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
