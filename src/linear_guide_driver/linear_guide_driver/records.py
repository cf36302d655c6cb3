# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Configuration and states of the linear guide and of the tendon actuator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tactile_ros.configs import check_parameters, parameter

SHORTEST_HANG_S = 0.5
"""Shortest standstill of a driver that counts as a hang; see docs/decisions/0013-liveliness.md."""

REST_REPORT_S = 0.2
"""Period of joint states at rest, and of Grbl's status reports."""

REST_AFTER_S = 1.0
"""Reports come at full rate for so long after the end of a motion: the last of it are wanted."""


@dataclass(frozen=True)
class EmergencyStopConfig:
    """The emergency stop, for each node of a rig."""

    emergency_stop_topic: str = parameter(
        '',
        'topic (std_msgs/Bool) of an emergency stop: true stops the rig until it is reset, and so '
        'does silence; false, published periodically, says that all is well; empty: none',
    )
    emergency_stop_timeout_s: float = parameter(
        0.5,
        'silence of emergency_stop_topic that stops the rig',
        unit='s',
        range=(0.05, 10.0),
    )


@dataclass(frozen=True)
class _MotionConfig(EmergencyStopConfig):
    """The signs of life that both drivers depend on; `ValueError` when out of range."""

    heartbeat_topics: tuple[str, ...] = parameter(
        (),
        'topics on which the nodes that motion needs give their sign of life; motion ends when '
        'one falls silent, or when two nodes give it on one topic',
    )
    heartbeat_timeout_s: float = parameter(
        0.15,
        'silence of a heartbeat topic that ends motion; the lease of its liveliness',
        unit='s',
        range=(0.15, 10.0),
    )
    peer_wait_s: float = parameter(
        5.0,
        'how long a goal waits for topics that have not been heard yet, as after a start',
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
        0.1, 'fastest speed that a goal may ask for', unit='m/s', range=(0.0001, 1.0)
    )
    run_on_s: float = parameter(
        0.25,
        'how much motion the controller is given in advance: it runs on for so long when the '
        'driver dies or the cable is cut, and a glide survives a pause of the host as long',
        unit='s',
        range=(0.1, 5.0),
    )
    poll_rate_hz: float = parameter(
        10.0,
        'rate of status reports and joint states in motion, at most 5 at rest; Grbl documents '
        '10 as its limit, 20 works on most boards',
        unit='Hz',
        range=(1.0, 20.0),
    )
    strain_timeout_s: float = parameter(
        0.0,
        'every motion ends when no valid sample came on tendon_sensor/strain for this long; '
        '0: none is needed',
        unit='s',
        range=(0.0, 10.0),
    )
    tendon_topic: str = parameter(
        'tendon_actuator/slack',
        'topic on which the tendon actuator says whether its tendon is slack; without a slack '
        'tendon the guide moves only in the glide of a trial; empty: the guide carries no tendon',
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
        0.01, 'radius at which the tendon winds up', unit='m', range=(0.001, 0.1)
    )
    reverse: bool = parameter(False, 'true when the servo tightens as its position count falls')
    speed_m_s: float = parameter(
        0.01, 'tendon speed of a goal that names none', unit='m/s', range=(0.0005, 0.5)
    )
    max_displacement_m: float = parameter(
        0.02, 'longest displacement that a goal may ask for', unit='m', range=(0.0, 0.5)
    )
    current_limit_a: float = parameter(
        0.3,
        'largest motor current; limits the pull even when no sensor is there',
        unit='A',
        range=(0.02, 3.0),
    )
    flexion_limit_n: float = parameter(
        15.0, 'tension at which a flexion pull is released', unit='N', range=(0.1, 200.0)
    )
    abduction_limit_n: float = parameter(
        3.0, 'tension at which an abduction pull is released', unit='N', range=(0.1, 200.0)
    )
    flexion_current_a: float = parameter(
        0.15,
        'largest motor current of a flexion pull, at most current_limit_a: friction_current_a + '
        '1.5 x flexion_limit_n x pulley_radius_m / torque_constant_nm_a',
        unit='A',
        range=(0.02, 3.0),
    )
    abduction_current_a: float = parameter(
        0.05,
        'largest motor current of an abduction pull and of homing: the same with '
        'abduction_limit_n',
        unit='A',
        range=(0.02, 3.0),
    )
    torque_constant_nm_a: float = parameter(
        1.78,
        'torque of the servo per motor current, from its stall at 12 V: XM430-W350 4.1 N m at '
        '2.3 A; for an XM430-W210 set 1.3 (3.0 N m at 2.3 A)',
        unit='N m/A',
        range=(0.01, 100.0),
    )
    friction_current_a: float = parameter(
        0.02,
        'motor current that tightens a slack tendon: the mean of current_a in the diagnostics '
        'during a slow pull with a free, slack tendon',
        unit='A',
        range=(0.0, 1.0),
    )
    current_mismatch_n: float = parameter(
        5.0,
        'a pull is held, then slackened, when the motor current shows so much more tension than '
        'the sensor reads, as when the sensor is stuck; 0: they are not compared',
        unit='N',
        range=(0.0, 1000.0),
    )
    saturation_n: float = parameter(
        0.0,
        'magnitude from which the reading of the tendon sensor is no measurement, equal to '
        'saturation_n of its driver; the tendon is released there; 0: not known',
        unit='N',
        range=(0.0, 1e6),
    )
    shares_sensor_clock: bool = parameter(
        True,
        'the strain samples are stamped by the clock of this computer, so that samples that are '
        'late from the start are noticed; false when the sensor driver runs on another computer '
        'whose clock is not synchronised',
    )
    unguarded: bool = parameter(
        False,
        'true lets the tendon be pulled although no strain sample arrives; then nothing but '
        'current_limit_a limits the tension',
    )
    taut_tension_n: float = parameter(
        0.2,
        'tension at which a tendon that is homed counts as taut',
        unit='N',
        range=(0.02, 5.0),
    )
    homing_speed_m_s: float = parameter(
        0.002, 'tendon speed while it is homed', unit='m/s', range=(0.0005, 0.02)
    )
    guard_timeout_s: float = parameter(
        0.2,
        'a taut tendon is held when no valid strain sample came for this long',
        unit='s',
        range=(0.02, 10.0),
    )
    slack_after_s: float = parameter(
        2.0,
        'a taut tendon that has lost its sensor, a heartbeat or its pull is held for this long, '
        'then slackened',
        unit='s',
        range=(0.0, 60.0),
    )
    watchdog_s: float = parameter(
        0.2,
        'the servo stops by itself when it hears nothing for this long; steps of 0.02',
        unit='s',
        range=(0.06, 2.54),
    )
    poll_rate_hz: float = parameter(
        60.0,
        'rate of state reads and joint states in motion and while the tendon is taut; at rest '
        'and slack 25 reads a second, or four per watchdog_s, and five joint states a second',
        unit='Hz',
        range=(5.0, 200.0),
    )
    hang_timeout_s: float = parameter(
        0.0,
        'a driver whose poll hangs for so long, as when it is frozen, is killed, so that its '
        'launch starts it again and the tendon is slackened; 0: never, as under a debugger',
        unit='s',
        range=(0.0, 60.0),
    )
    joint_name: str = parameter('tendon_joint', 'name of the joint in joint states')
    frame_id: str = parameter('tendon_link', 'frame of the joint states')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.watchdog_s * self.poll_rate_hz < 3.0:
            raise ValueError(
                f'watchdog_s is {self.watchdog_s} s, shorter than three polls at '
                f'{self.poll_rate_hz} Hz; raise one of them'
            )
        if 0.0 < self.hang_timeout_s < SHORTEST_HANG_S:
            raise ValueError(
                f'hang_timeout_s is {self.hang_timeout_s} s, which a busy computer reaches; use '
                f'{SHORTEST_HANG_S} s or more, or 0'
            )

    @property
    def limits_n(self) -> dict[str, float]:
        """Tension limit of each contact [N]."""
        return {'flexion': self.flexion_limit_n, 'abduction': self.abduction_limit_n}

    @property
    def currents_a(self) -> dict[str, float]:
        """Largest motor current of a pull of each contact [A]."""
        return {
            'flexion': min(self.flexion_current_a, self.current_limit_a),
            'abduction': min(self.abduction_current_a, self.current_limit_a),
        }

    def to_tension_n(self, current_a: float) -> float:
        """Return the tension that a motor current tightens against, without friction [N]."""
        moment_nm = (current_a - self.friction_current_a) * self.torque_constant_nm_a
        return moment_nm / self.pulley_radius_m

    def to_current_a(self, tension_n: float) -> float:
        """Return the motor current that tightens against a tension [A]."""
        moment_nm = tension_n * self.pulley_radius_m
        return moment_nm / self.torque_constant_nm_a + self.friction_current_a


class GuideState(NamedTuple):
    """The guide as of its last status report.

    ``position_m`` counts from the negative end of travel, and is None when not homed.
    ``velocity_m_s`` is the reported speed with the sign of the running move, ``state`` the
    controller's word: Idle, Run, Hold, Alarm, ... The report arrived at ``received_at_ns`` on the
    client's clock.
    """

    position_m: float | None
    velocity_m_s: float
    state: str
    received_at_ns: int


class TendonState(NamedTuple):
    """The tendon actuator as of its last poll.

    ``displacement_m`` counts from the slack reference, ``velocity_m_s`` is positive when it
    tightens. ``current_a`` is the motor current, positive when pulling: an estimate of the pull
    with friction in it. The values arrived at ``received_at_ns`` on the client's clock.
    """

    displacement_m: float
    velocity_m_s: float
    current_a: float
    voltage_v: float
    temperature_c: float
    received_at_ns: int
