# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon's servo: recognition, set-up, and control by a desired state.

The caller selects a `DesiredState`, reads the servo, and calls `TendonServo.apply`, which writes
the registers that differ. If a write is lost, the register still differs at the next read.

Nothing is written to a servo until it is known to be the tendon's servo:

- While the driver runs, the servo must have the model, firmware, modes and homing offset that the
  driver has set up.
- When the driver starts, the torque of the servo must be off, or its registers must have values
  that this driver writes. In particular, its bus watchdog must be armed or tripped, or it must
  have a mark. The mark identifies a servo whose driver was killed just before it armed the
  watchdog. A servo that loses its power loses the mark.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from enum import Enum
import logging
import math
import time
from typing import NamedTuple, TypeVar

from linear_guide_driver.config import TendonActuatorConfig
from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import ATTEMPTS, DynamixelBus, LATE_S, SilentServoError
from linear_guide_driver.dynamixel.registers import ServoSettings, ServoState
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
)
from linear_guide_driver.types import TendonState

SETTLING_S = 3.0
SETTLING_PERIOD_S = 0.1
SETTLED_COUNTS = 2

CONNECT_S = 3.0
"""Time [s] during which `open_servo` repeats a failed attempt. The servo may be restarting."""

CONNECT_PAUSE_S = 0.2

REBOOT_S = 3.0
"""Longest time [s] until a restarted servo answers; usually it takes about 0.3 s."""

SLACK_BELOW_M = 0.001
"""If the displacement is below the zero by more than this distance [m], the zero is wrong."""

ZERO_COUNTS = 2
"""A zero that deviates from the wanted zero by at most this number of counts is not written again,
because every write wears the EEPROM."""

SET_UP_CYCLES = 8
"""Number of cycles after which a set-up has failed. In each cycle, the servo is read and the
registers that differ are written. A set-up takes four cycles, or more if packets are lost."""

JUMP_COUNTS = registers.COUNTS_PER_TURN // 2
JUMP_SPEED_SHARE = 1.5
"""Between two reads, the position may change by `JUMP_COUNTS` plus `JUMP_SPEED_SHARE` times the
velocity limit times the elapsed time. A larger change means that the servo has lost its power, and
with it the number of whole turns."""

EXCHANGE_S = 0.3
"""Time without an answer [s] after which the servo is identified again. Another servo may have
been connected meanwhile."""

_logger = logging.getLogger(__name__)

_Read = TypeVar('_Read')


class DesiredState(NamedTuple):
    """Desired state of the servo.

    In every desired state, the torque is on, the watchdog is armed and the acceleration is
    unlimited.
    """

    displacement_m: float  # goal [m]; if infinite, the present position is held
    velocity: int  # profile velocity, in the servo's units
    current: int  # current limit, in the servo's units
    tightens: bool = False  # if False, the goal is limited so that it does not tighten the tendon


class Found(Enum):
    """Condition in which `TendonServo.set_up` has found a servo."""

    SAME = 'as this driver has left it'
    KEPT = 'holding as an earlier driver has left it, with a valid zero'
    MISPLACED = (
        'holding as an earlier driver has left it, at a position that does not fit its zero'
    )
    OFF = 'torque off, or set up by this driver and restarted since'


class ServoLimits(NamedTuple):
    """Limits stored in the servo: velocity in the servo's units, temperature [C]."""

    velocity: int
    temperature_c: int


class _Identity(NamedTuple):
    """Values that identify a servo; the servo keeps them without power."""

    model: int
    firmware: int
    drive_mode: int
    operating_mode: int
    homing_offset: int


class ServoChangedError(DeviceConnectionError):
    """The servo was exchanged, restarted or changed since this driver last read it."""


