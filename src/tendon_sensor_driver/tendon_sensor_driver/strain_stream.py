# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Grouping of the samples of any sensor into blocks with sequence numbers and time stamps.

A client of a sensor reads a `Batch` of one or more samples. The clock of the sensor
(`SampleClock`) drops duplicate, late and implausible samples, and returns the others as runs of
consecutive samples (`Run`). `Stream` determines the status of each sample and groups the samples
into blocks:

    Batch -> SampleClock.place_batch -> Run, Run ... -> status of each sample -> StrainBlock ...

A new block begins when the block is full, after missing samples, after an event such as a
reconnection, when the status changes, and when the stamp of a run deviates by more than half a
period from the time that is expected from the stamp of the block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import functools
import math
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.clock import Batch, DeviceClock, HostClock, Run, SampleClock
from tendon_sensor_driver.config import NEWTONS, TendonSensorConfig
from tendon_sensor_driver.types import LineReading

_FEWEST_EQUAL = 10
# The bits are stored as integers, because operations on IntFlag are slow.
_SATURATED, _STUCK = int(StrainStatus.SATURATED), int(StrainStatus.STUCK)
_RECONNECTED = int(StrainStatus.RECONNECTED)
_RESYNCHRONISED = int(StrainStatus.RESYNCHRONISED)
_CLOCK_STEP = int(StrainStatus.CLOCK_STEP)
_SIMULATED = np.array([int(StrainStatus.SIMULATED)], dtype=np.uint32)

_status_of = functools.cache(StrainStatus)  # cached, because constructing an IntFlag is slow

Clock = TypeVar('Clock', bound=SampleClock)


@dataclass
class _OpenBlock:
    """A block to which samples are still added."""

    stamp_ns: int
    sequence: int
    lost_before: int
    error_s: float
    status: int  # status bits, which are equal for all samples of the block
    event: int  # status bits of events before the first sample
    period_ns: int
    samples: int = 0
    tensions: list[NDArray[np.float64]] = field(default_factory=list)
    wrenches: list[NDArray[np.float64]] = field(default_factory=list)

    def misfit_ns(self, stamp_ns: int) -> int:
        """Return the deviation of the next sample from its expected time in the block [ns]."""
        return stamp_ns - self.stamp_ns - self.samples * self.period_ns

    def widen_error(self, stamp_ns: int, error_s: float) -> None:
        """Increase the error bound of the block so that it includes the next sample.

        A negative bound means that the error is unknown.
        """
        if self.error_s >= 0:
            misfit_s = abs(self.misfit_ns(stamp_ns)) / 1e9
            self.error_s = max(self.error_s, error_s + misfit_s) if error_s >= 0 else -1.0


