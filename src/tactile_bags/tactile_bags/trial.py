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

from tactile_classifier.types import WindowPrediction
from tactile_features.types import TrialEvent

NO_LABEL = 'the trial has no label'
"""Reason why trials without a label in bags of this package are excluded."""


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples of one trial.

    Attributes
    ----------
    time_s : ndarray of shape (n,), or None
        Times since the beginning of the trial [s]; None if times and rate are unknown.
    values : ndarray of float64, shape (channels, n)
        Values in ``unit``.
    channels : tuple of str
        Name of each channel.
    unit : str
        Unit of ``values``, such as ``N`` or ``mN``; empty if it is unknown, or if channels have
        different units.
    rate_hz : float or None
        Sample rate [Hz]; None if unknown.
    status : ndarray of int, shape (n,), or None
        `StrainStatus` of each sample, for bags of this package; otherwise None.
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
        Name of the trial. In bags of this package, it is the ``trial_id``; several trials may have
        the same one.
    source : str
        Path of the bag or file.
    label, session_id, mounting_id, contact, task : str
        Properties of the trial; empty if unknown.
    namespace : str
        Namespace of the finger, for bags of this package.
    why_not : str or None
        Reason why the trial is excluded from training and evaluation; None if it is included.
    is_faulty, is_excluded : bool
        True if ``why_not`` describes a fault of the samples, or states why the trial was excluded
        from a set of trials. Both are False for trials that were aborted or have no label.
    columns : dict
        All known properties of the trial. The keys are names of columns.
    events : tuple of TrialEvent
        Events of the trial in their order, for bags of this package.
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
    why_not: str | None = None
    is_faulty: bool = False
    is_excluded: bool = False
    columns: Mapping[str, Any] = field(default_factory=dict)
    events: tuple[TrialEvent, ...] = ()
    begin_ns: int | None = None
    load_signal: Callable[[], Signal] | None = field(default=None, repr=False)
    load_answers: Callable[[], tuple[WindowPrediction, ...]] = field(default=tuple, repr=False)

    @cached_property
    def signal(self) -> Signal:
        """The samples. In bags of this package, they last from the first to the last event."""
        assert self.load_signal is not None
        return self.load_signal()

    @cached_property
    def answers(self) -> tuple[WindowPrediction, ...]:
        """The recorded classifications, for bags of this package."""
        return self.load_answers()

    @property
    def phases(self) -> tuple[tuple[str, float, float], ...]:
        """Name, start and end of each phase, relative to the first event [s]."""
        starts = [(event.stamp_ns - self.events[0].stamp_ns) * 1e-9 for event in self.events]
        return tuple(
            (event.phase, start, end)
            for event, start, end in zip(self.events, starts[:-1], starts[1:], strict=False)
        )

    @property
    def simulated(self) -> bool:
        return bool(self.columns.get('simulated', False))


def mean_period_s(time_s: NDArray[np.float64] | None) -> float | None:
    """Return the mean time between consecutive samples, without pauses [s]; None if unknown."""
    if time_s is None or len(time_s) < 2:
        return None
    steps = np.diff(time_s)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    if not len(steps):
        return None
    return float(steps[steps <= 1.5 * np.median(steps)].mean())
