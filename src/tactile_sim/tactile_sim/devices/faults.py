# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scripted faults of the rig's devices: which there are, and the lines that have them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import math
import random
from typing import Any, NamedTuple, Protocol

from tactile_sim.devices.dynamixel.dynamixel_device import DynamixelDevice
from tactile_sim.devices.dynamixel.packets import encode_status, HEADER
from tactile_sim.devices.grbl.grbl_device import GrblDevice
from tactile_sim.devices.line_faults import (
    Burst,
    Corrupt,
    Deaf,
    Drop,
    Garbage,
    LineFault,
    Mute,
    Noise,
    Split,
    Unplugged,
    WrongBaud,
)
from tactile_sim.devices.load_cell_device import LoadCellDevice
from tactile_sim.errors import RigError

OVERLOAD = 0x20
END = 'none'
"""The kind that ends all faults of a device."""


class Option(NamedTuple):
    """A number that a kind of fault takes."""

    default: float
    lowest: float
    highest: float


class Kind(NamedTuple):
    """A kind of fault.

    Attributes
    ----------
    what
        What happens.
    options
        The numbers that it takes.
    is_event
        Whether it happens at once and has no duration.
    """

    what: str
    options: Mapping[str, Option] = {}
    is_event: bool = False


_COUNT = {'count': Option(math.nan, 1, 1e9)}
_SHARE = {'share': Option(0.3, 0.0, 1.0)}
_LINE_KINDS = {
    'mute': Kind('nothing that the device says arrives; it still hears'),
    'deaf': Kind('nothing arrives at the device; it still speaks'),
    'unplug': Kind('the port goes away, and comes back under the same name'),
    'burst': Kind('bytes arrive in clumps, period_s apart', {'period_s': Option(0.016, 1e-3, 10)}),
    'garbage': Kind('random bytes before a share of the records', _SHARE),
    'split': Kind('a share of the records loses its end', _SHARE),
    'wrong_baud': Kind(
        'the device speaks at ratio times the speed of the driver',
        {'ratio': Option(0.5, 0.01, 100.0)},
    ),
}
KINDS: Mapping[str, Mapping[str, Kind]] = {
    'sensor': {
        **_LINE_KINDS,
        'drop': Kind('count lines are lost, or all while it lasts', _COUNT),
        'saturate': Kind('the reading is the capacity'),
        'stuck': Kind('the reading stays at the last value; the time goes on'),
        'menu': Kind('the device sits in its menu, as after an "x"'),
        'restart': Kind('power fails for a moment: its clock starts anew', is_event=True),
    },
    'guide': {
        **_LINE_KINDS,
        'drop': Kind('count "ok" are lost, or all while it lasts', _COUNT),
        'alarm': Kind('the limit switch trips: alarm 1, the motor stops dead', is_event=True),
        'restart': Kind('power fails for a moment: the position is lost', is_event=True),
    },
    'tendon': {
        **_LINE_KINDS,
        'drop': Kind('count packets are lost, or all while it lasts', _COUNT),
        'corrupt': Kind('one bit of a share of the packets flips', _SHARE),
        'noise': Kind('half packets without a request'),
        'overheat': Kind(
            'the servo is hot and switches its torque off; the error stays until a reboot',
            {'temperature_c': Option(85.0, 80.0, 150.0)},
        ),
        'overload': Kind(
            'the overload protection switches the torque off until a reboot', is_event=True
        ),
        'restart': Kind('power fails for a moment: torque off, turns forgotten', is_event=True),
    },
}
"""What each device can suffer."""


@dataclass(frozen=True)
class FaultRequest:
    """A fault that somebody asks for.

    Attributes
    ----------
    device, kind
        See `KINDS`; the kind ``none`` ends all faults of the device.
    duration_s
        How long it lasts [s]; None: until it is ended.
    options
        The numbers of this kind, complete.

    Raises
    ------
    RigError
        There is no such fault.
    """

    device: str
    kind: str
    duration_s: float | None = None
    options: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.device, str) or self.device not in KINDS:
            raise RigError(f'no device {self.device!r}; there are {", ".join(KINDS)}')
        if self.kind == END:
            if self.duration_s is not None or self.options:
                raise RigError('the fault "none" ends the others; it takes nothing else')
            return
        kinds = KINDS[self.device]
        if not isinstance(self.kind, str) or self.kind not in kinds:
            raise RigError(
                f'the {self.device} has no fault {self.kind!r}; there are '
                f'{", ".join((*kinds, END))}'
            )
        kind = kinds[self.kind]
        if self.duration_s is not None:
            if kind.is_event:
                raise RigError(f'the fault {self.kind} is a moment; leave duration_s out')
            _check_number('duration_s', self.duration_s, 0.0, 1e6)
        for name, value in self.options.items():
            if name not in kind.options:
                known = ', '.join(kind.options) or 'none'
                raise RigError(f'the fault {self.kind} has no option {name!r}; there are: {known}')
            _check_number(name, value, kind.options[name].lowest, kind.options[name].highest)
        defaults = {name: option.default for name, option in kind.options.items()}
        object.__setattr__(self, 'options', {**defaults, **self.options})

    @classmethod
    def from_json(cls, document: Any) -> FaultRequest:
        """Read the object ``{"device": ..., "kind": ..., "duration_s": ..., options ...}``.

        Raises
        ------
        RigError
            It asks for no fault that there is.
        """
        if not isinstance(document, dict) or not {'device', 'kind'} <= set(document):
            raise RigError('a fault needs "device" and "kind"')
        options = dict(document)
        device, kind = options.pop('device'), options.pop('kind')
        return cls(device, kind, options.pop('duration_s', None), options)


