# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tendon's servo: recognised, set up, and brought to a desired state.

A caller chooses a `DesiredState`, reads the servo, and lets `TendonServo.bring` write the
registers that differ. A write that is lost differs at the next read.

Nothing is written to a servo before it is known to be the tendon's. While a driver runs, that is
the servo with the model, firmware, modes and homing offset of the one that it has set up. At the
start it is a servo with its torque off, or one with the registers that a driver leaves: above all
an armed or tripped bus watchdog, or a mark, which a servo forgets without power. The mark tells a
servo whose driver was killed just before it armed the watchdog.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from enum import Enum
import logging
import math
import time
from typing import NamedTuple, TypeVar

from linear_guide_driver.dynamixel import registers
from linear_guide_driver.dynamixel.bus import ATTEMPTS, DynamixelBus, LATE_S, SilentServoError
from linear_guide_driver.dynamixel.registers import ServoSettings, ServoState
from linear_guide_driver.errors import (
    DeviceConnectionError,
    DeviceRefusedError,
    LinearGuideDriverError,
)
from linear_guide_driver.records import TendonActuatorConfig, TendonState

SETTLING_S = 3.0
SETTLING_PERIOD_S = 0.1
SETTLED_COUNTS = 2

CONNECT_S = 3.0
"""A servo that does not answer at once is asked again for so long: it may be restarting."""

CONNECT_PAUSE_S = 0.2

REBOOT_S = 3.0
"""A restarted servo is silent for some 0.3 s."""

SLACK_BELOW_M = 0.001
"""A tendon found this far below its zero cannot be one that was tightened from it."""

ZERO_COUNTS = 2
"""A zero that is off by so little is not written again: the EEPROM wears out."""

SET_UP_CYCLES = 8
"""Reads, each followed by writes, in which a set-up must be confirmed: it takes four of them, and
packets may be lost."""

JUMP_COUNTS = registers.COUNTS_PER_TURN // 2
JUMP_SPEED_SHARE = 1.5
"""Largest change of position between two reads: half a turn, and this share of the velocity limit.
A servo that has lost its power has lost whole turns."""

EXCHANGE_S = 0.3
"""After a longer time without an answer the servo is identified again: it may be another one."""

_logger = logging.getLogger(__name__)

_Read = TypeVar('_Read')


class DesiredState(NamedTuple):
    """State that the servo is brought to; the torque, the watchdog and no limit of the
    acceleration always belong to it.

    ``displacement_m`` is infinite for holding where the servo stands [m]. Unless ``tightens``, the
    goal is never further in than the servo stands when it is written. ``velocity`` and ``current``
    are in the servo's units.
    """

    displacement_m: float
    velocity: int
    current: int
    tightens: bool = False


class Found(Enum):
    """Condition in which `TendonServo.set_up` has found a servo."""

    SAME = 'as this driver has left it'
    KEPT = 'holding as an earlier driver has left it, zero included'
    MISPLACED = 'holding as an earlier driver has left it, at a place that its zero cannot explain'
    OFF = 'torque off, or set up by this driver and restarted since'


class ServoLimits(NamedTuple):
    """Limits stored in the servo: velocity in its own units, temperature [C]."""

    velocity: int
    temperature_c: int


class _Identity(NamedTuple):
    """Values that identify a servo; kept without power."""

    model: int
    firmware: int
    drive_mode: int
    operating_mode: int
    homing_offset: int


class ServoChangedError(DeviceConnectionError):
    """The servo is not in the condition in which this driver has left it."""


