# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the linear guide and of the tendon actuator."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.configs import check_parameters, parameter

SHORTEST_HANG_S = 0.5
"""Shortest allowed ``hang_timeout_s`` [s]; see docs/decisions/0013-liveliness.md."""

REST_REPORT_S = 0.2
"""Period [s] of joint states and of Grbl's status reports while the guide or tendon is at rest."""

REST_CYCLE_S = 0.05
"""Period [s] at which a driver at rest publishes its heartbeat and evaluates the sensor's samples.
The lease of a heartbeat is 0.15 s, so a heartbeat at rest can be 0.1 s late before the lease ends.
In motion, the period of heartbeats is 0.03 to 0.04 s."""

REST_AFTER_S = 1.0
"""Time [s] after the end of a motion during which a device is still polled at the full rate."""


@dataclass(frozen=True)
class EmergencyStopConfig:
    """Parameters of the emergency stop, for each node of a rig."""

    emergency_stop_topic: str = parameter(
        '',
        'topic (std_msgs/Bool) of an emergency stop. The publisher must send false periodically '
        'while the rig may move. If it sends true, or nothing, the rig is stopped until it is '
        'reset. An empty name means that there is no emergency stop',
    )
    emergency_stop_timeout_s: float = parameter(
        0.5,
        'time without a message on emergency_stop_topic after which the rig is stopped',
        unit='s',
        range=(0.05, 10.0),
    )


@dataclass(frozen=True)
class _MotionConfig(EmergencyStopConfig):
    """Parameters of the heartbeats that the guide driver and the tendon driver monitor.

    Raises
    ------
    ValueError
        If a field is outside its range.
    """

    heartbeat_topics: tuple[str, ...] = parameter(
        (),
        'heartbeat topics of the nodes that must run during a motion; the motion ends if one of '
        'them falls silent or has two publishers',
    )
    heartbeat_timeout_s: float = parameter(
        0.15,
        'if no heartbeat arrives for this time, a motion ends; this is the lease of the DDS '
        'liveliness',
        unit='s',
        range=(0.15, 10.0),
    )
    peer_wait_s: float = parameter(
        5.0,
        'time that a goal waits for topics from which no message has arrived yet, for example '
        'after the start',
        unit='s',
        range=(0.0, 60.0),
    )

    def __post_init__(self) -> None:
        check_parameters(self)


@dataclass(frozen=True)
class LinearGuideConfig(_MotionConfig):
    """Connection and limits of the guide's Grbl controller."""

    port: str = parameter('/dev/ttyUSB0', 'serial port of the Grbl controller')
    baud: int = parameter(
        115200, 'speed of the serial line', unit='bit/s', range=(9600, 1_000_000)
    )
    travel_m: float = parameter(
        0.2, "travel of the guide; must equal the controller's $130", unit='m', range=(0.001, 5.0)
    )
    max_speed_m_s: float = parameter(
        0.1, 'highest speed that a goal may request', unit='m/s', range=(0.0001, 1.0)
    )
    run_on_s: float = parameter(
        0.25,
        'duration of the motion that is sent to the controller in advance. The guide keeps moving '
        'for this time if the driver dies or the cable is cut, and a glide stays steady during a '
        'pause of the host of up to this time',
        unit='s',
        range=(0.1, 5.0),
    )
    poll_rate_hz: float = parameter(
        10.0,
        'rate of status reports and joint states during motion (at rest: 5 Hz or less). Grbl '
        'documents a limit of 10 Hz; 20 Hz works on most boards',
        unit='Hz',
        range=(1.0, 20.0),
    )
    strain_timeout_s: float = parameter(
        0.0,
        'every motion ends if no valid sample arrives on tendon_sensor/strain for this time; 0 if '
        'motion needs no samples',
        unit='s',
        range=(0.0, 10.0),
    )
    tendon_topic: str = parameter(
        'tendon_actuator/slack',
        'topic on which the tendon actuator reports whether its tendon is slack. If the tendon is '
        'not slack, the guide moves only during the glide of a trial. An empty name means that '
        'there is no tendon',
    )
    joint_name: str = parameter('linear_guide_joint', 'name of the joint in joint states')
    frame_id: str = parameter('linear_guide_link', 'frame of the joint states')


