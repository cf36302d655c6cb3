# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings and health of a sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tactile_ros.strain import StrainStatus


class LineReading(NamedTuple):
    """The content of one line from a load cell."""

    device_ticks: int | None  # device time in ticks; None if the device sends none
    value: float  # value in the unit of the parameter ``unit``
    received_at_ns: int  # host time at which the end of the line was read [ns]
    resynchronised: bool = False  # bytes that could not be decoded were dropped before the line
    simulated: bool = False  # the line says that the device is simulated


@dataclass(frozen=True)
class SensorHealth:
    """State of the link at one moment. All counters start when the client is opened."""

    is_connected: bool  # the port is open
    heard_at_ns: int  # host time [ns] of the last reading, or of `open` before the first one
    bytes: int = 0
    lines: int = 0  # received lines, messages or datagrams; blank lines are not counted
    readings: int = 0  # received samples
    rejected_lines: int = 0  # lines, messages or datagrams without a valid sample
    lost_samples: int = 0  # samples missing according to device time, counter or stamp
    irregular_stamps: int = 0  # see `tendon_sensor_driver.topic_stream.StampClock`
    duplicates: int = 0  # samples that were received twice
    late_samples: int = 0  # samples that were received after a newer one
    outliers: int = 0  # samples dropped because of an implausible device time
    bursts: int = 0  # number of reads that returned three or more readings
    reconnects: int = 0  # number of times that a lost link was re-established
    restarts: int = 0  # number of times that the device restarted, or may have restarted
    overruns: int = 0  # number of times that input was dropped because ``on_block`` was too slow
    status: StrainStatus = StrainStatus.OK  # status of the newest sample
    device_status: str | None = None  # errors that the device reports, comma-separated
    rate_hz: float = 0.0  # measured rate of a Net F/T or a topic [Hz]; 0: unknown
    last_rejected: str = ''  # the last rejected line, shortened, as printable text
    last_reason: str | None = None  # reason for the last rejection, with a remedy
    last_error: str | None = None  # last error of the link or of ``on_block``
    advice: str | None = None  # problem of the received samples, with a remedy
