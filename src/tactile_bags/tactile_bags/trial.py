# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""One trial of a recording, and its samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_classifier.records import ClassificationResult
from tactile_features.records import TrialEvent


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples of one trial.

    Attributes
    ----------
    time_s : ndarray of shape (n,), or None
        Times since the trial's begin [s]; None: neither times nor the rate are known.
    values : ndarray of float64, shape (channels, n)
        In ``unit``.
    channels : tuple of str
        Name of each channel.
    unit : str
        Such as ``N`` or ``mN``; empty: not known, or not the same for all channels.
    rate_hz : float or None
        Sample rate [Hz]; None: not known.
    status : ndarray of int, shape (n,), or None
        `StrainStatus` of each sample of our own bags.
    """

    time_s: NDArray[np.float64] | None
    values: NDArray[np.float64]
    channels: tuple[str, ...]
    unit: str = ''
    rate_hz: float | None = None
    status: NDArray[np.intp] | None = None


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial of a recording.

    Attributes
    ----------
    name : str
        Of the trial; in our own bags its ``trial_id``, which may come again.
    source : str
        Path of the bag or file.
    label, session_id, mounting_id, contact, task : str
        Empty: not known.
    namespace : str
        Of the finger, in our own bags.
    why_not : str
        Why the trial does not count for training and evaluation; empty: it counts.
    columns : dict
        Everything that is known of the trial, by name of column.
    events : tuple of TrialEvent
        Of our own bags, in their order.
    begin_ns : int or None
        Time of the first event (ROS time) [ns].
    """

    name: str
    source: str
    label: str
    session_id: str = ''
    mounting_id: str = ''
    contact: str = ''
    task: str = ''
    namespace: str = ''
    why_not: str = ''
    columns: Mapping[str, Any] = field(default_factory=dict)
    events: tuple[TrialEvent, ...] = ()
    begin_ns: int | None = None
    load_signal: Callable[[], Signal] | None = field(default=None, repr=False)
    load_answers: Callable[[], tuple[ClassificationResult, ...]] = field(default=tuple, repr=False)

    @cached_property
    def signal(self) -> Signal:
        """The samples, from the first to the last event in our own bags."""
        assert self.load_signal is not None
        return self.load_signal()

    @cached_property
    def answers(self) -> tuple[ClassificationResult, ...]:
        """The classifications that were recorded; of our own bags."""
        return self.load_answers()

    @property
    def phases(self) -> tuple[tuple[str, float, float], ...]:
        """Name, start and end of each phase, from the first event [s]."""
        starts = [(event.stamp_ns - self.events[0].stamp_ns) * 1e-9 for event in self.events]
        return tuple(
            (event.phase, start, end)
            for event, start, end in zip(self.events, starts[:-1], starts[1:], strict=False)
        )

    @property
    def simulated(self) -> bool:
        return bool(self.columns.get('simulated', False))
