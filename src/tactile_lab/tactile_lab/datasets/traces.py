# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tension of recorded trials in time, for plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.message_records import read_records
from tactile_bags.recorded_topics import EVENT, STRAIN

Samples = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Times [s] and tension [N], each of shape (n,)."""


@dataclass(frozen=True)
class TrialTrace:
    """One trial in time.

    Attributes
    ----------
    begin_ns : int
        Time of the trial's first event (ROS time) [ns]; zero of the other times.
    time_s, tension_n : ndarray of shape (n,)
        Samples from the first to the last event [s], [N].
    phases : tuple of (name, start, end)
        Times in seconds.
    """

    begin_ns: int
    time_s: NDArray[np.float64]
    tension_n: NDArray[np.float64]
    phases: tuple[tuple[str, float, float], ...]


def read_trace(bag: TactileBag, trial_id: str, namespace: str = '') -> TrialTrace:
    """Return the trace of a trial.

    Raises
    ------
    BagError
        When the bag has no such trial.
    """
    events = [
        event
        for _, event in read_records(bag.messages(EVENT, namespace=namespace))
        if event.trial_id == trial_id
    ]
    if len(events) < 2:
        raise BagError(f'{bag.path} has no trial {trial_id}')
    begin_ns = events[0].stamp_ns
    starts = [(event.stamp_ns - begin_ns) * 1e-9 for event in events]
    phases = tuple(
        (event.phase, start, end)
        for event, start, end in zip(events[:-1], starts[:-1], starts[1:], strict=True)
    )
    ((time_s, tension_n),) = read_spans(bag, namespace, [(begin_ns, events[-1].stamp_ns)])
    return TrialTrace(begin_ns, time_s, tension_n, phases)


def read_spans(
    bag: TactileBag, namespace: str, spans_ns: Sequence[tuple[int, int]]
) -> list[Samples]:
    """Return the samples from start to end of each span, in time since its start."""
    offsets_ns: list[list[NDArray[np.int64]]] = [[] for _ in spans_ns]
    values: list[list[NDArray[np.float64]]] = [[] for _ in spans_ns]
    for _, block in read_records(bag.messages(STRAIN, namespace=namespace)):
        stamps_ns = block.stamp_ns + np.arange(len(block.tension_n)) * block.period_ns
        for i, (start_ns, end_ns) in enumerate(spans_ns):
            inside = (stamps_ns >= start_ns) & (stamps_ns <= end_ns)
            if inside.any():
                offsets_ns[i].append(stamps_ns[inside] - start_ns)
                values[i].append(np.asarray(block.tension_n, dtype=np.float64)[inside])
    return [
        (1e-9 * np.concatenate([np.empty(0), *offsets]), np.concatenate([np.empty(0), *parts]))
        for offsets, parts in zip(offsets_ns, values, strict=True)
    ]
