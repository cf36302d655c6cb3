# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of sensor, guide and tendon actuator. Each problem is reported with its remedy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
import functools
import operator
import time
from typing import Any

import numpy as np

from linear_guide_driver.config import LinearGuideConfig, TendonActuatorConfig
from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import DynamixelBus
from linear_guide_driver.dynamixel.servo import DesiredState, TendonServo
from linear_guide_driver.errors import LinearGuideDriverError
from linear_guide_driver.grbl.guide_client import LinearGuideClient
from tactile_bringup.launch_config.parameter_files import CONFIGS
from tactile_ros.errors import TactileError
from tactile_ros.strain import StrainBlock, StrainStatus
from tendon_sensor_driver.client import NowNs, OnBlock, SensorClient
from tendon_sensor_driver.config import TendonSensorConfig
from tendon_sensor_driver.errors import TendonSensorError
from tendon_sensor_driver.sensors import make_sensor
from tendon_sensor_driver.types import SensorHealth

MakeSensor = Callable[[TendonSensorConfig, OnBlock, NowNs], SensorClient]
"""Function that creates the client of a sensor, such as `make_sensor`."""

RATE_TOLERANCE = 0.02
MOST_STAMP_ERROR_S = 0.005

_STATUS_REMEDIES = {
    StrainStatus.SATURATED: (
        'the sensor saturates',
        'unload the tendon; if the sensor still saturates, check the wiring of the bridge',
    ),
    StrainStatus.STUCK: (
        'the reading does not change',
        'check the cable between load cell and amplifier; a coarse sensor needs stuck_s = 0',
    ),
}


_TOPIC_REMEDIES = {
    StrainStatus.SATURATED: (
        'the force is at or beyond saturation_n',
        "unload the tendon, or set saturation_n to the sensor's range",
    ),
    StrainStatus.STUCK: (
        'the value does not change',
        'check the publisher and its device; a coarse sensor needs stuck_s = 0',
    ),
}


def make_config(node: str, stated: Mapping[str, Any]) -> Any:
    """Return the configuration of a device's node from the parameters ``stated``.

    Parameters without a field in the configuration, such as ``use_sim_time``, are ignored. Raises
    `TactileError` when a value is invalid.
    """
    known = {field.name for field in fields(CONFIGS[node])}
    try:
        return CONFIGS[node](**{name: value for name, value in stated.items() if name in known})
    except (TypeError, ValueError) as error:
        raise TactileError(f'parameters of {node}: {error}') from error


def check_sensor_samples(
    config: TendonSensorConfig, seconds: float, make: MakeSensor = make_sensor
) -> CheckReport:
    """Read the sensor for ``seconds``, and check its samples.

    Parameters
    ----------
    seconds : float
        Duration [s]. The tendon must not be touched during this time, so that only noise is
        measured.
    make : callable
        Creates the client of the sensor. The client of a sensor on a topic needs a node, see
        `tactile_lab.force_topics.sensors_on_topics`.
    """
    link = {'net_ft': config.host, 'topic': config.topic}.get(config.sensor, config.port)
    blocks: list[StrainBlock] = []
    client = make(config, blocks.append, time.time_ns)
    try:
        client.open()
        time.sleep(seconds)
        health, identity = client.health(), client.identity
    except TendonSensorError as error:
        return CheckReport('sensor', link, {}, (Problem(str(error)),))
    finally:
        client.close()
    if not config.rate_hz and health.rate_hz:
        config = replace(config, rate_hz=health.rate_hz)
    facts, problems = judge_blocks(blocks, config)
    if config.sensor == 'topic':
        problems = _judge_topic(health, problems, seconds, is_heard=bool(blocks))
        facts['irregular stamps'] = health.irregular_stamps
        return CheckReport('sensor', link, facts, tuple(problems))
    if identity:
        facts = {'identity': identity, **facts}
    if health.rate_hz:
        facts['rate that the device states [Hz]'] = round(health.rate_hz, 3)
    if health.device_status is not None:
        problems.append(Problem(f'the sensor reports: {health.device_status}', 'power-cycle it'))
    out_of_order = health.duplicates + health.late_samples + health.outliers
    problems += _list_problems(
        (
            out_of_order,
            f'readings that are duplicate, late or have an impossible time: {out_of_order}',
            'check time_column and time_unit_s, and the cable',
        ),
        (
            blocks and health.rejected_lines,
            f'lines that are not readings: {health.rejected_lines}, the last one '
            f'"{health.last_rejected}": {health.last_reason}',
            'check ground and shield of the cable, and the columns',
        ),
    )
    if not blocks:
        said = health.last_error or (
            f'the last line was "{health.last_rejected}": {health.last_reason}'
            if health.last_rejected
            else 'silence'
        )
        remedy = 'check baud, unit and columns; "tactile devices" proposes values'
        problems = [Problem(f'no reading in {seconds:g} s: {said}', remedy)]
    return CheckReport('sensor', link, facts, tuple(problems))


