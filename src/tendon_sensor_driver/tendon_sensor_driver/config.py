# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the driver."""

from __future__ import annotations

from dataclasses import dataclass
import math

from tactile_ros.configs import check_parameters, parameter

SENSORS = ('line', 'net_ft', 'topic')
NEWTONS = {
    'kg': 9.80665,
    'g': 0.00980665,
    't': 9806.65,
    'N': 1.0,
    'mN': 0.001,
    'kN': 1000.0,
    'lbf': 4.4482216152605,  # 1 lb is 0.45359237 kg
    'oz': 0.27801385095378125,  # 1 oz is 1/16 lb
}
"""Exact number of newtons per unit. Masses are converted with standard gravity (CGPM 1901)."""
AXES = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
NORM = 'norm'
"""Value of ``axis`` that selects the magnitude of the force of a wrench on a topic."""
_LOW_PASSES_HZ = (0, 838, 326, 152, 73, 35, 18, 8, 5, 1500, 2000, 2500, 3000)
LOW_PASS_CODES = {cutoff_hz: code for code, cutoff_hz in enumerate(_LOW_PASSES_HZ)}
"""Code of a Net F/T's low-pass filter by cut-off frequency [Hz]; 0 Hz means no filter."""

MOST_BLOCKS_HZ, REST_BLOCKS_HZ = 100, 20
"""Highest default rate of blocks [Hz], in general and while the tendon is at rest.

The rate is limited, because each block is published and processed separately.
"""

_LEAST_RATE_HZ = 0.1
# Largest tick of the device time, in sample periods. With longer ticks, two samples could have the
# same device time.
_MOST_TICKS = 0.75


