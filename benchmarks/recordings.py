# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Public recordings listed in docs/real_recordings.md."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from tactile_analysis import TrialSet

FABRIC_SLIDE = 'fabric_slide.npz'
PHAC_HOLD = 'phac_hold.npz'


class Recording(NamedTuple):
    """Signals of shape (trials, channels, samples), labels, rate and columns of a recording."""

    x: NDArray[Any]
    label: NDArray[Any]
    rate_hz: float
    columns: dict[str, NDArray[Any]]


def read_fabrics() -> Recording:
    """Return the trials of the fabrics that are selected in the column ``balanced``."""
    return _read(TrialSet.load(find_recording(FABRIC_SLIDE) or '').select('balanced'))


def read_holds() -> Recording:
    """Return the signals of the held objects from 1 s to 5 s after the start of each hold."""
    return _read(TrialSet.load(find_recording(PHAC_HOLD) or '').crop(1.0, 5.0))


def _read(trials: TrialSet) -> Recording:
    x, label, _ = trials.windows()
    rate_hz = trials.rate_hz
    assert rate_hz is not None
    return Recording(x, label, rate_hz, trials.columns)


def find_recording(name: str) -> Path | None:
    """Return the path of a recording in the folder ``TACTILE_DATA``, or None if it is missing."""
    path = Path(os.environ.get('TACTILE_DATA', '')) / name
    return path if path.is_file() else None


def say_missing(name: str) -> str:
    """Return a sentence about a missing recording, with the remedy."""
    return f'{name} is missing: set TACTILE_DATA to the folder that contains it'
