# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The stream of an ATI Digital F/T to blocks: calibration, decimation, host time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.ati.counter import Batch
from tendon_sensor_driver.ati.digital_ft_protocol import (
    DigitalCalibration,
    StreamDecoder,
    StreamPart,
)
from tendon_sensor_driver.ati.sample_stream import CountedStream
from tendon_sensor_driver.records import TendonSensorConfig

_FIRST_MEASUREMENT_S = 0.5
_LONGEST_MEASUREMENT_S = 60.0


class DigitalFtStream:
    """Bytes in, blocks out.

    The device has no clock and its rate is its own. The rate is measured from arrivals, in
    half a second first and then over twice as long each time, up to a minute; as many records
    as bring it near the wanted rate are averaged to one sample. Samples carry host time; how
    many are lost is told by the bytes that were dropped, and across a pause by its length.

    Attributes
    ----------
    decoder : StreamDecoder
        Counts bytes and records.
    samples : CountedStream
        Counts and stamps the samples.
    """

    def __init__(self, config: TendonSensorConfig) -> None:
        self._config = config
        self.decoder = StreamDecoder()
        self.samples = CountedStream(config)
        self._matrix = np.eye(6)
        self._averaged = 0  # records in a sample; 0: the rate is not known yet
        self._index = 0  # of the next sample
        self._newest_ns = 0  # arrival of the newest sample
        self._is_resumed = False
        self._wait: list[NDArray[np.float64]] = []
        self._wait_errors: list[NDArray[np.bool_]] = []
        self._begun_ns: int | None = None
        self._measure_s = _FIRST_MEASUREMENT_S
        self._counted = 0

    @property
    def rate_hz(self) -> float:
        """Rate of the samples as measured [Hz]; 0 as long as it is not."""
        return self.samples.rate_hz if self._averaged else 0.0

    def begin_session(self, calibration: DigitalCalibration) -> None:
        """Say that the link stands, for the first time or again."""
        self._matrix = calibration.matrix
        self.decoder.reset()
        self._forget()
        self._begun_ns = None
        self._measure_s = _FIRST_MEASUREMENT_S
        if self._averaged:
            self.samples.begin_session(self.samples.rate_hz, 1, is_clock=False)
            self._is_resumed = True

    def note_clock_step(self, step_ns: int) -> None:
        """Say that the host's clock was set by this before the next bytes [ns]."""
        self.samples.note_clock_step(step_ns)
        self._newest_ns += step_ns
        if self._begun_ns is not None:
            self._begun_ns += step_ns

    def add(self, data: bytes, received_at_ns: int) -> list[StrainBlock]:
        """Take bytes; return the blocks that they complete."""
        blocks: list[StrainBlock] = []
        for part in self.decoder.feed(data):
            self._measure(len(part.gauges) + part.lost_before, received_at_ns)
            if not self._averaged:
                continue
            if part.lost_before:
                self.samples.note_dropped_bytes()
                self._index += -(-part.lost_before // self._averaged)
                self._forget()
            blocks += self._average(part, received_at_ns)
        return blocks

    def _forget(self) -> None:
        self._wait.clear()
        self._wait_errors.clear()

    def _measure(self, records: int, received_at_ns: int) -> None:
        """Count records against the host's clock."""
        if self._begun_ns is None:
            self._begun_ns, self._counted = received_at_ns, 0
            return  # the records of the first read are older than it
        self._counted += records
        elapsed_s = (received_at_ns - self._begun_ns) / 1e9
        if elapsed_s < self._measure_s:
            return
        rate_hz = self._counted / elapsed_s
        if self._averaged:
            self.samples.correct_rate(rate_hz / self._averaged)
        else:
            self._averaged = max(1, round(rate_hz / self._config.rate_hz))
            self.samples.begin_session(rate_hz / self._averaged, 1, is_clock=False)
        if self._measure_s < _LONGEST_MEASUREMENT_S:
            self._measure_s *= 2
        else:
            self._begun_ns, self._counted = received_at_ns, 0

    def _average(self, part: StreamPart, received_at_ns: int) -> list[StrainBlock]:
        self._wait.append(part.gauges @ self._matrix.T)
        self._wait_errors.append(part.has_error)
        wrench = np.concatenate(self._wait)
        errors = np.concatenate(self._wait_errors)
        count = len(wrench) // self._averaged
        used = count * self._averaged
        self._wait, self._wait_errors = [wrench[used:]], [errors[used:]]
        if not count:
            return []
        has_error = errors[:used].reshape(count, -1).any(axis=1)
        status = np.where(has_error, int(StrainStatus.DEVICE_ERROR), 0)
        if self._is_resumed:  # what the pause has cost is known by the host's clock alone
            elapsed_s = (received_at_ns - self._newest_ns) / 1e9
            self._index += max(0, round(elapsed_s * self.rate_hz) - count)
            self._is_resumed = False
        self._newest_ns = received_at_ns
        numbers = (self._index + np.arange(count)).astype(np.uint32)
        self._index += count
        return self.samples.add(
            Batch(
                records=numbers,
                ticks=numbers,
                wrench=wrench[:used].reshape(count, self._averaged, 6).mean(axis=1),
                status=(status | int(StrainStatus.HOST_TIME)).astype(np.uint32),
                timed=count - 1,
                received_at_ns=received_at_ns,
            )
        )
