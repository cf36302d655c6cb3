# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples in, blocks out: clock, status and numbering of one sensor, without IO."""

from __future__ import annotations

import math

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.records import NEWTONS, Reading, TendonSensorConfig
from tendon_sensor_driver.stream.clock import DeviceClock, HostClock, SampleClock
from tendon_sensor_driver.stream.sequencer import Sequencer

_FEWEST_EQUAL = 10


class SampleStream:
    """Turns the samples of one sensor, in newtons, into blocks.

    Parameters
    ----------
    config : TendonSensorConfig
    clock : SampleClock
        What gives the samples their time.
    period_ns : int
        Time between two samples, as the device truly takes them [ns].
    status : StrainStatus
        What holds for every sample, such as HOST_TIME.

    Attributes
    ----------
    clock : SampleClock
        Counts the samples that have no place in time.
    """

    def __init__(
        self,
        config: TendonSensorConfig,
        clock: SampleClock,
        period_ns: int,
        status: StrainStatus = StrainStatus.OK,
    ) -> None:
        self.clock = clock
        self._sequencer = Sequencer(period_ns, config.samples_per_block)
        self._always = status
        self._saturation_n = config.saturation_n or math.inf
        self._most_equal = (
            max(_FEWEST_EQUAL, math.ceil(config.stuck_s * 1e9 / period_ns))
            if config.stuck_s
            else math.inf
        )
        self._equal = 0  # samples, the newest one too
        self._last_n = math.nan
        self._event = StrainStatus.OK
        self.status = status

    @property
    def lost_samples(self) -> int:
        return self._sequencer.lost_samples

    def add_sample(
        self,
        device_ticks: int | None,
        received_at_ns: int,
        tension_n: float,
        status: StrainStatus = StrainStatus.OK,
        wrench: list[float] | None = None,
    ) -> list[StrainBlock]:
        """Take one sample; return the blocks that it completes.

        Parameters
        ----------
        device_ticks : int or None
            Device time of the sample; None for a `HostClock`.
        received_at_ns : int
            Host time of its arrival [ns].
        tension_n : float
            Tension [N].
        status : StrainStatus
            What the device says about it.
        wrench : list of 6 floats, optional
            Of a six-axis sensor [N, N m].
        """
        outliers = self.clock.outliers
        instant = self.clock.place(device_ticks, received_at_ns)
        if instant is None:
            if self.clock.outliers > outliers:  # a sample was dropped after all
                self._event |= StrainStatus.RESYNCHRONISED
            return []
        status = status | self._always
        if abs(tension_n) >= self._saturation_n:
            status |= StrainStatus.SATURATED
        self._equal = self._equal + 1 if tension_n == self._last_n else 1
        self._last_n = tension_n
        if self._equal > self._most_equal:
            status |= StrainStatus.STUCK
        event, self._event = self._event, StrainStatus.OK
        if instant.is_restart:
            event |= StrainStatus.RECONNECTED | StrainStatus.RESTARTED
        if instant.is_step:
            event |= StrainStatus.CLOCK_STEP
        if instant.is_leap:
            event |= StrainStatus.RESYNCHRONISED
        self.status = status
        return self._sequencer.add(instant, tension_n, status, event, wrench)

    def note_dropped_bytes(self) -> None:
        """Say that part of the stream is missing, or was no sample, before the next one."""
        self._event |= StrainStatus.RESYNCHRONISED

    def note_reconnection(self) -> None:
        """Say that the link was lost and came back before the next sample."""
        self.clock.note_reconnection()
        self._event |= StrainStatus.RECONNECTED

    def note_clock_step(self, step_ns: int) -> None:
        """Say that the host's clock was set by this before the next sample [ns]."""
        self.clock.note_step(step_ns)
        self._event |= StrainStatus.CLOCK_STEP

    def flush(self) -> list[StrainBlock]:
        """Return the unfinished block, if there is one."""
        return self._sequencer.flush()


class StrainStream(SampleStream):
    """Turns the readings of a load-cell line into blocks of tension.

    Newtons are value * scale * (newtons in one unit) + offset.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._newtons_per_value = NEWTONS[config.unit] * config.scale
        self._offset_n = config.offset_n
        if config.time_column < 0:
            super().__init__(config, HostClock(), config.period_ns, StrainStatus.HOST_TIME)
        else:
            super().__init__(config, DeviceClock(config.tick_s), config.period_ns)

    def add(self, reading: Reading) -> list[StrainBlock]:
        """Take one reading; return the blocks that it completes."""
        if reading.resynchronised:
            self.note_dropped_bytes()
        tension_n = reading.value * self._newtons_per_value + self._offset_n
        return self.add_sample(reading.device_ticks, reading.received_at_ns, tension_n)