def open_servo(config: TendonActuatorConfig) -> tuple[TendonServo, Found]:
    """Open the bus and set the servo up; retry for `CONNECT_S` if it does not answer.

    Raises
    ------
    DeviceConnectionError
        If the servo does not answer. The errors of `TendonServo.set_up` are raised, too. The bus
        is closed after every error.
    """
    deadline_s = time.monotonic() + CONNECT_S
    servo: TendonServo | None = None
    while True:
        try:
            if servo is None:
                servo = TendonServo(
                    DynamixelBus(config.port, config.baud, config.device_id), config
                )
            servo.bus.open()
            return servo, servo.set_up()
        except DeviceConnectionError as error:
            if servo is not None:
                servo.bus.close()
            if time.monotonic() > deadline_s:
                raise
            _logger.warning('%s; trying again', error)
        except DeviceRefusedError:
            if servo is not None:
                servo.switch_off()
            raise
        time.sleep(CONNECT_PAUSE_S)


class TendonServo:
    """The tendon's servo, controlled in lengths of tendon [m] instead of the servo's units.

    The position count of the servo is 0 at the zero of the displacement. Acquire ``bus.lock``
    around several calls that other threads must not interrupt.

    Attributes
    ----------
    bus : DynamixelBus
        Bus of the servo.
    limits : ServoLimits
        Limits stored in the servo; valid after `set_up`.
    identification : str
        Model and firmware; valid after `set_up`.
    """

    def __init__(self, bus: DynamixelBus, config: TendonActuatorConfig) -> None:
        self.bus = bus
        self.limits = ServoLimits(1, 0)
        self.identification = ''
        self._config = config
        self._sign = -1 if config.reverse else 1
        self._watchdog = math.ceil(config.watchdog_s / registers.WATCHDOG_STEP_S - 1e-9)
        self._desired = DesiredState(math.inf, self.to_velocity(config.speed_m_s), self.current)
        self._goal_counts: int | None = None  # goal last written for the desired state
        # Identity of the servo before and after the set-up.
        self._known: tuple[_Identity, _Identity] | None = None
        self._found: Found | None = None  # condition at the start of the set-up
        self._is_set_up = False
        self._is_arming = False  # watchdog is off until this driver arms it
        self._seen: tuple[int, float] | None = None  # last position [counts] and its time [s]

    # -- the desired state ---------------------------------------------------------------

    @property
    def desired(self) -> DesiredState:
        """The desired state, which `apply` writes."""
        return self._desired

    def desire(self, desired: DesiredState) -> None:
        """Select another desired state; `apply` writes it."""
        self._desired, self._goal_counts = desired, None

    @property
    def current(self) -> int:
        """The configured current limit, in the servo's units."""
        return registers.a_to_current(self._config.current_limit_a)

    def to_velocity(self, speed_m_s: float) -> int:
        """Convert a tendon speed [m/s] to a velocity in the servo's units."""
        return registers.m_s_to_velocity(speed_m_s, self._config.pulley_radius_m)

    def read(self) -> ServoState:
        """Read the present state of the servo, in one attempt."""
        return registers.decode_state(self.bus.read_block(registers.STATE_BLOCK))

    def read_displacement_m(self) -> float:
        """Return the present displacement [m]; retry if the servo is silent."""
        return self._to_displacement_m(self._retry(self.read).position_counts)

    def has_goal(self, actual: ServoState) -> bool:
        """Return True if the servo has the goal of the desired state."""
        return self._goal_counts is not None and actual.goal_counts == self._goal_counts

    def apply(self, actual: ServoState, *, may_tighten: bool) -> bool:
        """Write the registers that differ from the desired state.

        A goal and its velocity are written in one packet. A goal that tightens is written only
        after a read has confirmed the watchdog and the current limit. A lower current limit is
        written before the goal, a higher one after it. The torque is switched on only after a
        read has confirmed everything else.

        Parameters
        ----------
        actual : ServoState
            State of the servo that was read immediately before this call.
        may_tighten : bool
            If False, the goal is limited so that it does not tighten the tendon.

        Returns
        -------
        bool
            True if nothing remains to be written.
        """
        desired = self._desired
        if actual.watchdog == registers.WATCHDOG_TRIPPED:
            self._goal_counts, self._is_arming = None, True
            self.bus.write_once(registers.BUS_WATCHDOG, registers.WATCHDOG_OFF)
            # The watchdog is armed immediately, so that it trips if later packets are lost.
            if actual.is_torque_on:
                self.bus.write_once(registers.BUS_WATCHDOG, self._watchdog)
            actual = self.read()  # the servo may have moved since the trip was cleared
        if actual.watchdog == self._watchdog:
            self._is_arming = False
        is_armed = actual.watchdog == self._watchdog
        has_current = actual.goal_current == desired.current
        tightens = desired.tightens and may_tighten
        is_goal_there = self.has_goal(actual) or (
            # With some firmware, the goal register follows the position while torque is off.
            not actual.is_torque_on
            and abs(actual.goal_counts - actual.position_counts) <= SETTLED_COUNTS
        )
        profile = actual.profile_acceleration, actual.profile_velocity
        is_well = is_goal_there and profile == (0, desired.velocity)
        waits = tightens and not is_goal_there and not (is_armed and has_current)
        lowers_current = desired.current < actual.goal_current
        if lowers_current:
            self.bus.write_once(registers.GOAL_CURRENT, desired.current)
        if not is_well and not waits:
            self._goal_counts = self._find_goal(actual.position_counts, tightens=tightens)
            data = registers.encode_goal(desired.velocity, self._goal_counts)
            self.bus.write_block(registers.GOAL_BLOCK, data)
        if not has_current and not lowers_current:
            self.bus.write_once(registers.GOAL_CURRENT, desired.current)
        if not is_armed:  # the watchdog is active only while the torque is on
            self._is_arming = True
            self.bus.write_once(registers.BUS_WATCHDOG, self._watchdog)
        if actual.is_torque_on:
            return not waits
        if is_well and has_current and is_armed:
            self.bus.write_once(registers.TORQUE_ENABLE, 1)
        return False

    def _find_goal(self, position_counts: int, *, tightens: bool) -> int:
        if math.isinf(self._desired.displacement_m):
            return position_counts
        goal = self._to_counts(self._desired.displacement_m)
        return (
            goal if tightens else self._sign * min(self._sign * goal, self._sign * position_counts)
        )

    # -- recognition ---------------------------------------------------------------------

    def check_unchanged(self, actual: ServoState) -> None:
        """Raise `ServoChangedError` if a servo with its torque on has been changed or exchanged.

        This method must be called with each state that is read, because it compares the position
        with the position in the previous state.
        """
        known = (self._watchdog, registers.WATCHDOG_TRIPPED)
        if actual.watchdog not in known and not self._is_arming:
            raise ServoChangedError(
                f'the bus watchdog of {self.bus.name} has changed from {self._watchdog} to '
                f'{actual.watchdog}: the servo has lost its power or was exchanged'
            )
        now_s = time.monotonic()
        if self._seen is not None:
            counts, seen_s = self._seen
            if now_s - seen_s > EXCHANGE_S and not self._is_known(self._identify()[0]):
                raise ServoChangedError(f'{self.bus.name} has been exchanged for another servo')
            speed = JUMP_SPEED_SHARE * registers.velocity_to_counts_s(self.limits.velocity)
            if abs(actual.position_counts - counts) > JUMP_COUNTS + speed * (now_s - seen_s):
                raise ServoChangedError(
                    f'the position of {self.bus.name} has jumped from {counts} to '
                    f'{actual.position_counts} counts: the servo has lost its power or was '
                    'exchanged'
                )
        self._seen = actual.position_counts, now_s

    def _identify(self) -> tuple[_Identity, ServoSettings]:
        model = self.bus.ping()
        settings = self._read_settings()
        modes = settings.drive_mode, settings.operating_mode, settings.homing_offset
        return _Identity(model, settings.firmware, *modes), settings

    def _is_known(self, identity: _Identity) -> bool:
        known = self._known
        return known is not None and all(
            value in options
            for value, options in zip(identity, zip(*known, strict=True), strict=True)
        )

    def _was_left_by_driver(self, identity: _Identity, actual: ServoState) -> bool:
        """Return True if the registers of a servo with its torque on have this driver's values."""
        is_watched = actual.watchdog in (self._watchdog, registers.WATCHDOG_TRIPPED)
        # The watchdog is off if the previous driver was killed just before it armed the watchdog.
        is_unarmed = actual.watchdog == registers.WATCHDOG_OFF
        return (
            identity.drive_mode == 0
            and identity.operating_mode == registers.MODE_CURRENT_BASED_POSITION
            and 0 < actual.goal_current <= self.current
            and actual.profile_acceleration == 0
            and actual.profile_velocity > 0
            and (is_watched or (is_unarmed and self._has_mark()))
        )

    def _has_mark(self) -> bool:
        with suppress(DeviceRefusedError):
            return self.bus.read(registers.MARK) == registers.OUR_MARK
        return False

    def _write_mark(self, mark: int) -> None:
        with suppress(DeviceRefusedError):  # a servo that refuses the mark is used without it
            self.bus.write(registers.MARK, mark)

    def _find_condition(
        self, identity: _Identity, settings: ServoSettings, actual: ServoState
    ) -> Found:
        """Return the condition of a servo, or raise if it must not be used; writes nothing."""
        name = self.bus.name
        if identity.model not in registers.MODELS:
            raise DeviceRefusedError(
                f'{name} has model number {identity.model}; supported models are '
                f'{", ".join(registers.MODELS.values())}'
            )
        if identity.firmware < registers.FIRMWARE_WITH_WATCHDOG:
            raise DeviceRefusedError(
                f'{name} has firmware {identity.firmware}, which has no bus watchdog; update it '
                f'to {registers.FIRMWARE_WITH_WATCHDOG} or later'
            )
        if actual.status_return_level != registers.STATUS_ALWAYS:
            raise DeviceRefusedError(
                f'{name} does not answer every instruction; set its status return level to '
                f'{registers.STATUS_ALWAYS}'
            )
        if self._known is not None:
            if not self._is_known(identity):
                raise DeviceRefusedError(
                    f'{name} was exchanged, or its mode or homing offset was changed; nothing was '
                    'written to it. Connect the former servo, or configure the driver again to '
                    'use this one'
                )
            if self._is_set_up:
                if actual.is_torque_on:
                    try:
                        self.check_unchanged(actual)
                    except ServoChangedError:
                        return Found.OFF
                    return Found.SAME
                # A servo that has shut down is not set up again here. It is restarted only when
                # the driver is configured.
                return Found.SAME if actual.hardware_error else Found.OFF
            if self._found and actual.is_torque_on:  # an earlier set-up was interrupted
                return self._found
        if not actual.is_torque_on:
            return Found.OFF
        if not self._was_left_by_driver(identity, actual):
            startup = ''
            if settings.startup_configuration & registers.STARTUP_TORQUE_ON:
                startup = ' Its Startup Configuration switches the torque on; set it to 0.'
            raise DeviceRefusedError(
                f'{name} has its torque on, but was not set up by this driver; nothing was '
                'written to it. Check port and device_id. If it is the servo of the tendon, '
                f'switch off its torque or power, then configure the driver again.{startup}'
            )
        displacement_m = self._to_displacement_m(actual.position_counts)
        highest_m = self._config.max_displacement_m + SLACK_BELOW_M
        is_placed = -SLACK_BELOW_M <= displacement_m <= highest_m
        return Found.KEPT if is_placed else Found.MISPLACED

    # -- set-up ---------------------------------------------------------------------------

    def set_up(self) -> Found:
        """Identify the servo, check its limits, set modes and zero, and hold its position.

        A servo in the condition `Found.SAME` is not changed, and a servo in the condition
        `Found.KEPT` keeps its zero. Every other servo gets its zero at the position where the
        tendon comes to rest while the torque is off.

        Returns
        -------
        Found
            Condition in which the servo was found.

        Raises
        ------
        DeviceRefusedError
            If the model or firmware is not supported, the torque is on although this driver has
            not set up the servo, the servo reports a hardware error after a restart, or its
            limits are below the configured ones. Nothing is written to a servo that is not known
            to be the tendon's servo.
        """
        identity, settings = self._identify()
        actual = self._retry(self.read)
        found = self._find_condition(identity, settings, actual)
        if found is Found.SAME:
            return found
        self._found, self._is_set_up = found, False
        wanted = identity._replace(
            drive_mode=0, operating_mode=registers.MODE_CURRENT_BASED_POSITION
        )
        self._known = self._known or (identity, wanted)
        self._check_limits(settings)
        if actual.hardware_error:
            self._reboot(registers.format_hardware_error(actual.hardware_error))
            found = self._found = Found.OFF
        if found is not Found.KEPT:
            self._switch_torque_off()
            position_counts = self._wait_settled()  # the tendon may have been taut
            self._write_settings(wanted, position_counts)
            self._write_mark(registers.OUR_MARK)
        self.limits = ServoLimits(settings.velocity_limit, settings.temperature_limit_c)
        model = registers.MODELS[identity.model]
        self.identification = f'Dynamixel {model} firmware {identity.firmware}'
        self.hold()
        self._is_set_up = True
        return found

    def hold(self) -> None:
        """Switch the torque on and hold the present position; a final read confirms both."""
        self._seen, self._is_arming = None, True
        self.desire(DesiredState(math.inf, self._desired.velocity, self._desired.current))

        def is_done() -> bool:
            actual = self.read()
            return self.apply(actual, may_tighten=False) and not self._is_arming

        self._repeat(is_done, 'does not accept its set-up')

    def write_zero(self, displacement_m: float) -> None:
        """Set the servo's zero at a displacement [m]; the torque is off for some milliseconds."""
        identity, _ = self._identify()
        if not self._is_known(identity):
            raise ServoChangedError(f'{self.bus.name} has been exchanged for another servo')
        self._is_arming = True
        self._switch_torque_off()
        self._write_settings(identity, self._to_counts(displacement_m))
        self.hold()

    def switch_off(self) -> None:
        """Switch the torque off if this is the servo that was set up, and close the bus."""
        with suppress(LinearGuideDriverError):
            if self._known is not None and self._is_known(self._identify()[0]):
                self._switch_torque_off()
                self.bus.write(registers.BUS_WATCHDOG, registers.WATCHDOG_OFF)
                self._write_mark(registers.NO_MARK)
        self.bus.close()

    def _check_limits(self, settings: ServoSettings) -> None:
        config = self._config
        if self.to_velocity(config.speed_m_s) > settings.velocity_limit:
            fastest_m_s = registers.velocity_to_m_s(
                settings.velocity_limit, config.pulley_radius_m
            )
            raise DeviceRefusedError(
                f'speed_m_s is {config.speed_m_s}, but the servo allows {fastest_m_s:.4f} m/s; '
                'reduce speed_m_s'
            )
        if self.current > settings.current_limit:
            raise DeviceRefusedError(
                f'current_limit_a is {config.current_limit_a}, but the servo allows '
                f'{registers.current_to_a(settings.current_limit):.3f} A; reduce current_limit_a'
            )

    def _switch_torque_off(self) -> None:
        def is_off() -> bool:
            if self.read().is_torque_on:
                self.bus.write_once(registers.TORQUE_ENABLE, 0)
                return False
            return True

        self._repeat(is_off, 'does not switch its torque off')

    def _write_settings(self, identity: _Identity, zero_counts: int) -> None:
        """Write the modes and the zero that differ from the wanted ones; the torque must be off.

        ``zero_counts`` is the position count that becomes the new zero. Without power, the servo
        loses the number of whole turns in its position.
        """
        if abs(zero_counts) > ZERO_COUNTS:
            offset = identity.homing_offset - zero_counts
            identity = identity._replace(homing_offset=offset)
        known = self._known
        self._known = (known[0] if known else identity), identity

        def is_written() -> bool:
            settings = self._read_settings()
            differing = [
                (register, wanted)
                for register, wanted, present in (
                    (registers.DRIVE_MODE, identity.drive_mode, settings.drive_mode),
                    (registers.OPERATING_MODE, identity.operating_mode, settings.operating_mode),
                    (registers.HOMING_OFFSET, identity.homing_offset, settings.homing_offset),
                )
                if wanted != present  # unneeded writes would wear out the EEPROM
            ]
            for register, wanted in differing:
                self.bus.write_once(register, wanted)
            return not differing

        self._repeat(is_written, 'does not store its modes and its zero')
        self._known = identity, identity

    def _reboot(self, words: str) -> None:
        """Restart a servo that has shut down, and raise if it still reports an error."""
        _logger.warning('%s has shut down: %s; restarting it', self.bus.name, words)
        self.bus.reboot()
        deadline_s = time.monotonic() + REBOOT_S
        while True:
            time.sleep(SETTLING_PERIOD_S)
            try:
                word = self.read().hardware_error
                break
            except SilentServoError:
                if time.monotonic() > deadline_s:
                    raise
        if word:
            raise DeviceRefusedError(
                f'{self.bus.name} has shut down: {registers.format_hardware_error(word)}. A '
                'restart did not help; remove the cause, let the servo cool, and configure the '
                'driver again'
            )

    def _wait_settled(self) -> int:
        """Return the position [counts] at which the tendon comes to rest without torque."""
        # The elastic finger pulls the tendon out until it is slack.
        deadline_s = time.monotonic() + SETTLING_S
        last = self._retry(self.read).position_counts
        while time.monotonic() < deadline_s:
            time.sleep(SETTLING_PERIOD_S)
            now = self._retry(self.read).position_counts
            if abs(now - last) <= SETTLED_COUNTS:
                return now
            last = now
        raise DeviceRefusedError(
            'the tendon does not come to rest with the torque off; check that nothing moves the '
            'finger'
        )

    # -- inside ---------------------------------------------------------------------------

    def _read_settings(self) -> ServoSettings:
        return self._retry(
            lambda: registers.decode_settings(self.bus.read_block(registers.SETTINGS_BLOCK))
        )

    @staticmethod
    def _retry(read: Callable[[], _Read]) -> _Read:
        """Read, and retry if the servo is silent."""
        for _ in range(ATTEMPTS - 1):
            with suppress(SilentServoError):
                return read()
            time.sleep(LATE_S)
        return read()

    def _repeat(self, is_done: Callable[[], bool], problem: str) -> None:
        """Call ``is_done`` until it returns True; raise an error after `SET_UP_CYCLES` calls."""
        for _ in range(SET_UP_CYCLES - 1):
            with suppress(SilentServoError, DeviceRefusedError):
                if is_done():
                    return
                continue
            time.sleep(LATE_S)
        if not is_done():
            raise DeviceRefusedError(f'{self.bus.name} {problem}; configure the driver again')

    def to_state(self, servo: ServoState, received_at_ns: int) -> TendonState:
        """Convert a state in the servo's units to a `TendonState` in SI units."""
        radius_m = self._config.pulley_radius_m
        return TendonState(
            displacement_m=self._to_displacement_m(servo.position_counts),
            velocity_m_s=self._sign * registers.velocity_to_m_s(servo.velocity, radius_m),
            current_a=self._sign * registers.current_to_a(servo.current),
            voltage_v=servo.voltage * registers.VOLTAGE_UNIT_V,
            temperature_c=float(servo.temperature_c),
            received_at_ns=received_at_ns,
        )

    def _to_counts(self, displacement_m: float) -> int:
        return self._sign * registers.m_to_counts(displacement_m, self._config.pulley_radius_m)

    def _to_displacement_m(self, position_counts: int) -> float:
        return self._sign * registers.counts_to_m(position_counts, self._config.pulley_radius_m)
