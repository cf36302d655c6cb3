# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The records that pass through the driver, and its configuration."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from tactile_ros.configs import check_parameters, parameter
from tactile_ros.strain import StrainStatus

SENSORS = ('line', 'net_ft', 'topic')
NEWTONS = {
    'kg': 9.80665,
    'g': 0.00980665,
    't': 9806.65,
    'N': 1.0,
    'mN': 0.001,
    'kN': 1000.0,
    'lbf': 4.4482216152605,  # 0.45359237 kg
    'oz': 0.27801385095378125,  # 1/16 lbf
}
"""Newtons in one unit, exact; of a weight at standard gravity (CGPM 1901)."""
AXES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
NORM = 'norm'
"""The length of the force vector of a wrench on a topic."""
_LOW_PASSES_HZ = (0, 838, 326, 152, 73, 35, 18, 8, 5, 1500, 2000, 2500, 3000)
LOW_PASS_CODES = {cutoff_hz: code for code, cutoff_hz in enumerate(_LOW_PASSES_HZ)}
"""The manual's code of the low pass in a Net F/T by its cut-off frequency [Hz]; 0: off."""

MOST_BLOCKS_HZ = 100
"""Most blocks a second by default: each is a message, or a call through the finger."""

_LEAST_RATE_HZ = 0.1
_MOST_TICKS = 0.75  # of a period in one step of the device time: none falls on the one before


