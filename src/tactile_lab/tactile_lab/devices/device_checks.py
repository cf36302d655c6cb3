# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exercises guide or tendon through its driver; says what it found, each fault with a remedy."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
import time
from typing import Any

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import DynamixelBus
from linear_guide_driver.dynamixel.servo import arm_watchdog, set_up_servo
from linear_guide_driver.errors import LinearGuideDriverError
from linear_guide_driver.grbl.guide_client import LinearGuideClient
from linear_guide_driver.records import LinearGuideConfig, TendonActuatorConfig

MOST_TEMPERATURE_C = 60.0
MOVE_M = 0.005
MOVE_SPEED_M_S = 0.01
MOVE_TOLERANCE_M = 0.0001
LATE_S = 0.5


@dataclass(frozen=True)
class Problem:
    """Something wrong, and what to do about it, when the sentence does not say that itself."""

    what: str
    remedy: str = ''


@dataclass(frozen=True)
class CheckReport:
    """Result of the check of one device (sensor, guide or tendon) on its port or address.

    ``facts`` are measured or read values, by name with unit. A device without ``problems`` is fit
    for trials.
    """

    device: str
    link: str
    facts: dict[str, Any] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


# -- guide ---------------------------------------------------------------------------------


def check_guide(config: LinearGuideConfig, may_move: bool) -> CheckReport:
    """Reset the guide's controller, check its settings; home and move a little if allowed."""
    facts: dict[str, Any] = {}
    problems: list[Problem] = []
    client = LinearGuideClient(config)
    try:
        client.connect()
        state = client.state
        facts['firmware'] = client.identification
        facts['settings'] = 'fit'  # or it would not be connected
        facts['state'] = state.state if state else 'unknown'
        is_locked = state is not None and state.state == 'Alarm'
        facts['homed since power-up'] = 'no' if is_locked else 'perhaps; trials home it anyway'
        if may_move:
            problems += _exercise_guide(client, config, facts)
        if client.garbage_lines:
            problems.append(
                Problem(
                    f'{client.garbage_lines} lines were no Grbl',
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
    facts['move of 5 mm took [s]'] = round(took_s, 2)
    facts['error at rest [mm]'] = round((rest_m - target_m) * 1e3, 3)
    problems = []
    if abs(rest_m - target_m) > MOVE_TOLERANCE_M:
        problems.append(
            Problem(
                f'the guide rests {(rest_m - target_m) * 1e3:.2f} mm beside its target',
                'check $100 (steps per mm)',
            )
        )
    least_s = MOVE_M / speed_m_s
    if not least_s - LATE_S < took_s < least_s + 2 * LATE_S:
        problems.append(
            Problem(
                f'a move of {least_s:.1f} s took {took_s:.1f} s',
                'check $110 (maximum rate) and $120 (acceleration)',
            )
        )
    return problems


# -- tendon --------------------------------------------------------------------------------


def check_tendon(config: TendonActuatorConfig, may_move: bool) -> CheckReport:
    """Read the servo, hold it where it is, and see whether its watchdog stops it in silence.

    With ``may_move`` it winds in 2 mm and lets out again.
    """
    facts: dict[str, Any] = {}
    problems: list[Problem] = []
    bus = None
    try:
        bus = DynamixelBus(config.port, config.baud, config.device_id)
        problems += _read_servo(bus, facts)
        servo = set_up_servo(bus, config)
        facts['servo'] = servo.identification
        problems += _try_watchdog(bus, config, facts)
        if may_move:
            problems += _wind(bus, config, facts)
    except LinearGuideDriverError as error:
        problems.append(Problem(str(error)))
    finally:
        if bus is not None:
            for register in (registers.TORQUE_ENABLE, registers.BUS_WATCHDOG):
                with suppress(LinearGuideDriverError):
                    bus.write(register, 0)
            bus.close()
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
    problems = []
    if error:
        problems.append(
            Problem(
                f'the servo has shut down: {words}',
                'remove the cause; the driver restarts the servo when it is configured',
            )
        )
    if temperature_c > MOST_TEMPERATURE_C:
        problems.append(
            Problem(
                f'the servo has {temperature_c} degrees Celsius', 'let it cool; lower its load'
            )
        )
    return problems


def _try_watchdog(
    bus: DynamixelBus, config: TendonActuatorConfig, facts: dict[str, Any]
) -> list[Problem]:
    time.sleep(config.watchdog_s + 5 * registers.WATCHDOG_STEP_S)
    works = bus.read(registers.BUS_WATCHDOG) == registers.WATCHDOG_TRIPPED
    facts['watchdog'] = (
        f'stops the servo after {config.watchdog_s:g} s of silence' if works else 'does not trip'
    )
    if works:
        return []
    return [
        Problem(
            f'the servo keeps moving although the bus was silent for {config.watchdog_s:g} s',
            'check that no other device sends on the bus; update the firmware',
        )
    ]


def _wind(bus: DynamixelBus, config: TendonActuatorConfig, facts: dict[str, Any]) -> list[Problem]:
    """Wind in by a short way and let out; each read feeds the watchdog."""
    length_m = min(0.002, config.max_displacement_m)
    sign = -1 if config.reverse else 1
    counts = sign * registers.m_to_counts(length_m, config.pulley_radius_m)
    bus.write(registers.BUS_WATCHDOG, 0)  # it has tripped, which locks the goals
    bus.write(
        registers.PROFILE_VELOCITY,
        registers.m_s_to_velocity(config.speed_m_s, config.pulley_radius_m),
    )
    arm_watchdog(bus, config.watchdog_s)
    most_a = 0.0
    for goal in (counts, 0):
        bus.write(registers.GOAL_POSITION, goal)
        until_s = time.monotonic() + length_m / config.speed_m_s + LATE_S
        while time.monotonic() < until_s:
            state = registers.decode_state(bus.read_block(registers.STATE_BLOCK))
            most_a = max(most_a, abs(registers.current_to_a(state.current)))
            if abs(state.position_counts - goal) <= 8 and state.velocity == 0:
                break
        else:
            off_m = registers.counts_to_m(state.position_counts - goal, config.pulley_radius_m)
            return [
                Problem(
                    f'the servo rests {abs(off_m) * 1e3:.2f} mm beside its goal',
                    'see whether the tendon is caught; check current_limit_a',
                )
            ]
    facts['wound in and out [mm]'] = round(length_m * 1e3, 1)
    facts['largest current [A]'] = round(most_a, 3)
    return []