def open_servo(config: TendonActuatorConfig) -> tuple[TendonServo, Found]:
    """Open the bus and set the servo up; ask again for `CONNECT_S` if it does not answer.

    Raises `DeviceConnectionError`, and what `TendonServo.set_up` raises; the bus is closed then.
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
            _logger.warning('%s; asking again', error)
        except DeviceRefusedError:
            if servo is not None:
                servo.switch_off()
            raise
        time.sleep(CONNECT_PAUSE_S)


class TendonServo:
    """One servo, in lengths of tendon; its count is 0 where the tendon is slack.

    Hold ``bus.lock`` around calls that belong together. ``limits`` and ``identification``, model
    and firmware, are known after `set_up`.
    """

    def __init__(self, bus: DynamixelBus, config: TendonActuatorConfig) -> None:
        self.bus = bus
        self.limits = ServoLimits(1, 0)
        self.identification = ''
        self._config = config
        self._sign = -1 if config.reverse else 1
        self._watchdog = math.ceil(config.watchdog_s / registers.WATCHDOG_STEP_S - 1e-9)
        self._desired = DesiredState(math.inf, self.to_velocity(config.speed_m_s), self.current)
        self._goal_counts: int | None = None  # as it was last written for the desired state
        self._known: tuple[_Identity, _Identity] | None = None  # before and after being set up
        self._found: Found | None = None  # when the set-up began
        self._is_set_up = False
        self._is_arming = False  # the watchdog was switched off by this driver
        self._seen: tuple[int, float] | None = None  # last position and its time [counts, s]

    # -- the desired state ---------------------------------------------------------------

    @property
    def desired(self) -> DesiredState:
        """The state that `bring` brings about."""
        return self._desired

    def desire(self, desired: DesiredState) -> None:
        """Choose another state; `bring` writes it."""
        self._desired, self._goal_counts = desired, None

    @property
    def current(self) -> int:
        """The configured current limit, in the servo's units."""
        return registers.a_to_current(self._config.current_limit_a)

    def to_velocity(self, speed_m_s: float) -> int:
        """Return a tendon speed in the servo's units [m/s]."""
        return registers.m_s_to_velocity(speed_m_s, self._config.pulley_radius_m)

    def read(self) -> ServoState:
        """Read all registers that the desired state is about, asking once."""
        return registers.decode_state(self.bus.read_block(registers.STATE_BLOCK))

    def read_displacement_m(self) -> float:
        """Return the present displacement [m]; ask again if the servo is silent."""
        return self._to_displacement_m(self._insist(self.read).position_counts)

    def is_goal_in_force(self, actual: ServoState) -> bool:
        """Return whether the servo holds the goal of the desired state."""
        return self._goal_counts is not None and actual.goal_counts == self._goal_counts

    def bring(self, actual: ServoState, *, may_tighten: bool) -> bool:
        """Write what differs from the desired state; return whether nothing waits to be written.

        ``actual`` was just read. A goal that tightens, which needs ``may_tighten``, waits for a
        read that confirms watchdog and current. It travels in one packet with its velocity. A
        lower current is written before the goal, a higher one after it. The torque is switched on
        after a read that confirms everything else.
        """
        desired = self._desired
        if actual.watchdog == registers.WATCHDOG_TRIPPED:
            self._goal_counts, self._is_arming = None, True
            self.bus.write_once(registers.BUS_WATCHDOG, registers.WATCHDOG_OFF)
            if actual.is_torque_on:  # so that it trips again if nothing else is heard
                self.bus.write_once(registers.BUS_WATCHDOG, self._watchdog)
            actual = self.read()  # it may have moved: the goal that was locked is in force again
        if actual.watchdog == self._watchdog:
            self._is_arming = False
        is_armed = actual.watchdog == self._watchdog
        has_current = actual.goal_current == desired.current
        tightens = desired.tightens and may_tighten
        is_goal_there = self.is_goal_in_force(actual) or (
            # Some firmware lets the goal follow the position while the torque is off.
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
        if not is_armed:  # it counts only with the torque on
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
        """Raise `ServoChangedError` if a servo with its torque on is not as this driver left it.

        Call it with each state. The position counts from the last one without a change.
        """
        known = (self._watchdog, registers.WATCHDOG_TRIPPED)
        if actual.watchdog not in known and not self._is_arming:
            raise ServoChangedError(
                f'the bus watchdog of {self.bus.name} was {self._watchdog} and is '
                f'{actual.watchdog}: it has lost its power, or is another servo'
            )
        now_s = time.monotonic()
        if self._seen is not None:
            counts, seen_s = self._seen
            if now_s - seen_s > EXCHANGE_S and not self._is_known(self._identify()[0]):
                raise ServoChangedError(f'{self.bus.name} is another servo than before')
            speed = JUMP_SPEED_SHARE * registers.velocity_to_counts_s(self.limits.velocity)
            if abs(actual.position_counts - counts) > JUMP_COUNTS + speed * (now_s - seen_s):
                raise ServoChangedError(
                    f'the position of {self.bus.name} has jumped from {counts} to '
                    f'{actual.position_counts} counts: it has lost its power, or is another servo'
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
        """Return whether a servo with its torque on has the registers that a driver leaves."""
        is_watched = actual.watchdog in (self._watchdog, registers.WATCHDOG_TRIPPED)
        is_unarmed = actual.watchdog == registers.WATCHDOG_OFF  # its driver was about to arm it
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
        with suppress(DeviceRefusedError):  # a servo that does not take it works without
            self.bus.write(registers.MARK, mark)

    def _find_condition(
        self, identity: _Identity, settings: ServoSettings, actual: ServoState
    ) -> Found:
        """Return the condition of a servo that may be written to, or raise; writes nothing."""
        name = self.bus.name
        if identity.model not in registers.MODELS:
            raise DeviceRefusedError(
                f'{name} has model number {identity.model}; supported are '
                f'{", ".join(registers.MODELS.values())}'
            )
        if identity.firmware < registers.FIRMWARE_WITH_WATCHDOG:
            raise DeviceRefusedError(
                f'{name} has firmware {identity.firmware} without bus watchdog; update it to '
                f'{registers.FIRMWARE_WITH_WATCHDOG} or later'
            )
        if actual.status_return_level != registers.STATUS_ALWAYS:
            raise DeviceRefusedError(
                f'{name} does not answer every instruction; set its status return level to '
                f'{registers.STATUS_ALWAYS}'
            )
        if self._known is not None:
            if not self._is_known(identity):
                raise DeviceRefusedError(
                    f'{name} is another servo than before, or has another mode or homing offset; '
                    'nothing was written to it. Connect the right one, or configure the driver '
                    'again to use this one'
                )
            if self._is_set_up:
                if actual.is_torque_on:
                    try:
                        self.check_unchanged(actual)
                    except ServoChangedError:
                        return Found.OFF
                    return Found.SAME
                # One that has shut down is restarted only when the driver is configured.
                return Found.SAME if actual.hardware_error else Found.OFF
            if self._found and actual.is_torque_on:  # a set-up was cut off half way
                return self._found
        if not actual.is_torque_on:
            return Found.OFF
        if not self._was_left_by_driver(identity, actual):
            startup = ''
            if settings.startup_configuration & registers.STARTUP_TORQUE_ON:
                startup = ' Its Startup Configuration switches the torque on: set it to 0.'
            raise DeviceRefusedError(
                f'{name} holds with its torque on and was not set up by this driver; nothing was '
                'written to it. Check port and device_id. If it is the servo of the tendon, '
                f'switch its torque or its power off, then configure the driver again.{startup}'
            )
        displacement_m = self._to_displacement_m(actual.position_counts)
        highest_m = self._config.max_displacement_m + SLACK_BELOW_M
        is_placed = -SLACK_BELOW_M <= displacement_m <= highest_m
        return Found.KEPT if is_placed else Found.MISPLACED

    # -- set-up ---------------------------------------------------------------------------

    def set_up(self) -> Found:
        """Recognise the servo; set modes, limits and zero; hold it where it stands.

        A servo that is as this driver has left it is left alone. One that an earlier driver has
        left keeps its zero. Every other one gets its zero where the tendon comes to rest with the
        torque off.

        Raises `DeviceRefusedError` when it is not a supported servo, is too old, holds something
        that this driver has not set up, reports a hardware error that a restart does not end, or
        its limits are below those of the configuration. Nothing is written to a servo that is not
        known to be the tendon's.
        """
        identity, settings = self._identify()
        actual = self._insist(self.read)
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
            position_counts = self._wait_settled()  # it may be off since just now
            self._write_settings(wanted, position_counts)
            self._write_mark(registers.OUR_MARK)
        self.limits = ServoLimits(settings.velocity_limit, settings.temperature_limit_c)
        model = registers.MODELS[identity.model]
        self.identification = f'Dynamixel {model} firmware {identity.firmware}'
        self.hold()
        self._is_set_up = True
        return found

    def hold(self) -> None:
        """Switch the torque on and hold where the servo stands, confirmed by a last read."""
        self._seen, self._is_arming = None, True
        self.desire(DesiredState(math.inf, self._desired.velocity, self._desired.current))

        def is_done() -> bool:
            actual = self.read()
            return self.bring(actual, may_tighten=False) and not self._is_arming

        self._repeat(is_done, 'does not take its set-up')

    def write_zero(self, displacement_m: float) -> None:
        """Make a displacement the servo's zero [m]; the torque is off for some milliseconds."""
        identity, _ = self._identify()
        if not self._is_known(identity):
            raise ServoChangedError(f'another servo than before answers as {self.bus.name}')
        self._is_arming = True
        self._switch_torque_off()
        self._write_settings(identity, self._to_counts(displacement_m))
        self.hold()

    def switch_off(self) -> None:
        """Switch the torque off if the servo is the one that was set up, and close the bus."""
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
                f'speed_m_s is {config.speed_m_s} and the servo allows {fastest_m_s:.4f} m/s; '
                'lower it'
            )
        if self.current > settings.current_limit:
            raise DeviceRefusedError(
                f'current_limit_a is {config.current_limit_a} and the servo allows '
                f'{registers.current_to_a(settings.current_limit):.3f} A; lower it'
            )

    def _switch_torque_off(self) -> None:
        def is_off() -> bool:
            if self.read().is_torque_on:
                self.bus.write_once(registers.TORQUE_ENABLE, 0)
                return False
            return True

        self._repeat(is_off, 'does not switch its torque off')

    def _write_settings(self, identity: _Identity, zero_counts: int) -> None:
        """Write modes, and a position as the zero, where they differ; the torque must be off.

        The servo keeps its position over turns for as long as it has power. ``zero_counts`` is in
        the present count.
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
                if wanted != present  # EEPROM wears out
            ]
            for register, wanted in differing:
                self.bus.write_once(register, wanted)
            return not differing

        self._repeat(is_written, 'does not keep its modes and its zero')
        self._known = identity, identity

    def _reboot(self, words: str) -> None:
        """Restart a servo that has shut down; only that ends it, and what ails it comes again."""
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
                f'{self.bus.name} has shut down: {registers.format_hardware_error(word)}, and a '
                'restart did not help; remove the cause, let it cool, and configure the driver '
                'again'
            )

    def _wait_settled(self) -> int:
        """Return the position at which a tendon without torque has come to rest [counts]."""
        # The finger's spring unwinds a tendon that was held; slack is where that ends.
        deadline_s = time.monotonic() + SETTLING_S
        last = self._insist(self.read).position_counts
        while time.monotonic() < deadline_s:
            time.sleep(SETTLING_PERIOD_S)
            now = self._insist(self.read).position_counts
            if abs(now - last) <= SETTLED_COUNTS:
                return now
            last = now
        raise DeviceRefusedError('the tendon does not come to rest with the torque off')

    # -- inside ---------------------------------------------------------------------------

    def _read_settings(self) -> ServoSettings:
        return self._insist(
            lambda: registers.decode_settings(self.bus.read_block(registers.SETTINGS_BLOCK))
        )

    @staticmethod
    def _insist(read: Callable[[], _Read]) -> _Read:
        """Read; again if the servo is silent."""
        for _ in range(ATTEMPTS - 1):
            with suppress(SilentServoError):
                return read()
            time.sleep(LATE_S)
        return read()

    def _repeat(self, is_done: Callable[[], bool], problem: str) -> None:
        """Read and write until a read confirms what was written."""
        for _ in range(SET_UP_CYCLES - 1):
            with suppress(SilentServoError, DeviceRefusedError):
                if is_done():
                    return
                continue
            time.sleep(LATE_S)
        if not is_done():
            raise DeviceRefusedError(f'{self.bus.name} {problem}; configure the driver again')

    def to_state(self, servo: ServoState, received_at_ns: int) -> TendonState:
        """Return a polled state in lengths of tendon."""
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
