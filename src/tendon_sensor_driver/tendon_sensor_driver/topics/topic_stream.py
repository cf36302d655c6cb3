# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings of a topic to blocks of tension, without ROS."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.records import TendonSensorConfig
from tendon_sensor_driver.stream.clock import Batch
from tendon_sensor_driver.stream.strain_stream import Stream
from tendon_sensor_driver.topics.readings import TopicReading
from tendon_sensor_driver.topics.stamps import RateMeter, StampClock

LARGEST_TENSION_N = 1e9
"""A larger value is no tension of anything, and is refused by who takes the blocks."""


class TopicStream:
    """Turns the readings of one topic into blocks.

    A value that is not finite is handed on as not a number and marked ``DEVICE_ERROR``. With
    ``rate_hz`` 0 the rate is measured first; the readings until then make no blocks.

    Attributes
    ----------
    readings : int
        Readings that were taken.
    meter : RateMeter
        Measures the rate all the time.
    is_value_finite : bool
        Whether the newest value was a number.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._config = config
        self.meter = RateMeter()
        self.readings = 0
        self.is_value_finite = True
        self.clock: StampClock | None = None
        self.samples: Stream[StampClock] | None = None
        if config.rate_hz:
            self._begin(config)

    def _begin(self, config: TendonSensorConfig) -> None:
        self._config = config
        self.clock = StampClock(config.period_ns)
        self.samples = Stream(config, self.clock)

    @property
    def rate_hz(self) -> float:
        """Nominal rate [Hz]; 0 until it is measured."""
        return self._config.rate_hz

    def add(
        self, reading: TopicReading, received_at_ns: int, number: int | None = None
    ) -> list[StrainBlock]:
        """Take one reading; return the blocks that it completes.

        Parameters
        ----------
        reading : TopicReading
        received_at_ns : int
            Time of its arrival [ns].
        number : int, optional
            The middleware's number of the message, consecutive for one publisher.
        """
        self.readings += 1
        stamp_ns = reading.stamp_ns if self._config.topic_stamps == 'header' else None
        is_measured = self.meter.add(stamp_ns, received_at_ns)
        if self.samples is None or self.clock is None:
            if is_measured:
                self._begin(dataclasses.replace(self._config, rate_hz=self.meter.rate_hz))
            return []
        status = StrainStatus.OK if stamp_ns is not None else StrainStatus.HOST_TIME
        tension_n = reading.tension_n + self._config.offset_n
        self.is_value_finite = abs(tension_n) <= LARGEST_TENSION_N
        if not self.is_value_finite:
            tension_n = math.nan
            status |= StrainStatus.DEVICE_ERROR
        self.clock.number = number
        return self.samples.add(
            Batch(
                received_at_ns,
                np.array([tension_n]),
                None if stamp_ns is None else (stamp_ns,),
                None if reading.wrench is None else np.array([reading.wrench]),
                np.array([int(status)], dtype=np.uint32),
            )
        )

    def note_reconnection(self) -> None:
        """Say that the publisher went away and one came back."""
        if self.samples is not None:
            self.samples.note_reconnection()

    def note_clock_step(self, step_ns: int) -> None:
        """Say that the host's clock was set by this before the next reading [ns]."""
        if self.samples is not None:
            self.samples.note_clock_step(step_ns)

    def flush(self) -> list[StrainBlock]:
        """Return the unfinished block, if there is one."""
        return [] if self.samples is None else self.samples.flush()
