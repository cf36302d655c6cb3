# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tension of one recorded trial with its phases, for plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_bags.bag_reader import TactileBag
from tactile_bags.errors import BagError
from tactile_bags.message_records import read_records
from tactile_bags.recorded_topics import EVENT, STRAIN


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
    begin_ns, end_ns = events[0].stamp_ns, events[-1].stamp_ns
    offsets_ns: list[int] = []
    tension_n: list[float] = []
    for _, block in read_records(bag.messages(STRAIN, namespace=namespace)):
        for i, value in enumerate(block.tension_n):
            stamp_ns = block.stamp_ns + i * block.period_ns
            if begin_ns <= stamp_ns <= end_ns:
                offsets_ns.append(stamp_ns - begin_ns)
                tension_n.append(float(value))
    starts = [(event.stamp_ns - begin_ns) * 1e-9 for event in events]
    phases = tuple(
        (event.phase, start, end)
        for event, start, end in zip(events[:-1], starts[:-1], starts[1:], strict=True)
    )
    return TrialTrace(
        begin_ns, np.array(offsets_ns) * 1e-9, np.array(tension_n, dtype=np.float64), phases
    )