def _check_number(name: str, value: Any, lowest: float, highest: float) -> None:
    if (
        isinstance(value, bool)
        or not isinstance(value, (int, float))
        or not lowest <= value <= highest
    ):
        raise RigError(f'{name} is {value!r}; it must be a number from {lowest:g} to {highest:g}')


class Device(Protocol):
    """A device's core: bytes in, bytes out, told the time."""

    def receive(self, data: bytes, now_s: float) -> bytes: ...

    def poll(self, now_s: float) -> bytes: ...


class FaultyLine:
    """A device behind its line, which is sound until a fault begins.

    Parameters
    ----------
    device
        The device.
    seed
        Of what is random in the faults.
    """

    def __init__(self, device: Device, seed: int) -> None:
        self._device = device
        self._chance = random.Random(seed)
        self._running: dict[str, tuple[LineFault, float]] = {}

    @property
    def is_unplugged(self) -> bool:
        """Whether there is no port."""
        return 'unplug' in self._running

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes from the driver and return what arrives there at once."""
        held = self._end_due(now_s)
        for fault, _ in self._running.values():
            data = fault.hear(data)
        return held + self._say(self._device.receive(data, now_s), now_s)

    def poll(self, now_s: float) -> bytes:
        """Return what arrives at the driver by ``now_s``."""
        held = self._end_due(now_s)
        return held + self._say(self._device.poll(now_s), now_s)

    def begin(self, request: FaultRequest, now_s: float) -> None:
        """Begin a fault of this device, or end all with the kind ``none``."""
        names = list(self._running) if request.kind == END else [request.kind]
        for name in names:
            if name in self._running:
                # What it has held back is dropped with the line that held it.
                self._running.pop(name)[0].end()
        if request.kind == END:
            return
        fault = self._make_fault(request.kind, request.options, now_s)
        if fault is None:
            return
        lasting_s = math.inf if request.duration_s is None else request.duration_s
        self._running[request.kind] = fault, now_s + lasting_s

    def _end_due(self, now_s: float) -> bytes:
        held = b''
        for name, (fault, until_s) in list(self._running.items()):
            if fault.is_spent or now_s >= until_s:
                del self._running[name]
                held += fault.end()
        return held

    def _say(self, data: bytes, now_s: float) -> bytes:
        for fault, _ in self._running.values():
            data = fault.say(data, now_s)
        return data

    def _make_fault(
        self, kind: str, options: Mapping[str, float], now_s: float
    ) -> LineFault | None:
        """Make a fault of the line; one of the device itself is for the subclass."""
        if kind == 'mute':
            return Mute()
        if kind == 'deaf':
            return Deaf()
        if kind == 'burst':
            return Burst(options['period_s'])
        if kind == 'garbage':
            return Garbage(self._split, options['share'], self._chance)
        if kind == 'split':
            return Split(self._split, options['share'], self._chance)
        if kind == 'wrong_baud':
            return WrongBaud(options['ratio'])
        if kind == 'drop':
            count = options['count']
            return Drop(self._split, math.inf if math.isnan(count) else count, self._can_be_lost)
        return Unplugged()

    def _split(self, data: bytes) -> list[bytes]:
        return data.splitlines(keepends=True)

    def _can_be_lost(self, record: bytes) -> bool:
        return True


class SensorLine(FaultyLine):
    """The load cell, which takes its power from its line."""

    def __init__(self, device: LoadCellDevice, seed: int) -> None:
        super().__init__(device, seed)
        self._sensor = device

    def _make_fault(
        self, kind: str, options: Mapping[str, float], now_s: float
    ) -> LineFault | None:
        sensor = self._sensor
        if kind == 'unplug':
            return Unplugged(sensor.restart)
        if kind == 'saturate':
            sensor.is_saturated = True
            return LineFault(lambda: setattr(sensor, 'is_saturated', False))
        if kind == 'stuck':
            sensor.is_stuck = True
            return LineFault(lambda: setattr(sensor, 'is_stuck', False))
        if kind == 'menu':
            sensor.enter_menu()
            return LineFault(sensor.leave_menu)
        if kind == 'restart':
            sensor.restart()
            return None
        return super()._make_fault(kind, options, now_s)


class GuideLine(FaultyLine):
    """The guide's controller, with a power supply of its own."""

    def __init__(self, device: GrblDevice, seed: int) -> None:
        super().__init__(device, seed)
        self._guide = device

    def _make_fault(
        self, kind: str, options: Mapping[str, float], now_s: float
    ) -> LineFault | None:
        if kind == 'alarm':
            self._guide.trip_limit(now_s)
            return None
        if kind == 'restart':
            self._guide.restart(now_s)
            return None
        return super()._make_fault(kind, options, now_s)

    def _can_be_lost(self, record: bytes) -> bool:
        return record.strip() == b'ok'


class TendonLine(FaultyLine):
    """The servo, with a power supply of its own."""

    def __init__(self, device: DynamixelDevice, seed: int) -> None:
        super().__init__(device, seed)
        self._servo = device

    def _make_fault(
        self, kind: str, options: Mapping[str, float], now_s: float
    ) -> LineFault | None:
        servo = self._servo
        if kind == 'corrupt':
            return Corrupt(self._split, options['share'], self._chance)
        if kind == 'noise':
            return Noise(encode_status(1, 0, bytes(8)), self._chance)
        if kind == 'overheat':
            servo.heat(round(options['temperature_c']))
            return LineFault(servo.cool)
        if kind == 'overload':
            servo.fail(OVERLOAD)
            return None
        if kind == 'restart':
            servo.restart()
            return None
        return super()._make_fault(kind, options, now_s)

    def _split(self, data: bytes) -> list[bytes]:
        head, *packets = data.split(HEADER)
        return [part for part in (head, *(HEADER + packet for packet in packets)) if part]
