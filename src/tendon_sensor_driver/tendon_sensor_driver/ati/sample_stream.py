# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whole arrays of counted samples to numbered blocks: what `stream` does sample by sample."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.ati.counter import Batch, Order, SampleCounter
from tendon_sensor_driver.records import AXES, TendonSensorConfig
from tendon_sensor_driver.stream.clock import DeviceClock, HostClock, Instant

_FEWEST_STUCK = 10
_SECOND_NS = 1_000_000_000


@dataclass
class _Run:
    """The block under construction."""

    stamp_ns: int
    sequence: int
    lost_before: int
    error_s: float
    status: int
    event: StrainStatus
    samples: int = 0
    parts: list[NDArray[np.float64]] = field(default_factory=list)


class CountedStream:
    """Numbers samples by their device's counter, stamps them and groups them.

    The counter is clock and number in one. A block ends when it is full, before a gap,
    before a change of status, and where the clock was corrected by more than half a period.

    Attributes
    ----------
    counter : SampleCounter
        Counts what was dropped.
    readings, lost_samples, outliers : int
        Samples handed on, samples missing, samples without a place in time.
    status : StrainStatus
        Of the newest sample.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._config = config
        self._axis = AXES.index(config.axis)
        self._saturation_n = config.saturation_n
        self.counter = SampleCounter()
        self.readings = self.lost_samples = self.outliers = 0
        self.status = StrainStatus.OK
        self._tick_rate_hz = 0.0
        self._period_ns = 1
        self._clock: DeviceClock | HostClock = HostClock()
        self._sequence = -1
        self._end_ns: int | None = None  # stamp of the newest sample
        self._equal = 0
        self._tension_n = float('nan')
        self._lost = 0  # before the next sample
        self._event = StrainStatus.OK
        self._run: _Run | None = None

    def begin_session(
        self, tick_rate_hz: float, ticks_per_sample: int, *, is_clock: bool = True
    ) -> None:
        """Say that the link stands, for the first time or again.

        Parameters
        ----------
        tick_rate_hz : float
            Rate of the counter [Hz].
        ticks_per_sample : int
            Expected ticks from one sample to the next.
        is_clock : bool
            Whether the counter is the device's; one that the host counts tells no time.
        """
        if not is_clock:
            self._tick_rate_hz = tick_rate_hz
        elif tick_rate_hz != self._tick_rate_hz:
            self._tick_rate_hz = tick_rate_hz
            self._clock = DeviceClock(float(1 / Fraction(tick_rate_hz)))
        if self._sequence >= 0:
            self._clock.note_reconnection()
            self._event |= StrainStatus.RECONNECTED
        self.counter.begin_session(tick_rate_hz, ticks_per_sample)

    def correct_rate(self, tick_rate_hz: float) -> None:
        """Take a better value for the rate of a counter that is no clock [Hz]."""
        self._tick_rate_hz = tick_rate_hz

    @property
    def rate_hz(self) -> float:
        """Rate at which the device truly sends [Hz]."""
        return self._tick_rate_hz / self.counter.ticks_per_sample

    def note_dropped_bytes(self) -> None:
        """Say that something that was no sample was dropped before the next one."""
        self._event |= StrainStatus.RESYNCHRONISED

    def note_clock_step(self, step_ns: int) -> None:
        """Say that the host's clock was set by this before the next batch [ns]."""
        self._clock.note_step(step_ns)
        self.counter.note_clock_step(step_ns)
        if self._end_ns is not None:
            self._end_ns += step_ns
        self._event |= StrainStatus.CLOCK_STEP

    def add(self, batch: Batch) -> list[StrainBlock]:
        """Take a batch; return the blocks that it completes.

        Raises
        ------
        CounterRestartError
            When the counter jumps within a session; begin another one.
        """
        order = self.counter.sort(batch)
        if order.is_restart:
            self._event |= StrainStatus.RESTARTED
        if not len(order.indices):
            return []
        # A sample that came twice or late has no place in time.
        timed = batch.timed if order.ahead_ticks[batch.timed] > 0 else int(order.indices[0])
        instant = self._clock.place(int(batch.ticks[timed]), batch.received_at_ns)
        if instant is None:  # its time fits nothing: what is dropped here is missed below
            self.outliers += len(order.indices)
            self._lost += int(order.steps.sum())
            self._event |= StrainStatus.RESYNCHRONISED
            return []
        # The counter, not the clock, tells a restart: without it the host's clock was set.
        if instant.is_step or (instant.is_restart and not self._event & StrainStatus.RESTARTED):
            self._event |= StrainStatus.CLOCK_STEP
        if instant.is_leap:
            self._event |= StrainStatus.RESYNCHRONISED
        return self._place(batch._replace(timed=timed), order, instant)

    def flush(self) -> list[StrainBlock]:
        """Return the unfinished block, if there is one."""
        run, self._run = self._run, None
        if run is None:
            return []
        wrench = np.concatenate(run.parts)
        return [
            StrainBlock(
                stamp_ns=run.stamp_ns,
                sequence=run.sequence,
                period_ns=self._period_ns,
                tension_n=self._config.scale * wrench[:, self._axis],
                lost_before=run.lost_before,
                stamp_error_s=run.error_s,
                status=StrainStatus(run.status) | run.event,
                wrench=wrench,
            )
        ]

    # -- one batch ---------------------------------------------------------------------

    def _place(self, batch: Batch, order: Order, instant: Instant) -> list[StrainBlock]:
        indices, ahead = order.indices, order.ahead_ticks
        wrench = batch.wrench[indices]
        status = batch.status[indices] | self._judge(wrench)
        blocks = self._set_period()
        stamps, error_s = self._stamp(ahead[indices] - ahead[batch.timed], instant)
        lost = order.steps - 1
        lost[0] += self._lost
        self._lost = 0
        numbers = self._sequence + np.cumsum(lost + 1)
        self.readings += len(indices)
        self.lost_samples += int(lost.sum())

        is_break = lost > 0
        is_break[1:] |= status[1:] != status[:-1]
        is_break[0] |= self._is_break(int(stamps[0]), int(status[0]))
        starts = np.flatnonzero(is_break).tolist()
        if starts[:1] != [0]:
            starts.insert(0, 0)
        for first, last in zip(starts, [*starts[1:], len(indices)], strict=True):
            if is_break[first]:
                blocks += self.flush()
            blocks += self._extend(
                wrench[first:last],
                stamps[first:last],
                int(numbers[first]),
                int(lost[first]),
                int(status[first]),
                error_s,
            )
        self._sequence = int(numbers[-1])
        self.status = StrainStatus(int(status[-1]))
        return blocks

    def _set_period(self) -> list[StrainBlock]:
        """End the block when the device turns out to have another rate."""
        period_ns = round(_SECOND_NS * self.counter.ticks_per_sample / self._tick_rate_hz)
        blocks = self.flush() if period_ns != self._period_ns else []
        self._period_ns = period_ns
        return blocks

    def _stamp(
        self, ticks: NDArray[np.int64], instant: Instant
    ) -> tuple[NDArray[np.int64], float]:
        """Stamps of samples, from the one whose arrival was noted; later than any before."""
        stamps = instant.stamp_ns + np.rint(ticks * (_SECOND_NS / self._tick_rate_hz)).astype(
            np.int64
        )
        error_s = instant.stamp_error_s
        if self._end_ns is not None:
            shift_ns = self._end_ns + self._period_ns // 2 - int(stamps[0])
            if shift_ns > 0:
                stamps += shift_ns
                error_s += shift_ns / 1e9 if error_s >= 0 else 0.0
        return stamps, error_s

    def _is_break(self, stamp_ns: int, status: int) -> bool:
        run = self._run
        if run is None or self._event or status != run.status:
            return True
        misfit_ns = abs(stamp_ns - run.stamp_ns - run.samples * self._period_ns)
        return 2 * misfit_ns > self._period_ns

    def _extend(
        self,
        wrench: NDArray[np.float64],
        stamps: NDArray[np.int64],
        number: int,
        lost: int,
        status: int,
        error_s: float,
    ) -> list[StrainBlock]:
        """Take samples that belong together; return the blocks that they fill."""
        blocks: list[StrainBlock] = []
        taken = 0
        while taken < len(wrench):
            if self._run is None:
                self._run = _Run(
                    int(stamps[taken]), number + taken, lost, error_s, status, self._event
                )
                self._event = StrainStatus.OK
                lost = 0
            run = self._run
            part = wrench[taken : taken + self._config.samples_per_block - run.samples]
            run.parts.append(part)
            run.samples += len(part)
            run.error_s = max(run.error_s, error_s) if min(run.error_s, error_s) >= 0 else -1.0
            taken += len(part)
            self._end_ns = run.stamp_ns + (run.samples - 1) * self._period_ns
            if run.samples == self._config.samples_per_block:
                blocks += self.flush()
        return blocks

    def _judge(self, wrench: NDArray[np.float64]) -> NDArray[np.uint32]:
        """Status bits that the values themselves give."""
        tension_n = self._config.scale * wrench[:, self._axis]
        status = np.zeros(len(tension_n), dtype=np.uint32)
        if self._saturation_n:
            status[np.abs(tension_n) >= self._saturation_n] = int(StrainStatus.SATURATED)
        is_equal = np.empty(len(tension_n), dtype=np.bool_)
        is_equal[0] = tension_n[0] == self._tension_n
        np.equal(tension_n[1:], tension_n[:-1], out=is_equal[1:])
        self._tension_n = float(tension_n[-1])
        if not is_equal.any():
            self._equal = 1
            return status
        # Equal samples in a row, up to and with each one.
        position = np.arange(1, len(tension_n) + 1)
        change = np.maximum.accumulate(np.where(is_equal, -self._equal, position))
        equal = np.where(change > 0, position - change + 1, position + self._equal)
        self._equal = int(equal[-1])
        if self._config.stuck_s:
            needed = max(_FEWEST_STUCK, self._config.stuck_s * self.rate_hz)
            status[equal >= needed] |= int(StrainStatus.STUCK)
        return status
