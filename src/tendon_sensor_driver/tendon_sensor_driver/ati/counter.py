# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sample counter of a device: which samples are new, and how many are missing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendon_sensor_driver.errors import LinkError

_AGREEMENT_S = 1.0  # of the device's counter with the host's clock
_HALF = 1 << 31
_MASK = (1 << 32) - 1


class CounterRestartError(LinkError):
    """The device's counter does not go on from where it was: it has been restarted."""


class Batch(NamedTuple):
    """Samples that were read together, in the order of their arrival.

    Attributes
    ----------
    records : ndarray
        Numbers of the records in this session of the link, uint32, shape (samples,).
    ticks : ndarray
        The device's counter, uint32, shape (samples,).
    wrench : ndarray
        Fx, Fy, Fz [N], Tx, Ty, Tz [N m], float64, shape (samples, 6).
    status : ndarray
        Bits of `StrainStatus`, uint32, shape (samples,).
    timed : int
        Index of the sample that arrived at ``received_at_ns``; of the others it is only
        known that they arrived at about that time.
    received_at_ns : int
        Host time [ns].
    """

    records: NDArray[np.uint32]
    ticks: NDArray[np.uint32]
    wrench: NDArray[np.float64]
    status: NDArray[np.uint32]
    timed: int
    received_at_ns: int


class Order(NamedTuple):
    """What is new in a batch.

    Attributes
    ----------
    indices : ndarray
        Of the new samples, oldest first, shape (new,).
    steps : ndarray
        Whole samples from the one before to each, 1 when nothing is missing, int64,
        shape (new,).
    ahead_ticks : ndarray
        Ticks of each sample of the batch after the newest one of the batch before, int64,
        shape (samples,).
    is_restart : bool
        Whether the counter began anew, so that nothing is known of what is missing.
    """

    indices: NDArray[np.intp]
    steps: NDArray[np.int64]
    ahead_ticks: NDArray[np.int64]
    is_restart: bool


class SampleCounter:
    """Follows the counter of a device over batches, wraps and sessions.

    The ticks from one sample to the next are taken from the records themselves, because a
    box rounds the rate that it reports; until two measurements agree, ``ticks_per_sample``
    stands in.

    Attributes
    ----------
    ticks_per_sample : int
        Ticks from one sample to the next.
    duplicates, late, restarts : int
        Samples that repeat another one, samples older than one handed out before, and new
        beginnings of the counter.
    """

    def __init__(self) -> None:
        self.ticks_per_sample = 1
        self.duplicates = self.late = self.restarts = 0
        self._tick_rate_hz = 1.0
        self._newest: tuple[int, int] | None = None  # ticks, host time [ns]
        self._record: int | None = None
        self._measured = 0
        self._is_new_session = True

    def begin_session(self, tick_rate_hz: float, ticks_per_sample: int) -> None:
        """Expect record numbers from 1, and perhaps a counter that began anew."""
        self._tick_rate_hz = tick_rate_hz
        self.ticks_per_sample = self._measured = ticks_per_sample
        self._record = None
        self._is_new_session = True

    def note_clock_step(self, step_ns: int) -> None:
        """Say that the host's clock was set by this before the next batch [ns]."""
        if self._newest is not None:
            self._newest = (self._newest[0], self._newest[1] + step_ns)

    def sort(self, batch: Batch) -> Order:
        """Return the new samples of a batch in their order.

        Raises
        ------
        CounterRestartError
            When the counter jumps within a session; begin another one.
        """
        is_restart = self._judge(batch)
        if is_restart or self._newest is None:
            before = (int(batch.ticks[0]) - self.ticks_per_sample) & _MASK
            self._newest = (before, batch.received_at_ns)
        ahead = _subtract(batch.ticks, self._newest[0])
        indices = self._select(ahead)
        steps: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        if len(indices):
            newest = indices[-1]
            self._measure(int(batch.records[newest]), int(ahead[newest]))
            self._newest = (int(batch.ticks[newest]), batch.received_at_ns)
            elapsed = ahead[indices]
            elapsed[1:] -= elapsed[:-1].copy()
            if is_restart:
                elapsed[0] = self.ticks_per_sample
            steps = np.maximum(np.rint(elapsed / self.ticks_per_sample).astype(np.int64), 1)
        return Order(indices, steps, ahead, is_restart)

    def _judge(self, batch: Batch) -> bool:
        """Whether the counter began anew with this session; an error if within one."""
        is_new_session, self._is_new_session = self._is_new_session, False
        if self._newest is None:
            return False
        ticks, received_at_ns = self._newest
        # The host's clock may be set back, the counter not.
        elapsed_s = max(0.0, (batch.received_at_ns - received_at_ns) / 1e9)
        jump_s = int(_subtract(batch.ticks, ticks).max()) / self._tick_rate_hz
        least_s = elapsed_s - _AGREEMENT_S if is_new_session else -_AGREEMENT_S / 4
        if least_s < jump_s < elapsed_s + _AGREEMENT_S:
            return False
        if not is_new_session:
            raise CounterRestartError(
                f'the sample counter jumped by {jump_s:.1f} s: the device was restarted'
            )
        self.restarts += 1
        return True

    def _select(self, ahead: NDArray[np.int64]) -> NDArray[np.intp]:
        if ahead[0] > 0 and (ahead[1:] > ahead[:-1]).all():
            return np.arange(len(ahead), dtype=np.intp)
        unique, indices = np.unique(ahead, return_index=True)
        self.duplicates += len(ahead) - len(unique) + int((unique == 0).sum())
        self.late += int((unique < 0).sum())
        chosen: NDArray[np.intp] = indices[unique > 0]
        return chosen

    def _measure(self, record: int, ahead_ticks: int) -> None:
        """Correct the ticks of a sample when two measurements in turn agree on another."""
        if self._record is not None:
            records = (record - self._record) & _MASK
            if 0 < records < _HALF and ahead_ticks >= records:
                measured = round(ahead_ticks / records)
                if measured == self._measured:
                    self.ticks_per_sample = measured
                self._measured = measured
        self._record = record


def _subtract(ticks: NDArray[np.uint32], before: int) -> NDArray[np.int64]:
    """Signed difference of 32-bit counters."""
    difference: NDArray[np.uint32] = ticks.astype(np.uint32) - np.uint32(before)
    return difference.view(np.int32).astype(np.int64)