class Stream(Generic[Clock]):
    """Numbers the samples of one sensor, adds their status and groups them into blocks.

    A sample is marked as saturated if its magnitude is at least ``saturation_n``, and as stuck
    if at least ten equal samples in a row span ``stuck_s``.

    Parameters
    ----------
    config : TendonSensorConfig
        Limits, and the number of samples in a block.
    clock : SampleClock
        Assigns times to the samples.
    status : StrainStatus
        Status bits that all samples get, such as ``HOST_TIME``.

    Attributes
    ----------
    samples_per_block : int
        Number of samples in a full block; see `set_at_rest`.
    readings : int
        Number of accepted samples.
    lost_samples : int
        Number of missing samples.
    """

    def __init__(
        self, config: TendonSensorConfig, clock: Clock, status: StrainStatus = StrainStatus.OK
    ) -> None:
        self.clock = clock
        self.readings = self.lost_samples = 0
        self._status = int(status)
        self._config = config
        self.samples_per_block = config.block_samples
        self._always = int(status)
        self._saturation_n = config.saturation_n or math.inf
        self._stuck_ns = config.stuck_s * 1e9 or math.inf
        self._equal = 0  # number of equal samples in a row, including the newest
        self._last_n = math.nan
        self._sequence = -1
        self._event = 0  # status bits of events before the next sample
        self._open: _OpenBlock | None = None
        self._next_ns: int | None = None  # earliest allowed stamp of the next block

    @property
    def status(self) -> StrainStatus:
        """Status of the newest sample."""
        return StrainStatus(self._status)

    def add(self, batch: Batch) -> list[StrainBlock]:
        """Add samples that were read together; return the blocks that they complete.

        Raises
        ------
        CounterRestartError
            If the counter of a `CounterClock` jumped within a session.
        """
        outliers = self.clock.outliers
        runs = self.clock.place_batch(batch)
        if self.clock.outliers > outliers:
            self._event |= _RESYNCHRONISED
        blocks: list[StrainBlock] = []
        for run in runs:
            blocks += self._add_run(batch, run)
        return blocks

    def set_at_rest(self, is_at_rest: bool) -> None:
        """Use larger blocks while the tendon is at rest. Can be called from any thread."""
        config = self._config
        samples = config.rest_block_samples if is_at_rest else config.block_samples
        self.samples_per_block = samples

    def note_dropped_bytes(self) -> None:
        """Record that bytes before the next sample were lost or could not be decoded."""
        self._event |= _RESYNCHRONISED

    def note_reconnection(self) -> None:
        """Record that the link was lost and re-established before the next sample."""
        self.clock.note_reconnection()
        self._event |= _RECONNECTED

    def note_clock_step(self, step_ns: int) -> None:
        """Record that the host's clock was set by ``step_ns`` before the next sample."""
        self.clock.note_step(step_ns)
        if self._next_ns is not None:
            self._next_ns += step_ns
        self._event |= _CLOCK_STEP

    def flush(self) -> list[StrainBlock]:
        """End the unfinished block. Return a list of this block, or an empty list."""
        return [] if self._open is None else [self._close(self._open)]

    # -- one run -----------------------------------------------------------------------

    def _add_run(self, batch: Batch, run: Run) -> list[StrainBlock]:
        tension_n = batch.tension_n[run.samples]
        wrench = None if batch.wrench is None else batch.wrench[run.samples]
        status = self._judge(
            tension_n, None if batch.status is None else batch.status[run.samples]
        )
        count, period_ns, most = len(tension_n), self.clock.period_ns, self.samples_per_block
        self.lost_samples += run.lost
        self._sequence += run.lost
        self.readings += count
        if run.event:
            self._event |= run.event
            if run.event & _CLOCK_STEP:
                self._next_ns = None
        blocks: list[StrainBlock] = []
        made = self._open
        if made is not None and (
            run.lost or self._event or abs(made.misfit_ns(run.stamp_ns)) * 2 > period_ns
        ):
            blocks.append(self._close(made))
        ends = [count]
        if count > 1:
            ends = [*(np.flatnonzero(status[1:] != status[:-1]) + 1).tolist(), count]
        first, lost = 0, run.lost
        for end in ends:
            while first < end:
                stamp_ns, bits = run.stamp_ns + first * period_ns, int(status[first])
                made = self._open
                if made is not None and (
                    bits != made.status
                    or period_ns != made.period_ns
                    or made.samples >= most  # if `set_at_rest` has reduced the size
                ):
                    blocks.append(self._close(made))
                    made = None
                if made is None:
                    made = self._begin(stamp_ns, run.stamp_error_s, lost, bits)
                    lost = 0
                else:
                    made.widen_error(stamp_ns, run.stamp_error_s)
                last = min(end, first + most - made.samples)
                made.tensions.append(tension_n[first:last])
                if wrench is not None:
                    made.wrenches.append(wrench[first:last])
                made.samples += last - first
                self._sequence += last - first
                first = last
                if made.samples == most:
                    blocks.append(self._close(made))
        self._status = int(status[-1])
        return blocks

    def _begin(self, stamp_ns: int, error_s: float, lost: int, status: int) -> _OpenBlock:
        """Begin a block with the next sample. Its stamp is later than all stamps before it."""
        if self._next_ns is not None and stamp_ns < self._next_ns:
            error_s += (self._next_ns - stamp_ns) / 1e9 if error_s >= 0 else 0.0
            stamp_ns = self._next_ns
        event, self._event = self._event, 0
        self._open = _OpenBlock(
            stamp_ns, self._sequence + 1, lost, error_s, status, event, self.clock.period_ns
        )
        return self._open

    def _close(self, made: _OpenBlock) -> StrainBlock:
        self._open = None
        tension_n = made.tensions[0] if len(made.tensions) == 1 else np.concatenate(made.tensions)
        tension_n.flags.writeable = False  # because several consumers share the array
        self._next_ns = made.stamp_ns + (made.samples - 1) * made.period_ns + 1
        return StrainBlock(
            made.stamp_ns,
            made.sequence,
            made.period_ns,
            tension_n,
            lost_before=made.lost_before,
            stamp_error_s=made.error_s,
            status=_status_of(made.status | made.event),
            wrench=np.concatenate(made.wrenches) if made.wrenches else None,
        )

    def _judge(
        self, tension_n: NDArray[np.float64], stated: NDArray[np.uint32] | None
    ) -> Sequence[int] | NDArray[np.uint32]:
        """Return the status bits of each sample.

        They consist of the bits from the device (``stated``), and of those for saturated and
        stuck samples.
        """
        if len(tension_n) == 1:  # the same as below, but faster for single samples
            value_n = float(tension_n[0])
            self._equal = self._equal + 1 if value_n == self._last_n else 1
            self._last_n = value_n
            bits = self._always if stated is None else self._always | int(stated[0])
            bits |= _SATURATED if abs(value_n) >= self._saturation_n else 0
            if self._equal >= _FEWEST_EQUAL and self._are_stuck(self._equal):
                bits |= _STUCK
            return (bits,)
        status = np.full(len(tension_n), self._always, dtype=np.uint32)
        if stated is not None:
            status |= stated
        status[np.abs(tension_n) >= self._saturation_n] |= np.uint32(_SATURATED)
        is_equal = np.empty(len(tension_n), dtype=np.bool_)
        is_equal[0] = tension_n[0] == self._last_n
        np.equal(tension_n[1:], tension_n[:-1], out=is_equal[1:])
        self._last_n = float(tension_n[-1])
        if not is_equal.any():
            self._equal = 1
            return status
        # For each sample, compute how many samples in a row are equal up to this sample.
        position = np.arange(1, len(tension_n) + 1)
        change = np.maximum.accumulate(np.where(is_equal, -self._equal, position))
        equal = np.where(change > 0, position - change + 1, position + self._equal)
        self._equal = int(equal[-1])
        status[self._are_stuck(equal)] |= np.uint32(_STUCK)
        return status

    def _are_stuck(self, equal: Any) -> Any:
        """Return True if so many equal samples mean that the sensor is stuck.

        ``equal`` can be an integer or an array.
        """
        return (equal >= _FEWEST_EQUAL) & ((equal - 1) * self.clock.period_ns >= self._stuck_ns)


class StrainStream(Stream[SampleClock]):
    """Converts the readings of a load cell into blocks of tension.

    The tension is ``value * scale * newtons per unit + offset``.

    If a board sends no device time, its restarts cannot be detected. It is then assumed to have
    restarted after every reconnection, because many boards set their zero when they start.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._newtons_per_value = NEWTONS[config.unit] * config.scale
        self._offset_n = config.offset_n
        if config.time_column < 0:
            super().__init__(config, HostClock(config.period_ns), StrainStatus.HOST_TIME)
        else:
            super().__init__(config, DeviceClock(config.tick_s, config.period_ns))

    def note_reconnection(self) -> None:
        super().note_reconnection()
        if isinstance(self.clock, HostClock):
            self.clock.restarts += 1
            self._event |= int(StrainStatus.RESTARTED)

    def add_reading(self, reading: LineReading) -> list[StrainBlock]:
        """Add one reading; return the blocks that it completes."""
        if reading.resynchronised:
            self.note_dropped_bytes()
        return self.add(
            Batch(
                reading.received_at_ns,
                np.array([reading.value * self._newtons_per_value + self._offset_n]),
                None if reading.device_ticks is None else (reading.device_ticks,),
                status=_SIMULATED if reading.simulated else None,
            )
        )
