# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of the devices and of the serial lines between devices and drivers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import math
import random
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from tactile_sim.devices.dynamixel import DynamixelDevice, encode_status, HEADER
from tactile_sim.devices.grbl import GrblDevice
from tactile_sim.devices.load_cell import LoadCellDevice
from tactile_sim.errors import RigError

NOISE_PERIOD_S = 0.01
MOST_GARBAGE_BYTES = 12
_EARLY_S = 1e-9

Splitter = Callable[[bytes], Sequence[bytes]]
"""Splits the output of a device into records: lines or packets."""

OVERLOAD = 0x20
HIGHEST_C = 255  # the register has one byte
END = 'none'
"""The kind that ends all faults of a device."""

MOST = 1e6
"""Largest duration [s], and largest value of an option."""

MOMENTS = ('alarm', 'overload', 'restart', 'stall')
"""Kinds that are instantaneous and have no duration."""


class LineFault:
    """A fault of a line; this base class does not change the bytes.

    ``on_end`` is called at the end of the fault. If ``is_spent`` is True, the fault ends before
    its time.
    """

    def __init__(self, on_end: Callable[[], None] = lambda: None) -> None:
        self._on_end = on_end
        self.is_spent = False

    def say(self, data: bytes, now_s: float) -> bytes:
        """Return the bytes that reach the driver from the device; see `due_s`."""
        return data

    def hear(self, data: bytes) -> bytes:
        """Return the bytes that reach the device from the driver."""
        return data

    @property
    def due_s(self) -> float:
        """Time from which `say` may return bytes although the device sends none [s]."""
        return math.inf

    def end(self) -> bytes:
        """End the fault; return the bytes that it has delayed."""
        self._on_end()
        return b''


class Cut(LineFault):
    """A broken wire: bytes from the device, bytes to the device, or both are lost."""

    def __init__(self, says: bool, hears: bool, on_end: Callable[[], None] = lambda: None) -> None:
        super().__init__(on_end)
        self._says, self._hears = says, hears

    def say(self, data: bytes, now_s: float) -> bytes:
        return data if self._says else b''

    def hear(self, data: bytes) -> bytes:
        return data if self._hears else b''


class Burst(LineFault):
    """An adapter that buffers bytes and delivers them in bursts, one per period [s]."""

    def __init__(self, period_s: float) -> None:
        super().__init__()
        self._period_s = period_s
        self._clump = -math.inf
        self._held = bytearray()

    def say(self, data: bytes, now_s: float) -> bytes:
        self._held += data
        clump = now_s // self._period_s
        if clump == self._clump:
            return b''
        self._clump = clump
        return self._take()

    @property
    def due_s(self) -> float:
        # Rounded down, because the quotient in `say` may be rounded as well.
        return (self._clump + 1) * self._period_s - _EARLY_S

    def end(self) -> bytes:
        super().end()
        return self._take()

    def _take(self) -> bytes:
        taken, self._held = bytes(self._held), bytearray()
        return taken


class Drop(LineFault):
    """Whole records are lost: the first ``count`` records that ``is_wanted`` selects."""

    def __init__(self, split: Splitter, count: float, is_wanted: Callable[[bytes], bool]) -> None:
        super().__init__()
        self._split, self._left, self._is_wanted = split, count, is_wanted

    def say(self, data: bytes, now_s: float) -> bytes:
        kept = bytearray()
        for record in self._split(data):
            if self._left > 0 and self._is_wanted(record):
                self._left -= 1
            else:
                kept += record
        self.is_spent = self._left <= 0
        return bytes(kept)


Spoil = Callable[[bytes, random.Random], bytes]


class Spoiler(LineFault):
    """A fraction ``share`` of the records is damaged."""

    def __init__(self, spoil: Spoil, split: Splitter, share: float, chance: random.Random) -> None:
        super().__init__()
        self._spoil, self._split, self._share, self._chance = spoil, split, share, chance

    def say(self, data: bytes, now_s: float) -> bytes:
        return b''.join(
            self._spoil(record, self._chance) if self._chance.random() < self._share else record
            for record in self._split(data)
        )


def add_garbage(record: bytes, chance: random.Random) -> bytes:
    """Insert random bytes before a record."""
    return chance.randbytes(chance.randint(1, MOST_GARBAGE_BYTES)) + record


def cut_short(record: bytes, chance: random.Random) -> bytes:
    """Remove the end of a record and its line end, so that it joins the next record."""
    return record[: chance.randrange(len(record))]


def flip_bit(record: bytes, chance: random.Random) -> bytes:
    """Flip one bit of a record."""
    spoilt = bytearray(record)
    spoilt[chance.randrange(len(spoilt))] ^= 1 << chance.randrange(8)
    return bytes(spoilt)


class Noise(LineFault):
    """Incomplete packets arrive without a request: the beginnings of ``packet``."""

    def __init__(self, packet: bytes, chance: random.Random) -> None:
        super().__init__()
        self._packet, self._chance = packet, chance
        self._due_s = -math.inf

    def say(self, data: bytes, now_s: float) -> bytes:
        if now_s < self._due_s:
            return data
        self._due_s = now_s + NOISE_PERIOD_S
        return self._packet[: self._chance.randrange(1, len(self._packet))] + data

    @property
    def due_s(self) -> float:
        return self._due_s


