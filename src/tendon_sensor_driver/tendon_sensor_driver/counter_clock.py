# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Clock for devices that number their samples, such as the ATI Net F/T."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainStatus
from tendon_sensor_driver.clock import Batch, DeviceClock, Instant, Run, SampleClock
from tendon_sensor_driver.errors import LinkError

_AGREEMENT_S = 1.0  # larger deviations of the counter from the host's clock are a restart
_HALF = 1 << 31
_SECOND_NS = 1_000_000_000
_MASK = (1 << 32) - 1


class CounterRestartError(LinkError):
    """The device's counter jumped, so the device has restarted."""


class NewSamples(NamedTuple):
    """Samples of a batch that were neither duplicate nor late."""

    indices: NDArray[np.intp]  # indices of the new samples, oldest first, shape (new,)
    # Distance of each new sample from the sample before it, in samples, shape (new,); 1 if no
    # sample is missing.
    steps: NDArray[np.int64]
    # Distance of each sample of the batch from the newest sample of earlier batches, in ticks,
    # shape (samples,).
    ahead_ticks: NDArray[np.int64]
    ticks: NDArray[np.uint32]  # counter value of each sample of the batch, shape (samples,)
    is_restart: bool  # the counter restarted, so the number of missing samples is unknown


class CounterClock(SampleClock):
    """Assigns times to samples that contain a 32-bit counter of the device.

    The counter can wrap, and it continues when the stream is started again (a new session). The
    number of ticks per sample is measured from counter and record numbers, because a Net F/T
    reports a rounded rate. Until two consecutive measurements agree, the value given to
    `begin_session` is used.
    """

    def __init__(self) -> None:
        super().__init__(period_ns=1)
        self.ticks_per_sample = 1
        self._tick_rate_hz = 1.0
        self._clock: DeviceClock | None = None  # maps ticks to ROS time
        self._newest: tuple[int, int] | None = None  # ticks, host time [ns]
        self._record: int | None = None
        self._measured = 0
        self._is_new_session = True
        self._lost = 0  # samples dropped since the last accepted sample
        self._end_ns: int | None = None  # stamp of the newest sample
        self._event = 0  # bits of `StrainStatus` of events before the next sample

    @property
    def rate_hz(self) -> float:
        """Measured rate of the samples [Hz]."""
        return self._tick_rate_hz / self.ticks_per_sample

    def begin_session(self, tick_rate_hz: float, ticks_per_sample: int) -> None:
        """Begin a session, in which record numbers start again; the device may have restarted.

        Parameters
        ----------
        tick_rate_hz : float
            Rate of the counter [Hz].
        ticks_per_sample : int
            Ticks per sample according to the device's settings.
        """
        if self._clock is None or tick_rate_hz != self._tick_rate_hz:
            self._tick_rate_hz = tick_rate_hz
            self._clock = DeviceClock(float(1 / Fraction(tick_rate_hz)), self.period_ns)
        self._clock.note_reconnection()
        self._measured = ticks_per_sample
        self._set_period(ticks_per_sample)
        self._record = None
        self._is_new_session = True

    def note_step(self, step_ns: int) -> None:
        if self._clock is not None:
            self._clock.note_step(step_ns)
        if self._newest is not None:
            self._newest = (self._newest[0], self._newest[1] + step_ns)
        if self._end_ns is not None:
            self._end_ns += step_ns

    def place_batch(self, batch: Batch) -> list[Run]:
        """Return the new samples as runs.

        Raises
        ------
        CounterRestartError
            If the counter jumped within a session. Then call `begin_session` before the next
            batch.
        """
        assert self._clock is not None, 'call begin_session first'
        new = self._sort(batch)
        if new.is_restart:
            self._event |= int(StrainStatus.RESTARTED)
        indices, ahead = new.indices, new.ahead_ticks
        if not len(indices):
            return []
        # If the sample with the known time of arrival is not new, the first new one is used.
        timed = batch.timed if ahead[batch.timed] > 0 else int(indices[0])
        instant = self._clock.place(int(new.ticks[timed]), batch.received_at_ns)
        if instant is None:  # the time is implausible; the next batch counts the samples as lost
            self.outliers += len(indices)
            self._lost += int(new.steps.sum())
            return []
        # A restart of the device would also change the counter. If only `DeviceClock` reports a
        # restart, the host's clock was set.
        if instant.is_step or (instant.is_restart and not self._event & StrainStatus.RESTARTED):
            self._event |= int(StrainStatus.CLOCK_STEP)
        if instant.is_leap:
            self._event |= int(StrainStatus.RESYNCHRONISED)
        return self._make_runs(new, ahead[indices] - ahead[timed], instant)

    def _make_runs(self, new: NewSamples, ticks: NDArray[np.int64], instant: Instant) -> list[Run]:
        """Return the new samples as runs, with stamps that are later than all earlier stamps.

        ``instant`` is the time of one sample of the batch, and ``ticks`` are the distances of the
        new samples from this sample, shape (new,).
        """
        offsets_ns = np.rint(ticks * (_SECOND_NS / self._tick_rate_hz)).astype(np.int64)
        stamps_ns = instant.stamp_ns + offsets_ns
        error_s = instant.stamp_error_s
        if self._end_ns is not None:
            shift_ns = self._end_ns + self.period_ns // 2 - int(stamps_ns[0])
            if shift_ns > 0:
                stamps_ns += shift_ns
                error_s += shift_ns / 1e9 if error_s >= 0 else 0.0
        self._end_ns = int(stamps_ns[-1])
        lost = new.steps - 1
        lost[0] += self._lost
        self._lost = 0
        starts = [0, *(np.flatnonzero(lost[1:]) + 1).tolist()]
        event, self._event = self._event, 0
        runs = []
        for first, last in zip(starts, [*starts[1:], len(lost)], strict=True):
            samples = new.indices[first:last]
            runs.append(Run(samples, int(stamps_ns[first]), error_s, int(lost[first]), event))
            event = 0
        return runs

    def _sort(self, batch: Batch) -> NewSamples:
        """Return the new samples of a batch in order of time."""
        ticks = np.asarray(batch.ticks, dtype=np.uint32)
        is_restart = self._judge(ticks, batch.received_at_ns)
        if is_restart or self._newest is None:
            before = (int(ticks[0]) - self.ticks_per_sample) & _MASK
            self._newest = (before, batch.received_at_ns)
        ahead = _subtract(ticks, self._newest[0])
        indices = self._select(ahead)
        steps: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        if len(indices):
            newest = indices[-1]
            if batch.records is not None:
                self._measure(int(batch.records[newest]), int(ahead[newest]))
            self._newest = (int(ticks[newest]), batch.received_at_ns)
            elapsed = ahead[indices]
            elapsed[1:] -= elapsed[:-1].copy()
            if is_restart:
                elapsed[0] = self.ticks_per_sample
            steps = np.maximum(np.rint(elapsed / self.ticks_per_sample).astype(np.int64), 1)
        return NewSamples(indices, steps, ahead, ticks, is_restart)

    def _set_period(self, ticks_per_sample: int) -> None:
        self.ticks_per_sample = ticks_per_sample
        self.period_ns = round(_SECOND_NS * ticks_per_sample / self._tick_rate_hz)

    def _judge(self, batch_ticks: NDArray[np.uint32], received_at_ns: int) -> bool:
        """Return True if the counter restarted before this session.

        Raises `CounterRestartError` if it restarted within the session.
        """
        is_new_session, self._is_new_session = self._is_new_session, False
        if self._newest is None:
            return False
        ticks, before_ns = self._newest
        # The time is negative if the host's clock was set back.
        elapsed_s = max(0.0, (received_at_ns - before_ns) / 1e9)
        jump_s = int(_subtract(batch_ticks, ticks).max()) / self._tick_rate_hz
        least_s = elapsed_s - _AGREEMENT_S if is_new_session else -_AGREEMENT_S / 4
        if least_s < jump_s < elapsed_s + _AGREEMENT_S:
            return False
        if not is_new_session:
            raise CounterRestartError(
                f'the sample counter jumped by {jump_s:.1f} s: the device has restarted'
            )
        self.restarts += 1
        return True

    def _select(self, ahead: NDArray[np.int64]) -> NDArray[np.intp]:
        if ahead[0] > 0 and (ahead[1:] > ahead[:-1]).all():
            return np.arange(len(ahead), dtype=np.intp)
        unique, indices = np.unique(ahead, return_index=True)
        self.duplicates += len(ahead) - len(unique) + int((unique == 0).sum())
        self.late_samples += int((unique < 0).sum())
        chosen: NDArray[np.intp] = indices[unique > 0]
        return chosen

    def _measure(self, record: int, ahead_ticks: int) -> None:
        """Update the ticks per sample when two consecutive measurements agree."""
        if self._record is not None:
            records = (record - self._record) & _MASK
            if 0 < records < _HALF and ahead_ticks >= records:
                measured = round(ahead_ticks / records)
                if measured == self._measured:
                    self._set_period(measured)
                self._measured = measured
        self._record = record


def _subtract(ticks: NDArray[np.uint32], before: int) -> NDArray[np.int64]:
    """Return the differences of 32-bit counters, which can be negative, as int64."""
    difference: NDArray[np.uint32] = ticks.astype(np.uint32) - np.uint32(before)
    return difference.view(np.int32).astype(np.int64)