@dataclass(frozen=True)
class TendonActuatorConfig(_MotionConfig):
    """Connection and limits of the tendon's Dynamixel servo."""

    port: str = parameter('/dev/ttyUSB1', 'serial port of the Dynamixel bus')
    baud: int = parameter(
        1_000_000, 'speed of the serial line', unit='bit/s', range=(9600, 4_000_000)
    )
    device_id: int = parameter(1, 'ID of the servo on the bus', range=(0, 252))
    pulley_radius_m: float = parameter(
        0.01, 'radius of the pulley on which the tendon is wound', unit='m', range=(0.001, 0.1)
    )
    reverse: bool = parameter(
        False, 'true if the servo tightens the tendon when its position count decreases'
    )
    speed_m_s: float = parameter(
        0.01, 'tendon speed if a goal states no speed', unit='m/s', range=(0.0005, 0.5)
    )
    max_displacement_m: float = parameter(
        0.02, 'largest displacement that a goal may request', unit='m', range=(0.0, 0.5)
    )
    current_limit_a: float = parameter(
        0.3,
        'largest motor current; limits the tension even without a sensor',
        unit='A',
        range=(0.02, 3.0),
    )
    flexion_limit_n: float = parameter(
        15.0,
        'tension limit in flexion. If the tension exceeds it, the tendon is slackened',
        unit='N',
        range=(0.1, 200.0),
    )
    abduction_limit_n: float = parameter(
        3.0,
        'tension limit in abduction. If the tension exceeds it, the tendon is slackened',
        unit='N',
        range=(0.1, 200.0),
    )
    flexion_current_a: float = parameter(
        0.15,
        'largest motor current of a flexion pull. Recommended value: friction_current_a + 1.5 x '
        'flexion_limit_n x pulley_radius_m / torque_constant_nm_a. current_limit_a applies, too',
        unit='A',
        range=(0.02, 3.0),
    )
    abduction_current_a: float = parameter(
        0.05,
        'largest motor current of an abduction pull and of homing. Recommended value: as for '
        'flexion_current_a, but with abduction_limit_n',
        unit='A',
        range=(0.02, 3.0),
    )
    torque_constant_nm_a: float = parameter(
        1.78,
        'torque of the servo per motor current, computed from stall torque and stall current at '
        '12 V. Default: XM430-W350, 4.1 N m at 2.3 A. For an XM430-W210, set 1.3 (3.0 N m at 2.3 '
        'A)',
        unit='N m/A',
        range=(0.01, 100.0),
    )
    friction_current_a: float = parameter(
        0.02,
        'motor current that is needed to tighten a slack tendon. To measure it, take the mean of '
        'current_a in the diagnostics during a slow pull of a free, slack tendon',
        unit='A',
        range=(0.0, 1.0),
    )
    current_mismatch_n: float = parameter(
        5.0,
        'during a pull, the tendon is held, then slackened, if the tension computed from the '
        'motor current exceeds the reading of the sensor by this amount, for example because the '
        'sensor is stuck. 0 disables the comparison',
        unit='N',
        range=(0.0, 1000.0),
    )
    saturation_n: float = parameter(
        0.0,
        'magnitude of the reading at which the tendon sensor saturates, equal to saturation_n of '
        'its driver. At this reading the tendon is slackened. 0 if the range is unknown',
        unit='N',
        range=(0.0, 1e6),
    )
    shares_sensor_clock: bool = parameter(
        True,
        'the strain samples are stamped with the clock of this computer, so that a constant delay '
        'is detected, too. Set it to false if the sensor driver runs on another computer whose '
        'clock is not synchronised',
    )
    unguarded: bool = parameter(
        False,
        'allows pulls without strain samples; then only current_limit_a limits the tension',
    )
    taut_tension_n: float = parameter(
        0.2,
        'tension at which the tendon counts as taut during homing',
        unit='N',
        range=(0.02, 5.0),
    )
    homing_speed_m_s: float = parameter(
        0.002, 'tendon speed during homing', unit='m/s', range=(0.0005, 0.02)
    )
    guard_timeout_s: float = parameter(
        0.2,
        'a taut tendon is held if no valid strain sample arrives for this time',
        unit='s',
        range=(0.02, 10.0),
    )
    slack_after_s: float = parameter(
        2.0,
        'time for which a taut tendon is held after Stop, or after the loss of the sensor, of a '
        'heartbeat or of the servo. The tendon is then slackened',
        unit='s',
        range=(0.0, 60.0),
    )
    watchdog_s: float = parameter(
        0.2,
        'the servo stops by itself if it receives no packet for this time; resolution 0.02',
        unit='s',
        range=(0.06, 2.54),
    )
    poll_rate_hz: float = parameter(
        60.0,
        'rate of state reads and joint states during motion and while the tendon is taut. At rest '
        'with a slack tendon there are 20 reads per second (or four per watchdog_s, if that is '
        'more) and five joint states per second',
        unit='Hz',
        range=(5.0, 200.0),
    )
    hang_timeout_s: float = parameter(
        0.0,
        'if the poll of the driver does not run for this time, the driver is killed, so that '
        'launch can restart it and the tendon is slackened. 0 disables this, for example under a '
        'debugger',
        unit='s',
        range=(0.0, 60.0),
    )
    joint_name: str = parameter('tendon_joint', 'name of the joint in joint states')
    frame_id: str = parameter('tendon_link', 'frame of the joint states')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.watchdog_s * self.poll_rate_hz < 3.0:
            raise ValueError(
                f'watchdog_s is {self.watchdog_s} s, which is shorter than three polls at '
                f'{self.poll_rate_hz} Hz; increase watchdog_s or poll_rate_hz'
            )
        if 0.0 < self.hang_timeout_s < SHORTEST_HANG_S:
            raise ValueError(
                f'hang_timeout_s is {self.hang_timeout_s} s, which a busy computer may exceed; '
                f'use {SHORTEST_HANG_S} s or more, or 0'
            )

    @property
    def limits_n(self) -> dict[str, float]:
        """Tension limit [N] for each contact."""
        return {'flexion': self.flexion_limit_n, 'abduction': self.abduction_limit_n}

    @property
    def currents_a(self) -> dict[str, float]:
        """Largest motor current [A] of a pull, for each contact."""
        return {
            'flexion': min(self.flexion_current_a, self.current_limit_a),
            'abduction': min(self.abduction_current_a, self.current_limit_a),
        }

    def to_tension_n(self, current_a: float) -> float:
        """Return the tension [N] of a motor current [A] after subtracting the friction current."""
        moment_nm = (current_a - self.friction_current_a) * self.torque_constant_nm_a
        return moment_nm / self.pulley_radius_m

    def to_current_a(self, tension_n: float) -> float:
        """Return the motor current [A] that balances a tension [N], plus the friction current."""
        moment_nm = tension_n * self.pulley_radius_m
        return moment_nm / self.torque_constant_nm_a + self.friction_current_a