class WrongBaud(LineFault):
    """Device and driver have different baud rates.

    ``ratio`` is the rate of the device divided by the rate of the driver.
    """

    def __init__(self, ratio: float) -> None:
        super().__init__()
        self._ratio = ratio

    def say(self, data: bytes, now_s: float) -> bytes:
        return resample_uart(data, self._ratio)

    def hear(self, data: bytes) -> bytes:
        return resample_uart(data, 1 / self._ratio)


def resample_uart(data: bytes, ratio: float) -> bytes:
    """Return what a receiver with another baud rate reads of bytes sent without pauses, 8N1.

    A byte whose stop bit is missing is read as 0, as Linux does by default. ``ratio`` is the rate
    of the sender divided by the rate of the receiver. If it is 1, the bytes are unchanged.
    """
    bits = [bit for byte in data for bit in (0, *(byte >> i & 1 for i in range(8)), 1)]

    def level(time: float) -> int:  # in bits of the sender; the idle line is high
        return bits[int(time)] if time < len(bits) else 1

    heard = bytearray()
    time = 0.0
    while time < len(bits):
        if level(time):
            time = math.floor(time) + 1.0
            continue
        *byte, stop = (level(time + (i + 0.5) * ratio) for i in range(1, 10))
        heard.append(sum(bit << i for i, bit in enumerate(byte)) if stop else 0)
        time += 9.5 * ratio
        while not level(time):  # a start bit must follow an idle line
            time = math.floor(time) + 1.0
    return bytes(heard)


_SHARE = {'share': 0.3}
_ON_ANY_LINE: Mapping[str, Mapping[str, float]] = {
    'mute': {},
    'deaf': {},
    'unplug': {},
    'burst': {'period_s': 0.016},
    'garbage': _SHARE,
    'split': _SHARE,
    'wrong_baud': {'ratio': 0.5},
    'drop': {'count': math.inf},
}
KINDS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    'sensor': {**_ON_ANY_LINE, 'saturate': {}, 'stuck': {}, 'menu': {}, 'restart': {}},
    'guide': {**_ON_ANY_LINE, 'alarm': {}, 'restart': {}, 'stall': {}},
    'tendon': {
        **_ON_ANY_LINE,
        'corrupt': _SHARE,
        'noise': {},
        'overheat': {'temperature_c': 85.0},
        'overload': {},
        'restart': {},
    },
}
"""Faults of each device, with the defaults of their options; docs/faults.md describes them."""


class FaultRequest(NamedTuple):
    """A requested fault; see `KINDS`.

    The kind ``none`` ends all faults of the device. ``lasting_s`` is the duration [s], infinite if
    the fault lasts until it is ended. ``options`` are complete.
    """

    device: str
    kind: str
    lasting_s: float
    options: Mapping[str, float]


def read_request(document: Any) -> FaultRequest:
    """Read the object ``{"device": ..., "kind": ..., "duration_s": ..., options ...}``.

    Raises `RigError` for an unknown fault or an invalid option.
    """
    if not isinstance(document, dict) or not {'device', 'kind'} <= set(document):
        raise RigError('a fault needs "device" and "kind"')
    given = dict(document)
    device, kind, lasting_s = given.pop('device'), given.pop('kind'), given.pop('duration_s', None)
    if not isinstance(device, str) or device not in KINDS:
        raise RigError(f'unknown device {device!r}; use {", ".join(KINDS)}')
    if kind == END and (lasting_s is not None or given):
        raise RigError('the fault "none" ends the others; it has no duration and no options')
    kinds = {**KINDS[device], END: {}}
    if not isinstance(kind, str) or kind not in kinds:
        raise RigError(f'the {device} has no fault {kind!r}; use {", ".join(kinds)}')
    if lasting_s is None:
        lasting_s = math.inf
    elif kind in MOMENTS:
        raise RigError(f'the fault {kind} is instantaneous; omit duration_s')
    else:
        _check_number('duration_s', lasting_s)
    options = kinds[kind]
    for name, value in given.items():
        if name not in options:
            known = ', '.join(options) or 'none'
            raise RigError(f'the fault {kind} has no option {name!r}; its options are: {known}')
        _check_number(name, value)
    return FaultRequest(device, kind, lasting_s, {**options, **given})


def _check_number(name: str, value: Any) -> None:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not (is_number and 0 < value <= MOST):
        raise RigError(f'{name} is {value!r}; it must be a number above 0 and at most {MOST:g}')


class Device(Protocol):
    """A simulated device: receives and returns bytes at given times."""

    def receive(self, data: bytes, now_s: float) -> bytes: ...

    def poll(self, now_s: float) -> bytes: ...

    @property
    def due_s(self) -> float: ...


_D = TypeVar('_D', bound=Device)


