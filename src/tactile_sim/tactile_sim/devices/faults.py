# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of simulated devices, and of the serial lines between devices and drivers."""

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
"""Function that splits the output of a device into records, which are lines or packets."""

OVERLOAD = 0x20
HIGHEST_C = 255  # the temperature register of the servo has one byte
END = 'none'
"""Kind of fault in a request that ends all faults of a device."""

MOST = 1e6
"""Largest duration of a fault [s], and largest value of an option of a fault."""

MOMENTS = ('alarm', 'overload', 'restart', 'stall')
"""Kinds of faults that are instantaneous, so that they have no duration."""


class LineFault:
    """Base class of faults of a serial line, which does not change the transmitted bytes.

    ``on_end`` is called at the end of the fault. A fault sets ``is_spent`` to True if it ends
    before its requested duration.
    """

    def __init__(self, on_end: Callable[[], None] = lambda: None) -> None:
        self._on_end = on_end
        self.is_spent = False

    def say(self, data: bytes, now_s: float) -> bytes:
        """Return the bytes that reach the driver if the device sends ``data``."""
        return data

    def hear(self, data: bytes) -> bytes:
        """Return the bytes that reach the device if the driver sends ``data``."""
        return data

    @property
    def due_s(self) -> float:
        """Time from which `say` can return bytes even if the device sends nothing [s]."""
        return math.inf

    def end(self) -> bytes:
        """End the fault, and return the bytes that it has delayed until now."""
        self._on_end()
        return b''


class Cut(LineFault):
    """A broken wire, which loses all bytes from the device, to the device, or both.

    ``says`` is True if bytes from the device arrive, and ``hears`` if bytes to the device arrive.
    """

    def __init__(self, says: bool, hears: bool, on_end: Callable[[], None] = lambda: None) -> None:
        super().__init__(on_end)
        self._says, self._hears = says, hears

    def say(self, data: bytes, now_s: float) -> bytes:
        return data if self._says else b''

    def hear(self, data: bytes) -> bytes:
        return data if self._hears else b''


class Burst(LineFault):
    """A serial adapter that buffers bytes from the device, and delivers them once per period."""

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
        # A little earlier than the exact time, because the quotient in `say` may be rounded up.
        return (self._clump + 1) * self._period_s - _EARLY_S

    def end(self) -> bytes:
        super().end()
        return self._take()

    def _take(self) -> bytes:
        taken, self._held = bytes(self._held), bytearray()
        return taken


class Drop(LineFault):
    """The first ``count`` records for which ``is_wanted`` returns True are lost."""

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
    """The function ``spoil`` damages a random fraction ``share`` of the records."""

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
    """Incomplete copies of ``packet`` arrive at the driver, although it has requested nothing."""

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
    """Return the bytes that a receiver with another baud rate reads.

    The sender transmits ``data`` without pauses, with 8 data bits, no parity and one stop bit. A
    byte whose stop bit is missing is read as 0, as on Linux by default. ``ratio`` is the baud rate
    of the sender divided by the baud rate of the receiver; if it is 1, the bytes do not change.
    """
    bits = [bit for byte in data for bit in (0, *(byte >> i & 1 for i in range(8)), 1)]

    def level(time: float) -> int:  # the unit of time is one bit of the sender
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
        while not level(time):  # a start bit needs a high level before it
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
"""For each device, its kinds of faults with the default values of their options. The page
docs/faults.md describes the faults."""


class FaultRequest(NamedTuple):
    """Request to begin a fault of one of the `KINDS`, or to end all faults of a device.

    The kind ``none`` ends all faults of the device. ``lasting_s`` is the duration [s]; it is
    infinite if the fault lasts until a request ends it. ``options`` includes default values.
    """

    device: str
    kind: str
    lasting_s: float
    options: Mapping[str, float]


def read_request(document: Any) -> FaultRequest:
    """Convert a parsed JSON object to a `FaultRequest`.

    The object has the keys ``device`` and ``kind``, and optionally ``duration_s`` and options of
    the fault. Raises `RigError` for an unknown fault or an invalid option.
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
        _check_number(name, value, 1.0 if name == 'share' else MOST)
    return FaultRequest(device, kind, lasting_s, {**options, **given})


def _check_number(name: str, value: Any, most: float = MOST) -> None:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not (is_number and 0 < value <= most):
        raise RigError(f'{name} is {value!r}; it must be a number above 0 and at most {most:g}')


class Device(Protocol):
    """Interface of a simulated device, which receives bytes and returns its answers."""

    def receive(self, data: bytes, now_s: float) -> bytes: ...

    def poll(self, now_s: float) -> bytes: ...

    @property
    def due_s(self) -> float: ...


_D = TypeVar('_D', bound=Device)


class FaultyLine(Generic[_D]):
    """A device and its serial line, which can have faults.

    ``seed`` is the seed of faults that damage records at random.
    """

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
        """Time at which `poll` must be called next, if the driver sends nothing before [s]."""
        due_s = self._device.due_s
        for fault, until_s in self._running.values():
            due_s = min(due_s, -math.inf if fault.is_spent else min(fault.due_s, until_s))
        return due_s

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Pass bytes from the driver to the device; return bytes that reach the driver now."""
        held = self._end_due(now_s)
        for fault, _ in self._running.values():
            data = fault.hear(data)
        return held + self._say(self._device.receive(data, now_s), now_s)

    def poll(self, now_s: float) -> bytes:
        """Return the bytes that reach the driver between the last call and ``now_s``."""
        held = self._end_due(now_s)
        return held + self._say(self._device.poll(now_s), now_s)

    def begin(self, request: FaultRequest, now_s: float) -> None:
        """Begin the requested fault, or end all faults if the kind is ``none``."""
        for kind in list(self._running):
            if request.kind in (END, kind):
                # The bytes that this fault has delayed are lost.
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

        A subclass overrides this method to add faults that only its device has.
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
        return Cut(says=False, hears=False)  # the kind ``unplug``

    def _make_spoiler(self, spoil: Spoil, wanted: FaultRequest) -> Spoiler:
        return Spoiler(spoil, self._split, wanted.options['share'], self._chance)

    def _happen(self, kind: str, now_s: float) -> None:
        """Let an instantaneous fault happen."""
        raise NotImplementedError

    def _split(self, data: bytes) -> list[bytes]:
        return data.splitlines(keepends=True)

    def _can_be_lost(self, record: bytes) -> bool:
        return True


class SensorLine(FaultyLine[LoadCellDevice]):
    """The load cell and its serial line, which also supplies it with power."""

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
    """The controller of the linear guide and its serial line; it has a separate power supply."""

    def _happen(self, kind: str, now_s: float) -> None:
        guide = self._device
        happen = {'alarm': guide.trip_limit, 'restart': guide.restart, 'stall': guide.stall}
        happen[kind](now_s)

    def _can_be_lost(self, record: bytes) -> bool:
        return record.strip() == b'ok'


class TendonLine(FaultyLine[DynamixelDevice]):
    """The servo of the tendon and its serial line; it has a separate power supply."""

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