@dataclass(frozen=True)
class TendonSensorConfig:
    """Configuration of the sensor: kind, connection and data format.

    The default values are for a load cell that sends lines ``milliseconds,kilograms,kg,`` at
    60 Hz. Parameters that belong to another kind of sensor are ignored. For example, a Net F/T
    ignores the parameters of lines.

    Raises
    ------
    ValueError
        If a field is outside its range or two fields contradict each other.
    """

    sensor: str = parameter(
        'line',
        'kind of sensor: load-cell lines, ATI Net F/T, or a force that another node publishes '
        'on a topic',
        choices=SENSORS,
    )
    port: str = parameter('/dev/ttyUSB0', 'serial port of a sensor that sends lines')
    baud: int = parameter(115200, 'speed of the serial port', unit='baud', range=(300, 12_000_000))
    value_column: int = parameter(
        1, 'column of the value in a line, counted from 0', range=(0, 63)
    )
    time_column: int = parameter(
        0,
        'column of the device time in a line, counted from 0; -1 if the device sends no time',
        range=(-1, 63),
    )
    time_unit_s: float = parameter(0.001, 'unit of the device time', unit='s', range=(1e-9, 1.0))
    time_decimals: int = parameter(
        0,
        'number of digits after the decimal mark of the device time; every line must have this '
        'number',
        range=(0, 9),
    )
    unit: str = parameter(
        'kg',
        'unit of the value in a line; kg, g, t and oz are weights at standard gravity. A line '
        'that names another unit is refused',
        choices=tuple(NEWTONS),
    )
    decimal_mark: str = parameter(
        '.',
        'decimal mark in a line; if it is ".", every comma separates columns',
        choices=('.', ','),
    )
    line_columns: int = parameter(
        0,
        'number of columns in a line; required if a number other than the time is next to the '
        'value. Lines with another number of columns are refused. 0: a line with such a number '
        'is refused, because the number may be part of the value',
        range=(0, 64),
    )
    scale: float = parameter(
        1.0,
        'factor by which the value is multiplied; a negative factor reverses the sign. For a '
        'topic, it includes the conversion to newtons, such as 1/radius for the torque of a joint',
        unit='1',
        range=(-1e12, 1e12),
    )
    offset_n: float = parameter(
        0.0,
        'offset of a line sensor or a topic, added to value * scale before the tare is '
        'subtracted; see tactile calibrate',
        unit='N',
        range=(-1e6, 1e6),
    )
    leave_menu: bool = parameter(
        True, 'send x to a load-cell board whose settings menu is open, so that it measures again'
    )
    host: str = parameter('192.168.1.1', 'name or address of a Net F/T')
    rdt_port: int = parameter(49152, 'UDP port of the samples of a Net F/T', range=(1, 65535))
    http_port: int = parameter(80, 'TCP port of the settings of a Net F/T', range=(1, 65535))
    axis: str = parameter(
        'fz',
        'component of a six-axis sensor or of a wrench; the tension is this component times '
        'scale. norm: magnitude of the force of a wrench on a topic',
        choices=(*AXES, NORM),
    )
    low_pass_hz: int = parameter(
        18,
        'cut-off frequency of the low-pass filter that is set in a Net F/T; 0: off',
        unit='Hz',
        choices=tuple(sorted(LOW_PASS_CODES)),
    )
    topic: str = parameter(
        '',
        'topic of the force: WrenchStamped, Wrench, Float64, Float32 or JointState; the message '
        'type is taken from the publisher',
    )
    joint: str = parameter(
        '',
        'joint of a JointState whose effort is the tension; may be empty if the message has one '
        'joint only',
    )
    topic_stamps: str = parameter(
        'header',
        'time of a sample on a topic: the stamp of the message header, or the time of arrival. '
        'A message without a header or with a zero stamp always gets the time of arrival',
        choices=('header', 'arrival'),
    )
    rate_hz: float = parameter(
        60.0,
        'nominal sample rate; a Net F/T is set to this rate. For a topic, 0 means that the rate '
        'is measured during the first two seconds',
        unit='Hz',
        range=(0.0, 10_000.0),
    )
    samples_per_block: int = parameter(
        0,
        f'samples in one message; 0: the smallest number that gives at most {MOST_BLOCKS_HZ} '
        f'messages per second; while the tendon is slack and at rest, the largest number that '
        f'gives at least {REST_BLOCKS_HZ}',
        unit='1',
        range=(0, 1000),
    )
    saturation_n: float = parameter(
        0.0,
        'a sample is marked as saturated if the magnitude of its tension is at least this value; '
        '0 if the range of the sensor is unknown',
        unit='N',
        range=(0.0, 1e6),
    )
    stuck_s: float = parameter(
        0.8,
        'the sensor counts as stuck if at least ten samples have been exactly equal for this '
        'time; 0 disables the check, for a sensor of coarse resolution',
        unit='s',
        range=(0.0, 3600.0),
    )
    silence_s: float = parameter(
        0.5,
        'time without a reading after which the link counts as silent',
        unit='s',
        range=(0.01, 3600.0),
    )
    tare_samples: int = parameter(
        60, 'number of latest samples from which a tare is measured', range=(2, 100_000)
    )
    tare_limit_n: float = parameter(
        2.0,
        'a tare is refused as loaded if the mean of its samples exceeds this magnitude. No '
        'earlier tare is subtracted from these samples',
        unit='N',
        range=(0.0, 1e6),
    )
    tare_spread_n: float = parameter(
        0.1,
        'a tare is refused as noisy if the standard deviation of its samples exceeds this value',
        unit='N',
        range=(0.0, 1e6),
    )
    tare_change_n: float = parameter(
        0.1,
        'a tare is refused as moving if the tension rises or falls by more than this value during '
        'its samples',
        unit='N',
        range=(0.0, 1e6),
    )
    tendon_topic: str = parameter(
        'tendon_actuator/slack',
        'topic on which a tendon actuator reports whether its tendon is slack; the tare cannot be '
        'set or cleared while the tendon is taut. An empty name turns this check off',
    )
    trial_topic: str = parameter(
        'trial_runner/events',
        'topic of the events of trials; the tare cannot be set or cleared while a trial runs. An '
        'empty name turns this check off',
    )
    simulated: bool = parameter(
        False,
        'marks every sample, and everything derived from it, as simulated. Not needed for the '
        'simulated load cell, which marks its own lines',
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
                f'the device time has a resolution of {self.tick_s:g} s, which is too coarse for '
                f'samples at {self.rate_hz:g} Hz; let the device send a finer time, such as '
                'micros(), or set time_column to -1'
            )
        if self.scale == 0:
            raise ValueError('scale is 0, so every tension would be 0 N; set another factor')
        if 0 < self.rate_hz < _LEAST_RATE_HZ:
            raise ValueError(f'rate_hz is {self.rate_hz}; it must be {_LEAST_RATE_HZ} or more')

    def _check_device(self) -> None:
        if not self.rate_hz:
            raise ValueError(
                'rate_hz is 0, which only a topic allows; set it to the rate of the sensor'
            )
        if self.axis == NORM:
            raise ValueError(
                'axis is norm, which only a topic allows; set it to a component, such as fz'
            )

    @property
    def period_ns(self) -> int:
        """Nominal time between two samples [ns]."""
        return round(1e9 / self.rate_hz)

    @property
    def block_samples(self) -> int:
        """Number of samples in one block, derived from the rate if ``samples_per_block`` is 0."""
        return self.samples_per_block or max(1, math.ceil(self.rate_hz / MOST_BLOCKS_HZ))

    @property
    def rest_block_samples(self) -> int:
        """Number of samples in one block while the tendon is at rest."""
        return self.samples_per_block or max(1, int(self.rate_hz // REST_BLOCKS_HZ))

    @property
    def tick_s(self) -> float:
        """Smallest step of the device time of a load-cell line [s]."""
        return self.time_unit_s / 10.0**self.time_decimals