def _judge_topic(
    health: SensorHealth, problems: list[Problem], seconds: float, *, is_heard: bool
) -> list[Problem]:
    if not is_heard:
        said = (
            health.last_error
            or health.last_rejected
            or health.advice
            or 'too few messages to measure the rate; set rate_hz, or increase --seconds'
        )
        return [Problem(f'no reading in {seconds:g} s: {said}')]
    rejected = [Problem(health.last_rejected)] if health.rejected_lines else []
    # The rate has already been checked by `judge_blocks`.
    advice = [Problem(health.advice)] if health.advice and 'rate_hz' not in health.advice else []
    return [*problems, *rejected, *advice]


def judge_blocks(
    blocks: list[StrainBlock], config: TendonSensorConfig
) -> tuple[dict[str, Any], list[Problem]]:
    """Return measured values and problems from the blocks of a sensor.

    The tendon must not have been touched.
    """
    if not blocks:
        return {'samples': 0}, []
    tension_n = np.concatenate([block.tension_n for block in blocks])
    first_ns = blocks[0].stamp_ns
    time_ns = [b.stamp_ns - first_ns + b.period_ns * np.arange(b.tension_n.size) for b in blocks]
    time_s = np.concatenate(time_ns) * 1e-9
    # The first block may count losses from before the check.
    lost = sum(block.lost_before for block in blocks[1:])
    status = functools.reduce(operator.or_, (block.status for block in blocks))
    span_s = float(time_s[-1] - time_s[0])
    rate_hz = (tension_n.size + lost - 1) / span_s if span_s > 0 else 0.0
    noise_n = _compute_noise_n(time_s, tension_n)
    error_s = blocks[-1].stamp_error_s
    clock = 'not known (host time)' if status & StrainStatus.HOST_TIME else 'not known yet'
    facts = {
        'samples': int(tension_n.size),
        'rate [Hz]': round(rate_hz, 3),
        'lost samples': int(lost),
        'tension [N]': round(float(tension_n.mean()), 4),
        'noise, standard deviation [N]': round(noise_n, 5),
        'error of the stamps [s]': round(error_s, 6) if error_s >= 0 else clock,
    }
    if status & StrainStatus.SIMULATED:
        facts['simulated'] = 'SIMULATED: no number is a measurement'
    remedies = _TOPIC_REMEDIES if config.sensor == 'topic' else _STATUS_REMEDIES
    problems = [Problem(*text) for bit, text in remedies.items() if status & bit]
    problems += _list_problems(
        (
            tension_n.size > 1 and not tension_n.any(),
            f'all {tension_n.size} samples are exactly 0 N',
            'pull the tendon and test again; check the axis, and that the sensor has power',
        ),
        (
            abs(rate_hz - config.rate_hz) > RATE_TOLERANCE * config.rate_hz,
            f'the rate is {rate_hz:.2f} Hz, but rate_hz is {config.rate_hz:g}',
            f'set rate_hz to {rate_hz:.4g}, or set the sensor to {config.rate_hz:g} Hz',
        ),
        _describe_losses(lost, tension_n.size, config),
        (
            error_s > MOST_STAMP_ERROR_S,
            f'the time stamps may be wrong by {error_s * 1e3:.1f} ms',
            "install the udev rule for the adapter's latency timer; end other programs",
        ),
    )
    return facts, problems


