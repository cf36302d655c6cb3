# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Readings in, blocks out: calibration, clock and numbering of one sensor, without IO."""

from __future__ import annotations

from tendon_sensor_driver.calibration import Calibration
from tendon_sensor_driver.clock import DeviceClock, HostClock
from tendon_sensor_driver.records import Block, Reading, StrainStatus, TendonSensorConfig
from tendon_sensor_driver.sequencer import Sequencer


class StrainStream:
    """Turns the readings of one sensor into blocks of tension.

    Parameters
    ----------
    config : TendonSensorConfig
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._calibration = Calibration(config.unit, config.scale)
        self._clock: DeviceClock | HostClock
        if config.time_column < 0:
            self._clock = HostClock()
            self._status = StrainStatus.HOST_TIME
        else:
            self._clock = DeviceClock(config.time_unit_s)
            self._status = StrainStatus.OK
        self._sequencer = Sequencer(config.period_ns, config.samples_per_block)
        self._saturation_n = config.saturation_n or float('inf')
        self._event = StrainStatus.OK

    @property
    def lost_samples(self) -> int:
        return self._sequencer.lost_samples

    @property
    def late_samples(self) -> int:
        return self._clock.late_samples

    @property
    def outliers(self) -> int:
        return self._clock.outliers

    def add(self, reading: Reading) -> list[Block]:
        """Take one reading; return the blocks that it completes."""
        if reading.resynchronised:
            self._event |= StrainStatus.RESYNCHRONISED
        outliers = self._clock.outliers
        instant = self._clock.place(reading.device_ticks, reading.received_at_ns)
        if instant is None:
            if self._clock.outliers > outliers:  # a line was dropped after all
                self._event |= StrainStatus.RESYNCHRONISED
            return []
        tension_n = self._calibration.to_newtons(reading.value)
        status = self._status
        if abs(tension_n) >= self._saturation_n:
            status |= StrainStatus.SATURATED
        event = self._event
        if instant.is_restart:
            event |= StrainStatus.RECONNECTED
        self._event = StrainStatus.OK
        return self._sequencer.add(instant, tension_n, status, event)

    def note_dropped_bytes(self) -> None:
        """Say that part of the byte stream is missing before the next reading."""
        self._event |= StrainStatus.RESYNCHRONISED

    def note_reconnection(self) -> None:
        """Say that the link was lost and came back before the next reading."""
        self._clock.note_reconnection()
        self._event |= StrainStatus.RECONNECTED

    def flush(self) -> list[Block]:
        """Return the unfinished block, if there is one."""
        return self._sequencer.flush()