@dataclass(frozen=True)
class TendonSensorConfig:
    """Configuration of the sensor: kind, connection and data format.

    The defaults fit lines ``milliseconds,kilograms,kg,`` sixty times a second. Parameters of
    other kinds of sensor are ignored, such as the columns with a six-axis sensor.

    Raises
    ------
    ValueError
        When a field is outside its range or two fields contradict each other.
    """

    sensor: str = parameter(
        'line',
        'kind of sensor: load-cell lines, ATI Net F/T, or a force that another node publishes '
        'on a topic',
        choices=SENSORS,
    )
    port: str = parameter('/dev/ttyUSB0', 'serial port of a sensor that sends lines')
    baud: int = parameter(115200, 'speed of the serial port', unit='baud', range=(300, 12_000_000))
    value_column: int = parameter(1, 'column of the value in a line, from 0', range=(0, 63))
    time_column: int = parameter(
        0,
        'column of the device time in a line, from 0; -1: the device sends no time',
        range=(-1, 63),
    )
    time_unit_s: float = parameter(
        0.001, 'what the device time counts', unit='s', range=(1e-9, 1.0)
    )
    time_decimals: int = parameter(
        0, 'digits after the point of the device time, always as many', range=(0, 9)
    )
    unit: str = parameter(
        'kg',
        'what the value of a line counts; kg, g, t and oz are weights at standard gravity. A line '
        'that names another unit is refused',
        choices=tuple(NEWTONS),
    )
    decimal_mark: str = parameter(
        '.',
        'mark before the decimals in a line; ".": every comma separates columns',
        choices=('.', ','),
    )
    line_columns: int = parameter(
        0,
        'number of columns in a line, where a number other than the time is beside the value; '
        'lines with another number of columns are refused. 0: a line with such a number is '
        'refused, since it may be part of the value',
        range=(0, 64),
    )
    scale: float = parameter(
        1.0,
        'factor on the value; -1 turns its sign. On a topic from its unit to newtons, such as '
        '1/radius for the torque of a joint',
        unit='1',
        range=(-1e12, 1e12),
    )
    offset_n: float = parameter(
        0.0,
        'added to value times scale, of lines and topics, beneath any tare; see tactile calibrate',
        unit='N',
        range=(-1e6, 1e6),
    )
    leave_menu: bool = parameter(
        True, 'send x to a load-cell board that waits in its settings menu instead of measuring'
    )
    host: str = parameter('192.168.1.1', 'name or address of a Net F/T')
    rdt_port: int = parameter(49152, 'UDP port of the samples of a Net F/T', range=(1, 65535))
    http_port: int = parameter(80, 'TCP port of the settings of a Net F/T', range=(1, 65535))
    axis: str = parameter(
        'fz',
        'component of a six-axis sensor or a wrench that is the tension, times scale; norm: '
        'length of the force of a wrench on a topic',
        choices=(*AXES, NORM),
    )
    low_pass_hz: int = parameter(
        18, 'low pass set in a Net F/T; 0: off', unit='Hz', choices=tuple(sorted(LOW_PASS_CODES))
    )
    topic: str = parameter(
        '',
        'topic of the force: WrenchStamped, Wrench, Float64, Float32 or JointState; its type is '
        'taken from the publisher',
    )
    joint: str = parameter(
        '', 'joint whose effort is the tension, of a JointState; empty: the only one'
    )
    topic_stamps: str = parameter(
        'header',
        'time of a sample on a topic: header of the message, or its arrival, as of messages '
        'without a header or with a zero stamp',
        choices=('header', 'arrival'),
    )
    rate_hz: float = parameter(
        60.0,
        'nominal sample rate; an ATI sensor is asked for it. 0: measured in the first two '
        'seconds, on a topic only',
        unit='Hz',
        range=(0.0, 10_000.0),
    )
    samples_per_block: int = parameter(
        0,
        f'samples in one message; 0: as few as give {MOST_BLOCKS_HZ} messages a second at most',
        unit='1',
        range=(0, 1000),
    )
    saturation_n: float = parameter(
        0.0,
        'magnitude from which the tension is no measurement; 0: not known',
        unit='N',
        range=(0.0, 1e6),
    )
    stuck_s: float = parameter(
        0.8,
        'time of exactly equal samples, at least ten, after which the sensor counts as stuck; '
        '0: never, for a coarse sensor',
        unit='s',
        range=(0.0, 3600.0),
    )
    silence_s: float = parameter(
        0.5,
        'time without a reading after which the link counts as silent',
        unit='s',
        range=(0.01, 3600.0),
    )
    tare_samples: int = parameter(60, 'samples that a tare is measured from', range=(2, 100_000))
    tare_limit_n: float = parameter(
        2.0,
        'magnitude of the mean, without any tare, from which a tare is refused as loaded',
        unit='N',
        range=(0.0, 1e6),
    )
    tare_spread_n: float = parameter(
        0.1,
        'standard deviation from which a tare is refused as noisy',
        unit='N',
        range=(0.0, 1e6),
    )
    tare_change_n: float = parameter(
        0.1,
        'rise or fall of the tension over the samples from which a tare is refused as moving',
        unit='N',
        range=(0.0, 1e6),
    )
    tendon_topic: str = parameter(
        'tendon_actuator/slack',
        'topic on which a tendon actuator says whether its tendon is slack: the tare is neither '
        'set nor cleared while it is taut; empty: no actuator is asked',
    )
    trial_topic: str = parameter(
        'trial_runner/events',
        'topic of the events of trials: the tare is neither set nor cleared while a trial runs; '
        'empty: no trials are heard of',
    )
    simulated: bool = parameter(
        False,
        'the sensor is simulated: marks every sample, and by it all that is derived. The '
        'simulated load cell says so in its lines, without this',
    )
    frame_id: str = parameter(
        'tendon_sensor_link', 'frame of the sensor, +x along the tendon, away from the finger'
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if self.sensor == 'net_ft':
            if not self.host:
                raise ValueError('host is empty; give the address of the Net F/T')
        elif self.sensor == 'topic':
            if not self.topic:
                raise ValueError('topic is empty; name the topic on which the force is published')
        elif not self.port:
            raise ValueError('port is empty; name the serial port of the sensor')
        if self.sensor != 'topic':
            self._check_device()
        if self.sensor == 'line' and self.time_column == self.value_column:
            raise ValueError(
                f'time_column and value_column are both {self.value_column}; '
                'set time_column to -1 if the device sends no time'
            )
        has_clock = self.sensor == 'line' and self.time_column >= 0
        if has_clock and self.tick_s * self.rate_hz > _MOST_TICKS:
            raise ValueError(
                f'a device time in steps of {self.tick_s:g} s cannot tell samples at '
                f'{self.rate_hz:g} Hz apart; let the device send finer ones, such as micros(), '
                'or set time_column to -1'
            )
        if self.scale == 0:
            raise ValueError('scale is 0; every tension would be 0 N, give another factor')
        if 0 < self.rate_hz < _LEAST_RATE_HZ:
            raise ValueError(f'rate_hz is {self.rate_hz}; it must be {_LEAST_RATE_HZ} or more')

    def _check_device(self) -> None:
        if not self.rate_hz:
            raise ValueError('rate_hz is 0, which is for topics; give the rate of the sensor')
        if self.axis == NORM:
            raise ValueError('axis is norm, which is for topics; name a component, such as fz')

    @property
    def period_ns(self) -> int:
        """Nominal time between two samples [ns]."""
        return round(1e9 / self.rate_hz)

    @property
    def block_samples(self) -> int:
        """Samples in one block: ``samples_per_block``, or as many as the rate asks for."""
        return self.samples_per_block or max(1, math.ceil(self.rate_hz / MOST_BLOCKS_HZ))

    @property
    def tick_s(self) -> float:
        """Smallest step of the device time of a load-cell line [s]."""
        return self.time_unit_s / 10.0**self.time_decimals


class Reading(NamedTuple):
    """One sample as the device sent it."""

    device_ticks: int | None  # device time in the device's own unit; None when it sends none
    value: float  # in the device's own unit
    received_at_ns: int  # host time of reading the bytes that completed it [ns]
    resynchronised: bool = False  # bytes that were no reading were dropped before it
    simulated: bool = False  # the device says that it is simulated


@dataclass(frozen=True)
class Health:
    """The state of the link at one moment; counters run from the opening."""

    is_connected: bool  # the port is open
    heard_at_ns: int  # host time of the last reading, or of the opening before the first [ns]
    bytes: int = 0
    lines: int = 0  # lines, messages or datagrams that were not blank
    readings: int = 0  # samples in them
    rejected_lines: int = 0  # those that held no samples
    lost_samples: int = 0  # missing by device time, counter or stamp
    duplicates: int = 0  # samples that came twice
    late_samples: int = 0  # samples that came after a later one
    outliers: int = 0  # samples whose device time fits nowhere
    bursts: int = 0  # times that three readings or more came at once
    reconnects: int = 0  # times that the link was lost and is back
    restarts: int = 0  # times that the device's clock began anew, or may have
    overruns: int = 0  # times that input was dropped because blocks were taken too slowly
    status: StrainStatus = StrainStatus.OK  # of the newest sample
    device_status: str = ''  # words of the device about what is wrong with it; empty: nothing
    rate_hz: float = 0.0  # rate at which the device truly samples [Hz]; 0: it does not say
    last_rejected: str = ''  # the last rejected line, shortened, as printable text
    last_reason: str = ''  # the reason of its rejection, and a remedy
    last_error: str = ''  # of the link or the consumer of blocks
    advice: str = ''  # about what arrives and what to do; empty: nothing is known to be wrong