def _describe_losses(lost: int, count: int, config: TendonSensorConfig) -> tuple[int, str, str]:
    """Return the number of missing samples, the problem and the remedy."""
    if config.sensor == 'topic':
        return (
            lost,
            f'{lost} of {count + lost} samples are missing: messages were lost, or the stamps '
            'have gaps',
            'set the publisher to reliable, and let it stamp each message with the time of the '
            'measurement; end other programs on its computer',
        )
    return (
        lost,
        f'{lost} of {count + lost} samples were lost',
        'check the cable, raise the baud rate, or end other programs on this computer',
    )


def _compute_noise_n(time_s: Any, tension_n: Any) -> float:
    """Return the standard deviation from a fitted line, so that drift is not included [N]."""
    if tension_n.size < 3:
        return 0.0
    line = np.polynomial.Polynomial.fit(time_s, tension_n, 1)
    return float(np.std(tension_n - line(time_s), ddof=2))


MOST_TEMPERATURE_C = 60.0
MOVE_M = 0.005
MOVE_SPEED_M_S = 0.01
MOVE_TOLERANCE_M = 0.0001
REST_TOLERANCE_M = 0.000125
LATE_S = 0.5


@dataclass(frozen=True)
class Problem:
    """A problem and its remedy. The remedy is empty if ``what`` already contains it."""

    what: str
    remedy: str = ''


def _list_problems(*cases: tuple[object, str, str]) -> list[Problem]:
    """Return the problems whose condition, the first element of each case, is true."""
    return [Problem(what, remedy) for is_so, what, remedy in cases if is_so]


@dataclass(frozen=True)
class CheckReport:
    """Result of the check of one device: ``sensor``, ``guide`` or ``tendon``.

    ``link`` is its port, address or topic. ``facts`` are measured or read values; the keys are
    names with units. A device without ``problems`` is ready for trials.
    """

    device: str
    link: str
    facts: dict[str, Any] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


# -- guide ---------------------------------------------------------------------------------


def check_guide(config: LinearGuideConfig, may_move: bool) -> CheckReport:
    """Reset the guide's controller and check its settings; if ``may_move``, home and move it."""
    facts: dict[str, Any] = {}
    problems: list[Problem] = []
    client = LinearGuideClient(config)
    try:
        client.connect()
        state = client.state
        facts['firmware'] = client.identification
        facts['settings'] = 'valid'  # `connect` refuses invalid settings
        facts['state'] = state.state if state else 'unknown'
        is_locked = state is not None and state.state == 'Alarm'
        facts['homed since power-up'] = 'no' if is_locked else 'unknown; it is homed before trials'
        if may_move:
            problems += _exercise_guide(client, config, facts)
        problems += _list_problems(
            (
                client.garbage_lines,
                f'lines that are not from Grbl: {client.garbage_lines}',
                'check ground and shield of the cable',
            )
        )
    except LinearGuideDriverError as error:
        problems.append(Problem(str(error)))
    finally:
        client.close()
    return CheckReport('guide', config.port, facts, tuple(problems))


def _exercise_guide(
    client: LinearGuideClient, config: LinearGuideConfig, facts: dict[str, Any]
) -> list[Problem]:
    start_s = time.monotonic()
    home_m = client.home().position_m or 0.0
    facts['homing took [s]'] = round(time.monotonic() - start_s, 1)
    facts['position after homing [m]'] = round(home_m, 5)
    target_m = home_m + (MOVE_M if home_m < config.travel_m / 2 else -MOVE_M)
    speed_m_s = min(MOVE_SPEED_M_S, config.max_speed_m_s)
    start_s = time.monotonic()
    rest_m = client.move_to(target_m, speed_m_s).position_m or 0.0
    took_s = time.monotonic() - start_s
    client.move_to(home_m, speed_m_s)
    off_mm, least_s = (rest_m - target_m) * 1e3, MOVE_M / speed_m_s
    facts['move of 5 mm took [s]'] = round(took_s, 2)
    facts['error at rest [mm]'] = round(off_mm, 3)
    return _list_problems(
        (
            abs(rest_m - target_m) > MOVE_TOLERANCE_M,
            f'the guide stops {off_mm:.2f} mm from its target',
            'check $100 (steps per mm)',
        ),
        (
            not least_s - LATE_S < took_s < least_s + 2 * LATE_S,
            f'a move of {least_s:.1f} s took {took_s:.1f} s',
            'check $110 (maximum rate) and $120 (acceleration)',
        ),
    )