class FaultyLine(Generic[_D]):
    """A device with its line, which works until a fault begins; ``seed`` is for random faults."""

    def __init__(self, device: _D, seed: int) -> None:
        self._device = device
        self._chance = random.Random(seed)
        self._running: dict[str, tuple[LineFault, float]] = {}

    @property
    def is_unplugged(self) -> bool:
        """True while the port is unplugged."""
        return 'unplug' in self._running

    @property
    def due_s(self) -> float:
        """Time of the next `poll` that may return or change something, if nothing is received."""
        due_s = self._device.due_s
        for fault, until_s in self._running.values():
            due_s = min(due_s, -math.inf if fault.is_spent else min(fault.due_s, until_s))
        return due_s

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Receive bytes from the driver; return bytes that arrive there immediately."""
        held = self._end_due(now_s)
        for fault, _ in self._running.values():
            data = fault.hear(data)
        return held + self._say(self._device.receive(data, now_s), now_s)

    def poll(self, now_s: float) -> bytes:
        """Return the bytes that arrive at the driver by ``now_s``."""
        held = self._end_due(now_s)
        return held + self._say(self._device.poll(now_s), now_s)

    def begin(self, request: FaultRequest, now_s: float) -> None:
        """Begin a fault of this device; the kind ``none`` ends all faults."""
        for kind in list(self._running):
            if request.kind in (END, kind):
                # Bytes that the previous connection has delayed are dropped.
                self._running.pop(kind)[0].end()
        if request.kind == END:
            return
        if request.kind in MOMENTS:
            self._happen(request.kind, now_s)
        else:
            self._running[request.kind] = self._make_fault(request), now_s + request.lasting_s

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

    def _make_fault(self, wanted: FaultRequest) -> LineFault:
        """Return the requested fault of the serial line.

        Subclasses override this to add faults of their device.
        """
        match wanted.kind:
            case 'mute':
                return Cut(says=False, hears=True)
            case 'deaf':
                return Cut(says=True, hears=False)
            case 'burst':
                return Burst(wanted.options['period_s'])
            case 'garbage':
                return self._make_spoiler(add_garbage, wanted)
            case 'split':
                return self._make_spoiler(cut_short, wanted)
            case 'wrong_baud':
                return WrongBaud(wanted.options['ratio'])
            case 'drop':
                return Drop(self._split, wanted.options['count'], self._can_be_lost)
        return Cut(says=False, hears=False)  # unplugged

    def _make_spoiler(self, spoil: Spoil, wanted: FaultRequest) -> Spoiler:
        return Spoiler(spoil, self._split, wanted.options['share'], self._chance)

    def _happen(self, kind: str, now_s: float) -> None:
        """Cause an instantaneous fault."""
        raise NotImplementedError

    def _split(self, data: bytes) -> list[bytes]:
        return data.splitlines(keepends=True)

    def _can_be_lost(self, record: bytes) -> bool:
        return True


class SensorLine(FaultyLine[LoadCellDevice]):
    """The load cell, which is powered by its line."""

    def _make_fault(self, wanted: FaultRequest) -> LineFault:
        sensor = self._device
        match wanted.kind:
            case 'unplug':
                return Cut(says=False, hears=False, on_end=sensor.restart)
            case 'saturate':
                sensor.is_saturated = True
                return LineFault(lambda: setattr(sensor, 'is_saturated', False))
            case 'stuck':
                sensor.is_stuck = True
                return LineFault(lambda: setattr(sensor, 'is_stuck', False))
            case 'menu':
                sensor.enter_menu()
                return LineFault(sensor.leave_menu)
        return super()._make_fault(wanted)

    def _happen(self, kind: str, now_s: float) -> None:
        self._device.restart()


class GuideLine(FaultyLine[GrblDevice]):
    """The controller of the guide, which has its own power supply."""

    def _happen(self, kind: str, now_s: float) -> None:
        guide = self._device
        happen = {'alarm': guide.trip_limit, 'restart': guide.restart, 'stall': guide.stall}
        happen[kind](now_s)

    def _can_be_lost(self, record: bytes) -> bool:
        return record.strip() == b'ok'


class TendonLine(FaultyLine[DynamixelDevice]):
    """The servo, which has its own power supply."""

    def _make_fault(self, wanted: FaultRequest) -> LineFault:
        servo = self._device
        match wanted.kind:
            case 'corrupt':
                return self._make_spoiler(flip_bit, wanted)
            case 'noise':
                return Noise(encode_status(1, 0, bytes(8)), self._chance)
            case 'overheat':
                servo.heat(min(round(wanted.options['temperature_c']), HIGHEST_C))
                return LineFault(servo.cool)
        return super()._make_fault(wanted)

    def _happen(self, kind: str, now_s: float) -> None:
        if kind == 'overload':
            self._device.fail(OVERLOAD)
        else:
            self._device.restart()

    def _split(self, data: bytes) -> list[bytes]:
        head, *packets = data.split(HEADER)
        return [part for part in (head, *(HEADER + packet for packet in packets)) if part]