# -- tendon --------------------------------------------------------------------------------


def check_tendon(config: TendonActuatorConfig, may_move: bool) -> CheckReport:
    """Read the servo, hold its position, and check that its bus watchdog stops it.

    If ``may_move`` is True, the tendon is also tightened by 2 mm and slackened again. At the end,
    the torque is switched off.
    """
    facts: dict[str, Any] = {}
    problems: list[Problem] = []
    servo = None
    try:
        servo = TendonServo(DynamixelBus(config.port, config.baud, config.device_id), config)
        problems += _read_servo(servo.bus, facts)
        servo.set_up()
        facts['servo'] = servo.identification
        problems += _try_watchdog(servo, config, facts)
        if may_move:
            problems += _tighten(servo, config, facts)
    except LinearGuideDriverError as error:
        problems.append(Problem(str(error)))
    finally:
        if servo is not None:
            servo.switch_off()
    return CheckReport('tendon', config.port, facts, tuple(problems))


def _read_servo(bus: DynamixelBus, facts: dict[str, Any]) -> list[Problem]:
    model, firmware = bus.ping(), bus.read(registers.FIRMWARE)
    facts['servo'] = f'{registers.MODELS.get(model, f"model {model}")} firmware {firmware}'
    voltage_v = bus.read(registers.PRESENT_VOLTAGE) * registers.VOLTAGE_UNIT_V
    temperature_c = bus.read(registers.PRESENT_TEMPERATURE)
    error = bus.read(registers.HARDWARE_ERROR)
    words = registers.format_hardware_error(error) if error else 'none'
    facts |= {
        'voltage [V]': round(voltage_v, 1),
        'temperature [C]': temperature_c,
        'hardware errors': words,
    }
    return _list_problems(
        (
            error,
            f'the servo has shut down: {words}',
            'remove the cause; the driver restarts the servo when it is configured',
        ),
        (
            temperature_c > MOST_TEMPERATURE_C,
            f'the temperature of the servo is {temperature_c} degrees Celsius',
            'let it cool; reduce its load',
        ),
    )


def _try_watchdog(
    servo: TendonServo, config: TendonActuatorConfig, facts: dict[str, Any]
) -> list[Problem]:
    time.sleep(config.watchdog_s + 5 * registers.WATCHDOG_STEP_S)
    works = servo.bus.read(registers.BUS_WATCHDOG) == registers.WATCHDOG_TRIPPED
    facts['watchdog'] = (
        f'stops the servo after {config.watchdog_s:g} s of silence' if works else 'does not trip'
    )
    return _list_problems(
        (
            not works,
            'the watchdog did not stop the servo when the bus was silent for '
            f'{config.watchdog_s:g} s',
            'check that no other device sends on the bus; update the firmware',
        )
    )


def _tighten(
    servo: TendonServo, config: TendonActuatorConfig, facts: dict[str, Any]
) -> list[Problem]:
    """Tighten and slacken the tendon by a short length.

    Reading the servo regularly prevents its watchdog from tripping.
    """
    length_m = min(0.002, config.max_displacement_m)
    one_unit_m_s = registers.velocity_to_m_s(1, config.pulley_radius_m)
    most_a = 0.0
    for goal_m in (length_m, 0.0):
        velocity = servo.to_velocity(config.speed_m_s)
        servo.desire(DesiredState(goal_m, velocity, servo.current, tightens=goal_m > 0.0))
        until_s = time.monotonic() + length_m / config.speed_m_s + LATE_S
        while time.monotonic() < until_s:
            actual = servo.read()
            servo.apply(actual, may_tighten=True)
            state = servo.to_state(actual, 0)
            off_m = state.displacement_m - goal_m
            most_a = max(most_a, abs(state.current_a))
            if abs(off_m) <= REST_TOLERANCE_M and abs(state.velocity_m_s) < one_unit_m_s:
                break
        else:
            return [
                Problem(
                    f'the servo stops {abs(off_m) * 1e3:.2f} mm from its goal',
                    'check that the tendon moves freely; check current_limit_a',
                )
            ]
    facts['tightened and slackened [mm]'] = round(length_m * 1e3, 1)
    facts['largest current [A]'] = round(most_a, 3)
    return []
